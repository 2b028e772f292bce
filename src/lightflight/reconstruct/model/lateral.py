"""Where a leg lies between the pixels: from how its light is shared among them.

Takes the counts of the pixels about each leg, gives the line of the leg in the picture to a
small fraction of a pixel, the width of the spot, and the strength of the light along the leg.
The strength is unknown and uneven, so it is fitted with it: log-strength is a spline along the
leg, one knot every three pixels, or every one and a half where the light asks for it; across the
leg the counts follow the spot. While legs are looked for, one spot of all and pixels alike are good
enough. The last, fine fit knows better: a spot is as wide as lens and beam make it where the leg
is, its log a parabola along each leg, held weakly to one width for all; and pixels are as unequal
as their counts show.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lightflight.reconstruct.model.information import ascend
from lightflight.reconstruct.model.kinks import LEAST_TELLING, Kinkable, bends_along
from lightflight.reconstruct.model.line_problem import (
    OF_SPOT,
    Expected,
    LineData,
    LineProblem,
    expected_by_priors,
    expected_photons,
    first_guess,
    over_leg,
    problem_of,
)
from lightflight.reconstruct.model.spot import SeenLine, seen_line
from lightflight.reconstruct.model.strength import (
    DENSE_KNOT_SPACING_PX,
    KNOT_SPACING_PX,
    LOG_SPOT_RANGE,
    SpotAlong,
    span_of_knots,
)
from lightflight.reconstruct.model.unequal import (
    MOST_STDS,
    half_deviance,
    likeliest_unequal,
    log_likelihood,
    median_scatter,
    price,
    rough_unequal,
    variance_of_counts,
)
from lightflight.units import std_from_mad

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_MOST_LEFT = 1.0 / 3.0
"""Denser knots must leave less than this share of the scatter: they left 0.03 to 0.26 of that of
uneven light, and 0.5 to 1.3 where lines bow or a path is wrong."""

_LEAST_MEAN = 0.3
"""Photons: a pixel that expects fewer is no stranger for having counted one."""

_ROUNDS = 2
"""Times that pixels are asked how unequal they are; then strangers among them are known."""

_MOST_LINE_STEPS = 40
"""Most steps of the fit of lines; what is left then is far below the counting noise."""

_AREA_ROUNDS = 4
"""Times that the active area is asked for: the first step overshoots by a third, the fourth is
below a percent."""

_LEAST_ACTIVE_PX = 0.3
"""A smaller active area changes no spot that pixels can show."""

_NOTHING = 1e-9
"""Information of an active area of which counts tell nothing, as a share of what it would be."""

_NO_LIGHT = -60.0
"""Log of the photons of a leg that nobody sees: below the least that a double tells from none."""


@dataclass(frozen=True, eq=False)
class ActiveArea:
    """The square active area that the spots of all legs show, and how a leg's line follows it.

    Attributes
    ----------
    side_px : float
        In pitches; 0: Gaussian spots.
    fourth_std : float
        Standard deviation of the fourth power of that, as the counts tell it.
    offset_by_fourth : array of float, shape (a,)
        D(offsets of the line) / d(fourth power), px.
    """

    side_px: float
    fourth_std: float
    offset_by_fourth: Floats


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
    area : ActiveArea
        Active area of the pixels.
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
    skewness, skewness_std : float
        Of the spot across the line, as the counts ask for it where all else is free, and its error;
        infinite where the line was not measured finely.
    """

    offset_px: Floats
    offset_covariance: Floats
    anchors_along_px: Floats
    spot_std_px: float
    spot: SpotAlong
    spline: BSpline
    spline_covariance: Floats
    area: ActiveArea
    knot_spacing_px: float
    excess_variance: float
    log_scatter: float
    bend_places_px: Floats
    bend_chi2_at: Floats
    skewness: float = 0.0
    skewness_std: float = np.inf

    @property
    def bend_chi2(self) -> float:
        """Chi-square of the most significant kink."""
        return float(self.bend_chi2_at.max(initial=0.0))

    def spot_std_at(self, along_px: Floats) -> Floats:
        """Standard deviation of the spot along the leg, px; as at its ends outside."""
        along = np.clip(along_px, *span_of_knots(self.spline.t))
        varied: Floats = self.spot_std_px * np.exp(self.spot.log_at(along))
        return varied

    def seen(self, along_px: Floats, across_px: Floats, heading_rad: Floats) -> SeenLine:
        """What pixels at such places see of the leg, where it flies that way in the picture."""
        spot = self.spot_std_at(along_px)
        return seen_line(across_px, spot, heading_rad, active_px=self.area.side_px)

    def looks_ahead(
        self, along_px: Floats, across_px: Floats, *, lens_var_px2: float, own_share: float
    ) -> tuple[Floats, Floats]:
        r"""How far ahead of their foot pixels look along the leg in the mean, and the variance.

        Parameters
        ----------
        along_px, across_px : array of float, shape (n,)
            Of the pixels, along the leg's line and from it.
        lens_var_px2 : float
            Variance of the spot where it is narrowest: the lens makes it.
        own_share : float
            Of what the spot is wider, the beam's share: that spreads no light along the leg.

        Returns
        -------
        ahead_px : array of float, shape (n,)
        variance_px2 : array of float, shape (n,)

        Notes
        -----
        Of variance v the lens makes :math:`v_l = (1 - \theta) v + \theta v_0`. Strength whose log
        has the slope L on the line is then seen :math:`v_l (L + g y^2 / v) + v_l'` ahead, y across
        the line and g the slope of the log of the spot: where it grows, light from ahead reaches
        farther.
        """
        along = np.clip(along_px, *span_of_knots(self.spline.t))
        variance = self.spot_std_at(along) ** 2
        growth = self.spot.growth_at(along)
        lens = variance - own_share * np.maximum(variance - lens_var_px2, 0.0)
        uneven = self.log_slope(along_px) + growth * across_px**2 / variance
        grows = 2.0 * growth * variance * np.where(variance > lens_var_px2, 1.0 - own_share, 1.0)
        return lens * uneven + grows, lens

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
        np.zeros((4, 4)), ActiveArea(0.0, 0.0, np.zeros(2)), 1.0, 1.0, 0.0, none, none,
    )  # fmt: skip


def fit_lines(
    data: list[LineData], *, fine: bool = False, active_px: float | None = None
) -> list[LineFit]:
    """Line, spot and strength of every leg in one fit (the spot is common to all).

    Fisher scoring for Poisson counts with a logarithmic link, damped; pixels that disagree by
    more than chance allows are left out after a first pass. Where a leg's counts scatter more than
    chance allows, knots twice as dense are tried on it, and stay if they explain the scatter.

    Parameters
    ----------
    data : list of LineData
        Counts about each leg.
    fine : bool, optional
        Whether each leg has a spot of its own, and pixels are as unequal as their counts scatter:
        for legs that are known to be there. While they are looked for, what is taken for an odd
        spot or for unequal pixels may be a leg too few.
    active_px : float, optional
        Side of the pixels' active area, in a fine fit; None: what the counts say of it.

    Returns
    -------
    list of LineFit
        One per leg.

    Notes
    -----
    Expected photons of a pixel at s along and y across the line are exp(B(s) - (y - y0(s))^2 / 2
    v(s)), B a cubic spline and v the variance of the spot; their variance is that mean mu, and u
    mu^2 with pixels unequal by sqrt(u) (method.md, What the counts say). A fine fit asks how large
    the pixels' active areas are, where counts show that a Gaussian is not their spot (`seen_line`).
    """
    fitted = partial(_fitted_finely, active_px=active_px) if fine else _fitted
    usual = fitted(data, [KNOT_SPACING_PX] * len(data))
    spacing = [
        DENSE_KNOT_SPACING_PX if line.log_scatter > 0.0 else KNOT_SPACING_PX for line in usual.lines
    ]
    if min(spacing) == KNOT_SPACING_PX:
        return usual.lines
    dense = fitted(data, spacing)
    if fine:
        # Light that is uneven along a leg is alike in pixels side by side, efficiencies are not.
        gained = dense.log_likelihood - usual.log_likelihood
        worth = gained > price(dense.n_parameters - usual.n_parameters, dense.n_pixels)
    else:
        worth = dense.scatter < _MOST_LEFT * usual.scatter
    return dense.lines if worth else usual.lines


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Lines of all legs, and how well they explain the counts."""

    lines: list[LineFit]
    log_likelihood: float
    n_parameters: int
    n_pixels: int
    scatter: float


def _fitted(data: list[LineData], spacing_px: list[float]) -> _Fitted:
    """One spot of all legs, pixels alike."""
    problem, parameters = _begun(data, spacing_px, fine=False)
    weights = _without_strangers(problem, parameters)
    return _told(problem, _scored(problem, parameters, weights), weights)


def _fitted_finely(
    data: list[LineData], spacing_px: list[float], *, active_px: float | None
) -> _Fitted:
    """A spot of its own for each leg, pixels unequal.

    Strangers lead a fit astray, so all that looks strange among equal pixels is left out at first:
    of unequal ones the brightest, which come back when the median of all says how unequal they are.
    """
    problem, parameters = _begun(data, spacing_px, fine=True)
    if active_px is not None:
        problem = replace(problem, active_px=active_px)
    parameters = _scored(problem, parameters, _without_strangers(problem, parameters))
    for _ in range(_ROUNDS):
        residual, counted = _off(problem, parameters)
        rough = rough_unequal(residual, counted)
        weights = _without_strangers(replace(problem, unequal=rough), parameters)
        kept = weights > 0
        unequal = likeliest_unequal(residual[kept], counted[kept], len(parameters))
        parameters = _scored(replace(problem, unequal=unequal), parameters, weights)
    problem = replace(problem, unequal=unequal)
    if active_px is None:
        problem, parameters, weights = _with_active_area(problem, parameters, weights)
    return _told(problem, parameters, weights)


def _with_active_area(
    problem: LineProblem, parameters: Floats, weights: Floats
) -> tuple[LineProblem, Floats, Floats]:
    """Problem, parameters and weights with the active area that the counts show, if they show one.

    What a Gaussian left unexplained was taken for unequal pixels and for strangers: these are asked
    for again.
    """
    asked = _asked_area(_slope_at(problem, parameters, weights))
    if asked.step <= 0.0 or 0.5 * asked.step**2 / asked.variance < price(1, len(weights)):
        return problem, parameters, weights
    for _ in range(_AREA_ROUNDS):
        area = np.clip(problem.active_px**4 + asked.step, _LEAST_ACTIVE_PX**4, 1.0)
        problem = replace(problem, active_px=float(area**0.25))
        parameters = _scored(problem, parameters, weights)
        residual, counted = _off(problem, parameters)
        weights = _without_strangers(problem, parameters)
        kept = weights > 0
        unequal = likeliest_unequal(residual[kept], counted[kept], len(parameters))
        problem = replace(problem, unequal=unequal)
        asked = _asked_area(_slope_at(problem, parameters, weights))
    return problem, _scored(problem, parameters, weights), weights


def _begun(
    data: list[LineData], spacing_px: list[float], *, fine: bool
) -> tuple[LineProblem, Floats]:
    """The problem and where its counts lead with all pixels."""
    problem = problem_of(data, spacing_px, fine=fine)
    start = first_guess(problem)
    problem = replace(problem, expected=expected_by_priors(problem, start))
    return problem, _scored(problem, start, np.ones(len(problem.data.photons)))


def _told(problem: LineProblem, parameters: Floats, weights: Floats) -> _Fitted:
    """What a fit says, with chi-square of all legs beyond one a degree of freedom."""
    lines = _results(problem, parameters, weights)
    residual, counted = _off(problem, parameters)
    return _Fitted(
        lines,
        log_likelihood(residual, variance_of_counts(counted, problem.unequal)),
        len(parameters),
        len(residual),
        sum(
            (here.stop - here.start) * max(0.0, line.excess_variance - 1.0)
            for here, line in zip(problem.pixels, lines, strict=True)
        ),
    )


def _without_strangers(problem: LineProblem, parameters: Floats) -> Floats:
    """(n,), 1, or 0 for pixels that agree with no leg."""
    mean = expected_photons(problem, parameters).photons
    counted = np.maximum(mean, _LEAST_MEAN) + problem.data.empty_variance
    scaled = np.abs(problem.data.photons - mean)
    scaled /= np.sqrt(variance_of_counts(counted, problem.unequal))
    weights = np.empty(len(scaled))
    for here in problem.pixels:
        spread = max(1.0, std_from_mad(float(np.median(scaled[here]))))
        weights[here] = scaled[here] < MOST_STDS * spread
    return weights


def _off(problem: LineProblem, parameters: Floats) -> tuple[Floats, Floats]:
    """Photons seen beyond those expected, (n,), and what was counted in all as expected."""
    mean = expected_photons(problem, parameters).photons
    return problem.data.photons - mean, _counted(problem, mean)


def _counted(problem: LineProblem, mean: Floats) -> Floats:
    """(n,), what is counted in all where `mean` photons are expected of the legs; nowhere zero."""
    return mean + problem.data.empty_variance + 1e-3


def _summed(places: Indices, values: Floats, size: int) -> Floats:
    """Sums of `values` by place; (size,)."""
    sums: Floats = np.bincount(places, values.ravel(), size).astype(np.float64, copy=False)
    return sums


@dataclass(frozen=True, eq=False)
class _Slope:
    """The likelihood of the counts about some parameters, with its priors."""

    value: float
    problem: LineProblem
    expected: Expected
    weights: Floats
    held: Floats

    @cached_property
    def weight(self) -> Floats:
        """(n,), each pixel's times its mean over its variance."""
        mean = self.expected.photons
        variance = variance_of_counts(_counted(self.problem, mean), self.problem.unequal)
        return self.weights * mean / variance

    @cached_property
    def score(self) -> Floats:
        data, mean = self.problem.data, self.expected.photons
        pulls = self.expected.gradient * (self.weight * (data.photons - mean))[:, np.newaxis]
        return _summed(self.problem.columns.ravel(), pulls, len(self.held)) - self.held

    @cached_property
    def information(self) -> Floats:
        gradient, size = self.expected.gradient, len(self.held)
        weighted = gradient * (self.weight * self.expected.photons)[:, np.newaxis]
        products = weighted[:, :, np.newaxis] * gradient[:, np.newaxis]
        information = _summed(self.problem.cells, products, size**2).reshape(size, size)
        return information + self.problem.precision + 1e-9 * np.eye(size)


def _slope_at(problem: LineProblem, parameters: Floats, weights: Floats) -> _Slope:
    data, expected = problem.data, expected_photons(problem, parameters)
    counted = _counted(problem, expected.photons)
    # Shifted Poisson: counts plus background variance have nearly equal mean and variance.
    shifted = np.maximum(data.photons + data.empty_variance, 0.0)
    value = -np.sum(weights * half_deviance(shifted, counted, problem.unequal))
    off = parameters - problem.expected
    held = problem.precision @ off
    return _Slope(float(value - 0.5 * off @ held), problem, expected, weights, held)


@dataclass(frozen=True, eq=False)
class _Asked:
    """What the counts ask of one number more: a step of it and its variance.

    All other parameters (p,) follow it: by `-followed`.
    """

    step: float
    variance: float
    followed: Floats


def _asked_area(slope: _Slope) -> _Asked:
    """The fourth power of the active side."""
    return _asked(slope, slope.expected.by_area)


def _asked(slope: _Slope, by_number: Floats) -> _Asked:
    """A number that the log of the photons follows by `by_number` (n,)."""
    problem, mean = slope.problem, slope.expected.photons
    weighted = by_number * slope.weight
    crossed = slope.expected.gradient * (weighted * mean)[:, np.newaxis]
    shared = _summed(problem.columns.ravel(), crossed, len(slope.held))
    followed = np.linalg.solve(slope.information, shared).astype(np.float64, copy=False)
    score = float(weighted @ (problem.data.photons - mean)) - float(followed @ slope.score)
    own = float((weighted * mean) @ by_number)
    # Where the others follow so well that nothing is left of it, rounding is.
    information = max(own - float(followed @ shared), _NOTHING * own, _NOTHING)
    return _Asked(score / information, 1.0 / information, followed)


def _skewness(slope: _Slope, here: slice) -> tuple[float, float]:
    """Skewness of the spot across one leg, whose pixels are `here`, and its error."""
    by_skewness = np.zeros(len(slope.weight))
    by_skewness[here] = slope.expected.by_skewness[here]
    asked = _asked(slope, by_skewness)
    return asked.step, float(np.sqrt(asked.variance))


def _scored(problem: LineProblem, parameters: Floats, weights: Floats) -> Floats:
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


def _results(problem: LineProblem, parameters: Floats, weights: Floats) -> list[LineFit]:
    slope = _slope_at(problem, parameters, weights)
    # Not scaled: all parameters are logarithms or px, of one size.
    covariance = np.linalg.pinv(slope.information, hermitian=True)
    # While legs are looked for nobody asks.
    nothing = _Asked(0.0, 0.0, np.zeros(len(parameters)))
    asked = _asked_area(slope) if problem.of_spot else nothing
    mean, gradient = slope.expected.photons, slope.expected.gradient
    residual = problem.data.photons - mean
    variance = variance_of_counts(_counted(problem, mean), problem.unequal)
    # What the legs' own spots have in common is the common spot's.
    own = np.zeros((len(problem.pixels), OF_SPOT))
    own[:, : problem.of_spot] = [
        parameters[stop - problem.of_spot : stop] for stop in problem.starts[1:]
    ]
    common = float(own[:, :2].mean())
    # What of the halo is told anew is no leg's.
    of_legs = slice(0, problem.spot_column + 1)
    fits = []
    for k, here in enumerate(problem.pixels):
        start, stop = problem.starts[k], problem.starts[k + 1]
        telling = (weights[here] > 0) & (variance[here] > LEAST_TELLING)
        dof = max(1, int(telling.sum()) - (stop - start + 1))
        excess = float(np.sum((residual[here] ** 2 / variance[here])[telling])) / dof
        n_offsets = len(problem.anchors[k])
        first = stop - problem.of_spot - n_offsets
        offsets = slice(first, first + n_offsets)
        touched = np.r_[start:stop, len(parameters) - 1]
        places, chi2 = bends_along(
            Kinkable(
                problem.data.along_px[here],
                gradient[here, 4 : 4 + n_offsets].sum(axis=1),
                over_leg(problem, k, gradient[:, of_legs]),
                mean[here],
                residual[here],
                variance[here],
                weights[here],
            ),
            span_of_knots(problem.knots[k]),
            covariance[np.ix_(touched, touched)],
        )
        skewness, skewness_std = _skewness(slope, here) if problem.of_spot else (0.0, np.inf)
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
                area=ActiveArea(
                    problem.active_px, float(np.sqrt(asked.variance)), -asked.followed[offsets]
                ),
                knot_spacing_px=problem.spacing_px[k],
                excess_variance=excess,
                log_scatter=np.sqrt(problem.unequal)
                if problem.of_spot
                else median_scatter(residual[here], mean[here], variance[here], weights[here]),
                bend_places_px=places,
                bend_chi2_at=chi2,
                skewness=skewness,
                skewness_std=float(np.sqrt(max(1.0, excess)) * skewness_std),
            )
        )
    return fits
