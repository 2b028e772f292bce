"""Where a leg lies between the pixels: from how its light is shared among them.

Takes the counts of the pixels about each leg, gives the line of the leg in the picture to a
small fraction of a pixel, the width of the spot, and the strength of the light along the leg.
The strength is unknown and uneven, so it is fitted with it: log-strength is a spline along the
leg, one knot every three pixels, or every one and a half where the light asks for it; across the
leg the counts follow the spot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import block_diag

from lightflight.reconstruct.model.information import ascend
from lightflight.reconstruct.model.strength import (
    DENSE_KNOT_SPACING_PX,
    KNOT_SPACING_PX,
    LOG_SPOT_RANGE,
    SPOT_PRIOR,
    knots_over,
    span_of_knots,
)
from lightflight.units import MEDIAN_CHI2, std_from_mad

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_OFFSET_PRIOR_PX = 1.0
"""A line is looked for about where it is expected; few pixels must not throw it far, px."""

_STRENGTH_PRIOR_LN = 13.0
"""How far the light on a line may be from its brightest pixels nearby, ln: pixels on one side of a
line cannot tell a near line from a far one that is brighter without end. Pixels that are five stds
off have e^-13 of the light. A line that twelve pixels see from one side is right and its error true
from 5 to 13, a leg of six pixels is lost at 7, 10 and 17 and found at 13, 15 and 20."""

_MOST_LINE_STEPS = 40
"""Most steps of the fit of lines; what is left then is far below the counting noise."""

_MOST_LEFT = 1.0 / 3.0
"""Denser knots must leave less than this share of the scatter: they left 0.03 to 0.26 of that of
uneven light, and 0.5 to 1.3 where lines bow or a path is wrong."""

_PLACES_AT_ONCE = 64
"""Places of a kink that are tried together."""


@dataclass(frozen=True, eq=False)
class LineData:
    """Photon counts of the pixels about one leg.

    Attributes
    ----------
    along_px : array of float, shape (n,)
        Position of the pixel's centre along the line, px.
    across_px : array of float, shape (n,)
        Distance of the centre from the line, px, positive to the right of the flight.
    photons : array of float, shape (n,)
        Photons of this leg in the pixel; may be negative by chance.
    empty_variance : array of float, shape (n,)
        Variance of `photons` where there is no light.
    n_offsets : int, optional
        Places at which the line may lie aside from where it is expected: two of a straight leg, as
        many more as the picture of a bent one has numbers.
    """

    along_px: Floats
    across_px: Floats
    photons: Floats
    empty_variance: Floats
    n_offsets: int = 2


_OF_PIXELS = ("along_px", "across_px", "photons", "empty_variance")
"""What `LineData` holds pixel by pixel."""

_NO_LIGHT = -60.0
"""Log of the photons of a leg that nobody sees: below the least that a double tells from none."""


@dataclass(frozen=True, eq=False)
class LineFit:
    """Line of one leg relative to the line it was measured about.

    Attributes
    ----------
    offset_px : array of float, shape (a,)
        Distance of the true line from the assumed one at the anchors, two of a straight leg; px.
    offset_covariance : array of float, shape (a, a)
        px^2.
    anchors_along_px : array of float, shape (a,)
        Where along the line the anchors are, px.
    spot_std_px : float
        Standard deviation of the spot (optics and active area), px.
    spline : BSpline
        Log of the photons per pixel on the line, against `along_px`.
    spline_covariance : array of float, shape (k, k)
        Of its coefficients, ln^2.
    knot_spacing_px : float
        Largest distance of its knots, px.
    excess_variance : float
        Chi-square per degree of freedom; the covariance is already widened by it where > 1.
    log_scatter : float
        Pixel-to-pixel scatter of ln(photons) beyond counting noise: uneven efficiency, or a spot of
        another shape than assumed.
    bend_places_px : array of float, shape (b,)
        Places along the line at which a kink was looked for, px.
    bend_chi2_at : array of float, shape (b,)
        Chi-square that a kink there would gain (one number each; score test).
    """

    offset_px: Floats
    offset_covariance: Floats
    anchors_along_px: Floats
    spot_std_px: float
    spline: BSpline
    spline_covariance: Floats
    knot_spacing_px: float
    excess_variance: float
    log_scatter: float
    bend_places_px: Floats
    bend_chi2_at: Floats

    @property
    def bend_chi2(self) -> float:
        """Chi-square of the most significant kink."""
        return float(self.bend_chi2_at.max(initial=0.0))

    def log_slope(self, along_px: Floats) -> Floats:
        """D ln(strength) / d(along), per px; zero outside the fitted range."""
        low, high = span_of_knots(self.spline.t)
        inside = (along_px >= low) & (along_px <= high)
        slope = self.spline.derivative()(np.clip(along_px, low, high))
        return np.where(inside, slope, 0.0)


def dark_line(spot_px: float) -> LineFit:
    """Of a leg that no pixel shows: nothing is lit, nothing is held to it.

    Parameters
    ----------
    spot_px : float
        Standard deviation of the spot, px.

    Returns
    -------
    LineFit
        Whose strength is that of no light.
    """
    none, even = np.empty(0), BSpline(np.repeat([0.0, 1.0], 4), np.full(4, _NO_LIGHT), 3)
    return LineFit(
        np.zeros(2), np.eye(2), np.array([0.0, 1.0]), spot_px, even, np.zeros((4, 4)), 1.0, 1.0,
        0.0, none, none,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Problem:
    """Data of all legs in one stack; parameters: spline of each leg, two offsets each, log spot.

    Each pixel is touched by seven of them alone: four of the cubic spline, its leg's two offsets,
    and the spot. Bent legs have more offsets, and where there is one w is the most that any has;
    columns that a leg does not fill name the spot, with a share of zero.

    Attributes
    ----------
    data : LineData
        (n,) each, leg after leg.
    pixels : list of slice
        Where each leg's pixels stand in `data`.
    starts : list of int
        Where each leg's parameters start; last, where the spot's stands.
    spacing_px : list of float
        Largest distance of each leg's knots, px.
    knots : list of array of float
        Knots of each leg's log-strength, px along it.
    anchors : list of array of float
        Where along each leg its offsets are taken, px.
    columns : array of int, shape (n, 5 + w)
        The parameters that touch each pixel.
    basis : array of float, shape (n, 4)
        Values of the splines.
    lever : array of float, shape (n, w)
        Share of the leg's offsets.
    precision : array of float, shape (p, p)
        Of the priors.
    expected : array of float, shape (p,)
        What the priors expect.
    """

    data: LineData
    pixels: list[slice]
    starts: list[int]
    spacing_px: list[float]
    knots: list[Floats]
    anchors: list[Floats]
    columns: Indices
    basis: Floats
    lever: Floats
    precision: Floats
    expected: Floats

    @cached_property
    def cells(self) -> Indices:
        """(49 n,), places in the flattened information of each pixel's products."""
        size = self.starts[-1] + 1
        cells: Indices = (
            self.columns[:, :, np.newaxis] * size + self.columns[:, np.newaxis]
        ).ravel()
        return cells


def fit_lines(data: list[LineData]) -> list[LineFit]:
    """Line, spot and strength of every leg in one fit (the spot is common to all).

    Fisher scoring for Poisson counts with a logarithmic link, damped; pixels that disagree by
    more than chance allows are left out after a first pass. Where a leg's counts scatter more than
    chance allows, knots twice as dense are tried on it, and stay if they explain the scatter.

    Parameters
    ----------
    data : list of LineData
        Counts about each leg.

    Returns
    -------
    list of LineFit
        One per leg.

    Notes
    -----
    Expected photons of a pixel at s along and y across the line are exp(B(s) - (y - y0(s))^2 / 2
    v), B a cubic spline and v the variance of the spot (method.md, What the counts say).
    """
    usual = _fitted(_problem(data, [KNOT_SPACING_PX] * len(data)))
    spacing = [DENSE_KNOT_SPACING_PX if fit.log_scatter > 0.0 else KNOT_SPACING_PX for fit in usual]
    if min(spacing) == KNOT_SPACING_PX:
        return usual
    dense = _fitted(_problem(data, spacing))
    left, there = (_scatter_of_all(fits, data) for fits in (dense, usual))
    return dense if left < _MOST_LEFT * there else usual


def _scatter_of_all(fits: list[LineFit], data: list[LineData]) -> float:
    """Chi-square of all legs beyond one a degree of freedom."""
    return sum(
        len(d.photons) * max(0.0, fit.excess_variance - 1.0)
        for fit, d in zip(fits, data, strict=True)
    )


def _fitted(problem: _Problem) -> list[LineFit]:
    stacked = problem.data
    start = _first_guess(problem)
    problem = replace(problem, expected=_expected(problem, start))
    parameters = _scored(problem, start, np.ones(len(stacked.photons)))
    mean, _ = _model(problem, parameters)
    scaled = np.abs(stacked.photons - mean)
    scaled /= np.sqrt(np.maximum(mean, 0.3) + stacked.empty_variance)
    weights = np.empty(len(scaled))
    for here in problem.pixels:
        spread = max(1.0, std_from_mad(float(np.median(scaled[here]))))
        # Six times the scatter that is there: hot pixels and other light, not the spot's own shape.
        weights[here] = scaled[here] < 6.0 * spread
    parameters = _scored(problem, parameters, weights)
    return _results(problem, parameters, weights)


def _problem(data: list[LineData], spacing_px: list[float]) -> _Problem:
    pixels: list[slice] = []
    starts, knots, anchors = [0], [], []
    columns, bases, levers, stiff = [], [], [], []
    for d, spacing in zip(data, spacing_px, strict=True):
        # Knots only where there is light: a dark end would leave its coefficients to chance.
        lit = d.along_px[d.photons > 3.0 * np.sqrt(d.empty_variance + 1.0)]
        lit = lit if len(lit) > 1 else d.along_px
        low, high = float(lit.min()) - 0.5, float(lit.max()) + 0.5
        knot = knots_over(low, high, spacing)
        anchor = _anchors_between(low, high, d.n_offsets)
        n, n_spline = len(d.photons), len(knot) - 4
        splines = BSpline.design_matrix(np.clip(d.along_px, low, high), knot, 3)
        offsets = np.tile(n_spline + np.arange(d.n_offsets), (n, 1))
        columns.append(starts[-1] + np.hstack((splines.indices.reshape(n, 4), offsets)))
        bases.append(splines.data.reshape(n, 4))
        levers.append(_levers(d.along_px, anchor))
        stiff.append(_leg_precision(n_spline, d.n_offsets))
        knots.append(knot)
        anchors.append(anchor)
        first = pixels[-1].stop if pixels else 0
        pixels.append(slice(first, first + n))
        starts.append(starts[-1] + n_spline + d.n_offsets)
    touched = _filled(columns, starts[-1])
    return _Problem(
        data=_joined(data),
        pixels=pixels,
        starts=starts,
        spacing_px=spacing_px,
        knots=knots,
        anchors=anchors,
        columns=np.column_stack((touched, np.full(len(touched), starts[-1]))),
        basis=np.vstack(bases),
        lever=_filled(levers, 0.0),
        precision=block_diag(*stiff, np.full((1, 1), SPOT_PRIOR[1] ** -2.0)),
        expected=np.zeros(starts[-1] + 1),
    )


def _joined(data: list[LineData]) -> LineData:
    """Pixels of all legs in one table, leg after leg."""
    along, across, photons, empty = (
        np.concatenate([getattr(d, name) for d in data]) for name in _OF_PIXELS
    )
    return LineData(along, across, photons, empty)


def _filled(parts: list[NDArray[Any]], value: float) -> NDArray[Any]:
    """Tables one below the other, narrow ones filled up to the right with a value."""
    width = max(part.shape[1] for part in parts)
    return np.vstack(
        [
            np.pad(part, ((0, 0), (0, width - part.shape[1])), constant_values=value)
            for part in parts
        ]
    )


def _anchors_between(low: float, high: float, n: int) -> Floats:
    """Where along a leg its n offsets are taken, px."""
    if n == 2:
        # A fifth in from both ends: there the two offsets are nearly independent.
        return np.array([low + 0.2 * (high - low), high - 0.2 * (high - low)])
    # Chebyshev's places: a polynomial through them does not run away between.
    inside = 0.5 - 0.5 * np.cos(np.pi * (np.arange(n) + 0.5) / n)
    return low + inside * (high - low)


def _levers(along_px: Floats, anchors: Floats) -> Floats:
    """(n, a), share of each anchor's offset in the line at places (n,): Lagrange's polynomials."""
    if len(anchors) == 2:
        share = (along_px - anchors[0]) / (anchors[1] - anchors[0])
        return np.column_stack((1 - share, share))
    powers = np.vander((anchors - anchors[0]) / (anchors[-1] - anchors[0]))
    places = np.vander((along_px - anchors[0]) / (anchors[-1] - anchors[0]), len(anchors))
    shares: Floats = np.linalg.solve(powers.T, places.T).T
    return shares


def _leg_precision(n_spline: int, n_offsets: int) -> Floats:
    """Precision (n + a, n + a) of the priors on one leg's strength and offsets.

    A dark stretch leaves its strength undefined: it is held weakly to its neighbours.
    """
    bend = 0.05 * np.diff(np.eye(n_spline), 2, axis=0)
    level = np.eye(n_spline) / _STRENGTH_PRIOR_LN**2
    return block_diag(bend.T @ bend + level, np.eye(n_offsets) / _OFFSET_PRIOR_PX**2)


def _expected(problem: _Problem, guess: Floats) -> Floats:
    """What the priors expect: lines where they are, a usual spot, the light that is guessed."""
    pull = guess / _STRENGTH_PRIOR_LN**2
    for stop, anchors in zip(problem.starts[1:], problem.anchors, strict=True):
        pull[stop - len(anchors) : stop] = 0.0
    pull[-1] = SPOT_PRIOR[0] * problem.precision[-1, -1]
    # Level and smoothness are two priors on one strength: this is where they agree.
    expected: Floats = np.linalg.solve(problem.precision, pull).astype(np.float64, copy=False)
    return expected


def _first_guess(problem: _Problem) -> Floats:
    parameters = np.zeros(problem.starts[-1] + 1)
    parameters[-1] = SPOT_PRIOR[0]
    for k, here in enumerate(problem.pixels):
        along, across = problem.data.along_px[here], problem.data.across_px[here]
        photons = problem.data.photons[here]
        low, high = span_of_knots(problem.knots[k])
        bins = np.clip(((along - low) // 1.5).astype(int), 0, None)
        brightest = np.zeros(bins.max() + 1)
        # The brightest of each stretch lies nearest to the line: its light is the strength there.
        np.maximum.at(brightest, bins, np.maximum(photons, 0.3))
        target = np.log(brightest[bins])
        on_line = np.abs(across) < 1.0
        n_offsets = len(problem.anchors[k])
        basis = _of_leg(problem, k, problem.basis)[on_line, : -1 - n_offsets]
        ridge = 1e-3 * np.eye(basis.shape[1])
        offsets = problem.starts[k + 1] - n_offsets
        parameters[problem.starts[k] : offsets] = np.linalg.solve(
            basis.T @ basis + ridge, basis.T @ target[on_line]
        )
        # Centre of mass of the light: near enough for Fisher scoring to finish.
        weight = np.maximum(photons, 0.0) * ((along > low) & (along < high))
        if weight.sum() > 0:
            lever = problem.lever[here, :n_offsets]
            normal = lever.T @ (weight[:, np.newaxis] * lever) + 1e-6 * np.eye(n_offsets)
            parameters[offsets : problem.starts[k + 1]] = np.linalg.solve(
                normal, lever.T @ (weight * across)
            )
    return parameters


def _of_leg(problem: _Problem, k: int, values: Floats) -> Floats:
    """Values (n, up to 5 + w) by pixel, over leg k's parameters and the spot: (n_k, p_k + 1)."""
    here = problem.pixels[k]
    start, stop = problem.starts[k], problem.starts[k + 1]
    columns = np.minimum(problem.columns[here, : values.shape[1]], stop) - start
    spread = np.zeros((len(columns), stop - start + 1))
    np.put_along_axis(spread, columns, values[here], axis=1)
    return spread


def _model(problem: _Problem, parameters: Floats) -> tuple[Floats, Floats]:
    """Expected photons (n,), and (n, 5 + w): d ln(expected) / d(the parameters that touch each)."""
    own = parameters[problem.columns]
    spot = np.exp(parameters[-1])
    u = (problem.data.across_px - np.sum(problem.lever * own[:, 4:-1], axis=1)) / spot
    log_mean = np.sum(problem.basis * own[:, :4], axis=1) - 0.5 * u**2
    gradient = np.column_stack((problem.basis, (u / spot)[:, np.newaxis] * problem.lever, u**2))
    return np.exp(np.clip(log_mean, -60, 40)), gradient


def _summed(places: Indices, values: Floats, size: int) -> Floats:
    """Sums of `values` by place; (size,)."""
    sums: Floats = np.bincount(places, values.ravel(), size).astype(np.float64, copy=False)
    return sums


@dataclass(frozen=True, eq=False)
class _Slope:
    """The likelihood of the counts about some parameters, with its priors."""

    value: float
    score: Floats
    information: Floats


def _slope_at(problem: _Problem, parameters: Floats, weights: Floats) -> _Slope:
    data, size = problem.data, problem.starts[-1] + 1
    mean, gradient = _model(problem, parameters)
    variance = mean + data.empty_variance + 1e-3
    weight = weights * mean / variance
    weighted = gradient * (weight * mean)[:, np.newaxis]
    products = weighted[:, :, np.newaxis] * gradient[:, np.newaxis]
    information = _summed(problem.cells, products, size**2).reshape(size, size)
    pulls = gradient * (weight * (data.photons - mean))[:, np.newaxis]
    score = _summed(problem.columns.ravel(), pulls, size)
    # Shifted Poisson: counts plus background variance have nearly equal mean and variance.
    shifted = np.maximum(data.photons + data.empty_variance, 0.0)
    ratio = np.where(shifted > 0, shifted / variance, 1.0)
    value = -np.sum(weights * (shifted * np.log(ratio) - (shifted - variance)))
    off = parameters - problem.expected
    held = problem.precision @ off
    information = information + problem.precision + 1e-9 * np.eye(size)
    return _Slope(float(value - 0.5 * off @ held), score - held, information)


def _scored(problem: _Problem, parameters: Floats, weights: Floats) -> Floats:
    def moved(at: Floats, _: _Slope, step: Floats) -> Floats:
        trial = at + step
        # The spot enters by an exponential: a large step of its log is never right.
        spot = at[-1] + np.clip(step[-1], -0.5, 0.5)
        trial[-1] = np.clip(spot, *LOG_SPOT_RANGE)
        return trial

    return ascend(
        parameters,
        lambda at: _slope_at(problem, at, weights),
        moved,
        most_steps=_MOST_LINE_STEPS,
    )[0]


def _results(problem: _Problem, parameters: Floats, weights: Floats) -> list[LineFit]:
    information = _slope_at(problem, parameters, weights).information
    # Not scaled: all parameters are logarithms or px, of one size.
    covariance = np.linalg.pinv(information, hermitian=True)
    mean, gradient = _model(problem, parameters)
    variance = mean + problem.data.empty_variance + 1e-3
    residual = problem.data.photons - mean
    fits = []
    for k, here in enumerate(problem.pixels):
        start, stop = problem.starts[k], problem.starts[k + 1]
        # Dark pixels agree with any model; they must not hide that the lit ones do not.
        telling = (weights[here] > 0) & (variance[here] > 0.5)
        dof = max(1, int(telling.sum()) - (stop - start + 1))
        excess = float(np.sum((residual[here] ** 2 / variance[here])[telling])) / dof
        n_offsets = len(problem.anchors[k])
        offsets = slice(stop - n_offsets, stop)
        own = np.r_[start:stop, len(parameters) - 1]
        places, chi2 = _bends(
            _Kinkable(
                problem.data.along_px[here],
                gradient[here, 4 : 4 + n_offsets].sum(axis=1),
                _of_leg(problem, k, gradient),
                mean[here],
                residual[here],
                variance[here],
                weights[here],
            ),
            span_of_knots(problem.knots[k]),
            covariance[np.ix_(own, own)],
        )
        widened: Floats = (max(1.0, excess) * covariance).astype(np.float64, copy=False)
        fits.append(
            LineFit(
                offset_px=parameters[offsets].copy(),
                offset_covariance=widened[offsets, offsets],
                anchors_along_px=problem.anchors[k],
                spot_std_px=float(np.exp(parameters[-1])),
                spline=BSpline(problem.knots[k], parameters[start : offsets.start], 3),
                spline_covariance=widened[start : offsets.start, start : offsets.start],
                knot_spacing_px=problem.spacing_px[k],
                excess_variance=excess,
                log_scatter=_log_scatter(residual[here], mean[here], variance[here], weights[here]),
                bend_places_px=places,
                bend_chi2_at=chi2,
            )
        )
    return fits


def _log_scatter(residual: Floats, mean: Floats, variance: Floats, weights: Floats) -> float:
    """Std of ln(photons / mean) beyond counting noise, from the pixels bright enough to show it."""
    telling = (weights > 0) & (mean > 30.0)
    if telling.sum() < 6:
        return 0.0
    ratio = (residual[telling] / mean[telling]) ** 2
    expected = variance[telling] / mean[telling] ** 2
    # The median of a chi-square of one degree; chance alone passes 1.5 in few recordings.
    excess = float(np.median(ratio / expected)) / MEDIAN_CHI2
    if excess < 1.0 + 4.0 / np.sqrt(telling.sum()):
        return 0.0
    return float(np.sqrt(max(0.0, np.median(ratio - MEDIAN_CHI2 * expected) / MEDIAN_CHI2)))


@dataclass(frozen=True, eq=False)
class _Kinkable:
    """A fitted leg, as the test for kinks needs it; n pixels, p parameters of leg and spot.

    Attributes
    ----------
    along_px : array of float, shape (n,)
    by_offset : array of float, shape (n,)
        D ln(expected) / d(distance of the line), per px.
    gradient : array of float, shape (n, p)
        D ln(expected) / d(parameters).
    mean : array of float, shape (n,)
        Expected photons.
    residual : array of float, shape (n,)
        Photons seen beyond those expected.
    variance : array of float, shape (n,)
        Of the photons.
    weights : array of float, shape (n,)
        1, or 0 for pixels left out.
    """

    along_px: Floats
    by_offset: Floats
    gradient: Floats
    mean: Floats
    residual: Floats
    variance: Floats
    weights: Floats


def _bends(leg: _Kinkable, span: tuple[float, float], covariance: Floats) -> tuple[Floats, Floats]:
    """Score test of a kink of a leg's line at places two pixels or more from its ends."""
    places = np.arange(span[0] + 2.0, span[1] - 1.9, 1.0)
    weight = leg.weights * leg.mean / leg.variance
    chi2 = np.zeros(len(places))
    weighted = leg.gradient * (weight * leg.mean)[:, np.newaxis]
    for first in range(0, len(places), _PLACES_AT_ONCE):
        some = slice(first, first + _PLACES_AT_ONCE)
        beyond = np.maximum(leg.along_px[:, np.newaxis] - places[some], 0)
        kinks = leg.by_offset[:, np.newaxis] * beyond
        score = kinks.T @ (weight * leg.residual)
        crossed = weighted.T @ kinks
        information = (weight * leg.mean) @ kinks**2 - np.sum(crossed * (covariance @ crossed), 0)
        told = information > 1e-12
        chi2[some][told] = score[told] ** 2 / information[told]
    used = (leg.weights > 0) & (leg.variance > 0.5)
    scaled = leg.residual[used] ** 2 / leg.variance[used]
    # Judged against the scatter that is there: a bend itself adds to it, so by the median.
    spread = max(1.0, float(np.median(scaled)) / MEDIAN_CHI2) if len(scaled) else 1.0
    return places, chi2 / spread
