"""Pulses that the path does not explain: components of their pixel, with a time and a strength.

A reflection, a further laser pulse, a speck: where it stands apart from the light of the legs, its
fit beside theirs is what a pixel expects of it, and it is neither background nor a reason to leave
the pixel out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight.reconstruct.fit.membership import prints_of_leg
from lightflight.reconstruct.model.geometry import Indices, PathState
from lightflight.reconstruct.model.second_path import SecondPath
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.timing.pulses.batch import share_and_density

Floats = NDArray[np.float64]

_NEAR_PX = 4.0
"""Pixels this near to a leg's line may show its light, px: ten stds of a usual spot."""
_GATE_STDS = 4.0
"""A pulse this near to a leg's time may be the leg's, in standard deviations of a pulse."""
_TRANSIT_PX = 0.35
"""Light runs along a leg for so long within a pixel's footprint, as a standard deviation, px."""
_DRAWN = 0.5
"""Transit longer than this share of a pulse's standard deviation draws it out visibly."""


def pulses_of_no_leg(
    sighting: Sighting, state: PathState, setting: Setting, std_ps: float
) -> Indices:
    """Rows of the arrivals that are no leg's: of the pulses near one, all but the nearest.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    state : PathState
        The path as it is now.
    setting : Setting
        Camera, source, medium and waypoints.
    std_ps : float
        Typical standard deviation of a pulse, ps.

    Returns
    -------
    array of int, shape (k,)
        With a time; also those that a flag excludes.
    """
    arrivals = sighting.arrivals
    pulses = np.flatnonzero(np.isfinite(sighting.arrival_ps))
    pixel = arrivals.row[pulses].astype(np.int64) * arrivals.shape[1] + arrivals.col[pulses]
    explained = np.zeros(len(pulses), dtype=bool)
    for k in state.seen:
        print_ = prints_of_leg(sighting, state, setting, pulses, k)
        gap = np.abs(sighting.arrival_ps[pulses] - print_.arrival_ps)
        drawn_ps = _TRANSIT_PX * np.nan_to_num(np.abs(print_.slope_ps_per_px))
        # Light that is drawn out within its footprint may be fitted as several pulses.
        near = (np.abs(print_.lateral_px) < _NEAR_PX) & (
            gap < _GATE_STDS * np.hypot(std_ps, drawn_ps)
        )
        explained |= near & (drawn_ps > _DRAWN * std_ps)
        alone = np.flatnonzero(near)
        alone = alone[np.lexsort((gap[alone], pixel[alone]))]
        first = np.ones(len(alone), dtype=bool)
        first[1:] = np.diff(pixel[alone]) != 0
        explained[alone[first]] = True
    strange: Indices = pulses[~explained]
    return strange


def strange_pulses(
    sighting: Sighting, state: PathState, setting: Setting, std_ps: float
) -> Indices:
    """Those of them that no second path explains either; as `pulses_of_no_leg`."""
    pulses = pulses_of_no_leg(sighting, state, setting, std_ps)
    if sighting.diffuse is None or not isinstance(sighting.diffuse.second, SecondPath):
        return pulses
    arrivals = sighting.arrivals
    rows, cols = (each[pulses].astype(np.int64) for each in (arrivals.row, arrivals.col))
    seen = sighting.diffuse.second.shows(
        rows, cols, sighting.arrival_ps[pulses], arrivals.photons[pulses]
    )
    return pulses[~seen]


def further_pulses(sighting: Sighting, rows: Indices, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,), True for pulses, by `rows` of the arrivals, whose pixel has a good one among them."""
    arrivals = sighting.arrivals
    shown = np.zeros(arrivals.shape, dtype=bool)
    shown[arrivals.row[rows[good]], arrivals.col[rows[good]]] = True
    further: NDArray[np.bool_] = ~good & shown[arrivals.row[rows], arrivals.col[rows]]
    return further


def counts_of_pulses(
    sighting: Sighting,
    pulses: Indices,
    rows: Indices,
    cols: Indices,
    intervals_ps: tuple[Floats, Floats],
) -> Floats:
    """Counts that pulses, as they were fitted, bring to the codes of some pixels.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    pulses : array of int, shape (k,)
        Rows of its arrivals.
    rows, cols : array of int, shape (n,)
        Pixels.
    intervals_ps : (array, array), shape (n, codes)
        From, to: of each code, ps on the clock of arrivals.

    Returns
    -------
    array of float, shape (n, codes)
        Zero for pixels without one of the pulses.
    """
    arrivals, response = sighting.arrivals, sighting.timing.response
    shape = np.empty((3, 0)) if response is None else response.table()
    period = float(sighting.histograms.laser_period_ps or 0.0)
    pulses, at = sighting.pulses_in(pulses, rows, cols)
    low, up = (each[at] - sighting.arrival_ps[pulses, np.newaxis] for each in intervals_ps)
    if period > 0.0:
        lap = period * np.rint(0.5 * (low + up) / period)
        low, up = low - lap, up - lap
    std = arrivals.std_ps[pulses, np.newaxis]
    share = share_and_density(up / std, shape)[0] - share_and_density(low / std, shape)[0]
    out = np.zeros(intervals_ps[0].shape)
    np.add.at(out, at, arrivals.photons[pulses, np.newaxis] * np.maximum(share, 0.0))
    return out


def whole_pulses(sighting: Sighting, pulses: Indices) -> NDArray[np.bool_]:
    """(k,), True for pulses that no flag excludes: what they hold is known."""
    arrivals = sighting.arrivals
    known = flags.is_usable(arrivals.flags[pulses])
    whole: NDArray[np.bool_] = known & np.isfinite(
        arrivals.photons[pulses] * arrivals.std_ps[pulses]
    )
    return whole
