"""A path from pulses that were found elsewhere: in tiles, by several workers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.camera.refraction import scene_medium
from lightflight.curves import DrawnCurve, checked_curves
from lightflight.flight import Medium, Source
from lightflight.reconstruct.answer import path_from_sightings
from lightflight.reconstruct.calls import checked_call, checked_media
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.told import Waypoint, checked_lengths, checked_waypoints
from lightflight.reconstruct.sightings import clock_or_nominal, unwrapped_sighting

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.path.light_path import LightPath
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.code_clock import CodeClock
    from lightflight.timing.pulses.arrivals import Arrivals


def path_from_arrivals(
    hist: Histograms,
    arrivals: Arrivals,
    *,
    blind: NDArray[np.bool_],
    camera: Camera | None = None,
    source: Source | None = None,
    medium: Medium | None = None,
    timing: CodeClock | None = None,
    n_legs: int | None = None,
    waypoints: Sequence[Waypoint] = (),
    curves: Sequence[DrawnCurve] = (),
    lengths: Sequence[tuple[int, float, float]] = (),
) -> LightPath:
    """Joint path fit to pulses that are already found; otherwise as `reconstruct`.

    Parameters
    ----------
    hist : Histograms
        The recording; only pixels that are not `blind` need hold their counts.
    arrivals : Arrivals
        Its pulses, on the clock `timing`; pixels without a pulse may be left out.
    blind : array of bool, shape (rows, cols)
        True where the counts are not to be used.
    """
    source = Source() if source is None else source
    camera = checked_call([hist], camera, source, "joint", n_legs, None)
    medium = scene_medium(camera) if medium is None else medium
    setting = Setting(
        camera,
        source,
        medium,
        checked_waypoints(waypoints, n_legs),
        curves=checked_curves(curves, n_legs, begun=False),
        lengths=checked_lengths(lengths, n_legs),
    )
    checked_media(setting, "joint")
    clock = clock_or_nominal(hist, timing)
    seen = Sighting(hist, clock, arrivals, arrivals.arrival_ps, blind)
    return path_from_sightings(
        [unwrapped_sighting(seen, setting)], setting, timing=timing, n_legs=n_legs
    )
