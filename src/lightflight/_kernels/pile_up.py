"""Pile-up kernels: which share of the laser periods was still open when each code came."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lightflight._kernels.bins import bins_from_codes, put, take_counts
from lightflight._kernels.jit import jit, jit_lent

Floats = NDArray[np.float64]


@jit_lent
def thin_exposure(counts, n, trials, exposure):
    """Exposure of bins that an earlier photon of the same period may have closed.

    A period ends with its first photon: of `trials` periods, those that saw none before bin k
    reach it. Counts among them are binomial with chance 1 - exp(-rate); the exposure given, counts
    over the rate that explains them, makes that a Poisson likelihood with the same maximum.
    """
    alive = trials
    for k in range(n):
        left = max(alive - counts[k], 1e-3)
        seen = alive
        if counts[k] > 0 and left < alive:
            seen = counts[k] / math.log(alive / left)
        exposure[k] *= seen / trials
        alive = left


@jit
def open_shares(
    counts: Floats, lower: Floats, upper: Floats, period: float, trials: Floats, shares: Floats
) -> None:
    """Share of the periods open in every code into `shares` (m, codes); 1 where trials are inf.

    counts, lower, upper: (m, codes); period inf where nothing folds; trials: (m,).
    """
    size = 2 * counts.shape[1] + 2
    edges, values = np.empty(size + 1), np.empty(size)
    exposure, widths, codes = np.empty(size), np.empty(size), np.empty(size, np.int64)
    for i in range(counts.shape[0]):
        shares[i, :] = 1.0
        n = bins_from_codes(lower[i], upper[i], period, edges, exposure, codes)
        if n == 0 or not trials[i] < math.inf:
            continue
        take_counts(counts[i], codes, n, values)
        put(exposure, n, widths)
        thin_exposure(values, n, trials[i], exposure)
        for k in range(n):
            if codes[k] >= 0:
                shares[i, codes[k]] = exposure[k] / widths[k]
