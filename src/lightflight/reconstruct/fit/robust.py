"""Solving for a path whose pulses may be wrong or err by more than is stated.

Wrong pulses are left out, and what the others scatter beyond their stated errors is measured and
stated.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import NothingFoundError
from lightflight.reconstruct.fit.least_squares import (
    OUTLIER,
    Solution,
    TimeData,
    fit_path,
    reweighted,
)
from lightflight.reconstruct.model.freedom import Freedom
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.picture import LineDataInPicture
from lightflight.reconstruct.model.setting import Setting
from lightflight.units import MEDIAN_CHI2

Floats = NDArray[np.float64]

_MOST_FLOORS = 6
"""Rounds of solution, outliers and floor; two are usual."""
_SAME_FLOOR = 0.02
"""Two percent of a floor are nothing beside the error of the floor itself."""
_LEAST_PS2 = 1e-6
"""A variance below which nothing matters, ps^2."""
_NEARLY = 1e-6
"""A floor is found to this part of itself."""
_LEAST_LEFT = 0.2
"""Share of the residuals that is left of them at least, however many numbers are fitted."""
_MEDIAN_SCATTER = 2.3
"""The median of n chi-squares of one degree scatters by about this over the root of n."""
_BY_CHANCE = 3.5
"""Residuals larger by no more than so many of its standard deviations are chance."""


def solve_robustly(
    state: PathState,
    times: TimeData,
    lines: LineDataInPicture,
    freedom: Freedom,
    setting: Setting,
    shared: Floats | None,
) -> tuple[Solution, TimeData, float]:
    """Solve, drop outliers, and raise the floor until the residuals are explained.

    Parameters
    ----------
    state : PathState
        Start.
    times : TimeData
        Pulses of the path.
    lines : LineDataInPicture
        Where its legs run in the picture.
    freedom : Freedom
        What may move, and the priors on it.
    setting : Setting
        Cameras and medium as told.
    shared : array of float, shape (k,), or None
        Shared errors that the path was found with, in standard deviations.

    Returns
    -------
    solution : Solution
    times : TimeData
        The same pulses; those that are wrong weigh nothing.
    floor_ps : float
        Extra error of each pulse that the residuals ask for.
    """
    floor_var = 0.0
    for _ in range(_MOST_FLOORS):
        solution = fit_path(
            state, times, lines, freedom, setting, floor_var=floor_var, shared=shared
        )
        state, shared = solution.state, solution.shared
        updated_floor = floor_variance(times, solution, solution.residual_ps)
        cut_times = reweighted(times, solution, floor_var=updated_floor, cut=OUTLIER)
        same = np.array_equal(cut_times.weight, times.weight)
        settled = abs(updated_floor - floor_var) < _SAME_FLOOR * (updated_floor + _LEAST_PS2)
        times, floor_var = cut_times, updated_floor
        if same and settled:
            break
    return solution, times, float(np.sqrt(floor_var))


def floor_variance(times: TimeData, solution: Solution, residual_ps: Floats) -> float:
    """Extra variance per pulse that makes the residuals as large as stated; 0 where they are.

    Judged by the median, which outliers do not reach, and only where chance is no excuse.

    Parameters
    ----------
    times : TimeData
        n pulses with their stated errors.
    solution : Solution
        The fit: how many numbers were fitted.
    residual_ps : array of float, shape (n,)
        What it left, ps.

    Returns
    -------
    float
        ps^2.
    """
    stated = times.photon_var + times.pixel_var
    squared = residual_ps**2
    n = len(squared)
    # Fitted numbers take their share of the residuals: the median falls by the same part.
    loss = max(_LEAST_LEFT, 1.0 - (n - solution.dof) / max(n, 1))

    def excess(extra: float) -> float:
        return float(np.median(squared / (stated + extra))) / (MEDIAN_CHI2 * loss) - 1.0

    if excess(0.0) < _BY_CHANCE * _MEDIAN_SCATTER / np.sqrt(n):
        return 0.0
    low, high = 0.0, float(np.max(squared)) + 1.0
    # Bisection: excess falls steadily as the extra variance grows.
    while high - low > _NEARLY * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high


def check_enough(times: TimeData, n_unknowns: int) -> None:
    """Refuse a path that fewer pixels show than it has unknowns.

    Parameters
    ----------
    times : TimeData
        Pulses of the path.
    n_unknowns : int
        What is fitted to them.

    Raises
    ------
    NothingFoundError
        Where the pixels are too few.
    """
    # Pixels, not pulses: repeats of one pixel do not tell another direction.
    pixels = len(np.unique(times.row * 1e6 + times.col + 1e12 * times.view))
    if pixels < n_unknowns - 1 or pixels < 3:
        raise NothingFoundError(
            f"{pixels} usable pixels lie on the path, fewer than its {n_unknowns} unknowns: record "
            "longer, give the source's place and time, or give a smaller n_legs"
        )
