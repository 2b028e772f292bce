"""Clocks of several cameras that are apart: while a path is rough, they may be as far as any clock.

Takes the setting as told and a path that is roughly right; gives the clocks by which pulses are
looked for and told apart. The fit itself takes them as told, with the errors that are stated.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.fit.least_squares import Solution
from lightflight.reconstruct.fit.membership import prints_of_leg, roughly_on_leg
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import shared_errors
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.sizes import PLAUSIBLE

Floats = NDArray[np.float64]

_ON_LINE_PX = 1.5
"""Pulses this near to a leg's line tell of a clock's zero, px: four stds of a usual spot."""
_LATE_STDS = 0.5
"""Pulses agree on a zero within this, and a clock that is off by less hides no pulse: stds of a
pulse, the gate in which pulses are taken for a leg's."""


def with_doubtful_clocks(setting: Setting) -> Setting:
    """The setting with clocks of further cameras as uncertain as any may be that is told as exact.

    While the path is rough, one that is wrong would bend it out of what its pulses show.
    """
    if not setting.others:
        return setting
    size = PLAUSIBLE["clock_offset"].size
    doubtful = [
        replace(camera, clock_offset_std_ps=max(camera.clock_offset_std_ps, size))
        for camera in setting.others
    ]
    return replace(setting, others=tuple(doubtful))


def shared_as_stated(rough: Solution, setting: Setting) -> Floats:
    """(k,), shared errors of a setting as a fit with doubtful clocks found them; clocks as told."""
    if not setting.others:
        return rough.shared
    errors = shared_errors(setting)
    own, found = (
        np.array([name != "clock_offset" for name in one.names], dtype=bool)
        for one in (errors, rough.errors)
    )
    shared = np.zeros(len(errors))
    shared[own] = rough.shared[found]
    return shared


def clocks_as_shown(
    state: PathState, sightings: list[Sighting], setting: Setting, std_ps: float
) -> Setting:
    """The setting with clocks of several cameras as their pulses say, where those are far off.

    By these pulses are told apart and looked for. A fit takes the clocks as told: what it must not
    make up for stays misfit, and is named.

    Parameters
    ----------
    state : PathState
        A path that is roughly right.
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    setting : Setting
        Cameras and medium as they were found so far.
    std_ps : float
        Typical standard deviation of a pulse, ps.

    Returns
    -------
    Setting
        The same where no clock is off by half a pulse, or there is one camera.
    """
    if not setting.others:
        return setting
    cameras = []
    for view, camera in enumerate(setting.cameras):
        own = [o for o in sightings if o.view == view]
        late_ps = _late_by_pulses(state, own, setting.at(view), std_ps)
        off = abs(late_ps) > _LATE_STDS * std_ps
        offset_ps = camera.clock_offset_ps + late_ps
        cameras.append(replace(camera, clock_offset_ps=offset_ps) if off else camera)
    return replace(setting, camera=cameras[0], others=tuple(cameras[1:]))


def _late_by_pulses(
    state: PathState, sightings: list[Sighting], setting: Setting, std_ps: float
) -> float:
    """How late most of the pulses on a path's lines are, ps."""
    late = []
    for o in sightings:
        usable = o.usable_pulses
        for k in state.seen:
            print_ = prints_of_leg(o, state, setting, usable, k)
            near = np.abs(print_.lateral_px) < _ON_LINE_PX
            near &= roughly_on_leg(print_, k, state)
            late.append((o.arrival_ps[usable] - print_.arrival_ps)[near])
    times = np.sort(np.concatenate(late)) if late else np.empty(0)
    times = times[np.isfinite(times)]
    if not len(times):
        return 0.0
    # The window that holds most: pulses of other legs on the same pixels are spread over all times.
    ends = np.searchsorted(times, times + 2.0 * _LATE_STDS * std_ps, side="right")
    first = int(np.argmax(ends - np.arange(len(times))))
    return float(np.median(times[first : ends[first]]))
