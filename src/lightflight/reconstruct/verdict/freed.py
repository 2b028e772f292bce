"""Causes of a large misfit, each freed in a fit of its own.

A score test works out by a straight line what freeing a cause would gain. Of a misfit of many
standard errors that line is wrong by more than causes differ from each other, so those that may be
the best are freed, with their plausible size as a prior, and the path is fitted anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import GeometryError
from lightflight.reconstruct.fit.least_squares import (
    OUTLIER,
    Solution,
    TimeData,
    fit_path,
    reweighted,
)
from lightflight.reconstruct.model.freedom import Freedom
from lightflight.reconstruct.model.picture import LineDataInPicture
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.verdict.candidates import Candidate

Floats = NDArray[np.float64]

STRAIGHT = 0.02
"""Share by which the gain of a score test may be wrong where the misfit is large; measured on
recordings whose trigger, codes, lens or camera was off by 20 to 500 sigma: 0.3 % typically."""

_MOST_DROPPED = 0.1
"""Share of the pulses that a freed cause may leave unexplained: two or three that merge at a corner
are a hundredth of all; of delays that err pixel by pixel any cause leaves out nine of ten."""


def fit_freed(
    candidate: Candidate,
    times: TimeData,
    lines: LineDataInPicture,
    solution: Solution,
    freedom: Freedom,
    setting: Setting,
) -> tuple[float, Floats] | None:
    """What a cause gains and its sizes (k,) when it is freed; None where no path fits then, or one
    only to a part of the pulses: leaving those out that a cause does not explain is no gain.

    The gain is the fall of the whole chi-square, the price of an implausible size and one for each
    parameter taken off; a pulse that no longer takes part costs what it may at most. Sizes are in
    plausible ones.
    """
    n, n_lines, k = len(times.leg), len(lines.leg), candidate.columns.shape[1]
    sqrt_weight = np.sqrt(times.weights(0.0))[:, np.newaxis]
    # Pulses that take no part have no weight to divide by, and need none.
    by_time = np.where(sqrt_weight > 0, candidate.columns[:n], 0.0) / np.where(
        sqrt_weight > 0, sqrt_weight, 1.0
    )
    times = replace(times, modes_ps=np.hstack((times.modes_ps, by_time)))
    moved = [] if lines.modes is None else [lines.modes]
    lines = replace(lines, modes=np.hstack((*moved, candidate.columns[n : n + n_lines])))

    def fitted(times: TimeData) -> Solution:
        return fit_path(solution.state, times, lines, freedom, setting)

    try:
        freed = fitted(times)
        # A misfit hides the pulses that are wrong whatever the cause (two that merge at a corner).
        kept = reweighted(times, freed, floor_var=0.0, cut=OUTLIER)
        kept = replace(kept, weight=kept.weight * times.weight)
        dropped = int(times.weight.sum() - kept.weight.sum())
        if dropped > _MOST_DROPPED * times.weight.sum():
            return None
        freed = fitted(kept) if dropped else freed
    except (GeometryError, np.linalg.LinAlgError):
        return None
    left = float(freed.rows @ freed.rows) + OUTLIER**2 * dropped
    return float(solution.rows @ solution.rows) - left - k, freed.modes[-k:]
