"""What light beside a plain flight would add to the counts of each pixel.

Columns are counts per unit of size, in the cells of some pixels: by their own pulse (late light,
other pulses, pile-up) or by the light of all bright pixels about them (halo, glare).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from lightflight.reconstruct.model.cells import Cells
from lightflight.reconstruct.model.counted import Pixels, cumulated

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
_NEAREST_STDS = 1.5
"""Nearer to the own pulse than this another one only moves and widens it."""
_STEPS_OF_TIME = 120


@dataclass(frozen=True, eq=False)
class Beam:
    """The bright pixels: where the light is that halo and glare spread.

    Attributes
    ----------
    points_px : array of int, shape (k, 2)
        (row, column).
    leg : array of int, shape (k,)
        The leg that lights each.
    arrival_ps : array of float, shape (k,)
        When its light comes, ps on the clock.
    photons : array of float, shape (k,)
    std_ps : float
        Standard deviation of a pulse, ps.
    """

    points_px: Indices
    leg: Indices
    arrival_ps: Floats
    photons: Floats
    std_ps: float


def late_light(pixels: Pixels) -> Floats:
    """(n, m, 3): the light of a pixel's first leg late by each of `LATE_PS`, its own taken off."""
    edges, late = pixels.cells.edges_ps, pixels.late_ps[:, 0]
    std, photons = pixels.std_ps[:, 0], pixels.photons[:, :1]
    prompt = cumulated(edges, late, std, 0.0)
    parts = [np.diff(cumulated(edges, late, std, wait) - prompt, axis=1) for wait in LATE_PS]
    return _in_cells(pixels.cells, photons[:, :, np.newaxis] * np.stack(parts, axis=2))


def other_lags(lags_ps: Floats, std_ps: float) -> Floats:
    """(k,) times of other pulses that are tried: the middle of each cell beside the pulse."""
    middle = 0.5 * (lags_ps[1:] + lags_ps[:-1])
    far = np.abs(middle) > _NEAREST_STDS * std_ps
    tried: Floats = middle[far & (middle > EARLIEST_PS) & (middle < LATEST_PS)]
    return tried


def other_pulses(pixels: Pixels, lags_ps: Floats) -> Floats:
    """(n, m, k): a second pulse like the pixel's own, earlier or later by each lag."""
    cells = pixels.cells
    out = np.empty((*cells.counts.shape, len(lags_ps)))
    std, photons = pixels.std_ps[:, :1], pixels.photons[:, :1]
    z = (cells.edges_ps - pixels.late_ps[:, :1]) / std
    for j, lag in enumerate(lags_ps):
        out[:, :, j] = photons * np.diff(pixels.shape.before(z - lag / std), axis=1)
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
        moments = np.zeros((3, *shape))
        for power in range(3):
            moments[(power, *beam.points_px[own].T)] = beam.photons[own] * gap**power
        for j, reach in enumerate(HALO_PX):
            down, across = (_blur(size, reach) for size in shape)
            light, first, second = (down @ moments @ across)[:, row, col]
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


def _blur(size: int, reach_px: float) -> Floats:
    """(size, size): share of the light of each row that a Gaussian spreads to each other."""
    gap = np.subtract.outer(np.arange(size), np.arange(size)) / reach_px
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
