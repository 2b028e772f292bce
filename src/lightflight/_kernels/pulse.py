"""Pulse kernels: fit one or several pulses on a constant background to the bins of one pixel.

Bins are those of `_kernels.bins`. Parameters of a fit with J pulses, `theta` (2 J + 2):
centres c_0 ... c_{J-1}, photons A_0 ... A_{J-1}, one shared std s, background b per unit time.
The expected counts of bin k are  sum_j A_j [Phi((e_{k+1} - c_j)/s) - Phi((e_k - c_j)/s)] + b w_k.
"""

from __future__ import annotations

import math

import numpy as np

from lightflight._kernels.bins import load_window, put
from lightflight._kernels.jit import jit, jit_lent

INV_SQRT_2 = math.sqrt(0.5)
INV_SQRT_2PI = 1.0 / math.sqrt(2.0 * math.pi)
REACH = 7.5  # a pulse is nothing (1e-13 of its photons) beyond this many std
MAX_STEPS = 60
TOLERANCE = 1e-6  # stop where a step's squared length in standard errors is below this
GOOD_ENOUGH = 1e-3  # and take it, out of steps, below this (a background that creeps to zero)
MIN_EXPECTED = 0.01  # bins expected to hold fewer counts say nothing about goodness of fit


@jit_lent
def load_around(bins, n, period, theta, n_pulses, reach, window, outside):
    """Load the window that holds every pulse out to `reach` std; sum what lies outside it.

    The window never exceeds one period, and is then centred on the pulses. outside: (counts,
    exposure) beyond the window, on top of (counts, exposure) of a background recording in
    outside[2:].
    """
    low, high = math.inf, -math.inf
    for j in range(n_pulses):
        low, high = min(low, theta[j]), max(high, theta[j])
    half = 0.5 * (high - low) + reach * theta[2 * n_pulses]
    half = min(half, 0.5 * period)
    middle = 0.5 * (low + high)
    m = load_window(bins, n, period, middle - half, middle + half, window)
    outside[0], outside[1] = outside[2], outside[3]
    if m < n:
        for k in range(n):
            outside[0] += bins[0][k]
            outside[1] += bins[2][k]
        for k in range(m):
            outside[0] -= window[0][k]
            outside[1] -= window[2][k]
    return m


@jit_lent
def shape_at(shape, z):
    """Share of a pulse that has come by z std after its centre, and its density there.

    shape (3, m): z in even steps, cumulated shape, density; the density is straight in between.
    """
    step = shape[0, 1] - shape[0, 0]
    place = (z - shape[0, 0]) / step
    if not place > 0.0:
        return 0.0, 0.0
    if place >= shape.shape[1] - 1:
        return 1.0, 0.0
    i = int(place)
    part = place - i
    density = shape[2, i] + part * (shape[2, i + 1] - shape[2, i])
    return shape[1, i] + 0.5 * part * step * (shape[2, i] + density), density


@jit_lent
def bin_model(theta, n_pulses, low, high, width, model, slope):
    """Expected counts of one bin and their derivatives by theta (into `slope`).

    model: (Poisson likelihood?, sampled?, Poisson counts?, shape). Pulses are Gaussians or of the
    tabulated shape (see `shape_at`), integrated over the bin, or Gaussians `sampled` at its middle
    as the paper's least squares does. A bin whose width is less than what lies between its edges
    was alive for that part only.
    """
    _, sampled, _, shape = model
    std, live = theta[2 * n_pulses], width / (high - low)
    expected = theta[2 * n_pulses + 1] * width
    slope_std = 0.0
    for j in range(n_pulses):
        photons = theta[n_pulses + j]
        if sampled:
            z = (0.5 * (low + high) - theta[j]) / std
            share = width * INV_SQRT_2PI * math.exp(-0.5 * z * z) / std
            by_centre = share * z / std
            by_std = share * (z * z - 1.0) / std
        else:
            z_low, z_high = (low - theta[j]) / std, (high - theta[j]) / std
            if shape.shape[1] > 0:
                before, pdf_low = shape_at(shape, z_low)
                after, pdf_high = shape_at(shape, z_high)
                share = live * (after - before)
            else:
                share = 0.5 * live * (math.erf(z_high * INV_SQRT_2) - math.erf(z_low * INV_SQRT_2))
                pdf_low = INV_SQRT_2PI * math.exp(-0.5 * z_low * z_low)
                pdf_high = INV_SQRT_2PI * math.exp(-0.5 * z_high * z_high)
            by_centre = live * (pdf_low - pdf_high) / std
            by_std = live * (z_low * pdf_low - z_high * pdf_high) / std
        expected += photons * share
        slope[j] = photons * by_centre
        slope[n_pulses + j] = share
        slope_std += photons * by_std
    slope[2 * n_pulses] = slope_std
    slope[2 * n_pulses + 1] = width
    return expected


@jit_lent
def reach_of_pulse(model):
    """Std on either side of its centre beyond which a pulse is nothing."""
    shape = model[3]
    if shape.shape[1] == 0:
        return REACH
    return max(-shape[0, 0], shape[0, shape.shape[1] - 1])


@jit_lent
def evaluate(theta, n_pulses, window, m, outside, model, slope, grad, info):
    """Objective (larger is better), its gradient and expected information at theta.

    Poisson log-likelihood (of densities: the same for every window), or minus half the sum of
    squares. `outside` = (counts, exposure) beyond the window: there the model is b w, so two
    sums are all they contribute.
    """
    counts, edges, exposure = window
    poisson = model[0]
    size = 2 * n_pulses + 2
    for a in range(size):
        grad[a] = 0.0
        for b in range(size):
            info[a, b] = 0.0
    objective = 0.0
    for k in range(m):
        if exposure[k] <= 0.0:
            continue
        expected = bin_model(theta, n_pulses, edges[k], edges[k + 1], exposure[k], model, slope)
        if poisson:
            weight = 1.0 / expected
            pull = counts[k] * weight - 1.0
            objective += counts[k] * math.log(expected / exposure[k]) - expected
        else:
            weight = 1.0
            pull = counts[k] - expected
            objective -= 0.5 * pull * pull
        for a in range(size):
            grad[a] += slope[a] * pull
            weighted = slope[a] * weight
            for b in range(a + 1):
                info[a, b] += weighted * slope[b]
    if outside[1] > 0.0:  # Poisson only: least squares always takes every bin
        background = theta[size - 1]
        objective += outside[0] * math.log(background) - background * outside[1]
        grad[size - 1] += outside[0] / background - outside[1]
        info[size - 1, size - 1] += outside[1] / background
    for a in range(size):
        for b in range(a):
            info[b, a] = info[a, b]
    return objective


@jit_lent
def factorise(info, free, size, damping, scale, factor):
    """Cholesky factor of the scaled information of the free parameters; False if singular.

    Fixed parameters get a unit row. `damping` is Marquardt's: it raises the diagonal.
    """
    for a in range(size):
        scale[a] = 1.0
        if free[a]:
            if not info[a, a] > 0.0:
                return False
            scale[a] = 1.0 / math.sqrt(info[a, a])
    for a in range(size):
        for b in range(a + 1):
            value = info[a, b] * scale[a] * scale[b] if free[a] and free[b] else 0.0
            if a == b:
                value = 1.0 + damping
            for i in range(b):
                value -= factor[a, i] * factor[b, i]
            if a == b:
                if not value > 1e-12:
                    return False
                factor[a, a] = math.sqrt(value)
            else:
                factor[a, b] = value / factor[b, b]
    return True


@jit_lent
def solve(factor, scale, free, size, right, solution):
    """Solve information @ solution = right with the factor from `factorise`."""
    for a in range(size):
        value = right[a] * scale[a] if free[a] else 0.0
        for i in range(a):
            value -= factor[a, i] * solution[i]
        solution[a] = value / factor[a, a]
    for back in range(size):
        a = size - 1 - back
        value = solution[a]
        for i in range(a + 1, size):
            value -= factor[i, a] * solution[i]
        solution[a] = value / factor[a, a]
    for a in range(size):
        solution[a] = solution[a] * scale[a] if free[a] else 0.0


@jit_lent
def limited_step(theta, step, n_pulses, bounds, trial):
    """Take a step: std at most doubles or halves, photons shrink to a third, centres move 2 std."""
    min_std, max_std, min_background = bounds
    std = theta[2 * n_pulses]
    for j in range(n_pulses):
        trial[j] = theta[j] + min(max(step[j], -2.0 * std), 2.0 * std)
        photons = theta[n_pulses + j] + step[n_pulses + j]
        trial[n_pulses + j] = max(photons, theta[n_pulses + j] / 3.0)
    wanted = min(max(std + step[2 * n_pulses], 0.5 * std), 2.0 * std)
    trial[2 * n_pulses] = min(max(wanted, min_std), max_std)
    background = theta[2 * n_pulses + 1] + step[2 * n_pulses + 1]
    trial[2 * n_pulses + 1] = max(background, min_background)


@jit_lent
def free_parameters(theta, grad, n_pulses, bounds, fit_std, free):
    """Mark the free parameters: those at a bound and pushed against it are not."""
    min_std, max_std, min_background = bounds
    size = 2 * n_pulses + 2
    for a in range(size):
        free[a] = True
    std, background = theta[size - 2], theta[size - 1]
    at_low = std <= min_std and grad[size - 2] < 0.0
    at_high = std >= max_std and grad[size - 2] > 0.0
    if not fit_std or at_low or at_high:
        free[size - 2] = False
    if background <= min_background and grad[size - 1] < 0.0:
        free[size - 1] = False


@jit_lent
def bounds_of(bins, n, period, model):
    """(smallest std, largest std, smallest background) a fit of these bins may reach."""
    all_exposure, n_live = 0.0, 0
    for k in range(n):
        all_exposure += bins[2][k]
        n_live += bins[2][k] > 0.0
    return bounds_from_sums(all_exposure, n_live, min(period, bins[1][n] - bins[1][0]), model)


@jit_lent
def bounds_from_sums(all_exposure, n_live, span, model):
    """See `bounds_of`: from the exposure of all bins, the number of live ones, what they span.

    A tenth of a mean bin: below it position and width inside one bin cannot be told. A
    thousandth of a count over the whole range: next to none, and the logarithm stays finite.
    """
    if n_live == 0:
        return 0.0, 0.0, 0.0
    floor = 1e-3 / all_exposure if model[0] else -math.inf
    return 0.1 * all_exposure / n_live, 0.5 * span, floor


@jit_lent
def fit_bins(bins, n, period, theta, n_pulses, model, fit_std, window, scratch, outcome):
    """Damped Fisher scoring from the start in `theta`, which it replaces.

    Never accepts a step that lowers the objective. A Poisson fit looks at a window that follows
    and grows with the pulses; the rest enters through sums, so it is the full-range fit.

    outcome: objective, converged (1 or 0), squared length of the last step, steps taken.
    Leaves information (expected) and free parameters in the scratch; returns bins in the window.
    """
    vectors, matrices, free, outside = scratch
    slope, grad, step, trial, new_grad, scale = vectors
    info, new_info, factor = matrices
    size = 2 * n_pulses + 2
    bounds = bounds_of(bins, n, period, model)
    reach = 1.25 * reach_of_pulse(model) if model[0] else math.inf
    theta[size - 2] = min(max(theta[size - 2], bounds[0]), bounds[1])
    theta[size - 1] = max(theta[size - 1], bounds[2])
    put(theta, size, trial)
    objective, damping, length2, unit, steps, m = 0.0, 0.0, math.inf, 1.0, 0, 0
    fresh, converged = True, False  # fresh: a new window, to be evaluated where we stand
    while True:
        if fresh:
            m = load_around(bins, n, period, theta, n_pulses, reach, window, outside)
        new = evaluate(trial, n_pulses, window, m, outside, model, slope, new_grad, new_info)
        if fresh or new >= objective - 1e-12 * abs(objective):
            put(trial, size, theta)
            put(new_grad, size, grad)
            for a in range(size):
                put(new_info[a], size, info[a])
            objective = new
            if not model[0]:
                unit = max(-2.0 * objective / max(m - size, 1), 1e-300)
            converged = length2 < TOLERANCE * unit and damping < 1.0
            damping = 0.0 if damping < 1e-2 else 0.1 * damping
            fresh = (
                m < n and not window_holds(theta, n_pulses, model, window, m) and steps < MAX_STEPS
            )
            if fresh:
                steps += 1
                continue
        else:
            damping = max(10.0 * damping, 1e-2)
        free_parameters(theta, grad, n_pulses, bounds, fit_std, free)
        while not factorise(info, free, size, damping, scale, factor) and damping < 1e10:
            damping = max(10.0 * damping, 1e-3)
        if converged or steps >= MAX_STEPS or damping >= 1e10:
            break
        steps += 1
        solve(factor, scale, free, size, grad, step)
        length2 = 0.0
        for a in range(size):
            length2 += step[a] * grad[a]
        limited_step(theta, step, n_pulses, bounds, trial)
    converged = converged or length2 < GOOD_ENOUGH * unit
    outcome[0], outcome[1], outcome[2], outcome[3] = objective, converged, length2, steps
    return m


@jit_lent
def window_holds(theta, n_pulses, model, window, m):
    """True where the loaded window holds all of every pulse."""
    reach = reach_of_pulse(model) * theta[2 * n_pulses]
    for j in range(n_pulses):
        if theta[j] - reach < window[1][0] or theta[j] + reach > window[1][m]:
            return False
    return True


@jit_lent
def normal_from_chi2(chi2, expected, variance):
    """Standard normal deviate as unlikely as a chi2 of given mean and variance.

    Wilson & Hilferty (1931) on the scaled chi2 of the same two moments.
    """
    if expected <= 0.0:
        return 0.0
    narrow = variance / (9.0 * expected * expected)
    return (np.cbrt(chi2 / expected) - (1.0 - narrow)) / math.sqrt(narrow)


@jit_lent
def describe_fit(bins, n, theta, n_pulses, model, window, m, scratch, summary):
    """Goodness of fit, and the share of the pulses the live bins could record.

    summary: Pearson chi2, its bins, how unlikely chi2 over the bins with >= 1 expected count is
    (as a standard normal deviate), smallest share of a pulse inside live bins.
    """
    counts, edges, exposure = window
    slope, held = scratch[0][0], scratch[0][4]
    size = 2 * n_pulses + 2
    for j in range(n_pulses):
        held[j] = 0.0
    chi2, n_bins, rich_chi2, rich_bins, rich_variance = 0.0, 0, 0.0, 0, 0.0
    for k in range(m):
        if exposure[k] <= 0.0:
            continue
        expected = bin_model(theta, n_pulses, edges[k], edges[k + 1], exposure[k], model, slope)
        live = exposure[k] / (edges[k + 1] - edges[k])
        for j in range(n_pulses):
            held[j] += slope[n_pulses + j] / live
        if expected < MIN_EXPECTED:
            continue
        term = (counts[k] - expected) ** 2 / expected
        chi2 += term
        n_bins += 1
        if expected >= 1.0:
            rich_chi2 += term
            rich_bins += 1
            rich_variance += 2.0 + 1.0 / expected
    if model[0] and m < n:
        background = theta[size - 1]
        term, n_out, exposed, inverse = outside_chi2(bins, n, window, m, background)
        if background * exposed >= MIN_EXPECTED * n_out:
            chi2 += term
            n_bins += n_out
        if background * exposed >= n_out:
            rich_chi2 += term
            rich_bins += n_out
            rich_variance += 2.0 * n_out + inverse / background
    summary[0], summary[1] = chi2, n_bins
    summary[2] = normal_from_chi2(rich_chi2, rich_bins, rich_variance)
    summary[3] = held[0]
    for j in range(n_pulses):
        summary[3] = min(summary[3], held[j])


@jit_lent
def outside_chi2(bins, n, window, m, background):
    """Pearson chi2 of the bins beyond the window; their number, exposure, sum of 1 / exposure."""
    squares, total, exposed, inverse, n_live = 0.0, 0.0, 0.0, 0.0, 0
    for part in range(2):
        counts, _, exposure = bins if part == 0 else window
        sign = 1.0 if part == 0 else -1.0
        for k in range(n if part == 0 else m):
            if exposure[k] > 0.0:
                squares += sign * counts[k] * counts[k] / exposure[k]
                total += sign * counts[k]
                exposed += sign * exposure[k]
                inverse += sign / exposure[k]
                n_live += 1 if part == 0 else -1
    chi2 = squares / background - 2.0 * total + background * exposed
    return chi2, n_live, exposed, inverse


@jit_lent
def sandwich(bread, meat, size, factor, spare):
    """Bread becomes factor * bread @ meat @ bread, all symmetric."""
    for a in range(size):
        for b in range(size):
            spare[a, b] = 0.0
            for i in range(size):
                spare[a, b] += bread[a, i] * meat[i, b]
    for a in range(size):
        for b in range(a + 1):
            meat[a, b] = 0.0
            for i in range(size):
                meat[a, b] += spare[a, i] * bread[i, b]
    for a in range(size):
        for b in range(a + 1):
            bread[a, b] = factor * meat[a, b]
            bread[b, a] = bread[a, b]


@jit_lent
def covariance_of_fit(theta, n_pulses, model, whole_exposure, window, m, scratch, covariance):
    """Covariance of theta (into `covariance`); False where the information is singular.

    Poisson likelihood: inverse of the expected information. Least squares: sandwich, with the
    model's variance for counts and the residuals' for scaled intensities (model[2]). A background
    at zero gets the standard deviation of one count over the whole range; a std at its bound
    gets its own size.
    """
    vectors, matrices, free, _ = scratch
    slope, column, unit, scale = vectors[0], vectors[2], vectors[3], vectors[5]
    info, meat, factor = matrices
    counts, edges, exposure = window
    size = 2 * n_pulses + 2
    if not factorise(info, free, size, 0.0, scale, factor):
        for a in range(size):
            for b in range(size):
                covariance[a, b] = math.nan
        return False
    for a in range(size):
        for b in range(size):
            unit[b] = 1.0 if a == b else 0.0
            meat[a, b] = 0.0
        solve(factor, scale, free, size, unit, column)
        put(column, size, covariance[a])
    if not model[0]:
        n_live = 0
        for k in range(m):
            if exposure[k] <= 0.0:
                continue
            n_live += 1
            expected = bin_model(theta, n_pulses, edges[k], edges[k + 1], exposure[k], model, slope)
            variance = max(expected, 0.0) if model[2] else (counts[k] - expected) ** 2
            for a in range(size):
                for b in range(size):
                    meat[a, b] += variance * slope[a] * slope[b]
        spread = 1.0 if model[2] else n_live / max(n_live - size, 1)
        sandwich(covariance, meat, size, spread, factor)
    if not free[size - 1]:
        covariance[size - 1, size - 1] = 1.0 / whole_exposure**2
    if not free[size - 2]:
        covariance[size - 2, size - 2] = theta[size - 2] ** 2
    return True


@jit
def new_scratch(n_bins, max_pulses):
    """Work space for pixels of up to `n_bins` bins.

    bins; window; running sums of counts, exposure, expected counts, and the latter themselves;
    small arrays (vectors, matrices, free parameters, sums outside the window and of a
    background recording).
    """
    size = 2 * max_pulses + 2
    bins = (np.empty(n_bins), np.empty(n_bins + 1), np.empty(n_bins))
    window = (np.empty(n_bins), np.empty(n_bins + 1), np.empty(n_bins))
    twice = 2 * n_bins + 1
    sums = (np.empty(twice), np.empty(twice), np.empty(twice), np.empty(n_bins))
    vectors = (
        np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size),
        np.empty(size),
    )  # fmt: skip
    matrices = (np.empty((size, size)), np.empty((size, size)), np.empty((size, size)))
    small = (vectors, matrices, np.ones(size, np.bool_), np.zeros(4))
    return bins, window, sums, small
