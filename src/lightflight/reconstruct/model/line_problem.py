"""The counts of the pixels about legs, as a problem of lines, strengths and spots.

Takes the counts about each leg, gives the parameters that explain them their places and priors, the
photons that each pixel expects, and how these follow the parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import block_diag

from lightflight.reconstruct.model.spot import SeenLine, seen_line
from lightflight.reconstruct.model.strength import (
    LOG_SPOT_RANGE,
    SPOT_PRIOR,
    SpotAlong,
    knots_over,
    shares_of_anchors,
    span_of_knots,
)

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_OFFSET_PRIOR_PX = 1.0
"""A line is looked for about where it is expected; few pixels must not throw it far, px."""

_STRENGTH_PRIOR_LN = 13.0
"""How far the light on a line may be from its brightest pixels nearby, ln: pixels on one side of a
line cannot tell a near line from a far one that is brighter without end. Pixels that are five stds
off have e^-13 of the light. A line that twelve pixels see from one side is right and its error true
from 5 to 13, a leg of six pixels is lost at 7, 10 and 17 and found at 13, 15 and 20."""

OF_SPOT = 3
"""Parameters of a leg's own spot, in a fine fit."""


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
    heading_rad : float or array of float, shape (n,), optional
        Direction of flight in the picture there, from u to v.
    """

    along_px: Floats
    across_px: Floats
    photons: Floats
    empty_variance: Floats
    n_offsets: int = 2
    heading_rad: Floats | float = 0.0


_OF_PIXELS = ("along_px", "across_px", "photons", "empty_variance")
"""What `LineData` holds pixel by pixel."""


@dataclass(frozen=True, eq=False)
class LineProblem:
    """Data of all legs in one stack; parameters: spline of each leg, its two offsets and the s
    numbers of its own spot (three, or none), and last the log of the spot of all.

    Each pixel is touched by few of them: four of the cubic spline, its leg's two offsets and s of
    its spot, and the spot of all. Bent legs have more offsets, and where there is one w is the most
    that any has; columns that a leg does not fill name the spot, with a share of zero.

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
    columns : array of int, shape (n, 5 + w + s)
        The parameters that touch each pixel.
    basis : array of float, shape (n, 4)
        Values of the splines.
    lever : array of float, shape (n, w)
        Share of the leg's offsets.
    spot_lever : array of float, shape (n, s)
        Share of its spot's numbers.
    precision : array of float, shape (p, p)
        Of the priors.
    expected : array of float, shape (p,)
        What the priors expect.
    unequal : float
        Variance of the pixels' efficiencies, ln^2.
    active_px : float
        Side of the pixels' active area in pitches, as the spot is made of it; 0: a Gaussian.
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
    unequal: float = 0.0
    active_px: float = 0.0

    @property
    def of_spot(self) -> int:
        """Numbers of each leg's own spot: three, or none."""
        return int(self.spot_lever.shape[1])

    @cached_property
    def cells(self) -> Indices:
        """(n c^2,), places in the flattened information of each pixel's products."""
        size = self.starts[-1] + 1
        cells: Indices = (
            self.columns[:, :, np.newaxis] * size + self.columns[:, np.newaxis]
        ).ravel()
        return cells


def problem_of(data: list[LineData], spacing_px: list[float], *, fine: bool) -> LineProblem:
    """The counts about legs with the parameters that are to explain them.

    Parameters
    ----------
    data : list of LineData
        Counts about each leg.
    spacing_px : list of float
        Largest distance of each leg's knots, px.
    fine : bool
        Whether each leg has a spot of its own.

    Returns
    -------
    LineProblem
        Whose priors expect nothing yet.
    """
    pixels: list[slice] = []
    starts, knots, anchors = [0], [], []
    columns, bases, levers, stiff = [], [], [], []
    spots: list[Floats] = []
    n_spot = OF_SPOT if fine else 0
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
        spot = SpotAlong(anchor[[0, -1]], np.zeros(3))
        levers.append(_levers(d.along_px, anchor))
        spots.append(spot.shares(d.along_px)[:, :n_spot])
        stiff.append(_leg_precision(n_spline, d.n_offsets, spot.precision[:n_spot, :n_spot]))
        knots.append(knot)
        anchors.append(anchor)
        first = pixels[-1].stop if pixels else 0
        pixels.append(slice(first, first + n))
        starts.append(starts[-1] + n_spline + d.n_offsets + n_spot)
    of_spot = [
        np.tile(stop - n_spot + np.arange(n_spot), (len(d.photons), 1))
        for stop, d in zip(starts[1:], data, strict=True)
    ]
    touched = np.hstack((_filled(columns, starts[-1]), np.vstack(of_spot)))
    return LineProblem(
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
    )


def _joined(data: list[LineData]) -> LineData:
    """Pixels of all legs in one table, leg after leg."""
    along, across, photons, empty = (
        np.concatenate([getattr(d, name) for d in data]) for name in _OF_PIXELS
    )
    heading = [np.broadcast_to(d.heading_rad, d.along_px.shape) for d in data]
    return LineData(along, across, photons, empty, heading_rad=np.concatenate(heading))


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


def _leg_precision(n_spline: int, n_offsets: int, of_spot: Floats) -> Floats:
    """Precision (n + a + s, n + a + s) of the priors on one leg's strength, offsets and spot.

    A dark stretch leaves its strength undefined: it is held weakly to its neighbours.
    """
    bend = 0.05 * np.diff(np.eye(n_spline), 2, axis=0)
    level = np.eye(n_spline) / _STRENGTH_PRIOR_LN**2
    offsets = np.eye(n_offsets) / _OFFSET_PRIOR_PX**2
    parts = [bend.T @ bend + level, offsets, *([of_spot] if of_spot.size else [])]
    return block_diag(*parts)


def expected_by_priors(problem: LineProblem, guess: Floats) -> Floats:
    """What the priors expect: lines where they are, a usual spot, the light that is guessed.

    Parameters
    ----------
    problem : LineProblem
        Of the counts.
    guess : array of float, shape (p,)
        Parameters to begin with.

    Returns
    -------
    array of float, shape (p,)
    """
    pull = guess / _STRENGTH_PRIOR_LN**2
    for stop, anchors in zip(problem.starts[1:], problem.anchors, strict=True):
        pull[stop - len(anchors) - problem.of_spot : stop] = 0.0
    pull[-1] = SPOT_PRIOR[0] * problem.precision[-1, -1]
    # Level and smoothness are two priors on one strength: this is where they agree.
    expected: Floats = np.linalg.solve(problem.precision, pull).astype(np.float64, copy=False)
    return expected


def first_guess(problem: LineProblem) -> Floats:
    """Parameters to begin with: strength of the brightest pixels, lines amid the light.

    Parameters
    ----------
    problem : LineProblem
        Of the counts.

    Returns
    -------
    array of float, shape (p,)
    """
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
        basis = over_leg(problem, k, problem.basis)[on_line, : -1 - n_offsets - problem.of_spot]
        ridge = 1e-3 * np.eye(basis.shape[1])
        offsets = problem.starts[k + 1] - n_offsets - problem.of_spot
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


def over_leg(problem: LineProblem, k: int, values: Floats) -> Floats:
    """Values by pixel and touching parameter, over a leg's parameters and the spot of all.

    Parameters
    ----------
    problem : LineProblem
        Of the counts.
    k : int
        Index of the leg.
    values : array of float, shape (n, c)
        Of the first c columns.

    Returns
    -------
    array of float, shape (n_k, p_k + 1)
    """
    here = problem.pixels[k]
    start, stop = problem.starts[k], problem.starts[k + 1]
    columns = np.minimum(problem.columns[here, : values.shape[1]], stop) - start
    spread = np.zeros((len(columns), stop - start + 1))
    np.put_along_axis(spread, columns, values[here], axis=1)
    return spread


@dataclass(frozen=True, eq=False)
class Expected:
    """Photons that each pixel expects.

    Attributes
    ----------
    photons : array of float, shape (n,)
        Of the legs alone.
    problem : LineProblem
        Of the counts.
    seen : SeenLine
        How that follows from line and spot.
    """

    photons: Floats
    problem: LineProblem
    seen: SeenLine

    @cached_property
    def gradient(self) -> Floats:
        """D ln(photons) / d(the parameters that touch each pixel), (n, 5 + w + s)."""
        problem = self.problem
        by_offset = -self.seen.by_across[:, np.newaxis]
        by_spot = self.seen.by_log_spot[:, np.newaxis]
        return np.hstack(
            (problem.basis, by_offset * problem.lever, by_spot * problem.spot_lever, by_spot)
        )


def expected_photons(problem: LineProblem, parameters: Floats) -> Expected:
    """Photons that each pixel expects, and how their logarithm follows what touches it.

    Parameters
    ----------
    problem : LineProblem
        Of the counts.
    parameters : array of float, shape (p,)
        All of them.

    Returns
    -------
    Expected
        For all pixels.
    """
    own, last = parameters[problem.columns], -1 - problem.of_spot
    log_spot = own[:, -1] + np.sum(problem.spot_lever * own[:, last:-1], axis=1)
    spot = np.exp(np.clip(log_spot, *LOG_SPOT_RANGE))
    line = np.sum(problem.lever * own[:, 4:last], axis=1)
    data = problem.data
    heading = np.asarray(data.heading_rad)
    seen = seen_line(data.across_px - line, spot, heading, active_px=problem.active_px)
    log_mean = np.sum(problem.basis * own[:, :4], axis=1) + seen.log_light
    return Expected(np.exp(np.clip(log_mean, -60, 40)), problem, seen)
