"""What light beside a plain flight would add to the counts of each pixel.

Columns are counts per unit of size, in the cells of some pixels: by their own pulse (late light,
other pulses, pile-up) or by the light of all bright pixels about them (halo, glare).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from lightflight.reconstruct.model.cells import Cells, as_counted
from lightflight.reconstruct.model.counted import Pixels
from lightflight.reconstruct.model.expected_counts import Tails
from lightflight.reconstruct.model.pulse_shape import GAUSSIAN, Shape
from lightflight.reconstruct.model.second_path import SecondPath
from lightflight.reconstruct.model.second_pulse import Echo
from lightflight.reconstruct.model.spread import (
    SIDES,
    WIDE_LABELS,
    WIDE_LATE,
    WIDE_PX,
    Beam,
    Spread,
    columns_of_halos,
    halo_whenever,
    spread_counts,
    wide_light,
)

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

LATE_PS = (150.0, 500.0, 2000.0)
"""Mean delays of light that is scattered more than once, or of a detector's slow carriers, ps."""
EARLIEST_PS, LATEST_PS = -3000.0, 6000.0
"""Where another pulse is looked for about a pixel's own, ps."""
LEAST_SHARE = 0.005
"""Of the path's light: less is less than is known of the shape of pulses. It may move a path by
more than its error all the same, which `blind_to` says. With a third more the same recordings are
trusted, and the same causes named."""
MUCH = 0.03
"""Of the light: where as much is diffuse, lines and brightness in the picture are moved by it."""
_NEAREST_STDS = 1.5
"""Nearer to the own pulse than this another one only moves and widens it."""
_FINE_PS, _AROUND_PS = 25.0, 1500.0
_COARSE_PS, _COARSE_FOR_PS = 250.0, 18_500.0
"""Steps of the times between which diffuse light is a straight line: from so long before the light
until so long after it, and from then on for so long."""


N_LATE, N_WIDE = len(LATE_PS), len(WIDE_LABELS)
LABELS = (
    *(f"late by {wait:g} ps" for wait in LATE_PS),
    *WIDE_LABELS,
    *(f"how late those of {wait:g} ps are" for wait in LATE_PS),
    *(f"how much brighter it is {side} the picture" for side in SIDES),
)
WIDE = slice(N_LATE, N_LATE + N_WIDE)
WAITS, OUTSIDE = slice(WIDE.stop, WIDE.stop + N_LATE), slice(WIDE.stop + N_LATE, len(LABELS))
HALOS = slice(N_LATE, N_LATE + len(WIDE_PX) + len(WIDE_LATE))
OF_PULSES, OF_SPREAD = np.r_[:N_LATE, WAITS], np.r_[WIDE, OUTSIDE]
"""Where the kinds of `LABELS` stand: which are a pulse's own, which are of light from elsewhere."""
_ACROSS_PX = 0.5
_FALLS_OFF = _ACROSS_PX * np.array(
    [
        np.exp(-0.5 * (np.arange(-4.0 * WIDE_PX[-1], 4.0 * WIDE_PX[-1], _ACROSS_PX) / reach) ** 2)
        / (reach * np.sqrt(2.0 * np.pi))
        for reach in WIDE_PX
    ]
)
"""How halos fall off from a long line: light of each in strips of half a pixel; it sums to one."""
_LEAST_HALO = 0.1
"""Of the brightest halo: what is unknown of dimmer ones is taken as of this one."""
_NUDGE = 1e-3
"""Step of a mean wait for its derivative, ln."""


@dataclass(frozen=True, eq=False)
class Strengths:
    """Diffuse light: shares of the path's, how much longer than `LATE_PS` it waits, and how much
    more of it comes from outside of the picture than was guessed.

    Attributes
    ----------
    value : array of float, shape (k,)
        In the order of `LABELS`; shares may be negative by chance, waits are ln.
    covariance : array of float, shape (k, k)
    """

    value: Floats
    covariance: Floats

    @property
    def of_kinds(self) -> Floats:
        """Shares, the reaches of a halo as one: they are parts of one profile, and may be less
        than none where it falls off faster than they do.
        """
        halo, late, glare = np.split(self.wide, [len(WIDE_PX), len(WIDE_PX) + len(WIDE_LATE)])
        return np.concatenate((self.value[:N_LATE], [halo.sum(), late.sum()], glare))

    @property
    def most(self) -> float:
        """The largest share, in absolute value, of any kind of it."""
        return max(self.of_halos, float(np.abs(self.of_kinds).max()))

    @property
    def of_halos(self) -> float:
        """The larger share of what is spread about the path, at once and late.

        That may be less than none on one side of a place and more on the other, as it falls off
        from a line: either counts.
        """
        shares = np.zeros((2, len(WIDE_PX)))
        columns = columns_of_halos(WIDE_PX, WIDE_LATE)
        for share, (reach, wait) in zip(self.value[HALOS], columns, strict=True):
            shares[int(wait > 0.0), reach] += share
        return float(np.abs(shares @ _FALLS_OFF).sum(axis=1).max())

    @property
    def wide(self) -> Floats:
        """Halo and glare."""
        return self.value[WIDE]

    @property
    def outside(self) -> Floats:
        """(4,), by how much the light on each side of the picture is brighter than guessed."""
        return self.value[OUTSIDE]

    @property
    def tails(self) -> Tails:
        """Of each pulse: share that is late, and its mean wait, ps."""
        waits = np.array(LATE_PS) * np.exp(self.value[WAITS])
        return tuple(zip(self.value[:N_LATE].tolist(), waits.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Diffuse:
    """Diffuse light of one recording: how strong, and of which light; n pixels with s legs each.

    Attributes
    ----------
    strengths : Strengths
    beam : Beam
        The light that is spread.
    rows, cols : array of int, shape (n,)
        Pixels that the path lights.
    leg : array of int, shape (n, s)
        Which legs; -1: none.
    arrival_ps : array of float, shape (n, s)
        When their light comes, ps on the clock.
    photons, std_ps : array of float, shape (n, s)
        Light of each, late light and all, and the width of its pulse, ps (`model.counted.Pixels`).
    modes_ps : array of float, shape (n, s, k)
        How those times follow what is left unknown of the strengths, one-sigma columns.
    second : SecondPath, Echo or None
        Whose light comes with it; None: there is none.
    shape : Shape
        Of the pulses, without late light.
    """

    strengths: Strengths
    beam: Beam
    rows: Indices
    cols: Indices
    leg: Indices
    arrival_ps: Floats
    photons: Floats
    std_ps: Floats
    modes_ps: Floats
    second: SecondPath | Echo | None = None
    shape: Shape = field(default=GAUSSIAN, kw_only=True)

    @property
    def drawn_out_ps(self) -> Floats:
        """(n, s), standard deviation of pulses with what flight adds to them, ps."""
        return self.shape.drawn_out_ps(self.std_ps)

    @property
    def has_halo(self) -> bool:
        """Whether much light is spread about the path."""
        return self.strengths.of_halos > MUCH

    def without_halo(self) -> Diffuse:
        """The same without the light that is spread about the path."""
        value = self.strengths.value.copy()
        value[HALOS] = 0.0
        return replace(self, strengths=replace(self.strengths, value=value))

    def halo_photons(self, rows: Indices, cols: Indices, shape: tuple[int, int]) -> Floats:
        """(m,), photons of all halos in some pixels, whenever they come."""
        photons: Floats = self._halos(rows, cols, shape) @ self.strengths.value[HALOS]
        return photons

    def _halos(self, rows: Indices, cols: Indices, shape: tuple[int, int]) -> Floats:
        """(m, j), the same of each halo at a strength of one."""
        beam = self.beam.brighter(self.strengths.outside, shape)
        return halo_whenever(np.column_stack((rows, cols)), beam, shape)

    def halo_unknown(self, rows: Indices, cols: Indices, shape: tuple[int, int]) -> Floats:
        """(m, j), how the log of the halo in some pixels follows what is unknown of how wide it is.

        One standard deviation a column.
        """
        each = self._halos(rows, cols, shape)
        told = each @ self.strengths.value[HALOS]
        root = np.linalg.cholesky(self.strengths.covariance[HALOS, HALOS])
        # Where there is hardly any its log would be anything.
        least = _LEAST_HALO * float(told.max(initial=0.0))
        if least <= 0.0:
            return np.zeros((len(rows), 0))
        unknown: Floats = each @ root / np.maximum(told, least)[:, np.newaxis]
        return unknown

    def otherwise(self) -> Iterator[Diffuse]:
        """The same with spread light that is off by one standard deviation, of one error each.

        What is left unknown of its strengths is a sum of these errors, which are independent.
        """
        own = np.ix_(OF_SPREAD, OF_SPREAD)
        variance, errors = np.linalg.eigh(self.strengths.covariance[own])
        for error in (errors * np.sqrt(np.maximum(variance, 0.0))).T:
            value = self.strengths.value.copy()
            value[OF_SPREAD] += error
            yield replace(self, strengths=replace(self.strengths, value=value))

    def times(self, factor: float) -> Diffuse:
        """The same of a recording `factor` times as long."""
        beam = replace(self.beam, photons=factor * self.beam.photons)
        second = None if self.second is None else self.second.times(factor)
        return replace(self, beam=beam, photons=factor * self.photons, second=second)

    def at_pixels(self, rows: Indices, cols: Indices, shape: tuple[int, int]) -> Indices:
        """(m,), which of the n pixels each of some others is; -1: none."""
        place = np.full(shape, -1)
        place[self.rows, self.cols] = np.arange(len(self.rows))
        at: Indices = place[rows, cols]
        return at

    def modes_of_legs(
        self, rows: Indices, cols: Indices, shape: tuple[int, int], n_legs: int
    ) -> Floats:
        """(m, L, k), modes of some pixels; zero where the path gives them no light."""
        at = self.at_pixels(rows, cols, shape)
        modes = np.zeros((len(rows), n_legs, self.modes_ps.shape[2]))
        for k in range(self.leg.shape[1]):
            own = np.flatnonzero((at >= 0) & (self.leg[at, k] >= 0))
            modes[own, self.leg[at[own], k]] = self.modes_ps[at[own], k]
        return modes

    def spread(
        self, cells: Cells, points_px: Indices, reference_ps: Floats, shape: tuple[int, int]
    ) -> Floats:
        """(n, m), counts of halo and glare in cells of some pixels; as `spread_light`."""
        beam = self.beam.brighter(self.strengths.outside, shape)
        wide = wide_light(cells, points_px, reference_ps, beam, shape)
        counts: Floats = wide @ self.strengths.wide
        return counts

    def counts(
        self,
        rows: Indices,
        cols: Indices,
        intervals_ps: tuple[Floats, Floats],
        period_ps: float,
        shape: tuple[int, int],
    ) -> Floats:
        """(m, codes), counts expected of it in codes from `intervals_ps`, on the clock of arrivals.

        Light that is late is counted here, and what is prompt with the path: late light tells
        hardly when it left.
        """
        at = self.at_pixels(rows, cols, shape)
        points = np.column_stack((rows, cols))
        # One grid for all pixels: what falls into one may come from the other end of the flight.
        first, last = float(np.min(self.beam.arrival_ps)), float(np.max(self.beam.arrival_ps))
        middle = 0.5 * (first + last)
        fine = np.arange(first - middle - _AROUND_PS, last - middle + _AROUND_PS, _FINE_PS)
        coarse = np.arange(fine[-1] + _COARSE_PS, fine[-1] + _COARSE_FOR_PS, _COARSE_PS)
        lags = np.concatenate((fine, coarse))
        beam = self.beam.brighter(self.strengths.outside, shape)
        found = spread_counts(middle + lags, points, beam, shape, self.strengths.wide)
        for k in range(self.leg.shape[1]):
            own = np.flatnonzero((at >= 0) & (self.photons[at, k] > 0.0))
            late = self.arrival_ps[at[own], k, np.newaxis] - middle
            std, photons = self.std_ps[at[own], k, np.newaxis], self.photons[at[own], k, np.newaxis]
            pulse = self.shape.of(at[own], k)
            for again, delay in ((1.0, 0.0), *self._second):
                z = (lags - late - delay) / std
                prompt, come = pulse.come(z), np.zeros_like(z)
                for share, wait in self.strengths.tails:
                    come += share * (prompt - pulse.kept_back(z, std / wait))
                found[own] += again * photons * np.diff(come, axis=1)
        before = np.concatenate((np.zeros((len(rows), 1)), np.cumsum(found, axis=1)), axis=1)
        out = np.empty(intervals_ps[0].shape)
        for i in range(len(rows)):
            low, up = (each[i] - middle for each in intervals_ps)
            if period_ps > 0.0:
                lap = period_ps * np.floor((low - lags[0]) / period_ps)
                low, up = low - lap, up - lap
            out[i] = np.interp(up, lags, before[i]) - np.interp(low, lags, before[i])
        if isinstance(self.second, SecondPath):
            out += self.second.counts(rows, cols, intervals_ps, period_ps)
        return out

    def guessed(
        self,
        rows: Indices,
        cols: Indices,
        intervals_ps: tuple[Floats, Floats],
        period_ps: float,
    ) -> Floats | None:
        """(m, codes), of these counts those that are guessed; None: none are.

        A mirror shows what the picture does not: nobody knows how bright that is.
        """
        if not isinstance(self.second, SecondPath):
            return None
        found = self.second.counts(rows, cols, intervals_ps, period_ps, only_guessed=True)
        return found if found.any() else None

    @property
    def _second(self) -> tuple[tuple[float, float], ...]:
        """Share and delay, ps, of a second pulse; (): there is none."""
        second = self.second
        return ((second.share, second.delay_ps),) if isinstance(second, Echo) else ()

    def counts_of_second_pulse(
        self,
        rows: Indices,
        cols: Indices,
        intervals_ps: tuple[Floats, Floats],
        period_ps: float,
        shape: tuple[int, int],
    ) -> Floats:
        """(m, codes), what a second pulse brings at once; as `counts`, of which it is no part.

        It tells as well as the first when it left, so who fits counts has it in the model.
        """
        out = np.zeros(intervals_ps[0].shape)
        at = self.at_pixels(rows, cols, shape)
        prompt = 1.0 - sum(share for share, _ in self.strengths.tails)
        for again, delay in self._second:
            for k in range(self.leg.shape[1]):
                own = np.flatnonzero((at >= 0) & (self.photons[at, k] > 0.0))
                late = self.arrival_ps[at[own], k, np.newaxis] + delay
                low, up = (each[own] - late for each in intervals_ps)
                if period_ps > 0.0:
                    lap = period_ps * np.rint(0.5 * (low + up) / period_ps)
                    low, up = low - lap, up - lap
                std = self.std_ps[at[own], k, np.newaxis]
                pulse = self.shape.of(at[own], k)
                come = pulse.come(up / std) - pulse.come(low / std)
                light = again * prompt * self.photons[at[own], k, np.newaxis]
                out[own] += light * np.maximum(come, 0.0)
        return out


def late_light(pixels: Pixels, waits_ps: Sequence[float] = LATE_PS) -> Floats:
    """(n, m, k): the light of a pixel's legs late by k mean waits, their own taken off."""
    edges, second = pixels.cells.edges_ps, pixels.second
    out = np.zeros((*pixels.cells.counts.shape, len(waits_ps)))
    for k in range(pixels.photons.shape[1]):
        lit = np.flatnonzero(pixels.photons[:, k] > 0.0)
        late, std = pixels.late_ps[lit, k : k + 1], pixels.std_ps[lit, k : k + 1]
        come = [(pixels.photons[lit, k : k + 1], (edges[lit] - late) / std)]
        if second is not None:
            again = (edges[lit] - late - second.later(edges[lit], late)) / std
            come.append((second.share * come[0][0], again))
        shape = pixels.shape.of(lit, k)
        for photons, z in come:
            for j, wait in enumerate(waits_ps):
                # What comes late less what comes at once: what waits still keep back.
                out[lit, :, j] -= photons * np.diff(shape.kept_back(z, std / wait), axis=1)
    return as_counted(pixels.cells, out)


def diffuse_light(pixels: Pixels, spread: Spread | None, strengths: Strengths) -> Floats:
    """(n, m, k): how the counts of lit pixels follow the strengths, in the order of `LABELS`.

    With the tails that the pixels were fitted with; without `spread` shares and waits of late light
    alone (`OF_PULSES`).
    """
    shares, waits = (np.array(each) for each in zip(*strengths.tails, strict=True))
    both = late_light(pixels, [*waits.tolist(), *(np.exp(_NUDGE) * waits).tolist()])
    late, later = np.split(both, 2, axis=2)
    waiting = shares / _NUDGE * (later - late)
    if spread is None:
        return np.concatenate((late, waiting), axis=2)
    wide, outside = np.split(spread.columns(strengths.wide, strengths.outside), [N_WIDE], axis=2)
    return np.concatenate((late, wide, waiting, outside), axis=2)


def other_lags(
    lags_ps: Floats, std_ps: float, between_ps: tuple[float, float] = (EARLIEST_PS, LATEST_PS)
) -> Floats:
    """(k,) times of other pulses that are tried: the middle of each cell beside the pulse."""
    middle = 0.5 * (lags_ps[1:] + lags_ps[:-1])
    far = np.abs(middle) > _NEAREST_STDS * std_ps
    tried: Floats = middle[far & (middle > between_ps[0]) & (middle < between_ps[1])]
    return tried


def other_pulses(pixels: Pixels, lags_ps: Floats) -> Floats:
    """(n, m, k): a second pulse like the pixel's own, earlier or later by each lag."""
    cells = pixels.cells
    out = np.empty((*cells.counts.shape, len(lags_ps)))
    std, photons = pixels.std_ps[:, :1], pixels.photons[:, :1]
    z, shape = (
        (cells.edges_ps - pixels.late_ps[:, :1]) / std,
        pixels.shape.of(np.arange(len(std)), 0),
    )
    for j, lag in enumerate(lags_ps):
        out[:, :, j] = photons * np.diff(shape.come(z - lag / std), axis=1)
    return as_counted(cells, out)


def pile_up(pixels: Pixels, sync_ps: Floats, period_ps: float | None) -> Floats:
    """(n, m, 1): photons that earlier ones of their period hide, per share of hidden ones.

    `sync_ps` (n,) is when the period begins, ps after the pixel's reference.
    """
    cells = pixels.cells
    middle = 0.5 * (cells.edges_ps[:, 1:] + cells.edges_ps[:, :-1])
    passed, lap = middle - sync_ps[:, np.newaxis], np.zeros_like(middle)
    if period_ps is not None:
        lap = np.floor(passed / period_ps)
        passed = passed - lap * period_ps
    before = pixels.background_per_ps[:, np.newaxis] * passed
    for k in range(pixels.photons.shape[1]):
        z = (middle - pixels.late_ps[:, k : k + 1]) / pixels.drawn_out_ps[:, k : k + 1]
        before = before + np.where(lap == 0.0, pixels.photons[:, k : k + 1] * ndtr(z), 0.0)
    most = max(float(pixels.photons.max(initial=0.0)), 1.0)
    return as_counted(cells, -(pixels.mean * before / most)[:, :, np.newaxis])


def classes(cells: Cells, of_class: Indices, lags_ps: Floats, size: Floats) -> Floats:
    """(n, m, classes x lags): counts of one class of pixels in one stretch of time, by `size`.

    Of the classes that there are, in their order.
    """
    middle = 0.5 * (cells.edges_ps[:, 1:] + cells.edges_ps[:, :-1])
    stretch = np.clip(np.searchsorted(lags_ps, middle) - 1, 0, len(lags_ps) - 2)
    n_lags = len(lags_ps) - 1
    kinds, kind = np.unique(of_class, return_inverse=True)
    which = kind[:, np.newaxis] * n_lags + stretch
    own = which[:, :, np.newaxis] == np.arange(len(kinds) * n_lags)
    return as_counted(cells, own * size[:, :, np.newaxis])
