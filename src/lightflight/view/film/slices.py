"""Counts of a recording in slices of time, cut to where the light is.

Takes Histograms, gives TimeSlices: by nominal codes, or by the clock of every pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lightflight.errors import NothingFoundError
from lightflight.recording.histograms import nominal_intervals
from lightflight.view.figures.recording import screaming_pixels
from lightflight.view.film.encode import check_length
from lightflight.view.types import Floats, Marks, Whole

if TYPE_CHECKING:
    from lightflight import Histograms, TimingCalibration

_GAP_CODES = 20
"""Codes without light that part one burst of light from the next."""
_MOST_SLICES = 240
"""Of one code each; of more codes several make a slice, unless told: 20 s at 12 a second."""


@dataclass(frozen=True, eq=False)
class TimeSlices:
    """Counts of every pixel in slices of time, in the order in which light arrives.

    Attributes
    ----------
    edges : array of float
        (k + 1,), in `unit`, since the laser sync.
    counts : array of float
        (k, rows, cols).
    unit : str
        "ps", or "codes" where the width of a code is unknown.
    left_out : array of bool
        (rows, cols), pixels that scream, or have no clock: of no scale and no sum.
    clocks : str
        Whose time it is, in words.
    """

    edges: Floats

    counts: Floats

    unit: str

    left_out: Marks

    clocks: str


def slices_from_histograms(
    hist: Histograms,
    *,
    slice_codes: int | None = None,
    window: tuple[float, float] | None = None,
    timing: TimingCalibration | None = None,
) -> TimeSlices:
    """Counts in slices of whole codes, ordered in time, cut to where the light is.

    Parameters
    ----------
    hist : Histograms
        The recording.
    slice_codes : int, optional
        Codes in one slice; None: one, or as many as make 240 slices of what is shown.
    window : (float, float), optional
        (first, last) in the unit of time; None: from the first to the last light, found in the sum
        over all pixels that do not scream.
    timing : TimingCalibration, optional
        Its clocks tell when each pixel counted; counts are shared out to slices by overlap. None:
        nominal codes, so that pixels differ by their own delays.

    Raises
    ------
    NothingFoundError
        Where the recording holds no photons.
    ValueError
        For fewer than one code per slice, or an empty window.
    """
    if slice_codes is not None and slice_codes < 1:
        raise ValueError(f"slice_codes must be at least 1, got {slice_codes}")
    if not float(np.asarray(hist.photons, dtype=float).sum()) > 0:
        raise NothingFoundError("the recording holds no photons: there is nothing to show")
    left_out = screaming_pixels(hist)
    source: _Codes | _Clocks
    if timing is None:
        source = _Codes(hist)
    else:
        source = _Clocks(hist, timing)
        left_out = left_out | ~source.known
    first, last = _shown(source, left_out, window, 2 if slice_codes is None else 2 * slice_codes)
    codes = slice_codes or -(-(last - first) // _MOST_SLICES)
    check_length((last - first) / codes, shorter="more codes per slice, or a window")
    starts = np.arange(first, last, codes)
    counts = np.empty((len(starts), *hist.shape))
    for row in range(hist.shape[0]):
        in_time = source.counts_of_row(row)[:, :last]
        counts[:, row] = np.add.reduceat(in_time, starts, axis=1).T
    return TimeSlices(
        edges=np.append(source.edges[starts], source.edges[last]),
        counts=counts,
        unit=source.unit,
        left_out=left_out,
        clocks=source.words,
    )


class _Codes:
    """Counts by nominal codes, live ones alone, in ascending time."""

    words = "by nominal codes: pixels differ by delays of their own"

    def __init__(self, hist: Histograms) -> None:
        self._hist = hist
        lower, upper, self.unit = nominal_intervals(hist)
        live = np.flatnonzero(upper > lower)
        self._order: Whole = live[np.argsort(lower[live])]
        self.edges: Floats = np.append(lower[self._order], upper[self._order[-1]])

    def counts_of_row(self, row: int) -> Floats:
        """(cols, codes)."""
        return np.asarray(self._hist.counts[row][:, self._order], dtype=float)


class _Clocks:
    """Counts at the delays that a calibration tells, each pixel's skew taken off."""

    unit = "ps"
    words = "by the calibrated clock of each pixel"

    def __init__(self, hist: Histograms, timing: TimingCalibration) -> None:
        timing.check_matches(hist)
        self._hist, self._timing = hist, timing
        self.known: Marks = timing.is_known
        row, col = np.argwhere(self.known)[0] if self.known.any() else (0, 0)
        lower, upper = self._intervals(int(row), np.array([int(col)]))
        width = float(np.median((upper - lower)[upper > lower]))
        start, stop = float(lower.min()), float(upper.max())
        # Other pixels reach a little further at both ends, where no flight is.
        n = int(np.ceil((stop - start) / width))
        self.edges: Floats = start + width * np.arange(n + 1, dtype=np.float64)

    def _intervals(self, row: int, cols: Whole) -> tuple[Floats, Floats]:
        lower, upper = self._timing.code_intervals_ps(np.full(len(cols), row), cols)
        skew = self._timing.skew_ps[row, cols][:, np.newaxis]
        return lower - skew, upper - skew

    def counts_of_row(self, row: int) -> Floats:
        """(cols, codes), those of a pixel without a clock zero."""
        counts = np.asarray(self._hist.counts[row], dtype=float)
        out = np.zeros((len(counts), len(self.edges) - 1))
        cols = np.flatnonzero(self.known[row])
        if not cols.size:
            return out
        lower, upper = self._intervals(row, cols)
        for col, first, last in zip(cols, lower, upper, strict=True):
            live = np.flatnonzero(last > first)
            live = live[np.argsort(first[live])]
            knots = np.append(first[live], last[live[-1]])
            reached = np.concatenate(([0.0], np.cumsum(counts[col, live])))
            out[col] = np.diff(np.interp(self.edges, knots, reached))
        return out


def _shown(
    source: _Codes | _Clocks, left_out: Marks, window: tuple[float, float] | None, spare: int
) -> tuple[int, int]:
    """First and last + 1 of the steps in time that are shown."""
    if window is not None:
        lower, upper = source.edges[:-1], source.edges[1:]
        inside = np.flatnonzero((upper > window[0]) & (lower < window[1]))
        if inside.size == 0:
            raise ValueError(
                f"window {window} holds no code: the codes run from {lower[0]:g} to "
                f"{upper[-1]:g} {source.unit}"
            )
        return int(inside[0]), int(inside[-1]) + 1
    # Row by row: as numbers with a fraction the whole cube is four times as large.
    total = np.zeros(len(source.edges) - 1)
    for row, out in enumerate(left_out):
        total += source.counts_of_row(row)[~out].sum(axis=0)
    return _lit_range(total, margin=max(3, spare))


def _lit_range(total: Floats, *, margin: int) -> tuple[int, int]:
    """Codes (first, last + 1) in which the sum stands clearly above its median.

    Lone codes that are merely wider than their neighbours (the first live one of a TDC) hold
    next to nothing of the light, and do not stretch the range.
    """
    base = float(np.median(total))
    # At least what Poisson says; a clock of unequal codes scatters more. 1.4826: to a standard
    # deviation.
    noise = max(np.sqrt(max(base, 1.0)), 1.4826 * float(np.median(np.abs(total - base))))
    lit = np.flatnonzero(total > base + 6.0 * noise)
    if lit.size == 0:
        return 0, len(total)
    groups = np.split(lit, np.flatnonzero(np.diff(lit) > _GAP_CODES) + 1)
    light = np.array([float((total[group] - base).sum()) for group in groups])
    # A burst of less than 2 % of the light is a wide code, not a pulse.
    kept = [group for group, share in zip(groups, light / light.sum(), strict=True) if share > 0.02]
    return max(0, int(kept[0][0]) - margin), min(len(total), int(kept[-1][-1]) + 1 + margin)
