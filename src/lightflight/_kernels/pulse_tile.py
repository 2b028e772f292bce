"""Tile kernels: every pixel of a tile from codes to fitted pulses. Plain arrays, no checks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lightflight._kernels.bins import bins_from_codes, scan_for_pulse, start_from_window
from lightflight._kernels.jit import jit
from lightflight._kernels.pulse import covariance_of_fit, describe_fit, fit_bins, new_scratch
from lightflight._kernels.pulse_split import ALONE, residual_scan, split_pulses

Floats = NDArray[np.float64]

N_COLUMNS = 14
"""Columns of a table of fits."""

(
    COUNTS, EXPOSURE, LOG_EXCESS, N_PULSES, OBJECTIVE, CONVERGED, LAST_STEP, STEPS, CHI2, CHI2_BINS,
    CHI2_DEVIATE, HELD_SHARE, RESIDUAL, STD_FREE,
) = range(N_COLUMNS)  # fmt: skip


@jit
def fit_tile(
    counts: Floats,
    lower: Floats,
    upper: Floats,
    period: float,
    todo: NDArray[np.bool_],
    double_code: Floats,
    dark_counts: Floats,
    dark_ratio: float,
    log_alarms: float,
    model: tuple[bool, bool, bool],
    thetas: Floats,
    covariances: Floats,
    table: Floats,
) -> None:
    """Fit the one strongest pulse of each pixel of a tile.

    counts (m, codes); lower, upper (m or 1, codes); period inf where nothing folds; todo (m,);
    double_code (m,), see `scan_for_pulse`; dark_counts (m,): counts of a background recording,
    dark_ratio: its exposure over this one's (0: none); log_alarms: a pulse must be less likely by
    chance than exp(-that - 3); model: Poisson likelihood?, sampled Gaussian?, Poisson counts?

    thetas (m, 4) centre, photons, std, background; covariances (m, 4, 4) in that order; table
    (m, N_COLUMNS): counts, exposure, log excess of the scan, pulses found, objective, converged,
    squared last step, steps, chi2, its bins, its deviate, share of the pulse in live bins,
    log excess of the residuals far from the pulse, 1 where std is not at a bound.
    """
    bins, window, sums, small = new_scratch(2 * counts.shape[1] + 2, 1)
    best, outcome, summary = np.empty(3), np.empty(4), np.empty(4)
    # Not plain 1 and True: for a literal, Numba would compile the whole fit once more.
    single, is_last = np.int64(1), np.bool_(True)
    for i in range(counts.shape[0]):
        thetas[i], covariances[i], table[i] = math.nan, math.nan, math.nan
        if not todo[i]:
            continue
        row = i if lower.shape[0] > 1 else 0
        n = bins_from_codes(counts[i], lower[row], upper[row], period, bins)
        if n == 0:
            continue
        total = scan_for_pulse(bins, n, period < math.inf, double_code[i], sums, best)
        exposure = sums[1][n]
        small[3][2], small[3][3] = dark_counts[i], dark_ratio * exposure
        table[i, COUNTS], table[i, EXPOSURE], table[i, LOG_EXCESS] = total, exposure, best[0]
        table[i, N_PULSES] = 0.0
        if total <= 0.0 or (model[2] and best[0] < log_alarms):
            thetas[i, 3] = (total + small[3][2]) / (exposure + small[3][3])
            continue
        theta = thetas[i]
        start_from_window(bins, n, period, sums, int(best[1]), int(best[2]), theta)
        m = fit_bins(bins, n, period, theta, single, model, is_last, window, small, outcome)
        if not covariance_of_fit(theta, single, model, exposure, window, m, small, covariances[i]):
            covariances[i] = math.nan
        describe_fit(bins, n, theta, single, model, window, m, small, summary)
        table[i, N_PULSES] = 1.0
        table[i, OBJECTIVE : OBJECTIVE + 4] = outcome
        table[i, CHI2 : CHI2 + 4] = summary
        table[i, STD_FREE] = small[2][2]
        if model[0]:
            residual_scan(
                bins, n, period, theta, single, ALONE, theta[2], double_code[i], sums, small, best
            )
            table[i, RESIDUAL] = best[0] - math.log(n)


@jit
def split_tile(
    counts: Floats,
    lower: Floats,
    upper: Floats,
    period: float,
    typical_std: float,
    double_code: Floats,
    dark_counts: Floats,
    dark_ratio: float,
    log_alarms: float,
    thetas: Floats,
    covariances: Floats,
    table: Floats,
) -> None:
    """Look for more pulses in pixels whose single fit is in the first 4 columns of `thetas`.

    thetas (m, 2 J + 2) for up to J pulses, covariances (m, 2 J + 2, 2 J + 2), table as in
    `fit_tile`; rows change only where more than one pulse is found. typical_std: NaN if unknown.
    """
    size = thetas.shape[1]
    max_pulses = size // 2 - 1
    model = (np.bool_(True), np.bool_(False), np.bool_(True))  # no literals, see `fit_tile`
    bins, window, sums, small = new_scratch(2 * counts.shape[1] + 2, max_pulses)
    best, outcome, summary = np.empty(3), np.empty(4), np.empty(4)
    theta = np.empty(size)
    work = (window, sums, small, outcome, best, np.empty(size), np.empty(size))
    for i in range(counts.shape[0]):
        row = i if lower.shape[0] > 1 else 0
        n = bins_from_codes(counts[i], lower[row], upper[row], period, bins)
        scan_for_pulse(bins, n, period < math.inf, double_code[i], sums, best)
        small[3][2], small[3][3] = dark_counts[i], dark_ratio * sums[1][n]
        theta[:] = thetas[i]
        n_pulses, m = split_pulses(
            bins, n, period, theta, table[i, OBJECTIVE], max_pulses, typical_std, log_alarms,
            double_code[i], model, work,
        )  # fmt: skip
        if n_pulses < 2:
            continue
        thetas[i] = theta
        exposure = (1.0 + dark_ratio) * sums[1][n]
        if not covariance_of_fit(
            theta, n_pulses, model, exposure, window, m, small, covariances[i]
        ):
            covariances[i] = math.nan
        describe_fit(bins, n, theta, n_pulses, model, window, m, small, summary)
        table[i, N_PULSES] = n_pulses
        table[i, OBJECTIVE : OBJECTIVE + 4] = outcome
        table[i, CHI2 : CHI2 + 4] = summary
        table[i, STD_FREE] = small[2][2 * n_pulses]
