"""More than one pulse in a pixel: look for what the fit left over, refit all pulses together.

A further pulse is accepted where chance does not explain it *and* it stands apart: either the
counts show a valley between the pulses, or the single fit is clearly wider than the array's
pulses and the split ones are not. A response with a tail passes neither test.
"""

from __future__ import annotations

import math

import numpy as np

from lightflight._kernels.bins import accumulate, edge_at, log_excess_over, put, residual_level
from lightflight._kernels.jit import jit, jit_lent
from lightflight._kernels.pulse import bin_model, describe_fit, fit_bins, reach_of_pulse

APART = 1.5  # centres closer than this many std are one pulse
ALONE = 3.0  # further than this many std from every pulse, light is another pulse or a tail
MERGED = 4.0  # two pulses further apart than this many std have a valley between them
WEAKEST = 0.005  # a further pulse has at least this share of the strongest one's photons
WIDER = 1.15  # a blend of two is at least this much wider than one
SAME = 1.12  # and its parts are as wide as one to within this
UNEVEN = 0.3  # codes of a clock that takes all as equal may be so much narrower than their peers
VALLEY = 5.0  # log-likelihood by which a valley must be better than a slope
UNLIKELY = 4.0  # deviate of chi2 from which a fit may be of too few pulses
MISFIT = 0.02  # ... where chi2 exceeds its due by this share of the photons
DOUBTFUL = -4.0  # added to the threshold of a further pulse: residuals above it are looked into


@jit_lent
def wrapped(difference, period):
    """Time difference moved into [-period/2, period/2)."""
    if period == math.inf:
        return difference
    return difference - period * math.floor(difference / period + 0.5)


@jit_lent
def expected_counts(bins, n, period, theta, n_pulses, model, one, slope, expected):
    """Counts that theta expects in every bin, over the whole range. `one`: room for a theta."""
    _, edges, exposure = bins
    std = theta[2 * n_pulses]
    single = np.int64(1)  # no literal, see `pulse_tile.fit_alone`
    reach = reach_of_pulse(model) * std
    for k in range(n):
        expected[k] = theta[2 * n_pulses + 1] * exposure[k]
        if exposure[k] <= 0.0:
            continue
        middle, half = 0.5 * (edges[k] + edges[k + 1]), 0.5 * (edges[k + 1] - edges[k])
        for j in range(n_pulses):
            away = wrapped(middle - theta[j], period)
            if abs(away) - half <= reach:
                one[0], one[1], one[2], one[3] = middle - away, 1.0, std, 0.0
                share = bin_model(one, single, edges[k], edges[k + 1], exposure[k], model, slope)
                expected[k] += theta[n_pulses + j] * share


@jit_lent
def residual_scan(
    bins, n, period, theta, n_pulses, model, near, std, double_code, sums, scratch, best
):
    """Window of a pulse's length (2.5 std) with the excess over theta that chance explains least.

    Windows whose middle is within `near` of theta's std of a pulse are left out. `double_code` as
    in `scan_for_pulse`; sums: running sums of counts and exposure. best: log excess, middle,
    counts in excess.
    """
    vectors, _, _, _ = scratch
    expected = sums[3]
    expected_counts(bins, n, period, theta, n_pulses, model, vectors[3], vectors[0], expected)
    edges = bins[1]
    reach = 2 * n if period < math.inf else n
    accumulate(expected, n, reach, sums[2])
    length = 1 << residual_level(std, (edges[n] - edges[0]) / n, n)
    raised = double_code * (1.0 / length + 0.05) * theta[2 * n_pulses + 1]
    best[0], best[1], best[2] = 0.0, 0.0, 0.0
    for i in range(min(n, reach - length + 1)):
        inside = sums[0][i + length] - sums[0][i]
        due = sums[2][i + length] - sums[2][i]
        if inside <= due:
            continue
        exposed = sums[1][i + length] - sums[1][i]
        value = log_excess_over(inside, due + raised * exposed)
        if value > best[0]:
            middle = 0.5 * (edges[i] + edge_at(edges, n, period, i + length))
            if closest_pulse(middle, theta, n_pulses, period) > near * theta[2 * n_pulses]:
                best[0], best[1], best[2] = value, middle, inside - due


@jit_lent
def closest_pulse(time, theta, n_pulses, period):
    """Distance to the nearest centre."""
    closest = math.inf
    for j in range(n_pulses):
        closest = min(closest, abs(wrapped(time - theta[j], period)))
    return closest


@jit_lent
def counts_between(window, m, low, high):
    """Counts and exposure of the bins whose middles lie in [low, high); of the nearest if none."""
    counts, edges, exposure = window
    inside, exposed, nearest, least = 0.0, 0.0, 0, math.inf
    for k in range(m):
        middle = 0.5 * (edges[k] + edges[k + 1])
        if low <= middle < high:
            inside += counts[k]
            exposed += exposure[k]
        away = abs(middle - 0.5 * (low + high))
        if exposure[k] > 0.0 and away < least:
            nearest, least = k, away
    if exposed > 0.0:
        return inside, exposed
    return counts[nearest], exposure[nearest]


@jit_lent
def valley_between(window, m, left, right, weaker, std, hollow):
    """Log-likelihood by which the counts between two centres lie below those of the weaker pulse.

    Bump: +-1 std around the weaker centre; valley: the emptiest +-0.5 std in between. Codes that
    are narrower than the clock knows look like one: only what lies below `hollow` bumps counts.
    """
    bump, bump_width = counts_between(window, m, weaker - std, weaker + std)
    bump *= hollow
    n_steps = int(4.0 * (right - left) / std)
    gain = 0.0
    for i in range(1, n_steps):
        time = left + (right - left) * i / n_steps
        if abs(time - weaker) < 1.2 * std:
            continue
        low, low_width = counts_between(window, m, time - 0.5 * std, time + 0.5 * std)
        if low * bump_width < bump * low_width:
            both = (bump + low) / (bump_width + low_width)
            value = bump * math.log(bump / (both * bump_width))
            if low > 0.0:
                value += low * math.log(low / (both * low_width))
            gain = max(gain, value)
    return gain


@jit_lent
def stands_apart(theta, n_pulses, std_before, typical_std, double_code, window, m):
    """True where the pulses are separate ones, not the parts of one pulse of another shape."""
    std = theta[2 * n_pulses]
    strongest, photons = 0.0, 0.0
    for j in range(n_pulses):
        strongest = max(strongest, theta[n_pulses + j])
        photons += theta[n_pulses + j]
    widest_single = (WIDER + 3.0 / math.sqrt(2.0 * photons)) * typical_std
    blend = std_before > widest_single and typical_std / SAME < std < typical_std * SAME
    # (False where the typical std is unknown, NaN.)
    for j in range(n_pulses):
        if theta[n_pulses + j] < WEAKEST * strongest:
            return False
        after = -1  # the next pulse in time
        for i in range(n_pulses):
            if theta[i] > theta[j] and (after < 0 or theta[i] < theta[after]):
                after = i
        if after < 0:
            continue
        if theta[after] - theta[j] < APART * std:
            return False
        weaker = theta[j] if theta[n_pulses + j] < theta[n_pulses + after] else theta[after]
        if blend and theta[after] - theta[j] < MERGED * std:
            continue
        hollow = 1.0 - UNEVEN * double_code
        if valley_between(window, m, theta[j], theta[after], weaker, std, hollow) < VALLEY:
            return False
    return True


@jit_lent
def with_one_more(theta, n_pulses, time, photons, std, period, trial):
    """Start of a fit with a further pulse: theta, the new pulse in the same period, std."""
    for j in range(n_pulses):
        trial[j] = theta[j]
        trial[n_pulses + 1 + j] = theta[n_pulses + j]
    trial[n_pulses] = theta[0] + wrapped(time - theta[0], period)
    trial[2 * n_pulses + 1] = photons
    trial[2 * n_pulses + 2] = std
    trial[2 * n_pulses + 3] = theta[2 * n_pulses + 1]


@jit_lent
def explains_counts(
    bins, n, period, theta, n_pulses, typical_std, log_alarms, double_code, model, m, work
):
    """True where the fit in the window leaves nothing that a further pulse could explain.

    The same is asked of single pulses before any split, see `_pulse_fits.pixels_to_split`.
    """
    window, sums, scratch, _, best, summary, _, _ = work
    std, photons = theta[2 * n_pulses], 0.0
    for j in range(n_pulses):
        photons += theta[n_pulses + j]
    describe_fit(bins, n, theta, n_pulses, model, window, m, scratch, summary)
    misfit = (summary[0] - summary[1]) / photons
    if std > WIDER * typical_std or (summary[2] > UNLIKELY and misfit > MISFIT):
        return False
    residual_scan(
        bins, n, period, theta, n_pulses, model, ALONE, std, double_code, sums, scratch, best
    )
    return best[0] - math.log(n) <= log_alarms + DOUBTFUL


@jit_lent
def best_with_one_more(
    bins, n, period, theta, n_pulses, typical_std, log_alarms, double_code, model, work, best_theta
):
    """Fit with one more pulse from several starts; returns the best objective, theta in best_theta.

    The first fit that explains the counts is taken.

    Starts: the largest excess over the fit; the same with the array's std (or, unknown, 0.4 of
    the fitted one, for a fit that spans two pulses); a symmetric split of the first pulse.
    """
    window, sums, scratch, outcome, best, _, base, trial = work
    std = theta[2 * n_pulses]
    narrow = typical_std if typical_std < std / WIDER else 0.4 * std
    highest = -math.inf
    size = 2 * n_pulses + 4
    # no literals, see `pulse_tile.fit_alone`
    none, is_last, is_first = np.int64(0), np.bool_(True), np.bool_(False)
    more = n_pulses + 1
    for start in range(3):
        put(theta, size, base)
        if start == 0:
            near, width = APART, std
        elif start == 1:
            near, width = APART, narrow
            base[2 * n_pulses] = narrow
            if n_pulses == 1:
                trial[0], trial[1] = narrow, theta[3]
                residual_scan(
                    bins, n, period, trial, none, model, 0.0, narrow, double_code, sums, scratch,
                    best,
                )  # fmt: skip
                base[0] = theta[0] + wrapped(best[1] - theta[0], period)
            fit_bins(bins, n, period, base, n_pulses, model, is_first, window, scratch, outcome)
        else:
            near, width = 0.0, narrow
        residual_scan(
            bins, n, period, base, n_pulses, model, near, width, double_code, sums, scratch, best
        )
        with_one_more(base, n_pulses, best[1], max(best[2], 1.0), width, period, trial)
        if start == 2:
            half = 0.8 * math.sqrt(max(std**2 - narrow**2, 0.25 * narrow**2))
            trial[0], trial[n_pulses] = theta[0] - half, theta[0] + half
            trial[n_pulses + 1] = 0.5 * theta[n_pulses]
            trial[2 * n_pulses + 1] = 0.5 * theta[n_pulses]
        elif best[0] <= 0.0:
            continue
        m = fit_bins(bins, n, period, trial, more, model, is_last, window, scratch, outcome)
        if outcome[0] > highest:
            highest = outcome[0]
            put(trial, size, best_theta)
            if outcome[1] == 1.0 and explains_counts(
                bins, n, period, best_theta, more, typical_std, log_alarms, double_code, model, m,
                work,
            ):  # fmt: skip
                break
    return highest


@jit
def split_pulses(
    bins, n, period, theta, max_pulses, typical_std, log_alarms, double_code, model, work
):
    """Add pulses to the single fit in theta while the counts demand it.

    Returns how many and, for more than one, the bins in the window: theta, window and scratch
    then hold the accepted fit, ready for its covariance.
    A further pulse must raise the log-likelihood by log_alarms + log(number of places) + 1, and
    its photons must exceed what an imperfect clock could have misplaced.
    """
    window, _, scratch, outcome, _, _, _, _ = work
    new = np.empty_like(theta)
    # no literals, see `pulse_tile.fit_alone`
    is_last = np.bool_(True)
    n_pulses, m = np.int64(1), 0
    span = bins[1][n] - bins[1][0]
    fit_bins(bins, n, period, theta, n_pulses, model, is_last, window, scratch, outcome)
    objective = outcome[0]
    while n_pulses < max_pulses:
        std = theta[2 * n_pulses]
        higher = best_with_one_more(
            bins, n, period, theta, n_pulses, typical_std, log_alarms, double_code, model, work, new
        )
        needed = log_alarms + math.log(max(span / new[2 * n_pulses + 2], 1.0)) + 1.0
        if not higher > objective + needed:
            break
        more = n_pulses + 1
        m = fit_bins(bins, n, period, new, more, model, is_last, window, scratch, outcome)
        weakest = new[more]
        for j in range(more):
            weakest = min(weakest, new[more + j])
        misplaced = double_code * new[2 * more + 1] * span / n
        if (
            outcome[1] == 0.0
            or weakest < 2.0 * misplaced
            or not stands_apart(new, more, std, typical_std, double_code, window, m)
        ):
            break
        put(new, theta.size, theta)
        objective = outcome[0]
        n_pulses = more
        if explains_counts(
            bins, n, period, theta, n_pulses, typical_std, log_alarms, double_code, model, m, work
        ):
            break
    if n_pulses > 1:
        m = fit_bins(bins, n, period, theta, n_pulses, model, is_last, window, scratch, outcome)
    return n_pulses, m
