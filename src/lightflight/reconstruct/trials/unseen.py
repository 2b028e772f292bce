"""A path with detours that nobody sees: runs of legs as found in the picture, joined by mirrors.

Every run starts like a path of its own, from an unknown source: its times say its depth, roughly.
Two mirrors that make up for the time in between join it to the run before (model.detour).
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from lightflight.flight import Source
from lightflight.reconstruct.fit.joint import JointFit, fit_joint
from lightflight.reconstruct.fit.start import state_from_legs
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.reconstruct.model.detour import mirrors
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.trials.outcome import NoFit, fit_or_reason
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]


def fits_with_gaps(
    sightings: list[Sighting], legs: tuple[ImageLeg, ...], gaps: tuple[int, ...], setting: Setting
) -> list[JointFit]:
    """Joint fits of legs in the picture with a detour after some of them.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    legs : tuple of ImageLeg
        Legs as found in the picture, in the order of flight.
    gaps : tuple of int
        Legs, by number and ascending, after which the light is lost from sight.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    list of JointFit
        From each start that makes a path: after every detour the light is looked for at the depth
        that its own times say, and level with where it was last seen.
    """
    found = []
    for level in product((False, True), repeat=len(gaps)):
        fit = fit_or_reason(partial(_fit_from_runs, sightings, legs, gaps, setting, level))
        if not isinstance(fit, NoFit):
            found.append(fit)
    return found


def _fit_from_runs(
    sightings: list[Sighting],
    legs: tuple[ImageLeg, ...],
    gaps: tuple[int, ...],
    setting: Setting,
    level: tuple[bool, ...],
) -> JointFit:
    """The fit whose runs start level with the end of the one before, or by their own times."""
    camera, medium = setting.camera, setting.medium
    starts = [0, *(gap + 1 for gap in gaps), len(legs)]
    runs = [legs[first:last] for first, last in pairwise(starts)]
    state = state_from_legs(runs[0], camera=camera, source=setting.source, medium=medium)
    for run, is_level in zip(runs[1:], level, strict=True):
        away = float(np.linalg.norm(state.vertices_mm[-1] - camera.center_mm))
        after = state_from_legs(
            run,
            camera=camera,
            source=Source(),
            medium=medium,
            depth_mm=away if is_level else None,
        )
        state = _joined(state, after, setting)
    return fit_joint(sightings, state, setting, legs=[(leg,) for leg in legs])


def _joined(before: PathState, after: PathState, setting: Setting) -> PathState:
    """One path of two that were seen, each whole, with a detour between them."""
    ends = before.vertices_mm[-2:], after.vertices_mm[:2]
    away, back = ((end - start) / np.linalg.norm(end - start) for start, end in ends)
    last, again = before.vertices_mm[-1], after.vertices_mm[0]
    delay = after.start_time_ps - before.vertex_times_ps(setting.medium)[-1]
    way = delay * SPEED_OF_LIGHT_MM_PER_PS / setting.medium.path_group_index
    placed = mirrors(last, away, again, back, way)
    vertices = np.vstack((before.vertices_mm[:-1], *placed, after.vertices_mm[1:]))
    return PathState(vertices, before.start_time_ps, (*before.unseen, before.n_legs))
