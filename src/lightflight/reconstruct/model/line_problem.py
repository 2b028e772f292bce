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

_HALO_PRIOR_LN = 1.0
"""How much more halo there may be than was told of the line as it was, ln: the share that was found
goes with the brightness that was found, and both are found anew."""
_MOST_MORE_LN = 3.0
"""A trial that makes more of a halo than this is refused for its counts in any case."""
_LOG_ROOT_2_PI = 0.5 * float(np.log(2.0 * np.pi))
_STRENGTH_PRIOR_LN = 13.0
"""How far the light on a line may be from its brightest pixels nearby, ln: pixels on one side of a
line cannot tell a near line from a far one that is brighter without end. Pixels that are five stds
off have e^-13 of the light. A line that twelve pixels see from one side is right and its error true
from 5 to 13, a leg of six pixels is lost at 7, 10 and 17 and found at 13, 15 and 20."""
_STIFF_UNSEEN = 1.0 / 3.0
"""Second differences of a leg's strength where hardly a pixel shows it, 1 / ln: bends of 3 ln from
knot to knot. Held so everywhere, grains in a beam are not followed."""
_ON_PX = 0.7
"""Pixels whose centre is as near lie on the line, px: half of a pixel's diagonal."""

OF_SPOT = 3
"""Parameters of a leg's own spot, in a fine fit."""


@dataclass(frozen=True, eq=False)
class Halo:
    """Light of a leg that is spread to n pixels about it, as it was told of the line as it was.

    Attributes
    ----------
    photons : array of float, shape (n,)
    along_px : array of float, shape (p,)
        Places along the line that the light comes from, px.
    log_light : array of float, shape (p,)
        As told, ln of the photons per px of its length there.
    shares : array of float, shape (n, p)
        Of a pixel's halo, from each place; they sum to one.
    modes : array of float, shape (n, k)
        How its log follows what is left unknown of how wide it is, one-sigma columns, the same k
        for all legs.
    """

    photons: Floats
    along_px: Floats
    log_light: Floats
    shares: Floats
    modes: Floats


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
    halo : Halo or None, optional
        What of the photons is halo of the leg's light nearby; None: nothing is.
    """

    along_px: Floats
    across_px: Floats
    photons: Floats
    empty_variance: Floats
    n_offsets: int = 2
    heading_rad: Floats | float = 0.0
    halo: Halo | None = None

    @property
    def halo_photons(self) -> Floats | float:
        """(n,), what of the photons is halo."""
        return 0.0 if self.halo is None else self.halo.photons


_A_PHOTON = 1.0
"""Pixels that expect less of their legs say nothing of a spot's skewness: their chance is no
Gaussian's, and a photon of the background is enough."""

_OF_PIXELS = ("along_px", "across_px", "photons", "empty_variance")
"""What `LineData` holds pixel by pixel."""


@dataclass(frozen=True, eq=False)
class HaloTable:
    """How the halo among the photons of n pixels follows what is fitted.

    Attributes
    ----------
    photons : array of float, shape (n,)
        As told.
    columns : array of int, shape (n, h)
        Coefficients of the spline of the leg that it is of.
    basis : array of float, shape (n, h)
        Their values at the places that it comes from, by the shares of these.
    spot_lever : array of float, shape (n, s)
        The same of the numbers of the leg's own spot.
    log_light : array of float, shape (n,)
        The same of the line as told, ln of the photons per px.
    more : array of float, shape (n, 1 + k)
        How the log of it follows how much more there is, and what is unknown of how wide it is.
    """

    photons: Floats
    columns: Indices
    basis: Floats
    spot_lever: Floats
    log_light: Floats
    more: Floats

    @property
    def n_more(self) -> int:
        """Numbers that say how much more of it there is, and how wide it is."""
        return int(self.more.shape[1])


@dataclass(frozen=True, eq=False)
class LineProblem:
    """Data of all legs in one stack; parameters: spline of each leg, its two offsets and the s
    numbers of its own spot (three, or none), then, where halo is among the photons, the log of how
    much more there is than told and k numbers of how wide it is, last the log of the spot of all.

    Each pixel is touched by few of them: four of the cubic spline, its leg's two offsets and s of
    its spot, the spot of all and the halo. Bent legs have more offsets, and where there is one w is
    the most that any has; columns that a leg does not fill name the spot, with a share of zero.

    Attributes
    ----------
    data : LineData
        (n,) each, leg after leg.
    pixels : list of slice
        Where each leg's pixels stand in `data`.
    starts : list of int
        Where each leg's parameters start; last, where those of all legs do.
    spacing_px : list of float
        Largest distance of each leg's knots, px.
    knots : list of array of float
        Knots of each leg's log-strength, px along it.
    anchors : list of array of float
        Where along each leg its offsets are taken, px.
    columns : array of int, shape (n, 5 + w + s) or (n, 6 + w + s + h)
        The parameters that touch each pixel; those of its halo, and of all halo, last.
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
    halo : HaloTable or None
        What of the photons is halo; None: nothing is.
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
    halo: HaloTable | None = None
    active_px: float = 0.0

    @property
    def spot_column(self) -> int:
        """Which of `columns` is the spot of all; those behind it are the halo's."""
        return 4 + int(self.lever.shape[1]) + self.of_spot

    @property
    def of_spot(self) -> int:
        """Numbers of each leg's own spot: three, or none."""
        return int(self.spot_lever.shape[1])

    @cached_property
    def cells(self) -> Indices:
        """(n c^2,), places in the flattened information of each pixel's products."""
        size = len(self.expected)
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
        lit = d.along_px[d.photons - d.halo_photons > 3.0 * np.sqrt(d.empty_variance + 1.0)]
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
        shown: Floats = np.asarray(splines[np.abs(d.across_px) < _ON_PX].sum(axis=0)).ravel()
        stiff.append(_leg_precision(shown, d.n_offsets, spot.precision[:n_spot, :n_spot]))
        knots.append(knot)
        anchors.append(anchor)
        first = pixels[-1].stop if pixels else 0
        pixels.append(slice(first, first + n))
        starts.append(starts[-1] + n_spline + d.n_offsets + n_spot)
    of_spot = [
        np.tile(stop - n_spot + np.arange(n_spot), (len(d.photons), 1))
        for stop, d in zip(starts[1:], data, strict=True)
    ]
    modes = [d.halo.modes.shape[1] for d in data if d.halo is not None]
    n_more = 1 + max(modes) if modes else 0
    size = starts[-1] + n_more + 1
    touched = [
        _filled(columns, size - 1),
        np.vstack(of_spot),
        np.full((pixels[-1].stop, 1), size - 1),
    ]
    halo = _halo_of(data, knots, anchors, starts, n_spot) if n_more else None
    if halo is not None:
        touched += [np.tile(starts[-1] + np.arange(n_more), (pixels[-1].stop, 1)), halo.columns]
    more = np.diag(np.r_[_HALO_PRIOR_LN**-2.0, np.ones(n_more - 1)]) if n_more else None
    return LineProblem(
        data=_joined(data),
        pixels=pixels,
        starts=starts,
        spacing_px=spacing_px,
        knots=knots,
        anchors=anchors,
        columns=np.hstack(touched),
        basis=np.vstack(bases),
        lever=_filled(levers, 0.0),
        spot_lever=np.vstack(spots),
        precision=block_diag(
            *stiff, *([] if more is None else [more]), np.full((1, 1), SPOT_PRIOR[1] ** -2.0)
        ),
        expected=np.zeros(size),
        halo=halo,
    )


def _halo_of(
    data: list[LineData],
    knots: list[Floats],
    anchors: list[Floats],
    starts: list[int],
    n_spot: int,
) -> HaloTable:
    """The halo among the photons of all legs, leg after leg."""
    photons, columns, bases, levers, log_light, more = [], [], [], [], [], []
    for k, d in enumerate(data):
        n, n_spline = len(d.photons), len(knots[k]) - 4
        columns.append(np.tile(starts[k] + np.arange(n_spline), (n, 1)))
        if d.halo is None:
            photons.append(np.zeros(n))
            bases.append(np.zeros((n, n_spline)))
            levers.append(np.zeros((n, n_spot)))
            log_light.append(np.zeros(n))
            more.append(np.ones((n, 1)))
            continue
        # Beyond what is shown a line is as bright as where it ends.
        places = np.clip(d.halo.along_px, *span_of_knots(knots[k]))
        spot = SpotAlong(anchors[k][[0, -1]], np.zeros(3))
        photons.append(d.halo.photons)
        bases.append(d.halo.shares @ BSpline.design_matrix(places, knots[k], 3).toarray())
        levers.append(d.halo.shares @ spot.shares(places)[:, :n_spot])
        log_light.append(d.halo.shares @ d.halo.log_light)
        more.append(np.hstack((np.ones((n, 1)), d.halo.modes)))
    return HaloTable(
        np.concatenate(photons),
        _filled(columns, starts[-1]),
        _filled(bases, 0.0),
        np.vstack(levers),
        np.concatenate(log_light),
        _filled(more, 0.0),
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


def _leg_precision(shown: Floats, n_offsets: int, of_spot: Floats) -> Floats:
    """Precision (n + a + s, n + a + s) of the priors on one leg's strength, offsets and spot.

    A dark stretch leaves its strength undefined: it is held weakly to its neighbours. Where the
    pixels on the line are another leg's as well, hardly one shows a spline (`shown`, (n,), of how
    many pixels each is in sum) and its strength is drawn from one side to the other: held weakly
    it swings, and light a hundred times too dim or too bright is then what the model expects.
    """
    n_spline = len(shown)
    hidden = np.clip(1.0 - shown[1:-1], 0.0, 1.0)
    stiffness = 0.05 + (_STIFF_UNSEEN - 0.05) * hidden
    bend = stiffness[:, np.newaxis] * np.diff(np.eye(n_spline), 2, axis=0)
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
    pull[problem.starts[-1] :] = 0.0
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
    parameters = np.zeros(len(problem.expected))
    parameters[-1] = SPOT_PRIOR[0]
    for k, here in enumerate(problem.pixels):
        along, across = problem.data.along_px[here], problem.data.across_px[here]
        photons = problem.data.photons[here]
        if problem.halo is not None:
            photons = photons - problem.halo.photons[here]
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
        Of the legs, with what of their halo is among the counts.
    problem : LineProblem
        Of the counts.
    seen : SeenLine
        How what is no halo follows from line and spot.
    direct : array of float, shape (n,)
        Share of the photons that is no halo.
    across_stds : array of float, shape (n,)
        Distance of the pixel from the line, in standard deviations of the spot.
    """

    photons: Floats
    problem: LineProblem
    seen: SeenLine
    direct: Floats
    across_stds: Floats

    @cached_property
    def gradient(self) -> Floats:
        """D ln(photons) / d(the parameters that touch each pixel), as `LineProblem.columns`."""
        problem, direct = self.problem, self.direct[:, np.newaxis]
        by_spot = direct * self.seen.by_log_spot[:, np.newaxis]
        by_offset = -direct * self.seen.by_across[:, np.newaxis]
        of_line = direct * problem.basis, by_offset * problem.lever
        if problem.halo is None:
            return np.hstack((*of_line, by_spot * problem.spot_lever, by_spot))
        # A wider spot of the same brightness holds more light, and so does its halo.
        halo = 1.0 - direct
        of_spot = by_spot * problem.spot_lever + halo * problem.halo.spot_lever
        return np.hstack(
            (*of_line, of_spot, by_spot + halo, halo * problem.halo.more, halo * problem.halo.basis)
        )

    @property
    def by_area(self) -> Floats:
        """(n,), d ln(photons) / d(fourth power of the active side)."""
        return self.direct * self.seen.by_area

    @property
    def by_skewness(self) -> Floats:
        """(n,), d ln(photons) / d(skewness of the spot across the line).

        Five spots aside one photon, of whatever, would count as a hundred do in the spot.
        """
        u = np.where(self.photons < _A_PHOTON, 0.0, self.across_stds)
        by_skewness: Floats = self.direct * (u**3 - 3.0 * u) / 6.0
        return by_skewness


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
    data, own = problem.data, parameters[problem.columns]
    spot_at = problem.spot_column
    of_spot = own[:, spot_at - problem.of_spot : spot_at]
    log_spot = own[:, spot_at] + np.sum(problem.spot_lever * of_spot, axis=1)
    log_spot = np.clip(log_spot, *LOG_SPOT_RANGE)
    line = np.sum(problem.lever * own[:, 4 : spot_at - problem.of_spot], axis=1)
    heading = np.asarray(data.heading_rad)
    across, spot = data.across_px - line, np.exp(log_spot)
    seen = seen_line(across, spot, heading, active_px=problem.active_px)
    log_strength = np.sum(problem.basis * own[:, :4], axis=1)
    direct = np.exp(np.clip(log_strength + seen.log_light, -60, 40))
    told = problem.halo
    if told is None:
        return Expected(direct, problem, seen, np.ones(len(direct)), across / spot)
    # The spot of all, how much more halo there is, and the line where the halo comes from.
    of_halo, of_line = np.split(own[:, spot_at + 1 :], [told.n_more], axis=1)
    log_more = own[:, spot_at] + _LOG_ROOT_2_PI - told.log_light
    log_more += np.sum(told.more * of_halo, axis=1) + np.sum(told.basis * of_line, axis=1)
    log_more += np.sum(told.spot_lever * of_spot, axis=1)
    halo = told.photons * np.exp(np.clip(log_more, -_MOST_MORE_LN, _MOST_MORE_LN))
    return Expected(direct + halo, problem, seen, direct / (direct + halo), across / spot)
