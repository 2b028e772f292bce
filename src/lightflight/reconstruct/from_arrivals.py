"""A path from pulses that were found elsewhere: in tiles, by several workers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lightflight.flight import Medium, Source
from lightflight.reconstruct.api import (
    checked_call,
    clock_or_nominal,
    path_from_observations,
    unwrapped_observation,
)
from lightflight.reconstruct.freedom import Waypoint, checked_waypoints
from lightflight.reconstruct.observation import Observation
from lightflight.reconstruct.setting import Setting

if TYPE_CHECKING:
    from lightflight.camera import Camera
    from lightflight.histogram import Histograms
    from lightflight.path import LightPath
    from lightflight.timing.arrivals import Arrivals


def path_from_arrivals(
    hist: Histograms,
    arrivals: Arrivals,
    *,
    blind: NDArray[np.bool_],
    camera: Camera | None = None,
    source: Source | None = None,
    medium: Medium | None = None,
    timing: Any = None,
    n_legs: int | None = None,
    waypoints: Sequence[Waypoint] = (),
) -> LightPath:
    """Joint path fit to pulses that are already found; otherwise as `reconstruct`.

    Parameters
    ----------
    hist : the recording; only pixels that are not `blind` need hold their counts.
    arrivals : its pulses, on the clock `timing`; pixels without a pulse may be left out.
    blind : (rows, cols), True where the counts are not to be used.
    """
    source = Source() if source is None else source
    medium = Medium() if medium is None else medium
    camera = checked_call([hist], camera, source, "joint", n_legs, None)
    setting = Setting(camera, source, medium, checked_waypoints(waypoints, n_legs))
    clock = clock_or_nominal(hist, timing)
    seen = Observation(hist, clock, arrivals, arrivals.arrival_ps, blind)
    return path_from_observations(
        [unwrapped_observation(seen, setting)], setting, timing=timing, n_legs=n_legs
    )
