"""What light beside a plain flight would add to the counts of each pixel.

Columns are counts per unit of size, in the cells of some pixels: by their own pulse (late light,
other pulses, pile-up) or by the light of all bright pixels about them (halo, glare).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from lightflight.reconstruct.model.cells import Cells
from lightflight.reconstruct.model.counted import GAUSSIAN, Pixels, Shape, Tails, cumulated
from lightflight.reconstruct.model.second_path import SecondPath
from lightflight.reconstruct.model.second_pulse import Echo

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

LATE_PS = (150.0, 500.0, 2000.0)
"""Mean delays of light that is scattered more than once, or of a detector's slow carriers, ps."""
HALO_PX = (1.0, 3.0, 8.0)
"""Reach of a halo: neighbouring pixels, a lens out of focus or dusty, inner reflections, px."""
HALO_LATE_PS = 600.0
"""Mean delay of a halo that is scattered about the lens' surroundings, ps."""
GLARE_LATE_PS = 3000.0
"""Mean delay of light that a room throws back to all of the picture, ps."""
EARLIEST_PS, LATEST_PS = -3000.0, 6000.0
"""Where another pulse is looked for about a pixel's own, ps."""
LEAST_SHARE = 0.005
"""Of the path's light: less is less than is known of the shape of pulses. It may move a path by
more than its error all the same, which `blind_to` says. With a third more the same recordings are
trusted, and the same causes named."""
_NEAREST_STDS = 1.5
"""Nearer to the own pulse than this another one only moves and widens it."""
_STEPS_OF_TIME = 120
_GRID_PS = (1500.0, 1500.0, 25.0)
_GRID_LATE_PS = (1500.0, 20_000.0, 250.0)
"""From, to and step of the times about a pulse between which diffuse light is a straight line."""


N_LATE = len(LATE_PS)
WIDE_PX = HALO_PX[1:]
"""Nearer than 2 px to a leg's line a halo cannot be told from brightness."""
LABELS = (
    *(f"late by {wait:g} ps" for wait in LATE_PS),
    *(f"about the path by {reach:g} px" for reach in WIDE_PX),
    f"about the path by {WIDE_PX[-1]:g} px and late by {HALO_LATE_PS:g} ps",
    "over the picture",
    f"over the picture and late by {GLARE_LATE_PS:g} ps",
    *(f"how late those of {wait:g} ps are" for wait in LATE_PS),
)
N_WIDE = len(LABELS) - 2 * N_LATE
_NUDGE = 1e-3
"""Step of a mean wait for its derivative, ln."""


@dataclass(frozen=True, eq=False)
class Strengths:
    """Diffuse light, as shares of the path's, and how much longer than `LATE_PS` it waits, ln.

    Attributes
    ----------
    value : array of float, shape (k,)
        In the order of `LABELS`; shares may be negative by chance.
    covariance : array of float, shape (k, k)
    """

    value: Floats
    covariance: Floats

    @property
    def shares(self) -> Floats:
        """(k - 3,), without the waits."""
        return self.value[:-N_LATE]

    @property
    def wide(self) -> Floats:
        """(k - 6,), halo and glare."""
        return self.value[N_LATE:-N_LATE]

    @property
    def tails(self) -> Tails:
        """Of each pulse: share that is late, and its mean wait, ps."""
        waits = np.array(LATE_PS) * np.exp(self.value[-N_LATE:])
        return tuple(zip(self.value[:N_LATE].tolist(), waits.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Beam:
    """Where the light is that halo and glare spread, and when: bright pixels, or places of legs.

    Attributes
    ----------
    points_px : array of float, shape (k, 2)
        (row, column).
    leg : array of int, shape (k,)
        The leg that lights each.
    arrival_ps : array of float, shape (k,)
        When its light comes, ps on the clock.
    photons : array of float, shape (k,)
    std_ps : float
        Standard deviation of a pulse, ps.
    """

    points_px: Floats
    leg: Indices
    arrival_ps: Floats
    photons: Floats
    std_ps: float

    def of(self, kept: NDArray[np.bool_]) -> Beam:
        """Some of the places."""
        return Beam(
            self.points_px[kept],
            self.leg[kept],
            self.arrival_ps[kept],
            self.photons[kept],
            self.std_ps,
        )

    def with_second(self, second: Echo) -> Beam:
        """The light of both pulses; the second's is that of further legs."""
        return Beam(
            np.concatenate((self.points_px, self.points_px)),
            np.concatenate((self.leg, self.leg + int(self.leg.max(initial=0)) + 1)),
            np.concatenate((self.arrival_ps, self.arrival_ps + second.delay_ps)),
            np.concatenate((self.photons, second.share * self.photons)),
            self.std_ps,
        )


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
        Light of each, late light and all, and the width of its pulse, ps.
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
        middle = 0.5 * float(np.min(self.beam.arrival_ps) + np.max(self.beam.arrival_ps))
        reference = np.where(at >= 0, np.nan_to_num(self.arrival_ps[at, 0], nan=middle), middle)
        lags = np.concatenate(
            (np.arange(-_GRID_PS[0], _GRID_PS[1], _GRID_PS[2]), np.arange(*_GRID_LATE_PS))
        )
        edges = np.tile(lags, (len(rows), 1))
        nothing = np.zeros((len(rows), len(lags) - 1))
        cells = Cells(edges, nothing, nothing == 0.0, nothing, nothing + 1.0)
        found = spread_light(cells, points, reference, self.beam, shape) @ self.strengths.wide
        for k in range(self.leg.shape[1]):
            own = np.flatnonzero((at >= 0) & (self.photons[at, k] > 0.0))
            late = self.arrival_ps[at[own], k] - reference[own]
            std, photons = self.std_ps[at[own], k], self.photons[at[own], k, np.newaxis]
            for again, delay in ((1.0, 0.0), *self._second):
                for share, wait in self.strengths.tails:
                    by_edge = cumulated(edges[own], late + delay, std, wait, self.shape)
                    found[own] += again * share * photons * np.diff(by_edge, axis=1)
        before = np.concatenate((np.zeros((len(rows), 1)), np.cumsum(found, axis=1)), axis=1)
        out = np.empty(intervals_ps[0].shape)
        for i in range(len(rows)):
            low, up = (each[i] - reference[i] for each in intervals_ps)
            if period_ps > 0.0:
                lap = period_ps * np.floor((low + _GRID_PS[0]) / period_ps)
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
                come = self.shape.come(up / std) - self.shape.come(low / std)
                light = again * prompt * self.photons[at[own], k, np.newaxis]
                out[own] += light * np.maximum(come, 0.0)
        return out


def spread_light(
    cells: Cells, points_px: Indices, reference_ps: Floats, beam: Beam, shape: tuple[int, int]
) -> Floats:
    """(n, m, 5): halo over `WIDE_PX` and late, glare at once and late, per share of the light.

    Parameters
    ----------
    cells : Cells
        Of n pixels.
    points_px : array of int, shape (n, 2)
        (row, column).
    reference_ps : array of float, shape (n,)
        Arrival time at which their lags are zero, ps on the clock.
    beam : Beam
        Light that is spread; what lies outside of the picture makes no glare in it.
    shape : (int, int)
        Of the picture.

    Returns
    -------
    array of float, shape (n, m, 5)
    """
    row, col = beam.points_px.T
    seen = (row > -0.5) & (row < shape[0] - 0.5) & (col > -0.5) & (col < shape[1] - 0.5)
    if not seen.any():
        return np.zeros((*cells.counts.shape, N_WIDE))
    wide = halo(cells, points_px, reference_ps, beam, shape)[:, :, 1:]
    over = glare(cells, reference_ps, beam.of(seen), shape[0] * shape[1])
    return np.concatenate((wide, over), axis=2)


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
        for photons, z in come:
            prompt = pixels.shape.come(z)
            for j, wait in enumerate(waits_ps):
                by_edge = prompt - pixels.shape.kept_back(z, std / wait) - prompt
                out[lit, :, j] += photons * np.diff(by_edge, axis=1)
    return _in_cells(pixels.cells, out)


def diffuse_light(pixels: Pixels, wide: Floats, tails: Tails) -> Floats:
    """(n, m, k): what lit pixels gain by each strength, in the order of `LABELS`.

    `wide` (n, m, k - 6) as from `spread_light`; `tails` as the pixels were fitted with them.
    """
    shares, waits = (np.array(each) for each in zip(*tails, strict=True))
    both = late_light(pixels, [*waits.tolist(), *(np.exp(_NUDGE) * waits).tolist()])
    late, later = np.split(both, 2, axis=2)
    return np.concatenate((late, wide, shares / _NUDGE * (later - late)), axis=2)


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
    z = (cells.edges_ps - pixels.late_ps[:, :1]) / std
    for j, lag in enumerate(lags_ps):
        out[:, :, j] = photons * np.diff(pixels.shape.come(z - lag / std), axis=1)
    return _in_cells(cells, out)


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
        z = (middle - pixels.late_ps[:, k : k + 1]) / pixels.std_ps[:, k : k + 1]
        before = before + np.where(lap == 0.0, pixels.photons[:, k : k + 1] * ndtr(z), 0.0)
    most = max(float(pixels.photons.max(initial=0.0)), 1.0)
    return _in_cells(cells, -(pixels.mean * before / most)[:, :, np.newaxis])


def halo(
    cells: Cells, points_px: Indices, reference_ps: Floats, beam: Beam, shape: tuple[int, int]
) -> Floats:
    """(n, m, 4): light of the beam spread over `HALO_PX`, and over the widest late as well.

    `points_px` (n, 2) are the pixels, of a picture of `shape`. Of the light that a leg sends to a
    pixel the mean time and its spread are taken.
    """
    n, m = cells.counts.shape
    out = np.zeros((n, m, len(HALO_PX) + 1))
    row, col = points_px.T
    for leg in np.unique(beam.leg):
        own = beam.leg == leg
        center = float(np.median(beam.arrival_ps[own]))
        gap = beam.arrival_ps[own] - center
        moments = beam.photons[own] * gap ** np.arange(3)[:, np.newaxis]
        for j, reach in enumerate(HALO_PX):
            down, across = (
                _blur(size, beam.points_px[own, axis], reach) for axis, size in enumerate(shape)
            )
            light, first, second = ((down * one) @ across.T for one in moments)
            light, first, second = light[row, col], first[row, col], second[row, col]
            # Where a leg's halo is a ten-thousandth of its brightest it is none.
            lit = np.flatnonzero(light > 1e-4 * float(light.max(initial=1e-300)))
            mean, square = first[lit] / light[lit], second[lit] / light[lit]
            spread = np.sqrt(np.maximum(square - mean**2, 0.0) + beam.std_ps**2)
            late, edges = mean + center - reference_ps[lit], cells.edges_ps[lit]
            waits = (0.0, HALO_LATE_PS) if reach == HALO_PX[-1] else (0.0,)
            for k, wait in enumerate(waits):
                by_edge = cumulated(edges, late, spread, wait)
                out[lit, :, j + k] += light[lit, np.newaxis] * np.diff(by_edge, axis=1)
    return _in_cells(cells, out)


def _blur(size: int, places: Floats, reach_px: float) -> Floats:
    """(size, k): share of the light at each place that a Gaussian spreads to each row."""
    gap = np.subtract.outer(np.arange(size), places) / reach_px
    share: Floats = np.exp(-0.5 * gap**2) / (reach_px * np.sqrt(2.0 * np.pi))
    return share


def glare(cells: Cells, reference_ps: Floats, beam: Beam, n_pixels: int) -> Floats:
    """(n, m, 2): light of the beam over all of the picture alike, at once and `GLARE_LATE_PS`."""
    first, last = beam.arrival_ps.min(), beam.arrival_ps.max()
    wide = np.full(len(beam.leg), beam.std_ps)
    parts = []
    for wait in (0.0, GLARE_LATE_PS):
        reach = first - 5.0 * beam.std_ps, last + 5.0 * beam.std_ps + 8.0 * wait
        grid = np.linspace(*reach, _STEPS_OF_TIME)
        by_source = cumulated(np.tile(grid, (len(wide), 1)), beam.arrival_ps, wide, wait)
        by_time = beam.photons @ by_source / n_pixels
        places = cells.edges_ps + reference_ps[:, np.newaxis]
        parts.append(np.diff(np.interp(places, grid, by_time), axis=1))
    return _in_cells(cells, np.stack(parts, axis=2))


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
    return _in_cells(cells, own * size[:, :, np.newaxis])


def _in_cells(cells: Cells, columns: Floats) -> Floats:
    """Columns (n, m, k) as far as photons are counted, without the cells that are not live."""
    columns *= (cells.live * cells.open_share)[:, :, np.newaxis]
    return columns
