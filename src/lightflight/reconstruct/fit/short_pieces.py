"""Light of pieces that a picture shows too little of to be fitted: no leg accounts for it there.

It would speak against the path in all that is asked of the counts, so its pixels are left out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.reconstruct.fit.joint import JointFit, fit_joint
from lightflight.reconstruct.model.glass import lit_by_short_pieces
from lightflight.reconstruct.model.leg_in_picture import pixels_lit_from
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import without_pixels

_PLACES = 401
"""Of a leg, less than a quarter of a pixel apart."""


def without_short_pieces(fit: JointFit, setting: Setting) -> JointFit:
    """The fit, whose recordings leave out pixels with light of pieces too short to be fitted.

    Parameters
    ----------
    fit : JointFit
        The fit.
    setting : Setting
        Cameras, and blocks of glass that part legs.

    Returns
    -------
    JointFit
        The same path; where one camera sees it and nothing stands in the beam, the same fit.
    """
    if not setting.medium.blocks and not setting.others:
        return fit
    lit = [_lit_by_pieces(fit, number, setting) for number in range(len(fit.sightings))]
    seen = [without_pixels(*each) for each in zip(fit.sightings, lit, strict=True)]
    short = replace(fit, sightings=tuple(seen))
    if not setting.others or not any(each.any() for each in lit):
        return short
    # That light pulls the lines of the legs beside it.
    state, shared = fit.solution.state, fit.solution.shared
    try:
        return fit_joint(seen, state, setting, legs=None, shared=shared)
    except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
        return short


def _lit_by_pieces(fit: JointFit, number: int, setting: Setting) -> NDArray[np.bool_]:
    """Pixels (rows, cols) of one recording that hold light of such pieces."""
    state = fit.solution.state
    camera = setting.cameras[fit.sightings[number].view]
    lit = lit_by_short_pieces(state, setting.medium.blocks, camera)
    if setting.others:
        # Another camera shows these well.
        for leg in (k for k in state.seen if fit.pictures[number].legs[k].dark):
            lit |= pixels_lit_from(state.points_mm(leg, np.linspace(0.0, 1.0, _PLACES)), camera)
    return lit
