"""Light that is not the flight's: what a pulse on one path cannot do, a ghost does.

Light of one flight reaches the camera in the order in which it was scattered, so at any one
arrival time it comes from one place. A pulse in a pixel far from there at the same time, and
dimmer, is a reflection, a reconstruction's ghost or a neighbour's stray light.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_ELSEWHERE_PX = 5.0
"""Two pixels farther apart than this do not share one spot, px."""
_TOGETHER_STD = 1.0
"""Pulses nearer in time than this many pulse widths come from one moment."""
_DIM = 0.125
"""A pulse weaker than this share of another at the same moment elsewhere is a ghost's."""
_BLOCK_PULSES = 512
"""Pulses compared with their rivals at once, so that the table of pairs stays small."""


def overshone(points: Floats, times: Floats, photons: Floats, std_ps: float) -> NDArray[np.bool_]:
    """True for pulses that far brighter light elsewhere shows to be no part of the flight.

    Parameters
    ----------
    points : array of float, shape (n, 2)
        Picture, px.
    times : array of float, shape (n,)
        Arrival times, ps (or codes).
    photons : array of float, shape (n,)
        Strength of the pulses.
    std_ps : float
        Typical standard deviation of the pulses, ps (or codes).
    """
    n = len(times)
    # Sorted, rivals of one moment stand in one run, and blocks see only their own.
    order = np.argsort(times, kind="stable")
    p, t, w = points[order], times[order], photons[order]
    ghost = np.zeros(n, dtype=bool)
    reach = _TOGETHER_STD * std_ps
    first = np.searchsorted(t, t - reach, side="left")
    last = np.searchsorted(t, t + reach, side="right")
    for start in range(0, n, _BLOCK_PULSES):
        stop = min(start + _BLOCK_PULSES, n)
        low, high = int(first[start]), int(last[stop - 1])
        gap = np.hypot(
            p[start:stop, np.newaxis, 0] - p[np.newaxis, low:high, 0],
            p[start:stop, np.newaxis, 1] - p[np.newaxis, low:high, 1],
        )
        together = np.abs(t[start:stop, np.newaxis] - t[np.newaxis, low:high]) < reach
        rivals = np.where(together & (gap > _ELSEWHERE_PX), w[np.newaxis, low:high], 0.0)
        # Only a far brighter rival counts: of two alike neither is known to be the ghost.
        ghost[order[start:stop]] = w[start:stop] < _DIM * rivals.max(axis=1, initial=0.0)
    return ghost


def on_border(
    row: NDArray[np.int32], col: NDArray[np.int32], shape: tuple[int, int]
) -> NDArray[np.bool_]:
    """True for the two outermost rows and columns; a computed cube piles up there what is left."""
    edge: NDArray[np.int32] = np.minimum(
        np.minimum(row, shape[0] - 1 - row), np.minimum(col, shape[1] - 1 - col)
    )
    outermost: NDArray[np.bool_] = edge < 2
    return outermost
