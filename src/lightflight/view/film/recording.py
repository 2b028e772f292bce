"""A recording itself as a film, before any reconstruction: did the measurement work?

Takes Histograms, gives frames or a file: the counts of all pixels in successive slices of time
(nominal codes; nothing is fitted, nothing is subtracted), and the sum over the pixels below.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from lightflight.errors import NothingFoundError
from lightflight.recording.histograms import nominal_intervals
from lightflight.view import style
from lightflight.view.film.encode import Frame, Progress, check_length, check_movie, write_frames
from lightflight.view.film.stage import Stage
from lightflight.view.types import FilePath, Floats, Marks, Whole

if TYPE_CHECKING:
    from lightflight import Histograms


_INCHES_WIDE = 8.0
_LOUD_FACTOR = 30.0
"""A pixel this much louder than the median one is left out of the scales, not of the picture."""
_GAP_CODES = 20
"""Codes without light that part one burst of light from the next."""


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
    """

    edges: Floats

    counts: Floats

    unit: str


def slices_from_histograms(
    hist: Histograms, *, slice_codes: int = 1, window: tuple[float, float] | None = None
) -> TimeSlices:
    """Counts in slices of whole codes, ordered in time, cut to where the light is.

    Parameters
    ----------
    hist : Histograms
        The recording.
    slice_codes : int, optional
        Codes in one slice.
    window : (float, float), optional
        (first, last) in the unit of time; None: from the first to the last light, found in the sum
        over all pixels that do not scream.

    Raises
    ------
    NothingFoundError
        Where the recording holds no photons.
    ValueError
        For fewer than one code per slice, or an empty window.
    """
    if slice_codes < 1:
        raise ValueError(f"slice_codes must be at least 1, got {slice_codes}")
    if not float(np.asarray(hist.photons, dtype=float).sum()) > 0:
        raise NothingFoundError("the recording holds no photons: there is nothing to show")
    lower, upper, order, unit = _codes_in_time(hist)
    # Row by row: as numbers with a fraction the whole cube is four times as large.
    quiet = _quiet(np.array([row[:, order].sum(axis=1, dtype=float) for row in hist.counts]))
    total = np.zeros(len(order))
    for row, is_quiet in zip(hist.counts, quiet, strict=True):
        total += row[is_quiet][:, order].sum(axis=0, dtype=float)
    if window is None:
        first, last = _lit_range(total, margin=max(3, 2 * slice_codes))
    else:
        inside = np.flatnonzero((upper > window[0]) & (lower < window[1]))
        if inside.size == 0:
            raise ValueError(
                f"window {window} holds no code: the codes run from {lower[0]:g} to "
                f"{upper[-1]:g} {unit}"
            )
        first, last = int(inside[0]), int(inside[-1]) + 1
    check_length((last - first) / slice_codes, shorter="more codes per slice, or a window")
    starts = np.arange(first, last, slice_codes)
    counts = np.empty((len(starts), *hist.shape))
    for k, row in enumerate(hist.counts):
        in_time = row[:, order[:last]].astype(float)
        counts[:, k] = np.add.reduceat(in_time, starts, axis=1).T
    return TimeSlices(
        edges=np.append(lower[starts], upper[last - 1]),
        counts=counts,
        unit=unit,
    )


def _codes_in_time(hist: Histograms) -> tuple[Floats, Floats, Whole, str]:
    """Lower and upper edge of the live codes in ascending time, their order, and the unit."""
    lower, upper, unit = nominal_intervals(hist)
    live = np.flatnonzero(upper > lower)
    order = live[np.argsort(lower[live])]
    return lower[order], upper[order], order, unit


def _quiet(photons: Floats) -> Marks:
    """(rows, cols), True for pixels that are not absurdly loud, of the counts of each."""
    lit = photons[photons > 0]
    typical = float(np.median(lit)) if lit.size else 0.0
    quiet = photons <= _LOUD_FACTOR * max(typical, 1.0)
    return quiet if (quiet & (photons > 0)).any() else np.ones_like(quiet)


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


def recording_frames(
    slices: TimeSlices, *, size_px: tuple[int, int] = (960, 720), title: str = ""
) -> Iterator[Frame]:
    """Frames (height, width, 3) uint8, one per slice.

    Parameters
    ----------
    slices : TimeSlices
        Counts in slices of time.
    size_px : (int, int), optional
        Width and height of a frame, px; even.
    title : str, optional
        Heading.
    """
    with style.figure_style():
        stage = _RecordingStage(slices, size_px, title)
    for k in range(len(slices.counts)):
        with style.figure_style():
            yield stage.frame(k)


def write_recording_movie(
    hist: Histograms,
    file: FilePath,
    *,
    slice_codes: int = 1,
    window: tuple[float, float] | None = None,
    size_px: tuple[int, int] = (960, 720),
    frames_per_second: float = 12.0,
    title: str = "",
    progress: Progress | None = None,
) -> None:
    """Write a recording as MP4 or GIF, a frame per slice of time.

    Parameters
    ----------
    hist : Histograms
        The recording.
    file : path
        Where to write.
    slice_codes : int, optional
        Codes in one slice.
    window : (float, float), optional
        As in `slices_from_histograms`.
    size_px : (int, int), optional
        (width, height), even.
    frames_per_second : float, optional
        Of the film.
    title : str, optional
        Heading of the film.
    progress : callable, optional
        Called with (frames done, in all).
    """
    check_movie(file, size_px=size_px, frames_per_second=frames_per_second)
    slices = slices_from_histograms(hist, slice_codes=slice_codes, window=window)
    write_frames(
        recording_frames(slices, size_px=size_px, title=title),
        file,
        n_frames=len(slices.counts),
        size_px=size_px,
        frames_per_second=frames_per_second,
        progress=progress,
    )


class _RecordingStage(Stage):
    """The figure of the film; the scale is one for all frames, so that they compare."""

    def __init__(self, slices: TimeSlices, size_px: tuple[int, int], title: str) -> None:
        super().__init__(size_px, inches_wide=_INCHES_WIDE)
        self.slices = slices
        self.figure.text(
            0.04, 0.95, style.words(title) or "The recording", fontsize=13, fontweight="bold"
        )
        picture = self.figure.add_axes((0.10, 0.30, 0.80, 0.60))
        sums = self.figure.add_axes((0.10, 0.08, 0.86, 0.13))
        quiet = _quiet(slices.counts.sum(axis=0))
        # One scale for all frames, which a single bright slice of a single pixel must not set.
        top = float(np.percentile(slices.counts[:, quiet].max(axis=0), 99.5))
        self.light = picture.imshow(
            np.zeros(slices.counts.shape[1:]), cmap=style.count_colormap(), vmin=0,
            vmax=np.sqrt(max(top, 1.0)), animated=True,
        )  # fmt: skip
        picture.set(xlabel="column", ylabel="row")
        self._add_bar(picture, top)
        picture.set_anchor("W")
        total = slices.counts[:, quiet].sum(axis=1)
        sums.stairs(total, slices.edges, color=style.ARRIVAL, lw=1.1)
        sums.set(xlim=(slices.edges[0], slices.edges[-1]), ylim=(0, None))
        sums.set(xlabel=f"delay after the laser sync ({slices.unit})", ylabel="all pixels")
        sums.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
        self.picture, self.sums = picture, sums
        self.now = sums.axvspan(0, 1, color=style.EVENT, alpha=0.45, lw=0, animated=True)
        self.reading = self.figure.text(
            0.96, 0.95, "", fontsize=13, ha="right", family="DejaVu Sans Mono", animated=True
        )
        self.keep_background()

    def _add_bar(self, picture: Axes, top: float) -> None:
        bar = style.colorbar(picture, self.light, "counts in one slice")
        step = style.nice_step(top, 4)
        ticks = np.unique(np.concatenate(([0.0, step / 4], np.arange(step, top + step, step))))
        ticks = ticks[ticks <= top * 1.0001]
        bar.set_ticks(np.sqrt(ticks), labels=[style.number(v, 3) for v in ticks])

    def frame(self, k: int) -> Frame:
        """The picture of slice `k`."""
        slices = self.slices
        low, high = float(slices.edges[k]), float(slices.edges[k + 1])
        self.light.set_data(np.sqrt(np.maximum(slices.counts[k], 0.0)))
        self.now.set_x(low)
        self.now.set_width(high - low)
        self.reading.set_text(f"{(low + high) / 2:8.0f} {slices.unit}".replace("-", "\u2212"))
        return self.snapshot(
            ((self.picture, self.light), (self.sums, self.now), (self.figure, self.reading))
        )
