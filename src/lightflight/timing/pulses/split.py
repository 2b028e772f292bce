"""More than one pulse in a pixel: look for what the fit left over, refit all pulses together.

A further pulse is accepted where chance does not explain it *and* it stands apart: either the
counts show a valley between the pulses, or the single fit is clearly wider than the array's
pulses and the split ones are not. A response with a tail passes neither test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lightflight._kernels.pulse import ALONE
from lightflight.timing.pulses.batch import (
    Bools,
    Fit,
    Floats,
    Indices,
    Model,
    fit,
    share_and_density,
)
from lightflight.timing.pulses.bins import Bins

APART = 1.5
"""Centres closer than this many std are one pulse."""

MERGED = 4.0
"""Two pulses further apart than this many std have a valley between them."""

WEAKEST = 0.005
"""A further pulse has at least this share of the strongest one's photons."""

WIDER = 1.15
"""A blend of two is at least this much wider than one."""

SAME = 1.12
"""... and its parts are as wide as one to within this."""

UNEVEN = 0.3
"""Codes of a clock that takes all as equal may be so much narrower than their peers."""

VALLEY = 5.0
"""Log-likelihood by which a valley must be better than a slope."""

UNLIKELY = 4.0
"""Deviate of chi2 from which a fit may be of too few pulses."""

MISFIT = 0.02
"""... where chi2 exceeds its due by this share of the photons."""

DOUBTFUL = -4.0
"""Added to the threshold of a further pulse: residuals above it are looked into."""


@dataclass(frozen=True, eq=False)
class Search:
    """Pixels in which further pulses are looked for, and what decides.

    Attributes
    ----------
    typical_std : float
        Typical std of the array's pulses; NaN if unknown.
    log_alarms : float
        Threshold: a further pulse is less likely by chance than exp(-that).
    double_code : array of float
        (p,), codes' worth of light that the clock may misplace in a window.
    """

    bins: Bins
    model: Model
    typical_std: float
    log_alarms: float
    double_code: Floats

    def some(self, index: Indices | Bools) -> Search:
        """Some of the pixels."""
        return Search(
            self.bins.some(index), self.model, self.typical_std, self.log_alarms,
            self.double_code[index],
        )  # fmt: skip

    def fit(self, theta: Floats, *, fit_std: bool = True, enough: Floats | None = None) -> Fit:
        """See `batch.fit`."""
        return fit(self.bins, theta, self.model, fit_std=fit_std, enough=enough)


def wrapped(difference: Floats, period: float) -> Floats:
    """Time differences moved into [-period/2, period/2)."""
    if not math.isfinite(period):
        return difference
    return np.asarray(difference - period * np.floor(difference / period + 0.5))


def expected_counts(bins: Bins, theta: Floats, model: Model) -> Floats:
    """(p, N), counts that theta expects in every bin, over the whole range."""
    n_pulses = theta.shape[1] // 2 - 1
    expected = theta[:, -1:] * bins.exposure
    low, high = bins.edges[:, :-1], bins.edges[:, 1:]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    reach = model.reach * theta[:, -2:-1]
    for j in range(n_pulses):
        away = wrapped(middle - theta[:, j : j + 1], bins.period)
        row, k = np.nonzero((np.abs(away) - half <= reach) & (bins.exposure > 0.0))
        std = theta[row, -2]
        after, _ = share_and_density((away + half)[row, k] / std, model.shape)
        before, _ = share_and_density((away - half)[row, k] / std, model.shape)
        live = bins.exposure[row, k] / (2.0 * half[row, k])
        expected[row, k] += theta[row, n_pulses + j] * live * (after - before)
    return np.asarray(expected)


def residual_level(std: Floats, bin_width: Floats, n: Indices) -> Indices:
    """Level of sums (2^level bins) in which a scan for another pulse of this std looks."""
    level, length = np.zeros(len(std), np.int64), np.ones(len(std))
    while (grows := (1.414 * length < 2.5 * std / bin_width) & (4.0 * length <= n)).any():
        level, length = level + grows, np.where(grows, 2.0 * length, length)
    return level


@dataclass(frozen=True, eq=False)
class Residual:
    """The window of a pulse's length whose excess over a fit chance explains least.

    Attributes
    ----------
    log_excess : array of float
        (p,), 0 where nothing is in excess.
    time : array of float
        (p,), its middle.
    counts : array of float
        (p,), counts in excess.
    """

    log_excess: Floats
    time: Floats
    counts: Floats


def residual_scan(search: Search, theta: Floats, *, near: float, std: Floats) -> Residual:
    """Look for the largest excess over theta in windows of 2.5 `std`.

    Windows whose middle is within `near` of theta's std of a pulse are left out.
    """
    bins = search.bins
    p, width = bins.counts.shape
    length = 1 << residual_level(std, bins.span / bins.n, bins.n)
    expected = expected_counts(bins, theta, search.model)
    raised = search.double_code * (1.0 / length + 0.05) * theta[:, -1]
    inside, due, exposed = (
        _sums_over(values, bins, length) for values in (bins.counts, expected, bins.exposure)
    )
    start = np.arange(width)
    real = start < bins.n[:, None]
    if not math.isfinite(bins.period):
        real = start + length[:, None] <= bins.n[:, None]
    over = real & (inside > due)
    value = np.zeros((p, width))
    level = due + raised[:, None] * exposed
    above = over & (inside > level)
    some, its = inside[above], level[above]
    value[above] = some * np.log(some / its) - (some - its)
    row, k = np.nonzero(above)
    end = k + length[row]
    lap = end > bins.n[row]
    edge = bins.edges[row, np.where(lap, end - bins.n[row], end)]
    middle = 0.5 * (bins.edges[row, k] + edge + np.where(lap, bins.period if lap.any() else 0.0, 0))
    closest = np.full(len(row), np.inf)
    for j in range(theta.shape[1] // 2 - 1):
        closest = np.minimum(closest, np.abs(wrapped(middle - theta[row, j], bins.period)))
    value[row, k] *= closest > near * theta[row, -2]
    times = np.zeros((p, width))
    times[row, k] = middle
    pixel, best = np.arange(p), value.argmax(axis=1)
    highest = value[pixel, best]
    excess = np.where(highest > 0.0, inside[pixel, best] - due[pixel, best], 0.0)
    return Residual(highest, np.where(highest > 0.0, times[pixel, best], 0.0), excess)


def _sums_over(values: Floats, bins: Bins, length: Indices) -> Floats:
    """(p, N), sums over `length` bins from each bin on, across the fold."""
    sums = np.zeros((values.shape[0], values.shape[1] + 1))
    np.cumsum(values, axis=1, out=sums[:, 1:])
    end = np.arange(values.shape[1]) + length[:, None]
    lap = end > bins.n[:, None]
    row = np.arange(len(values))[:, None]
    after = sums[row, np.clip(np.where(lap, end - bins.n[:, None], end), 0, values.shape[1])]
    return np.asarray(after + np.where(lap, sums[row, bins.n[:, None]], 0.0) - sums[:, :-1])


def counts_between(
    counts: Floats, edges: Floats, exposure: Floats, low: Floats, high: Floats
) -> tuple[Floats, Floats]:
    """Counts and exposure of bins whose middles lie in [low, high); of the nearest lit if none."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    first, after = np.searchsorted(middle, low), np.searchsorted(middle, high)
    inside, exposed = (
        sums[after] - sums[first]
        for sums in (np.append(0.0, np.cumsum(counts)), np.append(0.0, np.cumsum(exposure)))
    )
    empty = ~(exposed > 0.0)
    if empty.any():
        lit = np.flatnonzero(exposure > 0.0)
        away = np.abs(middle[lit] - 0.5 * (low[empty] + high[empty])[:, None])
        nearest = lit[away.argmin(axis=1)]
        inside[empty], exposed[empty] = counts[nearest], exposure[nearest]
    return inside, exposed


def valley_between(
    counts: Floats, edges: Floats, exposure: Floats, *, left: float, right: float, weaker: float,
    std: float, hollow: float,
) -> float:  # fmt: skip
    """Log-likelihood by which the counts between two centres lie below those of the weaker pulse.

    Bump: +-1 std around the weaker centre; valley: the emptiest +-0.5 std in between. Codes that
    are narrower than the clock knows look like one: only what lies below `hollow` bumps counts.
    """
    n_steps = int(4.0 * (right - left) / std)
    time = left + (right - left) * np.arange(1, n_steps) / max(n_steps, 1)
    time = time[np.abs(time - weaker) >= 1.2 * std]
    half = np.append(np.full(len(time), 0.5 * std), std)
    time = np.append(time, weaker)
    inside, exposed = counts_between(counts, edges, exposure, time - half, time + half)
    bump, low, low_width = hollow * inside[-1], inside[:-1], exposed[:-1]
    both = (bump + low) / (exposed[-1] + low_width)
    lower = low * exposed[-1] < bump * low_width
    if not lower.any():
        return 0.0
    both, low, low_width = both[lower], low[lower], low_width[lower]
    gain = bump * np.log(bump / (both * exposed[-1]))
    some = low > 0.0
    gain[some] += low[some] * np.log(low[some] / (both[some] * low_width[some]))
    return max(float(gain.max()), 0.0)


def stands_apart(search: Search, i: int, theta: Floats, std_before: float) -> bool:
    """True where the pulses of pixel i are separate ones, not parts of one of another shape."""
    typical, std = search.typical_std, float(theta[-2])
    n_pulses = len(theta) // 2 - 1
    order = np.argsort(theta[:n_pulses], kind="stable")
    centre, photons = theta[:n_pulses][order], theta[n_pulses : 2 * n_pulses][order]
    if photons.min() < WEAKEST * photons.max() or np.diff(centre).min() < APART * std:
        return False
    widest_single = (WIDER + 3.0 / math.sqrt(2.0 * photons.sum())) * typical
    blend = std_before > widest_single and typical / SAME < std < typical * SAME
    # (False where the typical std is unknown, NaN.)
    hollow = 1.0 - UNEVEN * float(search.double_code[i])
    row = unfolded(search.bins, i, 0.5 * float(centre[0] + centre[-1]))
    for j in range(n_pulses - 1):
        if blend and centre[j + 1] - centre[j] < MERGED * std:
            continue
        weaker = centre[j] if photons[j] < photons[j + 1] else centre[j + 1]
        valley = valley_between(
            *row, left=centre[j], right=centre[j + 1], weaker=weaker, std=std, hollow=hollow
        )
        if valley < VALLEY:
            return False
    return True


def unfolded(bins: Bins, i: int, middle: float) -> tuple[Floats, Floats, Floats]:
    """Counts, edges and exposure of a pixel; with a period, of the one around `middle`."""
    n = int(bins.n[i])
    counts, edges, exposure = bins.counts[i, :n], bins.edges[i, : n + 1], bins.exposure[i, :n]
    if not math.isfinite(bins.period):
        return counts, edges, exposure
    low = middle - 0.5 * bins.period
    shift = math.floor((low - edges[0]) / bins.period) * bins.period
    k = min(max(int(np.searchsorted(edges, low - shift, side="right")) - 1, 0), n - 1)
    ends = np.concatenate([edges[k + 1 :], edges[1 : k + 1] + bins.period]) + shift
    return np.roll(counts, -k), np.append(edges[k] + shift, ends), np.roll(exposure, -k)


def explains_counts(search: Search, found: Fit) -> Bools:
    """True where a fit leaves nothing that a further pulse could explain.

    The same is asked of single pulses before any split, see `_pulse_fits.pixels_to_split`.
    """
    theta = found.theta
    n_pulses = theta.shape[1] // 2 - 1
    misfit = (found.chi2 - found.chi2_bins) / theta[:, n_pulses : 2 * n_pulses].sum(axis=1)
    explained = ~(theta[:, -2] > WIDER * search.typical_std)
    explained &= ~((found.deviate > UNLIKELY) & (misfit > MISFIT))
    asked = np.flatnonzero(explained)
    residual = residual_far_from_pulses(search.some(asked), theta[asked])
    explained[asked] = residual <= search.log_alarms + DOUBTFUL
    return np.asarray(explained)


def residual_far_from_pulses(search: Search, theta: Floats) -> Floats:
    """(p,), log excess over theta far from its pulses, less that of the number of places."""
    residual = residual_scan(search, theta, near=ALONE, std=theta[:, -2])
    return np.asarray(residual.log_excess - np.log(search.bins.n))


def _with_one_more(
    theta: Floats, time: Floats, photons: Floats, std: Floats, period: float
) -> Floats:
    """Start of a fit with a further pulse: theta, the new pulse in the same period, std."""
    n_pulses = theta.shape[1] // 2 - 1
    time = theta[:, 0] + wrapped(time - theta[:, 0], period)
    columns = (*theta.T[:n_pulses], time, *theta.T[n_pulses : 2 * n_pulses], photons, std)
    return np.stack([*columns, theta[:, -1]], axis=1)


def _starts(search: Search, theta: Floats, number: int) -> tuple[Floats, Bools]:
    """Start of a fit with one more pulse, and where there is one; see `best_with_one_more`."""
    std, typical, period = theta[:, -2], search.typical_std, search.bins.period
    n_pulses = theta.shape[1] // 2 - 1
    narrow = np.where(typical < std / WIDER, typical, 0.4 * std)
    if number == 0:
        residual = residual_scan(search, theta, near=APART, std=std)
        more = _with_one_more(theta, residual.time, np.maximum(residual.counts, 1.0), std, period)
        return more, residual.log_excess > 0.0
    base = theta.copy()
    if number == 1:
        base[:, -2] = narrow
        if n_pulses == 1:
            alone = np.stack([narrow, theta[:, -1]], axis=1)
            residual = residual_scan(search, alone, near=0.0, std=narrow)
            base[:, 0] = theta[:, 0] + wrapped(residual.time - theta[:, 0], period)
        base = search.fit(base, fit_std=False).theta
        residual = residual_scan(search, base, near=APART, std=narrow)
        photons = np.maximum(residual.counts, 1.0)
        more = _with_one_more(base, residual.time, photons, narrow, period)
        return more, residual.log_excess > 0.0
    half = 0.8 * np.sqrt(np.maximum(std**2 - narrow**2, 0.25 * narrow**2))
    photons = 0.5 * theta[:, n_pulses]
    base[:, 0], base[:, n_pulses] = theta[:, 0] - half, photons
    more = _with_one_more(base, theta[:, 0], photons, narrow, period)
    more[:, n_pulses] = theta[:, 0] + half
    return more, np.ones(len(theta), dtype=bool)


def best_with_one_more(search: Search, theta: Floats, enough: Floats) -> tuple[Fit, Bools]:
    """Fits with one more pulse, the best of several starts, and whether each explains the counts.

    Those that will not come to an objective of `enough` (p,), or to the best, are not finished.
    The first fit that explains the counts is taken. Starts: the largest excess over the fit; the
    same with the array's std (or, unknown, 0.4 of the fitted one, for a fit that spans two
    pulses); a symmetric split of the first pulse.
    """
    best = Fit.empty(len(theta), theta.shape[1] + 2)
    best.objective[:] = -np.inf
    explained = np.zeros(len(theta), dtype=bool)
    left = np.arange(len(theta))
    for number in range(3):
        more, some = _starts(search.some(left), theta[left], number)
        here = left[some]
        asked = np.maximum(enough, best.objective)[here]
        found = search.some(here).fit(more[some], enough=asked)
        better = found.objective > best.objective[here]
        here = here[better]
        best.put(here, _rows(found, better))
        sure = here[best.converged[here]]
        explained[sure] = explains_counts(search.some(sure), _rows(best, sure))
        left = left[~explained[left]]
        if not len(left):
            break
    return best, explained


def _rows(found: Fit, index: Indices | Bools) -> Fit:
    return Fit(*(getattr(found, name)[index] for name in found.__dataclass_fields__))


def split_pulses(search: Search, theta: Floats, max_pulses: int) -> list[tuple[Indices, Fit]]:
    """Add pulses to the single fits in theta (p, 4) while the counts demand it.

    Returns (pixels, their fits) for two pulses, for three and so on; a pixel's last is its answer.
    A further pulse must raise the log-likelihood by log_alarms + log(number of places) + 1, and
    its photons must exceed what an imperfect clock could have misplaced.
    """
    before = search.fit(theta)
    pixels, found = np.arange(len(theta)), []
    for n_pulses in range(2, max_pulses + 1):
        if not len(pixels):
            break
        now = search.some(pixels)
        enough = before.objective + now.log_alarms
        more, explained = best_with_one_more(now, before.theta, enough)
        span, n = now.bins.span, now.bins.n
        places = np.maximum(span / more.theta[:, -2], 1.0)
        needed = search.log_alarms + np.log(places) + 1.0
        weakest = more.theta[:, n_pulses : 2 * n_pulses].min(axis=1)
        misplaced = now.double_code * more.theta[:, -1] * span / n
        kept = (more.objective > before.objective + needed) & more.converged
        kept &= weakest >= 2.0 * misplaced
        for i in np.flatnonzero(kept).tolist():
            kept[i] = stands_apart(now, i, more.theta[i], float(before.theta[i, -2]))
        found.append((pixels[kept], _rows(more, kept)))
        on = kept & ~explained
        pixels, before = pixels[on], _rows(more, on)
    return found
