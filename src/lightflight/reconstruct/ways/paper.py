"""`paper`: the chain of Zheng et al. 2020 from the legs in the picture."""

from __future__ import annotations

from lightflight.path.light_path import LightPath
from lightflight.reconstruct.fit.paper import paper_path
from lightflight.reconstruct.legs.direction import legs_of_straight_light
from lightflight.reconstruct.ways.request import Request


def path_by_paper(request: Request) -> LightPath:
    """The path by `fit.paper.paper_path`; a start given by the user is refused there.

    Parameters
    ----------
    request : Request
        What is asked.

    Returns
    -------
    LightPath
        On some lap of the clock.
    """
    sightings, setting = request.sightings, request.setting
    given = request.start is not None
    legs = None if given else legs_of_straight_light(sightings[0], setting, request.n_legs)
    return paper_path(sightings, setting, legs=legs)
