"""Causes whose place is looked for: the best of many, and when that says anything.

Glass in the beam stands somewhere along a leg, a clock jumps at some row, column or count: of all
places each is tried, and the test is silent until the best of them would be chance in fewer than
one recording of a million.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.verdict.candidates import LEAST_SIGNAL
from lightflight.reconstruct.verdict.evidence import Evidence

Floats = NDArray[np.float64]

_MOST_PLACES = 64
"""Places that are tried on a leg, or counts of a clock."""
_NUMBERS = 2
"""Of such a cause: how late, and from where on."""
_SPEAKS_AT = 40.0
"""Chi-square of one place at a time: chance brings 2e-9 there, in some hundred places 2e-7."""


def best_place(left: Floats, residual: Floats, *, late_only: bool) -> int | None:
    """Which place explains most of what a fit left; None where none explains anything.

    Parameters
    ----------
    left : array of float, shape (N, k)
        What the fit cannot take up of each place's column at its plausible size, a prior.
    residual : array of float, shape (N,)
        Whitened.
    late_only : bool
        Whether it makes light late, never early.

    Returns
    -------
    int or None
    """
    score, signal2 = left.T @ residual, np.sum(left**2, axis=0)
    told = signal2 > LEAST_SIGNAL**2
    if late_only:
        told &= score > 0.0
    gain = np.where(told, score**2 / (1.0 + signal2), 0.0)
    best = int(np.argmax(gain))
    return best if gain[best] > 0.0 else None


def evenly_many(places: Floats) -> Floats:
    """Of many places every second, third, ...: not more than are tried."""
    return places[:: max(1, int(np.ceil(len(places) / _MOST_PLACES)))]


def seldom(tested: Evidence) -> Evidence:
    """The evidence on the best of many places: of two numbers, and silent unless it is clear.

    Parameters
    ----------
    tested : Evidence
        As if the place had been known.

    Returns
    -------
    Evidence
        Of other data than all others: its direction was chosen by them.
    """
    return replace(
        tested,
        dof=_NUMBERS,
        directions=np.empty((0, _NUMBERS)),
        deviates=np.empty(0),
        blind=(),
        silent_below=_SPEAKS_AT,
    )
