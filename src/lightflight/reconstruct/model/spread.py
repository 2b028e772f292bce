"""Light of a flight that lens and room spread over the picture: halo and glare.

A halo falls into the picture from outside of it as well. How bright the light is there nobody saw:
as bright as where it leaves the picture is a guess, one for each side, that the counts correct.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.cells import Cells, as_counted
from lightflight.reconstruct.model.counted import cumulated
from lightflight.reconstruct.model.image_plane import inside_edges_px
from lightflight.reconstruct.model.second_pulse import Echo

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

HALO_PX = (1.0, 3.0, 8.0)
"""Reach of halos that are looked for: neighbouring pixels, a lens out of focus or dusty, inner
reflections, px."""
HALO_LATE = ((8.0, 600.0),)
"""Reach, px, and mean delay, ps, of one that is scattered about the lens' surroundings."""
GLARE_LATE_PS = 3000.0
"""Mean delay of light that a room throws back to all of the picture, ps."""
WIDE_PX = (2.0, 2.5, 3.2, 4.2, 5.8, 8.0, 10.0, 12.5)
"""Reach of halos in the fit, px. One between two of them is a sum of all: of 240,000 photons what
is left is below their noise, and where the light of the leg hides it it is known to 1 %. With five
of them it was 13 % off there. Nearer than 2 px to a leg's line a halo is not told from brightness.
"""
_LATE_PX = (3.2, 8.0)
WIDE_LATE = tuple((reach, wait) for reach in _LATE_PX for wait in (200.0, 600.0, 1800.0))
"""Reach, px, and mean delay, ps, of halos in the fit that are late: fog of any kind is a sum."""
WIDE_LABELS = (
    *(f"about the path by {reach:g} px" for reach in WIDE_PX),
    *(f"about the path by {reach:g} px and late by {wait:g} ps" for reach, wait in WIDE_LATE),
    "over the picture",
    f"over the picture and late by {GLARE_LATE_PS:g} ps",
)
SIDES = ("above", "below", "left of", "right of")
"""Of the picture, where light may run on."""
_STEPS_OF_TIME = 120
_SLOT_STDS = 0.25
"""Light of a leg is spread slot by slot of its flight: what comes within a quarter of a pulse has
one mean time and width for all pixels, which leaves 1e-3 of the light wrong."""
_GRID_STDS = 0.125
"""Between two steps of a pulse's rise a straight line is off by 5e-4 of the pulse at most."""
_REACH_STDS = 5.0
"""Of a pulse 3e-7 lie beyond."""


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
        Outside of the picture a guess.
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
        arrays = {f.name: getattr(self, f.name)[kept] for f in fields(self) if f.name != "std_ps"}
        return replace(self, **arrays)

    def sides(self, shape: tuple[int, int]) -> Indices:
        """(k,), which of `SIDES` of a picture of `shape` each place lies on; -1: in it."""
        inside = inside_edges_px(self.points_px[:, 0], self.points_px[:, 1], shape)
        side: Indices = np.where(inside.min(axis=1) < 0.0, np.argmin(inside, axis=1), -1)
        return side

    def brighter(self, outside: Floats, shape: tuple[int, int]) -> Beam:
        """The same with light outside of the picture brighter by shares `outside` (4,)."""
        side = self.sides(shape)
        factor = np.where(side < 0, 1.0, 1.0 + outside[side])
        return replace(self, photons=factor * self.photons)

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
class Spread:
    """Counts that spread light brings to m cells of n pixels, at strengths of one.

    Attributes
    ----------
    wide : array of float, shape (n, m, k)
        In the order of `WIDE_LABELS`, the light outside as bright as guessed.
    outside : array of float, shape (n, m, s, h)
        Of the halos among them, what comes from each of s sides.
    sides : array of int, shape (s,)
        Which of `SIDES` these are.
    """

    wide: Floats
    outside: Floats
    sides: Indices

    def counts(self, wide: Floats, outside: Floats) -> Floats:
        """(n, m), at strengths `wide` (k,), light outside brighter by shares `outside` (4,)."""
        more = outside[self.sides, np.newaxis] * wide[: self.outside.shape[3]]
        counts: Floats = self.wide @ wide
        if more.any():
            counts = counts + self.outside.reshape(*counts.shape, -1) @ more.ravel()
        return counts

    def columns(self, wide: Floats, outside: Floats) -> Floats:
        """(n, m, k + 4), how `counts` follow `wide` and `outside`."""
        n_halos = self.outside.shape[3]
        columns = np.zeros((*self.wide.shape[:2], len(wide) + len(outside)))
        columns[:, :, : len(wide)] = self.wide
        columns[:, :, :n_halos] += np.einsum("nmsj,s->nmj", self.outside, outside[self.sides])
        # One product of a matrix and a vector: of many small ones each has its own price.
        of_sides = self.outside.reshape(-1, n_halos) @ wide[:n_halos]
        columns[:, :, len(wide) + self.sides] = of_sides.reshape(self.outside.shape[:3])
        return columns

    def times(self, factor: float) -> Spread:
        """The same of a recording `factor` times as long."""
        return replace(self, wide=factor * self.wide, outside=factor * self.outside)


def spread_light(
    cells: Cells, points_px: Indices, reference_ps: Floats, beam: Beam, shape: tuple[int, int]
) -> Spread:
    """Halo over `WIDE_PX` and late, glare at once and late, per share of the light.

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
    Spread
    """
    side = beam.sides(shape)
    sides = np.unique(side[side >= 0])
    outside = np.zeros((*cells.counts.shape, len(sides), len(WIDE_PX) + len(WIDE_LATE)))
    for k, one in enumerate(sides):
        there = beam.of(side == one)
        outside[:, :, k] = halo(cells, points_px, reference_ps, there, shape, WIDE_PX, WIDE_LATE)
    wide = wide_light(cells, points_px, reference_ps, beam.of(side < 0), shape)
    wide[:, :, : outside.shape[3]] += outside.sum(axis=2)
    return Spread(wide, outside, sides)


def wide_light(
    cells: Cells,
    points_px: Indices,
    reference_ps: Floats,
    beam: Beam,
    shape: tuple[int, int],
    reaches_px: Sequence[float] = WIDE_PX,
    late: Sequence[tuple[float, float]] = WIDE_LATE,
) -> Floats:
    """(n, m, k), the same of all sides together, in the order of `WIDE_LABELS`."""
    over = np.zeros((*cells.counts.shape, 2))
    seen = beam.sides(shape) < 0
    if seen.any():
        over = glare(cells, reference_ps, beam.of(seen), shape[0] * shape[1])
    about = halo(cells, points_px, reference_ps, beam, shape, reaches_px, late)
    return np.concatenate((about, over), axis=2)


def halo(
    cells: Cells,
    points_px: Indices,
    reference_ps: Floats,
    beam: Beam,
    shape: tuple[int, int],
    reaches_px: Sequence[float] = HALO_PX,
    late: Sequence[tuple[float, float]] = HALO_LATE,
) -> Floats:
    """(n, m, j + l): light of the beam spread over j reaches, and over some of them late as well.

    `points_px` (n, 2) are the pixels, of a picture of `shape`.
    """
    columns = columns_of_halos(reaches_px, late)
    out = np.zeros((len(columns), *cells.counts.shape))
    edges_ps = cells.edges_ps + reference_ps[:, np.newaxis]
    for leg in np.unique(beam.leg):
        one = beam.of(beam.leg == leg)
        slots, times, stds = _slots(one)
        grid = _grid(times, stds)
        rises = {wait: _rise(grid, times, stds, wait) for wait in {wait for _, wait in columns}}
        light = _by_slot(points_px, one, slots, shape, reaches_px)
        # Where a leg's halo is a ten-thousandth of its brightest it is none.
        bright = light.sum(axis=2)
        lit = np.any(bright > 1e-4 * bright.max(axis=1, initial=1e-300)[:, np.newaxis], axis=0)
        edges = _Edges.of(edges_ps[lit], grid)
        for c, (j, wait) in enumerate(columns):
            out[c, lit] += np.diff(_come_by(edges, light[j, lit], rises[wait], wait), axis=1)
    return as_counted(cells, np.ascontiguousarray(np.moveaxis(out, 0, 2)))


def halo_whenever(points_px: Indices, beam: Beam, shape: tuple[int, int]) -> Floats:
    """(n, j), light of halos in pixels (n, 2), whenever it comes; in the order of `WIDE_LABELS`."""
    everything = [np.arange(len(beam.leg))]
    by_reach = _by_slot(points_px, beam, everything, shape, WIDE_PX)[:, :, 0]
    return by_reach[[j for j, _ in columns_of_halos(WIDE_PX, WIDE_LATE)]].T


def spread_counts(
    edges_ps: Floats, points_px: Indices, beam: Beam, shape: tuple[int, int], wide: Floats
) -> Floats:
    """Counts that halo and glare of given strengths bring to cells that are alike in all pixels.

    Parameters
    ----------
    edges_ps : array of float, shape (m + 1,)
        Of these cells, on the clock.
    points_px : array of int, shape (n, 2)
        (row, column).
    beam : Beam
        Light that is spread; what lies outside of the picture makes no glare in it.
    shape : (int, int)
        Of the picture.
    wide : array of float, shape (k,)
        Shares of the light, in the order of `WIDE_LABELS`.

    Returns
    -------
    array of float, shape (n, m)
        As `wide_light` for each strength, summed: here light of one wait is told in one product.
    """
    out = np.zeros((len(points_px), len(edges_ps) - 1))
    columns = columns_of_halos(WIDE_PX, WIDE_LATE)
    for leg in np.unique(beam.leg):
        one = beam.of(beam.leg == leg)
        slots, times, stds = _slots(one)
        light = _by_slot(points_px, one, slots, shape, WIDE_PX)
        for late in sorted({wait for _, wait in columns}):
            own = [(c, j) for c, (j, wait) in enumerate(columns) if wait == late]
            by_slot = sum(wide[c] * light[j] for c, j in own)
            out += by_slot @ np.diff(_rise(edges_ps, times, stds, late), axis=1)
    seen = beam.sides(shape) < 0
    if seen.any():
        nothing = np.zeros((1, out.shape[1]))
        cells = Cells(edges_ps[np.newaxis], nothing, nothing == 0.0, nothing, nothing + 1.0)
        over = glare(cells, np.zeros(1), beam.of(seen), shape[0] * shape[1])
        out += over[0] @ wide[len(columns) :]
    return out


def columns_of_halos(
    reaches_px: Sequence[float], late: Sequence[tuple[float, float]]
) -> list[tuple[int, float]]:
    """Of each halo which reach it has and how long it waits, ps: those at once, then late ones."""
    at_once = [(j, 0.0) for j in range(len(reaches_px))]
    return at_once + [(list(reaches_px).index(reach), wait) for reach, wait in late]


def _by_slot(
    points_px: Indices,
    beam: Beam,
    slots: Sequence[Indices],
    shape: tuple[int, int],
    reaches_px: Sequence[float],
) -> Floats:
    """(j, n, b): light of each slot that a halo of each reach brings to pixels `points_px`."""
    row, col = points_px.T
    light = np.empty((len(reaches_px), len(row), len(slots)))
    # In the order of their slots, which are views then.
    order, ends = np.concatenate(slots), np.cumsum([len(own) for own in slots])
    photons, places = beam.photons[order], beam.points_px[order].T
    for j, reach in enumerate(reaches_px):
        down, across = (_blur(size, places[k], reach) for k, size in enumerate(shape))
        down *= photons
        by_column = np.ascontiguousarray(across.T)
        for b, (end, own) in enumerate(zip(ends, slots, strict=True)):
            here = slice(end - len(own), end)
            light[j, :, b] = (down[:, here] @ by_column[here])[row, col]
    return light


def _slots(beam: Beam) -> tuple[list[Indices], Floats, Floats]:
    """Places whose light comes within a quarter of a pulse; mean time and width of each."""
    late = beam.arrival_ps - beam.arrival_ps.min()
    slot = np.floor(late / (_SLOT_STDS * beam.std_ps))
    _, of, size = np.unique(slot, return_inverse=True, return_counts=True)
    mean = np.bincount(of, late) / size
    stds = np.sqrt(beam.std_ps**2 + np.bincount(of, (late - mean[of]) ** 2) / size)
    slots = np.split(np.argsort(of, kind="stable"), np.cumsum(size)[:-1])
    return slots, beam.arrival_ps.min() + mean, stds


def _grid(times_ps: Floats, stds_ps: Floats) -> Floats:
    """(g,), times at which it is told what has come of slots."""
    reach, step = _REACH_STDS * stds_ps.max(), _GRID_STDS * stds_ps.min()
    return np.arange(times_ps[0] - reach, times_ps[-1] + reach + step, step)


def _rise(grid_ps: Floats, times_ps: Floats, stds_ps: Floats, wait_ps: float) -> Floats:
    """(b, g), the share of the light of each slot that has come, late by a wait."""
    return cumulated(np.tile(grid_ps, (len(times_ps), 1)), times_ps, stds_ps, wait_ps)


@dataclass(frozen=True, eq=False)
class _Edges:
    """Where edges of cells (n, m) lie in a grid of times: step below, part of one, past the end.

    `below` counts through n tables, one after another.
    """

    below: Indices
    part: Floats
    beyond_ps: Floats

    @classmethod
    def of(cls, edges_ps: Floats, grid_ps: Floats) -> _Edges:
        place = (edges_ps - grid_ps[0]) / (grid_ps[1] - grid_ps[0])
        np.clip(place, 0.0, len(grid_ps) - 1.0, out=place)
        low = np.minimum(place.astype(np.int64), len(grid_ps) - 2)
        first = len(grid_ps) * np.arange(len(edges_ps))[:, np.newaxis]
        return cls(first + low, place - low, np.maximum(edges_ps - grid_ps[-1], 0.0))


def _come_by(edges: _Edges, light: Floats, come_of_slots: Floats, wait_ps: float) -> Floats:
    """(n, m), what has come by each edge of the light of slots (n, b), late by a wait."""
    by_grid = light @ come_of_slots
    flat = by_grid.ravel()
    come, after = flat.take(edges.below), flat.take(edges.below + 1)
    after -= come
    after *= edges.part
    come += after
    if wait_ps > 0.0:
        # All pulses have come by the end of the grid: what waits still decays, and nothing else.
        kept = light.sum(axis=1) - by_grid[:, -1]
        come -= kept[:, np.newaxis] * np.expm1(edges.beyond_ps / -wait_ps)
    return come


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
    return as_counted(cells, np.stack(parts, axis=2))
