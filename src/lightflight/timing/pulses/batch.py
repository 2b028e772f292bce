"""Fits of one or several pulses of any shape, in NumPy, over batches of pixels.

The same likelihood as the kernel of `_kernels.pulse`, which settles nearly all pixels; here are
those that need more: several pulses, a tabulated shape, least squares, a start far off. Parameters
of a fit with J pulses, `theta` (2 J + 2): centres c_0 ... c_{J-1}, photons A_0 ... A_{J-1}, one
shared std s, background b per unit time. The expected counts of bin k are
sum_j A_j [F((e_{k+1} - c_j)/s) - F((e_k - c_j)/s)] + b w_k, with F the cumulated shape of a pulse.

Pixels of a batch do not influence each other, not even by rounding: sums over bins run over a
number of bins that the pixel itself decides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightflight._kernels.pulse import MIN_EXPECTED
from lightflight.timing.pulses.bins import Bins, Window, place_in, step_above, window_at

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

REACH = 7.5
"""Std from its centre beyond which a Gaussian is nothing (1e-13 of its photons)."""

MAX_STEPS = 60
TOLERANCE = 1e-6
"""Squared length of a step, in standard errors, below which a fit has converged."""

GOOD_ENOUGH = 1e-3
"""... and is taken, out of steps (a background that creeps to zero) or where they lead nowhere."""

_STALLED_BY = 100.0
"""A step that gains less than this part of what is good enough leads nowhere: two pulses that trade
light sway about the top for fifty steps."""

_HOPES = 10.0
"""What a fit may still gain, in squared lengths of its last step: half of one near the top."""

_BATCH_BINS = 1 << 17
"""Pixels times bins fitted at once: what a pixel needs stays in the cache."""


class Model(NamedTuple):
    """What is fitted to the counts.

    Attributes
    ----------
    poisson : bool
        Poisson likelihood; else least squares.
    sampled : bool
        Gaussians at the middles of the codes, as in the paper; else integrated over the codes.
    counted : bool
        Photon counts; else scaled intensities.
    shape : array of float
        (3, m), see `timing.response.Response.table`; (3, 0): a Gaussian.
    """

    poisson: bool
    sampled: bool
    counted: bool
    shape: Floats

    @property
    def reach(self) -> float:
        """Std on either side of its centre beyond which a pulse is nothing."""
        return max(-self.shape[0, 0], self.shape[0, -1]) if self.shape.shape[1] else REACH


def share_and_density(z: Floats, shape: Floats) -> tuple[Floats, Floats]:
    """Share of a pulse that has come by z std after its centre, and its density there."""
    from scipy.special import ndtr

    if shape.shape[1] == 0:
        density = -0.5 * z
        density *= z
        np.exp(density, out=density)
        density /= math.sqrt(2.0 * math.pi)
        return ndtr(z), density
    step = shape[0, 1] - shape[0, 0]
    place = np.clip((z - shape[0, 0]) / step, 0.0, shape.shape[1] - 1.0)
    i = np.minimum(place.astype(np.intp), shape.shape[1] - 2)
    part = place - i
    density = shape[2, i] + part * (shape[2, i + 1] - shape[2, i])
    share = shape[1, i] + 0.5 * part * step * (shape[2, i] + density)
    return share, np.where((place > 0.0) & (place < shape.shape[1] - 1), density, 0.0)


def expected_in(window: Window, theta: Floats, model: Model) -> tuple[Floats, Floats, Floats]:
    """Expected counts (p, K), derivatives by theta (p, 2 J + 2, K), share of each pulse (p, J, K).

    A bin whose exposure is less than what lies between its edges was alive for that part only;
    the last of the three takes it as wholly alive.
    """
    n_pulses = theta.shape[1] // 2 - 1
    edges = window.edges[:, None, :]
    centre, photons = theta[:, :n_pulses, None], theta[:, n_pulses : 2 * n_pulses, None]
    std, width = theta[:, None, -2:-1], window.exposure[:, None, :]
    between = np.where(window.lit, window.edges[:, 1:] - window.edges[:, :-1], 1.0)[:, None, :]
    live = width / between
    if model.sampled:
        z = (0.5 * (edges[..., 1:] + edges[..., :-1]) - centre) / std
        held = between * np.exp(-0.5 * z * z) / std / math.sqrt(2.0 * math.pi)
        by_centre, by_std = held * z / std, held * (z * z - 1.0) / std
    else:
        z = (edges - centre) / std
        share, density = share_and_density(z, model.shape)
        held = share[..., 1:] - share[..., :-1]
        by_centre = (density[..., :-1] - density[..., 1:]) / std
        z *= density
        by_std = (z[..., :-1] - z[..., 1:]) / std
    # Most of the time of a fit is spent here, on memory: nothing is made twice, little copied.
    bright = photons * live
    slope = np.empty((len(theta), theta.shape[1], window.counts.shape[1]))
    np.multiply(bright, by_centre, out=slope[:, :n_pulses])
    np.multiply(live, held, out=slope[:, n_pulses : 2 * n_pulses])
    by_std *= bright
    np.sum(by_std, axis=1, out=slope[:, -2])
    slope[:, -1] = window.exposure
    bright *= held
    expected = np.sum(bright, axis=1)
    expected += theta[:, -1:] * window.exposure
    return expected, slope, held


class _Score(NamedTuple):
    """Objective (p,), larger is better; its gradient (p, s), expected information (p, s, s)."""

    objective: Floats
    gradient: Floats
    information: Floats


def _score(window: Window, dark: Floats, theta: Floats, model: Model) -> _Score:
    """Poisson log-likelihood (of densities: the same for every window), or minus half the squares.

    Outside the window the model is b w, so two sums are all that these bins contribute.
    """
    expected, slope, _ = expected_in(window, theta, model)
    lit = window.lit
    if not model.poisson:
        pull = np.where(lit, window.counts - expected, 0.0)
        slope = slope * lit[:, None]
        gradient = np.einsum("pak,pk->pa", slope, pull)
        return _Score(-0.5 * np.sum(pull * pull, axis=1), gradient, slope @ slope.swapaxes(1, 2))
    weight = np.divide(1.0, expected, out=np.zeros_like(expected), where=lit)
    rate = np.divide(expected, window.exposure, out=np.ones_like(expected), where=lit)
    np.log(rate, out=rate)
    rate *= window.counts
    # Bins without exposure expect nothing.
    rate -= expected
    objective = np.sum(rate, axis=1)
    gradient = np.einsum("pak,pk->pa", slope, window.counts * weight - lit)
    information = (slope * weight[:, None]) @ slope.swapaxes(1, 2)
    counts, exposure = (window.outside[:, :2] + dark).T
    some, background = exposure > 0.0, theta[:, -1]
    objective += np.where(some, counts * np.log(background) - background * exposure, 0.0)
    gradient[:, -1] += np.where(some, counts / background - exposure, 0.0)
    information[:, -1, -1] += np.where(some, exposure / background, 0.0)
    return _Score(objective, gradient, information)


@dataclass(frozen=True, eq=False)
class Fit:
    """Fits of some pixels.

    Attributes
    ----------
    theta : array of float
        (p, 2 J + 2).
    objective : array of float
        (p,).
    converged : array of bool
        (p,).
    steps : array of int
        (p,).
    std_free : array of bool
        (p,), False where the std is at a bound.
    covariance : array of float
        (p, 2 J + 2, 2 J + 2), NaN where the information is singular.
    chi2 : array of float
        (p,), Pearson's.
    chi2_bins : array of float
        (p,), bins it is of.
    deviate : array of float
        (p,), how unlikely chi2 over the bins with >= 1 expected count is, as a normal deviate.
    held : array of float
        (p,), smallest share of a pulse inside live bins.
    """

    theta: Floats
    objective: Floats
    converged: Bools
    steps: Indices
    std_free: Bools
    covariance: Floats
    chi2: Floats
    chi2_bins: Floats
    deviate: Floats
    held: Floats

    @classmethod
    def empty(cls, n_pixels: int, size: int) -> Fit:
        """Room for fits."""
        whole = np.zeros(n_pixels, dtype=np.int64)
        numbers = np.full((6, n_pixels), np.nan)
        return cls(
            np.empty((n_pixels, size)), numbers[0], whole > 0, whole, whole > 0,
            np.empty((n_pixels, size, size)), *numbers[1:5],
        )  # fmt: skip

    def put(self, index: Indices, other: Fit) -> None:
        """Write other fits into some of the rows."""
        for name in self.__dataclass_fields__:
            getattr(self, name)[index] = getattr(other, name)


def fit(
    bins: Bins, start: Floats, model: Model, *, fit_std: bool = True, enough: Floats | None = None
) -> Fit:
    """Damped Fisher scoring from `start` (p, 2 J + 2); no step lowers the objective.

    A Poisson fit looks at a window that follows and grows with the pulses; the rest enters
    through sums, so it is the full-range fit. One that will not come to an objective of `enough`
    (p,) is left where it is seen to.
    """
    asked = np.full(len(start), -np.inf) if enough is None else enough
    theta, found = start.copy(), Fit.empty(*start.shape)
    bounds = _bounds(bins, model)
    theta[:, -2] = np.clip(theta[:, -2], bounds[:, 0], bounds[:, 1])
    theta[:, -1] = np.maximum(theta[:, -1], bounds[:, 2])
    steps = np.zeros(len(theta), dtype=np.int64)
    left = np.arange(len(theta))
    while len(left):
        reach = 1.25 * model.reach if model.poisson else math.inf
        first, m, lap = place_in(bins.some(left), *_around(theta[left], bins.period, reach))
        again = []
        for width in np.unique(step_above(m)):
            same = np.flatnonzero(step_above(m) == width)
            for part in np.array_split(same, -(-len(same) * int(width) // _BATCH_BINS)):
                at = left[part]
                some = bins.some(at)
                window = window_at(some, first[part], m[part], lap[part])
                one, escaped = _fit_in(
                    window, some, theta[at], bounds[at], model, fit_std, steps[at], asked[at]
                )
                found.put(at, one)
                theta[at], steps[at] = one.theta, one.steps
                again.append(at[escaped])
        left = np.sort(np.concatenate(again))
    return found


def _around(theta: Floats, period: float, reach: float) -> tuple[Floats, Floats]:
    """Range that holds every pulse out to `reach` std; at most one period."""
    centres = theta[:, : theta.shape[1] // 2 - 1]
    low, high = centres.min(axis=1), centres.max(axis=1)
    half = np.minimum(0.5 * (high - low) + reach * theta[:, -2], 0.5 * period)
    return 0.5 * (low + high) - half, 0.5 * (low + high) + half


def _bounds(bins: Bins, model: Model) -> Floats:
    """(p, 3), smallest std, largest std, smallest background a fit of these bins may reach.

    A tenth of a mean bin: below it position and width inside one bin cannot be told. A
    thousandth of a count over the whole range: next to none, and the logarithm stays finite.
    """
    exposure, live = bins.exposure.sum(axis=1), np.sum(bins.exposure > 0.0, axis=1)
    floor = 1e-3 / exposure if model.poisson else np.full(len(live), -np.inf)
    span = np.minimum(bins.period, bins.span)
    return np.stack([0.1 * exposure / live, 0.5 * span, floor], axis=1)


def _fit_in(
    window: Window, bins: Bins, theta: Floats, bounds: Floats, model: Model, fit_std: bool,
    steps: Indices, enough: Floats,
) -> tuple[Fit, Bools]:  # fmt: skip
    """`fit` in a given window, and which pixels' pulses have left it."""
    theta, steps = theta.copy(), steps.copy()
    p, size = theta.shape
    state = _score(window, bins.dark, theta, model)
    damping, (length2, gained) = np.zeros(p), np.full((2, p), np.inf)
    escaped, done, free = np.zeros(p, bool), np.zeros(p, bool), np.ones((p, size), bool)
    active, accepted = np.arange(p), np.ones(p, bool)
    trial, trial_score = theta.copy(), state
    unit = np.ones(p)
    while True:
        took = active[accepted]
        gained[took] = trial_score.objective[accepted] - state.objective[took]
        theta[took] = trial[accepted]
        for old, new in zip(state, trial_score, strict=True):
            old[took] = new[accepted]
        if not model.poisson:
            spare = np.maximum(window.m[active] - size, 1)
            unit[active] = np.maximum(-2.0 * state.objective[active] / spare, 1e-300)
        converged = (length2[active] < TOLERANCE * unit[active]) & (damping[active] < 1)
        converged |= np.maximum(length2, _STALLED_BY * gained)[active] < GOOD_ENOUGH * unit[active]
        hopes = state.objective[active] + _HOPES * length2[active]
        converged |= (hopes < enough[active]) & (damping[active] < 1)
        converged &= accepted
        eased = np.where(damping[active] < 1e-2, 0.0, 0.1 * damping[active])
        damping[active] = np.where(accepted, eased, np.maximum(10.0 * damping[active], 1e-2))
        gone = ~_holds(window, theta[active], model, active) & (steps[active] < MAX_STEPS)
        escaped[active] = gone & accepted
        steps[active] += escaped[active]
        free[active] = _free(theta[active], state.gradient[active], bounds[active], fit_std)
        step, damping[active] = _step(state, free, damping, active)
        done[active] = converged
        going = ~converged & ~escaped[active] & (steps[active] < MAX_STEPS)
        going &= damping[active] < 1e10
        active, step = active[going], step[going]
        if not len(active):
            break
        steps[active] += 1
        length2[active] = np.sum(step * state.gradient[active], axis=1)
        trial = _limited(theta[active], step, bounds[active])
        some = _rows_of(window, active)
        trial_score = _score(some, bins.dark[active], trial, model)
        least = state.objective[active] - 1e-12 * np.abs(state.objective[active])
        accepted = trial_score.objective >= least
    done |= length2 < GOOD_ENOUGH * unit
    covariance = _covariance(window, bins, theta, state, free, model)
    found = Fit(
        theta, state.objective, done, steps, free[:, -2], covariance,
        *_goodness(window, theta, model),
    )  # fmt: skip
    return found, escaped


def _rows_of(window: Window, index: Indices) -> Window:
    if len(index) == len(window.m):
        return window
    return Window(*(getattr(window, name)[index] for name in window.__dataclass_fields__))


def _holds(window: Window, theta: Floats, model: Model, index: Indices) -> Bools:
    """True where the window holds all that was recorded of every pulse."""
    centres, reach = theta[:, : theta.shape[1] // 2 - 1], model.reach * theta[:, -2]
    begin, end = window.known[index].T
    held: Bools = (centres.min(axis=1) - reach >= begin) & (centres.max(axis=1) + reach <= end)
    return held


def _free(theta: Floats, gradient: Floats, bounds: Floats, fit_std: bool) -> Bools:
    """The free parameters: those at a bound and pushed against it are not."""
    free = np.ones(theta.shape, dtype=bool)
    std, push = theta[:, -2], gradient[:, -2]
    free[:, -2] = fit_std & ~((std <= bounds[:, 0]) & (push < 0.0))
    free[:, -2] &= ~((std >= bounds[:, 1]) & (push > 0.0))
    free[:, -1] = ~((theta[:, -1] <= bounds[:, 2]) & (gradient[:, -1] < 0.0))
    return free


def _scaled(information: Floats, free: Bools) -> tuple[Floats, Floats, Bools]:
    """Information scaled to a unit diagonal, unit rows for what is not free; scale; regular?"""
    diagonal = np.diagonal(information, axis1=1, axis2=2)
    fine = np.all(~free | (diagonal > 0.0), axis=1) & np.isfinite(information).all(axis=(1, 2))
    scale = np.where(free & fine[:, None], 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1)), 0.0)
    matrix = np.where(fine[:, None, None], information, 0.0)
    matrix = matrix * scale[:, :, None] * scale[:, None, :]
    i = np.arange(information.shape[1])
    matrix[:, i, i] = 1.0
    return matrix, scale, fine


def _step(state: _Score, free: Bools, damping: Floats, index: Indices) -> tuple[Floats, Floats]:
    """Marquardt's step, and the damping that made the information regular (1e10: none did)."""
    matrix, scale, fine = _scaled(state.information[index], free[index])
    least = np.linalg.eigvalsh(matrix)[:, 0]
    damping = np.where(fine, damping[index], 1e10)
    while (singular := (least + damping <= 1e-12) & (damping < 1e10)).any():
        damping = np.where(singular, np.maximum(10.0 * damping, 1e-3), damping)
    i = np.arange(matrix.shape[1])
    matrix[:, i, i] += damping[:, None]
    right = state.gradient[index] * scale
    right = np.where(np.isfinite(right), right, 0.0)
    return np.linalg.solve(matrix, right[..., None])[..., 0] * scale, damping


def _limited(theta: Floats, step: Floats, bounds: Floats) -> Floats:
    """Take a step: std at most doubles or halves, photons shrink to a third, centres move 2 std."""
    n_pulses = theta.shape[1] // 2 - 1
    std, trial = theta[:, -2], theta + step
    most = 2.0 * std[:, None]
    trial[:, :n_pulses] = theta[:, :n_pulses] + np.clip(step[:, :n_pulses], -most, most)
    photons = slice(n_pulses, 2 * n_pulses)
    trial[:, photons] = np.maximum(trial[:, photons], theta[:, photons] / 3.0)
    trial[:, -2] = np.clip(np.clip(trial[:, -2], 0.5 * std, 2.0 * std), bounds[:, 0], bounds[:, 1])
    trial[:, -1] = np.maximum(trial[:, -1], bounds[:, 2])
    return trial


def _covariance(
    window: Window, bins: Bins, theta: Floats, state: _Score, free: Bools, model: Model
) -> Floats:
    """Covariance of theta; NaN where the information is singular.

    Poisson likelihood: inverse of the expected information. Least squares: sandwich, with the
    model's variance for counts and the residuals' for scaled intensities. A background at zero
    gets the standard deviation of one count over the whole range; a std at its bound gets its own
    size.
    """
    matrix, scale, fine = _scaled(state.information, free)
    fine &= np.linalg.eigvalsh(matrix)[:, 0] > 1e-12
    matrix[~fine] = np.eye(theta.shape[1])
    covariance = np.linalg.inv(matrix) * scale[:, :, None] * scale[:, None, :]
    if not model.poisson:
        expected, slope, _ = expected_in(window, theta, model)
        variance, spread = np.maximum(expected, 0.0) * window.lit, np.ones(len(theta))
        if not model.counted:
            live = window.lit.sum(axis=1)
            variance = (window.counts - expected) ** 2 * window.lit
            spread = live / np.maximum(live - theta.shape[1], 1)
        meat = (slope * variance[:, None]) @ slope.swapaxes(1, 2)
        covariance = spread[:, None, None] * (covariance @ meat @ covariance)
    whole = bins.exposure.sum(axis=1) + bins.dark[:, 1]
    covariance[:, -1, -1] = np.where(free[:, -1], covariance[:, -1, -1], 1.0 / whole**2)
    covariance[:, -2, -2] = np.where(free[:, -2], covariance[:, -2, -2], theta[:, -2] ** 2)
    covariance[~fine] = np.nan
    return np.asarray(covariance)


def _goodness(window: Window, theta: Floats, model: Model) -> tuple[Floats, Floats, Floats, Floats]:
    """chi2, chi2_bins, deviate and held of `Fit`."""
    expected, _, held = expected_in(window, theta, model)
    counted = window.lit & (expected >= MIN_EXPECTED)
    rich = window.lit & (expected >= 1.0)
    weight = 1.0 / np.where(counted, expected, 1.0)
    term = (window.counts - expected) ** 2 * weight
    sums = [(term * counted), counted, (term * rich), rich, (2.0 + weight) * rich]
    chi2, n_bins, rich_chi2, n_rich, variance = (np.sum(x, axis=1, dtype=float) for x in sums)
    if model.poisson:
        counts, exposure, n_out, squares, inverse = window.outside.T
        background = theta[:, -1]
        out = background * exposure
        term_out = squares / background - 2.0 * counts + out
        some = ~window.whole & (out >= MIN_EXPECTED * n_out)
        many = ~window.whole & (out >= n_out)
        chi2, n_bins = chi2 + some * term_out, n_bins + some * n_out
        rich_chi2, n_rich = rich_chi2 + many * term_out, n_rich + many * n_out
        variance = variance + many * (2.0 * n_out + inverse / background)
    inside = np.sum(held * window.lit[:, None], axis=2).min(axis=1)
    return chi2, n_bins, _deviate(rich_chi2, n_rich, variance), inside


def _deviate(chi2: Floats, expected: Floats, variance: Floats) -> Floats:
    """Standard normal deviate as unlikely as a chi2 of given mean and variance.

    Wilson & Hilferty (1931) on the scaled chi2 of the same two moments.
    """
    some = expected > 0.0
    mean = np.where(some, expected, 1.0)
    narrow = np.where(some, variance, 1.0) / (9.0 * mean * mean)
    return np.where(some, (np.cbrt(chi2 / mean) - (1.0 - narrow)) / np.sqrt(narrow), 0.0)
