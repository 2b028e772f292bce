"""Counts about the time at which a path's light should come: few cells where there were many codes.

The edges of a cell are edges of codes, so what a cell expects needs no split of a code.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.sighting import Sighting
from lightflight.timing.clock.calibration import ASSUMED_PHASE_STD
from lightflight.timing.pulses.pile_up import open_share_of

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

CORE_STDS = 4.0
"""Half width of the finely divided part, in standard deviations of a pulse."""
_AT_ONCE = 1 << 16
"""Codes of all pixels that are worked on at once."""
_GAP_PS = 1e-6
"""Rounding of edges is less than this, ps."""
_FARTHEST_PS = 25_000.0
"""Without a laser period cells reach so far to both sides, ps."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Counts of n pixels in m cells each.

    Attributes
    ----------
    edges_ps : array of float, shape (n, m + 1)
        Ascending, after the pixel's reference time, ps.
    counts : array of float, shape (n, m)
        Photons between neighbouring edges.
    live : array of bool, shape (n, m)
        False where the codes have a gap, or no code ends within the cell.
    width_error : array of float, shape (n, m)
        Relative error of the cell's width, from what the clock leaves unknown of its codes.
    open_share : array of float, shape (n, m)
        Counts per photon that came: earlier ones of its period hide the rest (known pile-up).
    """

    edges_ps: Floats
    counts: Floats
    live: NDArray[np.bool_]
    width_error: Floats
    open_share: Floats

    @property
    def width_ps(self) -> Floats:
        """(n, m), ps; 0 where a cell is not live."""
        return np.where(self.live, np.diff(self.edges_ps, axis=1), 0.0)

    def of(self, kept: Indices | NDArray[np.bool_]) -> Cells:
        """The cells of some of the pixels."""
        return Cells(**{each.name: getattr(self, each.name)[kept] for each in fields(self)})


def lag_edges(std_ps: float, step_ps: float, growth: float, period_ps: float | None) -> Floats:
    """Edges of cells, ps after a pulse: `step_ps` apart about it, then wider by `growth` each."""
    half = CORE_STDS * std_ps
    farthest = _FARTHEST_PS if period_ps is None else 0.5 * period_ps
    n = max(1, int(np.ceil(half / step_ps)))
    later = [half]
    width = half / n
    while later[-1] + growth * width < farthest:
        width *= growth
        later.append(later[-1] + width)
    later.append(max(farthest, later[-1]))
    outer = np.array(later[1:])
    return np.concatenate((-outer[::-1], np.linspace(-half, half, 2 * n + 1), outer))


def as_counted(cells: Cells, columns: Floats) -> Floats:
    """Columns (n, m, k) as far as photons are counted, without the cells that are not live."""
    columns *= (cells.live * cells.open_share)[:, :, np.newaxis]
    return columns


def width_errors(sighting: Sighting, rows: Indices, cols: Indices, *, nominal: bool) -> Floats:
    """(n,), relative error of the width of one code, as the calibration states it."""
    timing = sighting.timing
    squared: Floats = np.mean(np.nan_to_num(timing.phase_std[rows, cols]) ** 2, axis=1)
    squared = squared + np.nan_to_num(timing.misfit_std[rows, cols]) ** 2
    if nominal:
        squared = squared + ASSUMED_PHASE_STD**2
    return np.sqrt(squared)


def cells_about(
    sighting: Sighting,
    rows: Indices,
    cols: Indices,
    reference_ps: Floats,
    lags_ps: Floats,
    *,
    nominal: bool,
) -> Cells:
    """Counts of pixels (n,) in cells about a time of each.

    Parameters
    ----------
    sighting : Sighting
        The recording.
    rows, cols : array of int, shape (n,)
        Pixels.
    reference_ps : array of float, shape (n,)
        Arrival time at which each pixel's lags are zero, ps on the clock.
    lags_ps : array of float, shape (m + 1,) or (n, m + 1)
        Of all pixels or of each; ascending, not longer than a laser period, ps; cells end at the
        next edges of codes.
    nominal : bool
        Whether the widths of the codes were never measured.

    Returns
    -------
    Cells
        (n, m).
    """
    # Few pixels at a time: their codes stay in the cache.
    step = max(1, _AT_ONCE // sighting.histograms.n_codes)
    blocks = [slice(first, first + step) for first in range(0, len(rows), step)]
    parts = [
        _cells_of(
            sighting, rows[block], cols[block], reference_ps[block],
            lags_ps if lags_ps.ndim == 1 else lags_ps[block],
        )
        for block in blocks
    ]  # fmt: skip
    edges, counts, size, share = (np.concatenate(part) for part in zip(*parts, strict=True))
    live = size > 0
    error = width_errors(sighting, rows, cols, nominal=nominal)[:, np.newaxis]
    return Cells(
        edges,
        np.where(live, counts, 0.0),
        live,
        np.where(live, error / np.sqrt(np.maximum(size, 1)), 0.0),
        share,
    )


def _cells_of(
    sighting: Sighting, rows: Indices, cols: Indices, reference_ps: Floats, lags_ps: Floats
) -> tuple[Floats, Floats, Indices, Floats]:
    """Edges (n, m + 1), ps, counts, number of codes (0: no cell) and open share, each (n, m)."""
    hist, timing = sighting.histograms, sighting.timing
    low, up = timing.code_intervals_ps(rows, cols)
    counts, blind = hist.counts[rows, cols], up <= low
    share = open_share_of(hist, rows, cols, (low, up))
    if blind.any():
        counts = np.where(blind, 0, counts)
    if hist.reversed_codes:
        low, up, counts, share = (each[:, ::-1] for each in (low, up, counts, share))
    n, codes = counts.shape
    shift = (timing.skew_ps[rows, cols] + reference_ps)[:, np.newaxis]
    first, last, wanted = low[:, :1], up[:, -1:], shift + lags_ps
    laps = np.zeros_like(wanted)
    if hist.laser_period_ps is not None:
        laps = np.floor((wanted - first) / hist.laser_period_ps) * hist.laser_period_ps
    at = _codes_at(low, last, np.clip(wanted - laps, first, last))
    before = np.zeros((n, codes + 1), dtype=np.int64)
    np.cumsum(counts, axis=1, out=before[:, 1:])
    found = np.diff(np.take_along_axis(before, at, axis=1), axis=1)
    # What lies beyond the last code on one lap and before the first on the next is no cell.
    size = np.diff(at, axis=1) * (np.diff(laps, axis=1) == 0.0)
    size[_spans_a_gap(low, up, at)] = 0
    starts = np.take_along_axis(low, np.minimum(at, codes - 1), axis=1)
    seen = np.ones(found.shape)
    # What hides photons of all delays alike is a part of the brightness.
    if share.shape[1] > 1:
        summed = np.concatenate((np.zeros((n, 1)), np.cumsum(share, axis=1)), axis=1)
        seen = np.diff(np.take_along_axis(summed, at, axis=1), axis=1) / np.maximum(size, 1)
        seen = np.where(size > 0, seen / share.max(axis=1, keepdims=True), 1.0)
    edges = np.where(at < codes, starts, last) + laps - shift
    return edges, found.astype(np.float64), size, seen


def _spans_a_gap(low: Floats, up: Floats, at: Indices) -> NDArray[np.bool_]:
    """(n, m), True for cells over time that no code covers, by codes that take no photon."""
    gap = low[:, 1:] - up[:, :-1] > _GAP_PS
    if not gap.any():
        return np.zeros((len(at), at.shape[1] - 1), dtype=bool)
    first, end = at[:, :-1], at[:, 1:]
    # Behind a code that lasts no time the gap is its own; else it lies between two of the cell's.
    own = _how_many(gap & (up <= low)[:, :-1], first, end)
    return np.asarray((own > 0) | (_how_many(gap, first, np.maximum(end - 1, 0)) > 0))


def _how_many(codes: NDArray[np.bool_], first: Indices, end: Indices) -> Indices:
    """(n, m), how many of (n, k) codes lie from `first` up to `end`; none where that is earlier."""
    before = np.zeros((len(codes), codes.shape[1] + 2), dtype=np.int64)
    np.cumsum(codes, axis=1, out=before[:, 1:-1])
    before[:, -1] = before[:, -2]
    here, there = (np.take_along_axis(before, at, axis=1) for at in (first, end))
    return np.asarray(there - here)


def _codes_at(low: Floats, last: Floats, delays: Floats) -> Indices:
    """(n, k): the last code that starts before each delay; the number of codes at the very end.

    `low` (n, codes) ascend. Codes are nearly of one length: two guesses lead close, steps the rest.
    """
    codes = low.shape[1]
    step = np.maximum(last - low[:, :1], 1e-9) / codes
    at = np.zeros(delays.shape, dtype=np.int64)
    for _ in range(2):
        gap = delays - np.take_along_axis(low, at, axis=1)
        at = np.clip(at + np.floor(gap / step).astype(np.int64), 0, codes - 1)
    while (early := (np.take_along_axis(low, at, axis=1) > delays) & (at > 0)).any():
        at = at - early
    after = np.minimum(at + 1, codes - 1)
    while (late := (np.take_along_axis(low, after, axis=1) <= delays) & (after > at)).any():
        at = at + late
        after = np.minimum(at + 1, codes - 1)
    return np.where(delays >= last, codes, at)
