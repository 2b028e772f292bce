"""Tile kernels: every pixel of a tile from codes to fitted pulses. Plain arrays, no checks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight._kernels.bins import (
    accumulate,
    bins_from_codes,
    even_width,
    invert_exposure,
    largest,
    log_trials,
    put,
    scan_for_pulse,
    start_from_window,
    take_counts,
    wrap_tail,
)
from lightflight._kernels.jit import jit, jit_lent
from lightflight._kernels.lanes import fetch_ahead
from lightflight._kernels.pile_up import thin_exposure
from lightflight._kernels.pulse import (
    bounds_from_sums,
    covariance_of_fit,
    describe_fit,
    fit_bins,
    new_scratch,
)
from lightflight._kernels.pulse_conveyor import (
    BROAD,
    NARROW,
    free_slot,
    load_lane,
    new_conveyor,
    reach_of,
    run_conveyor,
    window_of,
)
from lightflight._kernels.pulse_split import ALONE, residual_scan, split_pulses

Floats = NDArray[np.float64]
Model = tuple[bool, bool, bool, Floats]

ORDER = (0, 2, 1, 3)
"""Place in the kernel's theta (centre, photons, std, background) of each value of the table."""

N_COLUMNS = 12
"""Columns of a table of fits (rows in the kernels, which keep each together in memory)."""

(
    COUNTS, EXPOSURE, PEAK, N_PULSES, CONVERGED, STEPS_TAKEN, CHI2, CHI2_BINS, CHI2_DEVIATE,
    HELD_SHARE, STD_FREE, RESIDUAL,
) = range(N_COLUMNS)  # fmt: skip


@jit
def new_row(counts):
    """Room for one pixel: (levels, edges, exposure, inverse, covered, codes)."""
    size = 2 * counts.shape[1] + 2
    n_levels = int(math.log2(size)) + 2
    return (
        np.empty((n_levels, 2 * size), counts.dtype),
        np.empty(size + 1),
        np.empty(size),
        np.empty(size + 2),
        np.empty(2 * size + 1),
        np.empty(size, np.int64),
    )


@jit_lent
def lay_out(row, lower, upper, period):
    """Bins of a pixel into the row; returns (bins, bins with the tail behind the fold, even)."""
    _, edges, exposure, _, _, codes = row
    n = bins_from_codes(lower, upper, period, edges, exposure, codes)
    return n, *sum_exposure(row, n, period)


@jit_lent
def sum_exposure(row, n, period):
    """Sums over the exposure of the bins into the row; see `lay_out`."""
    _, _, exposure, inverse, covered, _ = row
    reach = 2 * n if period < math.inf else n
    inverse[n], inverse[n + 1] = invert_exposure(exposure[:n], inverse[:n])
    if n > 0:
        accumulate(exposure, n, reach, covered)
    return reach, even_width(exposure[:n])


@jit_lent
def fit_alone(row, n, period, start, dark, double_code, model, room, results, at):
    """Fit one pixel by the general kernel from `start`, into column `at` of the results."""
    levels, edges, exposure, _, covered, _ = row
    bins, window, sums, small, best, outcome, summary, theta, covariance = room
    values, covariances, table = results
    counts = bins[0]
    for k in range(n):
        counts[k] = levels[0][k]
    put(start, 4, theta)
    small[3][2], small[3][3] = dark
    bins = (counts, edges, exposure)
    # Not plain 1 and True: for a literal, Numba would compile the whole fit once more.
    single, fit_std = np.int64(1), np.bool_(True)
    m = fit_bins(bins, n, period, theta, single, model, fit_std, window, small, outcome)
    whole = covered[n] + dark[1]
    covariance_of_fit(theta, single, model, whole, window, m, small, covariance)
    describe_fit(bins, n, theta, single, model, window, m, small, summary)
    for a in range(4):
        values[a, at] = theta[ORDER[a]]
        for b in range(4):
            covariances[a, b, at] = covariance[ORDER[a], ORDER[b]]
    table[N_PULSES, at] = 1.0
    table[CONVERGED, at], table[STEPS_TAKEN, at] = outcome[1], outcome[3]
    for k in range(4):
        table[CHI2 + k, at] = summary[k]
    table[STD_FREE, at] = small[2][2]
    table[RESIDUAL, at] = 0.0
    if model[0]:
        reach = 2 * n if period < math.inf else n
        accumulate(counts, n, reach, sums[0])
        put(covered, reach + 1, sums[1])
        residual_scan(
            bins, n, period, theta, single, model, ALONE, theta[2], double_code, sums, small, best
        )
        table[RESIDUAL, at] = best[0] - math.log(n)


@jit
def fit_tile(
    counts: NDArray[Any],
    lower: Floats,
    upper: Floats,
    period: float,
    todo: NDArray[np.bool_],
    double_code: Floats,
    trials: Floats,
    dark_counts: Floats,
    dark_ratio: Floats,
    log_alarms: float,
    model: Model,
    starts: Floats,
    left: NDArray[np.int64],
    first: int,
    values: Floats,
    covariances: Floats,
    table: Floats,
) -> int:
    """Fit the one strongest pulse of each pixel of a tile, as far as lanes can.

    Returns how many pixels are left for `fit_rest`; they are first in `left` (m,), with a rough
    (centre, photons, std, background) of each pixel with a pulse in `starts` (m, 4). Returns -1
    where counts are too many for their integers: give them as floats.

    counts (m, codes), uint32 or float64; lower, upper (m or 1, codes);
    period inf where nothing folds; todo (m,); double_code (m,), see `scan_for_pulse`; trials (m,):
    laser periods that could have ended with a photon, see `thin_exposure` (inf: no pile-up);
    dark_counts (m,): counts of a background recording, dark_ratio (m,): its exposure over this
    one's (0: none); log_alarms: a pulse must be less likely by chance than exp(-that - 3); model:
    see `pulse.bin_model`.

    Of all pixels, the tile's in columns from `first` on: values (4, n) centre, std, photons,
    background; covariances (4, 4, n) in that order; table (N_COLUMNS, n): counts, exposure,
    largest bin, pulses found, converged, steps, chi2, its bins, its deviate, share of the pulse
    in live bins, 1 where std is not at a bound, log excess of the residuals far from the pulse.
    What has no meaning is NaN.
    """
    conveyors = (new_conveyor(), new_conveyor(), new_conveyor())
    room = (new_row(counts), conveyors, np.empty(3))
    return int(
        fit_in_lanes(
            counts, lower, upper, period, todo, double_code, trials, (dark_counts, dark_ratio),
            log_alarms, model, starts, left, first, (values, covariances, table), room,
        )
    )  # fmt: skip


@jit_lent
def fetch_quarter(counts, i, part):
    """Ask for a quarter of a row of counts that is wanted soon; all at once would be waited for."""
    if i < counts.shape[0]:
        row, size = counts[i], (counts.shape[1] + 3) // 4
        for start in range(part * size, min((part + 1) * size, row.size), 16):
            fetch_ahead(row, start)


@jit_lent
def leave_blank(results, at):
    """NaN in a column of the results: nothing is known of the pixel."""
    values, covariances, table = results
    for a in range(4):
        values[a, at] = math.nan
        for b in range(4):
            covariances[a, b, at] = math.nan
    for a in range(N_COLUMNS):
        table[a, at] = math.nan


@jit_lent
def most_of(levels):
    """Counts of a pixel from which their sums leave the integers they are kept in."""
    return 4294967296.0 if levels.itemsize == 4 else math.inf


@jit_lent
def fit_in_lanes(
    counts, lower, upper, period, todo, double_code, trials, dark_recording, log_alarms, model,
    starts, left, start_column, results, room,
):  # fmt: skip
    """`fit_tile` with the arrays it works in: room is (row, conveyors, (3,))."""
    row, conveyors, best = room
    values, covariances, table = results
    dark_counts, dark_ratio = dark_recording
    levels, edges, exposure, inverse, covered, codes = row
    # no literals for `run_conveyor`, see `fit_alone`
    n_left, keep_going, drain = np.int64(0), np.bool_(False), np.bool_(True)
    fits = (values, covariances, table[N_PULSES:])
    shared = lower.shape[0] == 1
    fresh, gaussian = False, model[3].shape[1] == 0
    n, reach, even, trials_log, n_log = 0, 0, 0.0, 0.0, 0.0
    for i in range(counts.shape[0]):
        column = start_column + i
        if not todo[i]:
            leave_blank(results, column)
            continue
        if not (shared and fresh):
            at = 0 if shared else i
            n, reach, even = lay_out(row, lower[at], upper[at], period)
            fresh = True
            trials_log, n_log = log_trials(n), math.log(max(n, 1))
            span = min(period, edges[n] - edges[0])
            bounds = bounds_from_sums(covered[n], inverse[n + 1], span, model)
        if n == 0:  # no code of this pixel has a width
            leave_blank(results, column)
            table[COUNTS, column], table[N_PULSES, column] = counts[i].sum(), 0.0
            continue
        fetch_quarter(counts, i + 1, 0)
        total = float(take_counts(counts[i], codes, n, levels[0]))
        if total >= most_of(levels):
            return np.int64(-1)
        wrap_tail(levels[0], n, reach)
        exposed = covered[n]
        dark = (dark_counts[i], dark_ratio[i] * exposed)
        if trials[i] < math.inf:
            thin_exposure(levels[0], n, trials[i], exposure)
            reach, even = sum_exposure(row, n, period)
            fresh = False
        fetch_quarter(counts, i + 1, 1)
        peak = float(largest(levels[0][:n]))
        floor = log_alarms + trials_log if model[2] else 0.0
        scan_for_pulse(levels, n, reach, covered, even, double_code[i], total, peak, floor, best)
        dim = total <= 0.0 or (model[2] and best[0] <= floor)
        if dim:
            leave_blank(results, column)
            table[N_PULSES, column] = 0.0
            values[3, column] = (total + dark[0]) / (covered[n] + dark[1])
        table[COUNTS, column], table[EXPOSURE, column], table[PEAK, column] = total, exposed, peak
        if dim:
            continue
        fetch_quarter(counts, i + 1, 2)
        first, length = int(best[1]), int(best[2])
        start_from_window(levels[0], edges, n, period, total, covered, first, length, starts[i])
        fetch_quarter(counts, i + 1, 3)
        low, high, enough = 0, 0, reach_of(total)
        if model[0] and gaussian and fresh:
            low, high = window_of(starts[i], first, edges, n, period, enough)
        if high > 0:
            full = (
                levels, edges, exposure, inverse, covered, n, total, enough, even, bounds, n_log
            )  # fmt: skip
            conveyor = conveyors[(high - low > NARROW) + (high - low > BROAD)]
            load_lane(conveyor, column, starts[i], low, high, full, double_code[i], dark)
            if free_slot(conveyor) < 0:
                n_left = run_conveyor(conveyor, keep_going, fits, left, n_left)
        else:
            left[n_left] = column
            n_left += 1
    for conveyor in conveyors:
        n_left = run_conveyor(conveyor, drain, fits, left, n_left)
    return n_left


@jit
def fit_rest(
    counts: NDArray[Any],
    lower: Floats,
    upper: Floats,
    period: float,
    left: NDArray[np.int64],
    double_code: Floats,
    trials: Floats,
    dark_counts: Floats,
    dark_ratio: Floats,
    model: Model,
    starts: Floats,
    first: int,
    values: Floats,
    covariances: Floats,
    table: Floats,
) -> None:
    """Fit what `fit_tile` left of a tile by the general kernel; arguments as there."""
    row = new_row(counts)
    levels, _, exposure, _, _, codes = row
    bins, window, sums, small = new_scratch(2 * counts.shape[1] + 2, 1)
    one = (np.empty(3), np.empty(4), np.empty(4), np.empty(4), np.empty((4, 4)))
    room = (bins, window, sums, small, *one)
    for column in left:
        i = column - first
        at = i if lower.shape[0] > 1 else 0
        n, _, _ = lay_out(row, lower[at], upper[at], period)
        take_counts(counts[i], codes, n, levels[0])
        if trials[i] < math.inf:
            thin_exposure(levels[0], n, trials[i], exposure)
            sum_exposure(row, n, period)
        dark = (dark_counts[i], dark_ratio[i] * table[EXPOSURE, column])
        fit_alone(
            row, n, period, starts[i], dark, double_code[i], model, room,
            (values, covariances, table), column,
        )  # fmt: skip


@jit
def split_tile(
    counts: NDArray[Any],
    lower: Floats,
    upper: Floats,
    period: float,
    typical_std: float,
    double_code: Floats,
    trials: Floats,
    dark_counts: Floats,
    dark_ratio: Floats,
    log_alarms: float,
    shape: Floats,
    thetas: Floats,
    covariances: Floats,
    table: Floats,
) -> None:
    """Look for more pulses in pixels whose single fit is in the first 4 columns of `thetas`.

    thetas (m, 2 J + 2) for up to J pulses, in the kernel's order; covariances (m, 2 J + 2,
    2 J + 2); table as in `fit_tile`; rows change only where more than one pulse is found.
    typical_std: NaN if unknown; shape: see `pulse.shape_at`, (3, 0) for a Gaussian.
    """
    size = thetas.shape[1]
    max_pulses = size // 2 - 1
    model = (np.bool_(True), np.bool_(False), np.bool_(True), shape)  # no literals, see above
    n_codes = counts.shape[1]
    row = new_row(counts)
    _, edges, exposure, _, covered, codes = row
    room, window, sums, small = new_scratch(2 * n_codes + 2, max_pulses)
    best, outcome, summary = np.empty(3), np.empty(4), np.empty(4)
    theta = np.empty(size)
    work = (window, sums, small, outcome, best, summary, np.empty(size), np.empty(size))
    for i in range(counts.shape[0]):
        at = i if lower.shape[0] > 1 else 0
        n, reach, _ = lay_out(row, lower[at], upper[at], period)
        bins = (room[0], edges, exposure)
        take_counts(counts[i], codes, n, bins[0])
        if trials[i] < math.inf:
            thin_exposure(bins[0], n, trials[i], exposure)
            sum_exposure(row, n, period)
        accumulate(bins[0], n, reach, sums[0])
        put(covered, reach + 1, sums[1])
        small[3][2], small[3][3] = dark_counts[i], dark_ratio[i] * table[i, EXPOSURE]
        put(thetas[i], size, theta)
        n_pulses, m = split_pulses(
            bins, n, period, theta, max_pulses, typical_std, log_alarms, double_code[i], model, work
        )
        if n_pulses < 2:
            continue
        put(theta, size, thetas[i])
        whole = covered[n] + dark_ratio[i] * table[i, EXPOSURE]
        covariance_of_fit(theta, n_pulses, model, whole, window, m, small, covariances[i])
        describe_fit(bins, n, theta, n_pulses, model, window, m, small, summary)
        table[i, N_PULSES] = n_pulses
        table[i, CONVERGED], table[i, STEPS_TAKEN] = outcome[1], outcome[3]
        put(summary, 4, table[i, CHI2:])
        table[i, STD_FREE] = small[2][2 * n_pulses]
