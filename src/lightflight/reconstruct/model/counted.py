"""What each pixel expects in its cells, and what it takes up by itself.

A pixel's own unknowns are the photons and the delay of each leg in it, the width of its pulses and
its background. All are fitted to its own counts, and what they can take up is taken from every
test: none depends on brightness along the legs, on the path's times or on the calibrated delays.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.cells import Cells
from lightflight.reconstruct.model.expected_counts import (
    Expected,
    Pulses,
    Tails,
    expected_counts,
    flight_std_of,
    pulse_at,
    with_flight,
)
from lightflight.reconstruct.model.pulse_shape import GAUSSIAN, Shape
from lightflight.reconstruct.model.second_pulse import Echo

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


_STEPS = 4
"""Steps of Fisher scoring; the last moves bright pixels by a small part of their errors."""
_WIDTH_STD = 0.1
"""By how much pulses may differ in width from pixel to pixel, ln."""
_TELLS = 0.9
"""A pixel whose counts leave more of that variance unknown says nothing of it."""
_AS_WIDE = 0.01
"""Half a variance, in a pulse's own, by which all pulses may be wider than expected: each pixel's
own takes up as little."""
_BEYOND_STD = 1.0
"""Light that nobody saw may be twice as bright as was told, or none: of its brightness."""
_WORSE = 0.1
"""A step after which a pixel's counts are less likely by more than this, twice the log, was too
long: where legs cross, whole steps go to and fro."""
_SHORTER = 0.3
"""Of it, the next one."""
_CLIPS = 4
"""Rounds in which pixels five deviations above the mean are left out of it."""
_ANY_BACKGROUND = 100.0
"""A pixel's background, as a multiple of the guess that it starts from, may be anything in what its
counts say: the guess is made of them. Held to once the guess, tests of two background counts a
pixel were off by an eighth of these, 4 sigma of 4,096 pixels together."""
_LEAST_PHOTONS = 1e-3
_MOST_PHOTONS = 1e3
"""Of all that a pixel counted: what nobody knows of the light of a pulse; no time hangs on it."""
_MOST_TAKEN = 0.5
"""No more than this share of a pulse's variance is taken up by the place that was fitted to it."""
_SHARE_STD = 2.0
"""Of what the picture says that a leg gives a pixel to which another gives more: lenses have wings,
and light has grains."""
_LEAST_SHARE = 0.005
"""The same, of all that a pixel counted: so little is told of no spot."""
_LEAST_ERROR = 1e-4
"""Of a code's width: what is less, no count shows."""
_HELD = 1e12
"""Precision of what a pixel does not have: it stays."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """n pixels with their unknowns fitted: photons and delay of s legs, ln width, background.

    These are q = 2 s + 2; for pulses that are no Gaussians one more, before the width: by how
    many of its standard deviations flight through the footprint adds more than is expected. Where
    other light is partly the pixel's own, one more before these: by how much that part exceeds
    what was told.

    Attributes
    ----------
    cells : Cells
        Their counts.
    mean : array of float, shape (n, m)
        Expected counts.
    weight : array of float, shape (n, m)
        Inverse variance of the counts; 0 where a cell is not live.
    slopes : array of float, shape (n, m, q)
        Derivatives of `mean` by the unknowns.
    inverse : array of float, shape (n, q, q)
        Their covariance.
    pull : array of float, shape (n, q)
        Slope of the log of the priors.
    photons : array of float, shape (n, s)
        Of each leg.
    late_ps : array of float, shape (n, s)
        Time after the pixel's reference, ps.
    std_ps : array of float, shape (n, s)
        Standard deviation, ps; of a tabulated shape without what flight adds.
    background_per_ps : array of float, shape (n,)
    follow : array of float, shape (n, m)
        How much counts follow light: 1, less where that is less than none (`_with_light`).
    shape : Shape
        Of their pulses.
    lacks : array of float, shape (n,)
        Twice what the log of likelihood and priors lacks, up to a constant.
    unknown : array of float, shape (n, q)
        All of them, as they were fitted.
    expected_ps : array of float, shape (n, s)
        Delays that these are counted from, ps.
    second : Echo or None
        That comes with each of them.
    """

    cells: Cells
    mean: Floats
    weight: Floats
    slopes: Floats
    inverse: Floats
    pull: Floats
    photons: Floats
    late_ps: Floats
    std_ps: Floats
    background_per_ps: Floats
    follow: Floats
    shape: Shape
    lacks: Floats
    unknown: Floats
    expected_ps: Floats
    second: Echo | None = None

    def of(self, kept: NDArray[np.bool_]) -> Pixels:
        """Some of the pixels."""
        whole = {f.name: getattr(self, f.name) for f in fields(self)}
        arrays: dict[str, Any] = {
            name: array[kept] for name, array in whole.items() if isinstance(array, np.ndarray)
        }
        return replace(self, cells=self.cells.of(kept), shape=self.shape.of(kept), **arrays)

    @property
    def drawn_out_ps(self) -> Floats:
        """(n, s), standard deviation of pulses with what flight adds to them, ps."""
        return self.shape.drawn_out_ps(self.std_ps)

    def taken_of(self, columns: Floats) -> Floats:
        """By how much the pixels' unknowns take up columns (n, m, k); (n, q, k)."""
        return self._eliminated(columns)[2]

    def said_of(self, columns: Floats) -> tuple[Floats, Floats, Floats]:
        """What the counts say of the sizes of columns (n, m, k), the pixels' own eliminated.

        Score (k,) and information (k, k), and what the unknowns take up of the columns (n, q, k).
        """
        k = columns.shape[2]
        # By the root of their weight, a matrix times itself is half the work of two matrices.
        root = np.sqrt(self.weight)[:, :, np.newaxis]
        rooted = root * columns
        shared: Floats = np.swapaxes(root * self.slopes, 1, 2) @ rooted
        taken: Floats = self.inverse @ shared
        rest, pull = self._rest_and_pull()
        score = rest.ravel() @ columns.reshape(-1, k) - pull.ravel() @ taken.reshape(-1, k)
        rooted = rooted.reshape(-1, k)
        information = rooted.T @ rooted - shared.reshape(-1, k).T @ taken.reshape(-1, k)
        return score, 0.5 * (information + information.T), taken

    def said_of_each(self, columns: Floats) -> tuple[Floats, Floats]:
        """What each pixel's counts say of each column alone: score and information, (n, k)."""
        weighted, shared, taken = self._eliminated(columns)
        rest, pull = self._rest_and_pull()
        weighted *= columns
        information = weighted.sum(axis=1) - np.einsum("nqk,nqk->nk", shared, taken)
        np.multiply(rest, columns, out=weighted)
        score = weighted.sum(axis=1) - np.einsum("nqk,nq->nk", taken, pull[:, :, 0])
        return score, information

    def _eliminated(self, columns: Floats) -> tuple[Floats, Floats, Floats]:
        """Columns by their weight (n, m, k); what unknowns share of them, and take up (n, q, k)."""
        weighted = self.weight[:, :, np.newaxis] * columns
        shared: Floats = np.swapaxes(self.slopes, 1, 2) @ weighted
        taken: Floats = self.inverse @ shared
        return weighted, shared, taken

    def _rest_and_pull(self) -> tuple[Floats, Floats]:
        """What the fit leaves, by its weight (n, m, 1), and the unknowns' slope (n, q, 1)."""
        rest = (self.weight * (self.cells.counts - self.mean))[:, :, np.newaxis]
        pull: Floats = np.swapaxes(self.slopes, 1, 2) @ rest + self.pull[:, :, np.newaxis]
        return rest, pull


def _background(cells: Cells, near: NDArray[np.bool_]) -> Floats:
    """(n,), counts per ps away from the pulses, held to all pixels' mean by one count."""
    width = cells.width_ps * ~near
    exposed, counted = width.sum(axis=1), np.sum(cells.counts * ~near, axis=1)
    # Pixels lit by something else say nothing of the others' background.
    usual = np.ones(len(counted), dtype=bool)
    most = np.median(counted) + 1.0
    for _ in range(_CLIPS):
        usual = counted <= most + 5.0 * np.sqrt(most)
        most = max(float(counted[usual].mean()), 0.1) if usual.any() else most
    mean = (counted[usual].sum() + 1.0) / (exposed[usual].sum() + 1.0)
    floor: Floats = (counted + 1.0) / (exposed + 1.0 / mean)
    return floor


def dark_pixels(
    cells: Cells,
    *,
    dispersion: float = 1.0,
    other: Floats | float = 0.0,
    beyond: Floats | None = None,
) -> Pixels:
    """Pixels that no leg lights: their background is all that they expect.

    Parameters
    ----------
    cells : Cells
        Their counts.
    dispersion : float, optional
        Variance of counts over that of Poisson's.
    other : array of float, shape (n, m), optional
        Counts that are expected of light which is no leg's.
    beyond : array of float, shape (n, m), optional
        Part of `other` of which nobody knows how bright it is in each pixel.

    Returns
    -------
    Pixels
        Without photons (n, 0).
    """
    nowhere = np.empty((len(cells.counts), 0))
    none = Pulses(nowhere, nowhere)
    return lit_pixels(cells, none, dispersion=dispersion, other=other, beyond=beyond)


def lit_pixels(
    cells: Cells,
    pulses: Pulses,
    *,
    dispersion: float = 1.0,
    tails: Tails = (),
    other: Floats | float = 0.0,
    beyond: Floats | None = None,
    second: Echo | None = None,
    last: Pixels | None = None,
) -> Pixels:
    """Fit the unknowns of each pixel to its own counts.

    Parameters
    ----------
    cells : Cells
        Counts.
    pulses : Pulses
        Where light is expected.
    dispersion : float, optional
        Variance of counts over that of Poisson's.
    tails : Tails, optional
        Shares of every pulse that are late.
    other : array of float, shape (n, m), optional
        Counts that are expected of light which is no leg's.
    beyond : array of float, shape (n, m), optional
        Part of `other` of which nobody knows how bright it is in each pixel.
    second : Echo, optional
        That comes with every pulse; None: there is none.
    last : Pixels, optional
        The same pixels as they were fitted before, to go on from.

    Returns
    -------
    Pixels
        At the last step.
    """
    n, s = pulses.late_ps.shape
    # A Gaussian that flight widens is a wider one; another shape becomes one of its own.
    if s and not pulses.shape.is_gaussian and pulses.shape.flight is None:
        pulses = replace(pulses, shape=pulses.shape.drawn_out(np.zeros((n, s))))
    own = _own_of(cells, pulses, other, beyond is not None)
    late, std = own.late_ps, own.std_ps
    unknown, center = own.unknown, own.center
    if last is not None and last.unknown.shape == unknown.shape:
        unknown = last.unknown.copy()
        unknown[:, s : 2 * s] += np.where(own.absent, 0.0, last.expected_ps - late)
    length = np.ones((n, 1))
    before: Expected | None = None
    lacked = np.zeros(n)
    steps = _STEPS if s else 2
    for step in range(steps):
        here = expected_counts(cells, late, std, unknown, pulses, tails, other, beyond, second)
        lacks = _lacks_of(cells, here.mean, dispersion)
        if before is not None:
            worse = lacks + own.penalty(unknown, center) > _WORSE + (
                lacked + own.penalty(before.unknown, center)
            )
            length = np.where(
                worse[:, np.newaxis], _SHORTER * length, np.minimum(1.5 * length, 1.0)
            )
            here, lacks = here.back(before, worse), np.where(worse, lacked, lacks)
            unknown = here.unknown
        before, lacked = here, lacks
        variance = dispersion * here.mean + (cells.width_error * here.mean) ** 2
        weight = np.divide(
            1.0, variance, out=np.zeros_like(variance), where=cells.live & (here.mean > 0.0)
        )
        last_step = step == steps - 1
        prior = own.told if last_step else own.prior
        pull = (center - unknown) * prior
        weighted = weight[:, :, np.newaxis] * here.slopes
        inverse = _inverse(np.swapaxes(here.slopes, 1, 2) @ weighted, prior)
        if last_step:
            break
        if s:
            center = _closer(center, inverse, own, pulses)
        rest = weight * (cells.counts - here.mean)
        score = np.einsum("nmq,nm->nq", here.slopes, rest) + pull
        unknown = own.moved(unknown, length * np.einsum("nij,nj->ni", inverse, score))
    return Pixels(
        cells,
        here.mean,
        weight,
        here.slopes,
        inverse,
        pull,
        unknown[:, :s],
        late + unknown[:, s : 2 * s],
        std * np.exp(unknown[:, -2:-1] - center[:, -2:-1]),
        unknown[:, -1],
        here.follow,
        with_flight(pulses, unknown - center),
        lacks + own.penalty(unknown, center),
        unknown,
        late,
        second,
    )


@dataclass(frozen=True, eq=False)
class _Own:
    """What is expected of the unknowns (n, q) of n pixels before their counts are looked at."""

    late_ps: Floats
    std_ps: Floats
    absent: NDArray[np.bool_]
    unknown: Floats
    center: Floats
    prior: Floats
    most: Floats
    background_per_ps: Floats

    @property
    def told(self) -> Floats:
        """(n, q), `prior` without that of the background, which comes from the same counts."""
        told = self.prior.copy()
        told[:, -1] *= _ANY_BACKGROUND**-2.0
        return told

    def penalty(self, unknown: Floats, center: Floats) -> Floats:
        """(n,), how far unknowns are from what is expected, squared, in standard deviations."""
        held = np.where(self.prior < _HELD, self.prior, 0.0)
        penalty: Floats = np.sum(held * (unknown - center) ** 2, axis=1)
        return penalty

    def moved(self, unknown: Floats, by: Floats) -> Floats:
        """Unknowns after a step, which is no longer than pulses are wide."""
        s = self.late_ps.shape[1]
        by[:, s : 2 * s] = np.clip(by[:, s : 2 * s], -0.5 * self.std_ps, 0.5 * self.std_ps)
        by[:, -2] = np.clip(by[:, -2], -0.2, 0.2)
        unknown = unknown + by
        photons = np.clip(unknown[:, :s], _LEAST_PHOTONS, self.most)
        unknown[:, :s] = np.where(self.absent, 0.0, photons)
        unknown[:, -1] = np.maximum(unknown[:, -1], 0.1 * self.background_per_ps)
        return unknown


def _own_of(cells: Cells, pulses: Pulses, other: Floats | float, beyond: bool) -> _Own:
    """Where unknowns begin, and what holds them."""
    n, s = pulses.late_ps.shape
    absent = np.isnan(pulses.late_ps)
    late, std = np.where(absent, 0.0, pulses.late_ps), np.where(absent, 1.0, pulses.std_ps)
    middle = 0.5 * (cells.edges_ps[:, 1:] + cells.edges_ps[:, :-1])
    close = np.abs(middle[:, :, np.newaxis] - late[:, np.newaxis]) < 3.5 * std[:, np.newaxis]
    close &= ~absent[:, np.newaxis]
    start = _background(cells, np.asarray(close.any(axis=2)))
    beside = start[:, np.newaxis] * cells.width_ps + other
    above = np.where(close, (cells.counts - beside)[:, :, np.newaxis], 0.0)
    changes = bool(s) and not pulses.shape.is_gaussian
    unknown, center, prior = np.zeros((3, n, 2 * s + 2 + changes + beyond))
    unknown[:, :s] = np.where(absent, 0.0, np.maximum(above.sum(axis=1), 0.5))
    unknown[:, -1] = start
    came = np.divide(
        cells.counts, cells.open_share, out=np.zeros_like(cells.counts),
        where=cells.open_share > 0.0,
    )  # fmt: skip
    # Two pulses at one place may trade light without end.
    most = came.sum(axis=1)[:, np.newaxis] + 1.0
    # Where shares below none leave nothing to expect, no cell says how bright a pulse is.
    prior[:, :s] = np.where(absent, _HELD, (_MOST_PHOTONS * most) ** -2.0)
    prior[:, s : 2 * s] = np.where(absent, _HELD, std**-2.0)
    if pulses.share is not None:
        # Of pulses that lie under each other nothing but the picture tells which is which.
        less = ~absent & (pulses.share < 0.5)
        told = pulses.share * most
        off = np.hypot(_SHARE_STD * told, _LEAST_SHARE * most)
        prior[:, :s] = np.where(less, off**-2.0, prior[:, :s])
        center[:, :s] = np.where(less, told, 0.0)
        unknown[:, :s] = np.where(less, np.minimum(unknown[:, :s], told), unknown[:, :s])
    if beyond:
        prior[:, 2 * s] = _BEYOND_STD**-2.0
    if changes:
        prior[:, -3] = 1.0
    # Stretched, a pulse with a tail comes late: it is spread.
    prior[:, -2] = _width_std(pulses) ** -2.0 if s and not changes else _HELD
    prior[:, -1] = start**-2.0
    center[:, -1] = start
    return _Own(late, std, absent, unknown, center, prior, most, start)


def _closer(center: Floats, inverse: Floats, own: _Own, pulses: Pulses) -> Floats:
    """Expected widths: about a place fitted to them few photons lie closer than about their own."""
    s, center = own.late_ps.shape[1], center.copy()
    taken = np.minimum(inverse[:, s, s] / own.std_ps[:, 0] ** 2, _MOST_TAKEN)
    closer = 0.5 * np.log1p(-taken)
    if not pulses.shape.is_gaussian and pulses.shape.flight is not None:
        spread = 1.0 + 2.0 * pulses.shape.flight[:, 0]
        center[:, -3] = closer * spread / flight_std_of(pulses)[:, 0]
    else:
        center[:, -2] = closer
    return center


def _lacks_of(cells: Cells, mean: Floats, dispersion: float) -> Floats:
    """(n,), twice what the log-likelihood of each pixel lacks, up to a constant.

    A quasi-likelihood, of which the score is the slope: with the variance V(m) = d m + (e m)^2 of a
    mean m, the integral of (n - m) / V.
    """
    unsure = np.maximum(cells.width_error, _LEAST_ERROR) ** 2 / dispersion
    more = np.log1p(unsure * mean)
    live = cells.live & (mean > 0.0)
    log = np.log(mean, out=np.zeros_like(mean), where=live)
    gained = np.where(live, cells.counts * (log - more) - more / unsure, 0.0)
    lacks: Floats = -2.0 / dispersion * gained.sum(axis=1)
    return lacks


def as_wide_as_seen(pulses: Pulses, pixels: Pixels) -> tuple[Pulses, bool]:
    """Pulses of a calibrated shape spread as all pixels together show them, and whether they were.

    A laser that is not that of the flat, or a warmer detector, spreads a pulse: what is stretched
    with it, tail and all, comes late.
    """
    expected, found = pulses.shape.flight, pixels.shape.flight
    if expected is None or found is None or not found.size:
        return pulses, False
    # Each pixel is held near what is expected; what it would say by itself is farther off.
    unknown = pixels.inverse[:, -3, -3]
    telling = unknown < _TELLS
    if not telling.any():
        return pulses, False
    said = (found[:, 0] - expected[:, 0])[telling] / (1.0 - unknown[telling])
    more = float(np.median(said))
    if abs(more) < _AS_WIDE:
        return pulses, False
    return replace(pulses, shape=pulses.shape.drawn_out(expected + more)), True


def _width_std(pulses: Pulses) -> Floats:
    """(n,), by how much Gaussian pulses may be wider than expected, ln; flight: of the nearest."""
    if pulses.flight_std is None:
        return np.full(len(pulses.late_ps), _WIDTH_STD)
    std: Floats = np.hypot(_WIDTH_STD, np.nan_to_num(pulses.flight_std[:, 0]))
    return std


def light_of_second_pulse(pixels: Pixels, second: Echo, tails: Tails) -> Floats:
    """(n, m, 2): how the counts of lit pixels follow share and delay of a second pulse.

    `tails` as the pixels were fitted with them.
    """
    cells = pixels.cells
    out = np.zeros((*cells.counts.shape, 2))
    for k in range(pixels.photons.shape[1]):
        lit = np.flatnonzero(pixels.photons[:, k] > 0.0)
        late, std = pixels.late_ps[lit, k : k + 1], pixels.std_ps[lit, k : k + 1]
        z = (cells.edges_ps[lit] - late - second.later(cells.edges_ps[lit], late)) / std
        come, density = pulse_at(z, std, pixels.shape.of(lit, k), tails)[:2]
        photons = pixels.photons[lit, k : k + 1]
        out[lit, :, 0] += photons * np.diff(come, axis=1)
        out[lit, :, 1] -= second.share * photons / std * np.diff(density, axis=1)
    out *= (cells.live * cells.open_share)[:, :, np.newaxis]
    return out


def _inverse(information: Floats, prior: Floats) -> Floats:
    """Inverse of each (q, q) with the priors' precision added, scaled so that none is singular."""
    diagonal = np.arange(prior.shape[1])
    information[:, diagonal, diagonal] += prior
    scale = 1.0 / np.sqrt(information[:, diagonal, diagonal] + 1e-300)
    scaled = information * scale[:, :, np.newaxis] * scale[:, np.newaxis]
    scaled[:, diagonal, diagonal] += 1e-9
    inverse: Floats = np.linalg.inv(scaled) * scale[:, :, np.newaxis] * scale[:, np.newaxis]
    return inverse


def cumulated(
    edges_ps: Floats, late_ps: Floats, std_ps: Floats, wait_ps: float, shape: Shape = GAUSSIAN
) -> Floats:
    """Share of pulses (n,) that has come by each edge (n, m), late by an exponential wait."""
    z = (edges_ps - late_ps[:, np.newaxis]) / std_ps[:, np.newaxis]
    prompt = shape.come(z)
    if wait_ps <= 0.0:
        return prompt
    share: Floats = prompt - shape.kept_back(z, (std_ps / wait_ps)[:, np.newaxis])
    return share
