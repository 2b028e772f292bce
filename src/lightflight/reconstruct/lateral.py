"""Where a leg lies between the pixels: from how its light is shared among them.

Takes the counts of the pixels about each leg, gives the line of the leg in the picture to a
small fraction of a pixel, the width of the spot, and the strength of the light along the leg.
The strength is unknown and uneven, so it is fitted with it: log-strength is a spline along the
leg, one knot every three pixels; across the leg the counts follow the spot.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.sparse import csr_array

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

KNOT_SPACING_PX = 3.0
"""Distance between knots of the log-strength along a leg, px."""

_SPOT_PRIOR = (np.log(0.4), 0.8)
"""Log of the spot's std in px and its width, where too few rows are lit to see it."""

_OFFSET_PRIOR_PX = 1.0
"""A line is looked for about where it is expected; few pixels must not throw it far, px."""

_MOST_STEPS = 40

_PLACES_AT_ONCE = 64
"""Places of a kink that are tried together."""


@dataclass(frozen=True, eq=False)
class LineData:
    """Photon counts of the pixels about one leg."""

    along_px: Floats
    """(n,), position of the pixel's centre along the line, px."""
    across_px: Floats
    """(n,), distance of the centre from the line, px, positive to the right of the flight."""
    photons: Floats
    """(n,), photons of this leg in the pixel; may be negative by chance."""
    empty_variance: Floats
    """(n,), variance of `photons` where there is no light."""


@dataclass(frozen=True, eq=False)
class LineFit:
    """Line of one leg relative to the line it was measured about."""

    offset_px: Floats
    """(2,), distance of the true line from the assumed one at the two anchors, px."""
    offset_covariance: Floats
    """(2, 2), px^2."""
    anchors_along_px: Floats
    """(2,), where along the line the anchors are, px."""
    spot_std_px: float
    """Standard deviation of the spot (optics and active area), px."""
    spline: BSpline
    """Log of the photons per pixel on the line, against `along_px`."""
    excess_variance: float
    """Chi-square per degree of freedom; the covariance is already widened by it where > 1."""
    log_scatter: float
    """Pixel-to-pixel scatter of ln(photons) beyond counting noise: uneven efficiency, or a spot
    of another shape than assumed."""
    bend_places_px: Floats
    """(b,), places along the line at which a kink was looked for, px."""
    bend_chi2_at: Floats
    """(b,), chi-square that a kink there would gain (one number each; score test)."""

    @property
    def bend_chi2(self) -> float:
        """Chi-square of the most significant kink."""
        return float(self.bend_chi2_at.max(initial=0.0))

    def log_slope(self, along_px: Floats) -> Floats:
        """D ln(strength) / d(along), per px; zero outside the fitted range."""
        low, high = self.spline.t[3], self.spline.t[-4]
        inside = (along_px >= low) & (along_px <= high)
        slope = self.spline.derivative()(np.clip(along_px, low, high))
        return np.where(inside, slope, 0.0)


def _knots(low: float, high: float) -> Floats:
    n = max(1, int(np.ceil((high - low) / KNOT_SPACING_PX)))
    inner = np.linspace(low, high, n + 1)
    return np.concatenate((np.full(3, low), inner, np.full(3, high)))


def _design(along: Floats, knots: Floats) -> Floats:
    inside = np.clip(along, knots[3], knots[-4])
    matrix: Floats = BSpline.design_matrix(inside, knots, 3).toarray()
    return matrix


@dataclass(eq=False)
class _Problem:
    """Data of all legs, stacked; parameters: spline of each leg, two offsets each, log spot."""

    data: list[LineData]
    knots: list[Floats]
    basis: list[Floats]
    sparse: list[Any]
    """`basis`, as a sparse array."""
    lever: list[Floats]
    anchors: list[Floats]

    @cached_property
    def starts(self) -> list[int]:
        """Where each leg's parameters start; last, where the spot's stands."""
        return [0, *accumulate(basis.shape[1] + 2 for basis in self.basis)]

    @cached_property
    def bends(self) -> list[Floats]:
        """Second differences of each spline's coefficients, times their weak prior."""
        sizes = [basis.shape[1] for basis in self.basis]
        return [0.05 * np.diff(np.eye(n), 2, axis=0) if n > 2 else np.zeros((0, n)) for n in sizes]


def fit_lines(data: list[LineData]) -> list[LineFit]:
    """Line, spot and strength of every leg in one fit (the spot is common to all).

    Fisher scoring for Poisson counts with a logarithmic link, damped; pixels that disagree by
    more than chance allows are left out after a first pass.
    """
    problem = _problem(data)
    weights = [np.ones(len(d.photons)) for d in data]
    parameters = _first_guess(problem)
    parameters = _scored(problem, parameters, weights)
    for k, d in enumerate(data):
        mean, _ = _model(problem, parameters, k)
        scaled = (d.photons - mean) / np.sqrt(np.maximum(mean, 0.3) + d.empty_variance)
        spread = max(1.0, 1.4826 * float(np.median(np.abs(scaled))))
        weights[k] = (np.abs(scaled) < 6.0 * spread).astype(float)
    parameters = _scored(problem, parameters, weights)
    return _results(problem, parameters, weights)


def _problem(data: list[LineData]) -> _Problem:
    knots, basis, lever, anchors = [], [], [], []
    for d in data:
        lit = d.along_px[d.photons > 3.0 * np.sqrt(d.empty_variance + 1.0)]
        lit = lit if len(lit) > 1 else d.along_px
        low, high = float(lit.min()) - 0.5, float(lit.max()) + 0.5
        knot = _knots(low, high)
        anchor = np.array([low + 0.2 * (high - low), high - 0.2 * (high - low)])
        share = (d.along_px - anchor[0]) / (anchor[1] - anchor[0])
        knots.append(knot)
        basis.append(_design(d.along_px, knot))
        lever.append(np.column_stack((1 - share, share)))
        anchors.append(anchor)
    return _Problem(data, knots, basis, [csr_array(b) for b in basis], lever, anchors)


def _first_guess(problem: _Problem) -> Floats:
    parameters = np.zeros(problem.starts[-1] + 1)
    parameters[-1] = _SPOT_PRIOR[0]
    for k, d in enumerate(problem.data):
        low, high = problem.knots[k][3], problem.knots[k][-4]
        bins = np.clip(((d.along_px - low) // 1.5).astype(int), 0, None)
        brightest = np.zeros(bins.max() + 1)
        np.maximum.at(brightest, bins, np.maximum(d.photons, 0.3))
        target = np.log(brightest[bins])
        on_line = np.abs(d.across_px) < 1.0
        basis = problem.basis[k][on_line]
        ridge = 1e-3 * np.eye(basis.shape[1])
        start = problem.starts[k]
        parameters[start : start + basis.shape[1]] = np.linalg.solve(
            basis.T @ basis + ridge, basis.T @ target[on_line]
        )
        inside = (d.along_px > low) & (d.along_px < high)
        weight = np.maximum(d.photons, 0.0) * inside
        if weight.sum() > 0:
            lever = problem.lever[k]
            normal = lever.T @ (weight[:, np.newaxis] * lever) + 1e-6 * np.eye(2)
            parameters[start + basis.shape[1] : start + basis.shape[1] + 2] = np.linalg.solve(
                normal, lever.T @ (weight * d.across_px)
            )
    return parameters


def _model(problem: _Problem, parameters: Floats, k: int) -> tuple[Floats, Floats]:
    """Expected photons of leg k's pixels (n,), d ln(expected) / d(parameters of leg and spot)."""
    start, stop = problem.starts[k], problem.starts[k + 1]
    own = parameters[start:stop]
    basis, lever = problem.basis[k], problem.lever[k]
    spot = np.exp(parameters[-1])
    u = (problem.data[k].across_px - lever @ own[-2:]) / spot
    log_mean = basis @ own[:-2] - 0.5 * u**2
    gradient = np.column_stack((basis, (u / spot)[:, np.newaxis] * lever, u**2))
    return np.exp(np.clip(log_mean, -60, 40)), gradient


def _normal(problem: _Problem, k: int, gradient: Floats, weight: Floats) -> Floats:
    """gradient.T @ diag(weight) @ gradient; a pixel is touched by four splines alone."""
    spline, n = problem.sparse[k], problem.basis[k].shape[1]
    rest = gradient[:, n:]
    weighted = rest * weight[:, np.newaxis]
    normal = np.empty((gradient.shape[1],) * 2)
    normal[:n, :n] = (spline.T @ (spline * weight[:, np.newaxis])).toarray()
    normal[:n, n:] = spline.T @ weighted
    normal[n:, :n] = normal[:n, n:].T
    normal[n:, n:] = rest.T @ weighted
    return normal


def _step_and_deviance(
    problem: _Problem, parameters: Floats, weights: list[Floats]
) -> tuple[Floats, Floats, float]:
    """Fisher information, score, and a deviance to descend."""
    size = problem.starts[-1] + 1
    information, score, deviance = np.zeros((size, size)), np.zeros(size), 0.0
    for k, d in enumerate(problem.data):
        mean, gradient = _model(problem, parameters, k)
        variance = mean + d.empty_variance + 1e-3
        weight = weights[k] * mean / variance
        own = np.r_[problem.starts[k] : problem.starts[k + 1], size - 1]
        information[np.ix_(own, own)] += _normal(problem, k, gradient, weight * mean)
        score[own] += gradient.T @ (weight * (d.photons - mean))
        shifted = np.maximum(d.photons + d.empty_variance, 0.0)
        ratio = np.where(shifted > 0, shifted / variance, 1.0)
        deviance += float(2 * np.sum(weights[k] * (shifted * np.log(ratio) - (shifted - variance))))
    mean_prior, width_prior = _SPOT_PRIOR
    information[-1, -1] += 1 / width_prior**2
    score[-1] -= (parameters[-1] - mean_prior) / width_prior**2
    deviance += ((parameters[-1] - mean_prior) / width_prior) ** 2
    for k in range(len(problem.data)):
        # A dark stretch leaves its strength undefined: hold it weakly to its neighbours.
        n = problem.basis[k].shape[1]
        bend = problem.bends[k]
        own_slice = slice(problem.starts[k], problem.starts[k] + n)
        information[own_slice, own_slice] += bend.T @ bend + 1e-9 * np.eye(n)
        score[own_slice] -= bend.T @ (bend @ parameters[own_slice])
        deviance += float(np.sum((bend @ parameters[own_slice]) ** 2))
        offsets = np.arange(problem.starts[k] + n, problem.starts[k] + n + 2)
        information[offsets, offsets] += 1 / _OFFSET_PRIOR_PX**2
        score[offsets] -= parameters[offsets] / _OFFSET_PRIOR_PX**2
        deviance += float(np.sum((parameters[offsets] / _OFFSET_PRIOR_PX) ** 2))
    return information, score, deviance


def _scored(problem: _Problem, parameters: Floats, weights: list[Floats]) -> Floats:
    information, score, deviance = _step_and_deviance(problem, parameters, weights)
    damping = 1e-3
    for _ in range(_MOST_STEPS):
        damped = information + damping * np.diag(np.diag(information) + 1e-12)
        step = np.linalg.solve(damped, score)
        step[-1] = np.clip(step[-1], -0.5, 0.5)
        trial = parameters + step
        trial[-1] = np.clip(trial[-1], np.log(0.08), np.log(6.0))
        new = _step_and_deviance(problem, trial, weights)
        if new[2] <= deviance + 1e-9:
            settled = deviance - new[2] < 1e-7 * (1.0 + abs(deviance)) and damping < 1e-2
            parameters, (information, score, deviance) = trial, new
            damping = max(damping / 10, 1e-9)
            if settled:
                break
        else:
            damping *= 10
            if damping > 1e8:
                break
    return parameters


def _results(problem: _Problem, parameters: Floats, weights: list[Floats]) -> list[LineFit]:
    information, _, _ = _step_and_deviance(problem, parameters, weights)
    covariance = np.linalg.pinv(information, hermitian=True)
    fits = []
    for k, d in enumerate(problem.data):
        mean, gradient = _model(problem, parameters, k)
        variance = mean + d.empty_variance + 1e-3
        telling = (weights[k] > 0) & (variance > 0.5)
        dof = max(1, int(telling.sum()) - gradient.shape[1])
        excess = float(np.sum(((d.photons - mean) ** 2 / variance)[telling])) / dof
        start, n = problem.starts[k], problem.basis[k].shape[1]
        where = slice(start + n, start + n + 2)
        widened = covariance[where, where] * max(1.0, excess)
        own = np.r_[start : problem.starts[k + 1], len(parameters) - 1]
        places, chi2 = _bends(problem, parameters, weights, k, covariance[np.ix_(own, own)])
        fits.append(
            LineFit(
                offset_px=parameters[where].copy(),
                offset_covariance=widened,
                anchors_along_px=problem.anchors[k],
                spot_std_px=float(np.exp(parameters[-1])),
                spline=BSpline(problem.knots[k], parameters[start : start + n], 3),
                excess_variance=excess,
                log_scatter=_log_scatter(d.photons, mean, variance, weights[k]),
                bend_places_px=places,
                bend_chi2_at=chi2,
            )
        )
    return fits


def _log_scatter(photons: Floats, mean: Floats, variance: Floats, weights: Floats) -> float:
    """Std of ln(photons / mean) beyond counting noise, from the pixels bright enough to show it."""
    telling = (weights > 0) & (mean > 30.0)
    if telling.sum() < 6:
        return 0.0
    ratio = (photons[telling] / mean[telling] - 1.0) ** 2
    expected = variance[telling] / mean[telling] ** 2
    # The median of a chi-square of one degree; chance alone passes 1.5 in few recordings.
    excess = float(np.median(ratio / expected)) / 0.4549
    if excess < 1.0 + 4.0 / np.sqrt(telling.sum()):
        return 0.0
    return float(np.sqrt(max(0.0, np.median(ratio - 0.4549 * expected) / 0.4549)))


def _bends(
    problem: _Problem, parameters: Floats, weights: list[Floats], k: int, covariance: Floats
) -> tuple[Floats, Floats]:
    """Score test of a kink of leg k's line at places two pixels or more from its ends."""
    d = problem.data[k]
    low, high = problem.knots[k][3], problem.knots[k][-4]
    places = np.arange(low + 2.0, high - 1.9, 1.0)
    mean, gradient = _model(problem, parameters, k)
    variance = mean + d.empty_variance + 1e-3
    weight = weights[k] * mean / variance
    spot = np.exp(parameters[-1])
    offsets = parameters[problem.starts[k + 1] - 2 : problem.starts[k + 1]]
    u = (d.across_px - problem.lever[k] @ offsets) / spot
    chi2 = np.zeros(len(places))
    weighted = gradient * (weight * mean)[:, np.newaxis]
    for first in range(0, len(places), _PLACES_AT_ONCE):
        some = slice(first, first + _PLACES_AT_ONCE)
        kinks = (u / spot)[:, np.newaxis] * np.maximum(d.along_px[:, np.newaxis] - places[some], 0)
        score = kinks.T @ (weight * (d.photons - mean))
        crossed = weighted.T @ kinks
        information = (weight * mean) @ kinks**2 - np.sum(crossed * (covariance @ crossed), axis=0)
        told = information > 1e-12
        chi2[some][told] = score[told] ** 2 / information[told]
    scaled = (d.photons - mean)[weights[k] > 0] ** 2 / variance[weights[k] > 0]
    # Judged against the scatter that is there: a bend itself adds to it, so by the median.
    spread = (
        max(1.0, float(np.median(scaled[variance[weights[k] > 0] > 0.5])) / 0.4549)
        if len(scaled)
        else 1.0
    )
    return places, chi2 / spread
