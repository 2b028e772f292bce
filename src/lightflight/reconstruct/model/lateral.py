"""Where a leg lies between the pixels: from how its light is shared among them.

Takes the counts of the pixels about each leg, gives the line of the leg in the picture to a
small fraction of a pixel, the width of the spot, and the strength of the light along the leg.
The strength is unknown and uneven, so it is fitted with it: log-strength is a spline along the
leg, one knot every three pixels, or every one and a half where the light asks for it; across the
leg the counts follow the spot. That is as wide as the lens and the beam make it where the leg is:
its log is a parabola along each leg, held weakly to one width for all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import block_diag
from scipy.optimize import minimize_scalar

from lightflight.reconstruct.model.information import ascend
from lightflight.reconstruct.model.kinks import LEAST_TELLING, Kinkable, bends_along
from lightflight.reconstruct.model.strength import (
    DENSE_KNOT_SPACING_PX,
    KNOT_SPACING_PX,
    LOG_SPOT_RANGE,
    SPOT_PRIOR,
    SpotAlong,
    knots_over,
    shares_of_anchors,
    span_of_knots,
)
from lightflight.units import std_from_mad

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_OFFSET_PRIOR_PX = 1.0
"""A line is looked for about where it is expected; few pixels must not throw it far, px."""

_STRENGTH_PRIOR_LN = 13.0
"""How far the light on a line may be from its brightest pixels nearby, ln: pixels on one side of a
line cannot tell a near line from a far one that is brighter without end. Pixels that are five stds
off have e^-13 of the light. A line that twelve pixels see from one side is right and its error true
from 5 to 13, a leg of six pixels is lost at 7, 10 and 17 and found at 13, 15 and 20."""

_OF_SPOT = 3
"""Parameters of a leg's own spot."""

_LOG_UNEQUAL = (-18.0, -3.8)
"""Log of the least and largest variance of the pixels' efficiencies that is looked for, ln^2: from
1e-4, which takes a hundred million photons to see, to 0.15. What scatters more is a bent line."""

_MOST_STDS = 6.0
"""Times the scatter that is there: hot pixels and other light, not the spot's own shape."""

_MOST_LINE_STEPS = 40
"""Most steps of the fit of lines; what is left then is far below the counting noise."""


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
        Standard deviation of the spot (optics and active area) that all legs have in common, px.
    spot : SpotAlong
        How this leg's own spot differs from the common one, about the same anchors.
    spline : BSpline
        Log of the photons per pixel on the line, against `along_px`.
    spline_covariance : array of float, shape (k, k)
        Of its coefficients, ln^2.
    knot_spacing_px : float
        Largest distance of its knots, px.
    excess_variance : float
        Chi-square per degree of freedom, unequal pixels counted; the covariance is already widened
        by it where > 1.
    log_scatter : float
        Pixel-to-pixel scatter of ln(photons) beyond counting noise: uneven efficiency, or a spot of
        another shape than assumed; the fit weighs pixels by it.
    bend_places_px : array of float, shape (b,)
        Places along the line at which a kink was looked for, px.
    bend_chi2_at : array of float, shape (b,)
        Chi-square that a kink there would gain (one number each; score test).
    """

    offset_px: Floats
    offset_covariance: Floats
    anchors_along_px: Floats
    spot_std_px: float
    spot: SpotAlong
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

    def spot_std_at(self, along_px: Floats) -> Floats:
        """Standard deviation of the spot along the leg, px; as at its ends outside."""
        along = np.clip(along_px, *span_of_knots(self.spline.t))
        varied: Floats = self.spot_std_px * np.exp(self.spot.log_at(along))
        return varied

    def light_slope(self, along_px: Floats, across_px: Floats) -> Floats:
        """D ln(strength) / d(along) as the mean time over a footprint asks for it, per px.

        Where the log of the spot grows by g per pixel, light from ahead reaches farther back than
        light from behind: that is worth g (2 + y^2 / v), y across the line and v the variance.
        """
        along = np.clip(along_px, *span_of_knots(self.spline.t))
        wide = 2.0 + (across_px / self.spot_std_at(along_px)) ** 2
        slope: Floats = self.log_slope(along_px) + self.spot.growth_at(along) * wide
        return slope

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
    even_spot = SpotAlong(np.array([0.0, 1.0]), np.zeros(3))
    none, even = np.empty(0), BSpline(np.repeat([0.0, 1.0], 4), np.full(4, _NO_LIGHT), 3)
    return LineFit(
        np.zeros(2), np.eye(2), np.array([0.0, 1.0]), spot_px, even_spot, even,
        np.zeros((4, 4)), 1.0, 1.0, 0.0, none, none,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Problem:
    """Data of all legs in one stack; parameters: spline of each leg, its two offsets and three
    numbers of its own spot, and last the log of the spot of all.

    Each pixel is touched by ten of them alone: four of the cubic spline, its leg's two offsets and
    three of its spot, and the spot of all. Bent legs have more offsets, and where there is one w is
    the most that any has; columns that a leg does not fill name the spot, with a share of zero.

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
    columns : array of int, shape (n, 8 + w)
        The parameters that touch each pixel.
    basis : array of float, shape (n, 4)
        Values of the splines.
    lever : array of float, shape (n, w)
        Share of the leg's offsets.
    spot_lever : array of float, shape (n, 3)
        Share of its spot's numbers.
    precision : array of float, shape (p, p)
        Of the priors.
    expected : array of float, shape (p,)
        What the priors expect.
    unequal : array of float, shape (n,)
        Variance of the pixel's own efficiency, ln^2.
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
    spot_lever: Floats
    precision: Floats
    expected: Floats
    unequal: Floats

    @cached_property
    def cells(self) -> Indices:
        """(100 n,), places in the flattened information of each pixel's products."""
        size = self.starts[-1] + 1
        cells: Indices = (
            self.columns[:, :, np.newaxis] * size + self.columns[:, np.newaxis]
        ).ravel()
        return cells


def fit_lines(data: list[LineData]) -> list[LineFit]:
    """Line, spot and strength of every leg in one fit (the spot is common to all).

    Fisher scoring for Poisson counts with a logarithmic link, damped; pixels that disagree by
    more than chance allows are left out after a first pass. Pixels of a leg are unequal by as much
    as its counts scatter beyond chance. Where they do, knots twice as dense are tried on it: light
    that is uneven along the leg is alike in pixels side by side, efficiencies are not.

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
    v(s)), B a cubic spline and v the variance of the spot; their variance is that mean mu and
    unequal^2 mu^2 (method.md, What the counts say).
    """
    usual, spoke = _fitted(_problem(data, [KNOT_SPACING_PX] * len(data)))
    spacing = [DENSE_KNOT_SPACING_PX if fit.log_scatter > 0.0 else KNOT_SPACING_PX for fit in usual]
    if min(spacing) == KNOT_SPACING_PX:
        return usual
    dense, speaks = _fitted(_problem(data, spacing))
    more = sum(len(fit.spline.c) for fit in dense) - sum(len(fit.spline.c) for fit in usual)
    return dense if speaks - spoke > _price(more, sum(len(d.photons) for d in data)) else usual


def _fitted(problem: _Problem) -> tuple[list[LineFit], float]:
    """The fit, and the log-likelihood of the counts with their scatter."""
    stacked = problem.data
    start = _first_guess(problem)
    problem = replace(problem, expected=_expected(problem, start))
    weights = np.ones(len(stacked.photons))
    parameters = _scored(problem, start, weights)
    # Bright pixels hold all there is to know until they are seen to be unequal: twice round.
    for _ in range(2):
        problem = replace(problem, unequal=_unequal(problem, parameters))
        weights = _without_strangers(problem, parameters)
        parameters = _scored(problem, parameters, weights)
    return _results(problem, parameters, weights), _log_likelihood(*_off(problem, parameters))


def _without_strangers(problem: _Problem, parameters: Floats) -> Floats:
    """(n,), 1, or 0 for pixels that agree with no leg."""
    residual, variance = _off(problem, parameters)
    scaled = np.abs(residual) / np.sqrt(variance)
    weights = np.empty(len(scaled))
    for here in problem.pixels:
        spread = max(1.0, std_from_mad(float(np.median(scaled[here]))))
        weights[here] = scaled[here] < _MOST_STDS * spread
    return weights


def _log_likelihood(residual: Floats, variance: Floats) -> float:
    """Of normal residuals, but for a constant; strangers among them count as they may at most."""
    squared = np.minimum(residual**2 / variance, _MOST_STDS**2)
    return -0.5 * float(np.sum(squared + np.log(variance)))


def _off(problem: _Problem, parameters: Floats) -> tuple[Floats, Floats]:
    """Photons seen beyond those expected, (n,), and their variance."""
    mean, _ = _model(problem, parameters)
    return problem.data.photons - mean, _variance(problem, mean)


def _variance(problem: _Problem, mean: Floats) -> Floats:
    """(n,), of the photons: counting noise, and what pixels are unequal by."""
    counted = mean + problem.data.empty_variance + 1e-3
    return counted * (1.0 + problem.unequal * counted)


def _unequal(problem: _Problem, parameters: Floats) -> Floats:
    """(n,), variance of the pixels' efficiencies that makes each leg's scatter likeliest, ln^2."""
    unequal = np.zeros(len(problem.data.photons))
    residual, counted = _off(replace(problem, unequal=unequal), parameters)
    for k, here in enumerate(problem.pixels):
        told = counted[here] > LEAST_TELLING
        n, noise = int(told.sum()), counted[here][told]
        fitted = problem.starts[k + 1] - problem.starts[k] + 1
        if n <= fitted:
            continue
        # What the fit took up of the scatter is put back.
        scatter = residual[here][told] * np.sqrt(n / (n - fitted))

        def unlikely(
            log_variance: float, scatter: Floats = scatter, noise: Floats = noise
        ) -> float:
            return -_log_likelihood(scatter, noise * (1.0 + np.exp(log_variance) * noise))

        found = minimize_scalar(unlikely, bounds=_LOG_UNEQUAL, method="bounded")
        if -found.fun > _log_likelihood(scatter, noise) + _price(1, n):
            unequal[here] = np.exp(found.x)
    return unequal


def _price(n_parameters: int, n_data: int) -> float:
    """Log-likelihood that parameters must gain: Schwarz, Ann. Stat. 6, 461 (1978)."""
    return 0.5 * n_parameters * float(np.log(n_data))


def _problem(data: list[LineData], spacing_px: list[float]) -> _Problem:
    pixels: list[slice] = []
    starts, knots, anchors = [0], [], []
    columns, bases, levers, stiff = [], [], [], []
    of_spot, spots = [], []
    for d, spacing in zip(data, spacing_px, strict=True):
        # Knots only where there is light: a dark end would leave its coefficients to chance.
        lit = d.along_px[d.photons > 3.0 * np.sqrt(d.empty_variance + 1.0)]
        lit = lit if len(lit) > 1 else d.along_px
        low, high = float(lit.min()) - 0.5, float(lit.max()) + 0.5
        knot = knots_over(low, high, spacing)
        anchor = _anchors_between(low, high, d.n_offsets)
        n, n_spline = len(d.photons), len(knot) - 4
        splines = BSpline.design_matrix(np.clip(d.along_px, low, high), knot, 3)
        offsets = starts[-1] + n_spline + np.tile(np.arange(d.n_offsets + _OF_SPOT), (n, 1))
        of_line = offsets[:, :-_OF_SPOT]
        columns.append(np.hstack((starts[-1] + splines.indices.reshape(n, 4), of_line)))
        of_spot.append(offsets[:, -_OF_SPOT:])
        bases.append(splines.data.reshape(n, 4))
        spot = SpotAlong(anchor[[0, -1]], np.zeros(3))
        levers.append(_levers(d.along_px, anchor))
        spots.append(spot.shares(d.along_px))
        stiff.append(_leg_precision(n_spline, d.n_offsets, spot))
        knots.append(knot)
        anchors.append(anchor)
        first = pixels[-1].stop if pixels else 0
        pixels.append(slice(first, first + n))
        starts.append(starts[-1] + n_spline + d.n_offsets + _OF_SPOT)
    touched = np.hstack((_filled(columns, starts[-1]), np.vstack(of_spot)))
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
        spot_lever=np.vstack(spots),
        precision=block_diag(*stiff, np.full((1, 1), SPOT_PRIOR[1] ** -2.0)),
        expected=np.zeros(starts[-1] + 1),
        unequal=np.zeros(sum(len(d.photons) for d in data)),
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
        return shares_of_anchors(along_px, anchors)
    powers = np.vander((anchors - anchors[0]) / (anchors[-1] - anchors[0]))
    places = np.vander((along_px - anchors[0]) / (anchors[-1] - anchors[0]), len(anchors))
    shares: Floats = np.linalg.solve(powers.T, places.T).T
    return shares


def _leg_precision(n_spline: int, n_offsets: int, spot: SpotAlong) -> Floats:
    """Precision (n + a + 3, n + a + 3) of the priors on one leg's strength, offsets and spot.

    A dark stretch leaves its strength undefined: it is held weakly to its neighbours.
    """
    bend = 0.05 * np.diff(np.eye(n_spline), 2, axis=0)
    level = np.eye(n_spline) / _STRENGTH_PRIOR_LN**2
    offsets = np.eye(n_offsets) / _OFFSET_PRIOR_PX**2
    return block_diag(bend.T @ bend + level, offsets, spot.precision)


def _expected(problem: _Problem, guess: Floats) -> Floats:
    """What the priors expect: lines where they are, a usual spot, the light that is guessed."""
    pull = guess / _STRENGTH_PRIOR_LN**2
    for stop, anchors in zip(problem.starts[1:], problem.anchors, strict=True):
        pull[stop - len(anchors) - _OF_SPOT : stop] = 0.0
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
        basis = _of_leg(problem, k, problem.basis)[on_line, : -1 - n_offsets - _OF_SPOT]
        ridge = 1e-3 * np.eye(basis.shape[1])
        offsets = problem.starts[k + 1] - n_offsets - _OF_SPOT
        parameters[problem.starts[k] : offsets] = np.linalg.solve(
            basis.T @ basis + ridge, basis.T @ target[on_line]
        )
        # Centre of mass of the light: near enough for Fisher scoring to finish.
        weight = np.maximum(photons, 0.0) * ((along > low) & (along < high))
        if weight.sum() > 0:
            lever = problem.lever[here, :n_offsets]
            normal = lever.T @ (weight[:, np.newaxis] * lever) + 1e-6 * np.eye(n_offsets)
            parameters[offsets : offsets + n_offsets] = np.linalg.solve(
                normal, lever.T @ (weight * across)
            )
    return parameters


def _of_leg(problem: _Problem, k: int, values: Floats) -> Floats:
    """Values (n, up to 8 + w) by pixel over leg k's parameters and the spot: (n_k, p_k + 1)."""
    here = problem.pixels[k]
    start, stop = problem.starts[k], problem.starts[k + 1]
    columns = np.minimum(problem.columns[here, : values.shape[1]], stop) - start
    spread = np.zeros((len(columns), stop - start + 1))
    np.put_along_axis(spread, columns, values[here], axis=1)
    return spread


def _model(problem: _Problem, parameters: Floats) -> tuple[Floats, Floats]:
    """Expected photons (n,), and (n, 8 + w): d ln(expected) / d(the parameters that touch each)."""
    own = parameters[problem.columns]
    log_spot = own[:, -1] + np.sum(problem.spot_lever * own[:, -1 - _OF_SPOT : -1], axis=1)
    spot = np.exp(np.clip(log_spot, *LOG_SPOT_RANGE))
    line = np.sum(problem.lever * own[:, 4 : -1 - _OF_SPOT], axis=1)
    u = (problem.data.across_px - line) / spot
    log_mean = np.sum(problem.basis * own[:, :4], axis=1) - 0.5 * u**2
    by_offset, by_spot = (u / spot)[:, np.newaxis], (u**2)[:, np.newaxis]
    gradient = np.hstack(
        (problem.basis, by_offset * problem.lever, by_spot * problem.spot_lever, by_spot)
    )
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
    variance = _variance(problem, mean)
    weight = weights * mean / variance
    weighted = gradient * (weight * mean)[:, np.newaxis]
    products = weighted[:, :, np.newaxis] * gradient[:, np.newaxis]
    information = _summed(problem.cells, products, size**2).reshape(size, size)
    pulls = gradient * (weight * (data.photons - mean))[:, np.newaxis]
    score = _summed(problem.columns.ravel(), pulls, size)
    # Shifted Poisson: counts plus background variance have nearly equal mean and variance.
    shifted = np.maximum(data.photons + data.empty_variance, 0.0)
    value = -np.sum(
        weights * _deviance(shifted, mean + data.empty_variance + 1e-3, problem.unequal)
    )
    off = parameters - problem.expected
    held = problem.precision @ off
    information = information + problem.precision + 1e-9 * np.eye(size)
    return _Slope(float(value - 0.5 * off @ held), score - held, information)


def _deviance(counts: Floats, mean: Floats, unequal: Floats) -> Floats:
    """(n,), half of it: of Poisson counts whose mean is itself unequal by chance (a gamma)."""
    ratio = np.where(counts > 0, counts / mean, 1.0)
    of_poisson = counts * np.log(ratio) - (counts - mean)
    if not unequal.any():
        return of_poisson
    v = np.where(unequal > 0, unequal, 1.0)
    of_gamma = (counts + 1.0 / v) * np.log1p(v * (counts - mean) / (1.0 + v * mean))
    return np.where(unequal > 0, counts * np.log(ratio) - of_gamma, of_poisson)


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
    residual, variance = _off(problem, parameters)
    # What the legs' own spots have in common is the common spot's.
    own = np.array([parameters[stop - _OF_SPOT : stop] for stop in problem.starts[1:]])
    common = float(own[:, :2].mean())
    fits = []
    for k, here in enumerate(problem.pixels):
        start, stop = problem.starts[k], problem.starts[k + 1]
        telling = (weights[here] > 0) & (variance[here] > LEAST_TELLING)
        dof = max(1, int(telling.sum()) - (stop - start + 1))
        excess = float(np.sum((residual[here] ** 2 / variance[here])[telling])) / dof
        n_offsets = len(problem.anchors[k])
        first = stop - _OF_SPOT - n_offsets
        offsets = slice(first, first + n_offsets)
        touched = np.r_[start:stop, len(parameters) - 1]
        places, chi2 = bends_along(
            Kinkable(
                problem.data.along_px[here],
                gradient[here, 4 : 4 + n_offsets].sum(axis=1),
                _of_leg(problem, k, gradient),
                mean[here],
                residual[here],
                variance[here],
                weights[here],
            ),
            span_of_knots(problem.knots[k]),
            covariance[np.ix_(touched, touched)],
        )
        widened: Floats = (max(1.0, excess) * covariance).astype(np.float64, copy=False)
        fits.append(
            LineFit(
                offset_px=parameters[offsets].copy(),
                offset_covariance=widened[offsets, offsets],
                anchors_along_px=problem.anchors[k],
                spot_std_px=float(np.exp(parameters[-1] + common)),
                spot=SpotAlong(problem.anchors[k][[0, -1]], own[k] - [common, common, 0.0]),
                spline=BSpline(problem.knots[k], parameters[start : offsets.start], 3),
                spline_covariance=widened[start : offsets.start, start : offsets.start],
                knot_spacing_px=problem.spacing_px[k],
                excess_variance=excess,
                log_scatter=float(np.sqrt(problem.unequal[here].max(initial=0.0))),
                bend_places_px=places,
                bend_chi2_at=chi2,
            )
        )
    return fits
