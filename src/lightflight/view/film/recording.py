"""A recording itself as a film, before any reconstruction: did the measurement work?

Takes slices of time, gives frames or a file: the counts of all pixels in each slice, the flight so
far, and the sum over the pixels below (nothing is fitted).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, to_rgb
from matplotlib.image import AxesImage

from lightflight.view import style
from lightflight.view.film.encode import Frame, Progress, check_movie, write_frames
from lightflight.view.film.slices import TimeSlices, slices_from_histograms
from lightflight.view.film.stage import Stage
from lightflight.view.types import FilePath, Floats

if TYPE_CHECKING:
    from lightflight import Histograms, TimingCalibration


_INCHES_WIDE = 8.0


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
    slice_codes: int | None = None,
    window: tuple[float, float] | None = None,
    timing: TimingCalibration | None = None,
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
        Codes in one slice; None: one, or as many as make 240 slices of what is shown.
    window : (float, float), optional
        (first, last) in ps, or in codes where their width is unknown; None: where the light is.
    timing : TimingCalibration, optional
        Its clocks tell when each pixel counted; None: nominal codes, the same for all pixels.
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
    slices = slices_from_histograms(hist, slice_codes=slice_codes, window=window, timing=timing)
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
        heading = style.words(title) or "The recording"
        self.figure.text(0.04, 0.95, heading, fontsize=13, fontweight="bold")
        n_out = int(slices.left_out.sum())
        crossed = f"; \u00d7: left out, screaming or without a clock ({n_out})" if n_out else ""
        note = f"Time {slices.clocks}{crossed}."
        self.figure.text(0.04, 0.91, note, fontsize=7.5, color=style.QUIET)
        # One scale for all frames, which a single bright slice of a single pixel must not set.
        top = float(np.percentile(slices.counts[:, ~slices.left_out].max(axis=0), 99.5))
        self.top = max(top, 1.0)
        self.base = np.median(slices.counts, axis=0)
        self.most = np.zeros(self.base.shape)
        self.when = np.zeros(self.base.shape, dtype=int)
        now, self.light = self._add_picture((0.07, 0.32, 0.36, 0.52), "This slice")
        so_far, self.trail = self._add_picture((0.58, 0.32, 0.36, 0.52), "So far, coloured by time")
        so_far.set_ylabel("")
        self._add_bar(now)
        sums = self._add_sums()
        self.pictures, self.sums = (now, so_far), sums
        self.now = sums.axvspan(0, 1, color=style.INK, alpha=0.35, lw=0, animated=True)
        self.reading = self.figure.text(
            0.96, 0.95, "", fontsize=13, ha="right", family="DejaVu Sans Mono", animated=True
        )
        self.keep_background()

    def _add_picture(
        self, place: tuple[float, float, float, float], heading: str
    ) -> tuple[Axes, AxesImage]:
        """Axes for the camera's picture, pixels that are left out crossed."""
        ax = self.figure.add_axes(place)
        image = ax.imshow(
            np.zeros(self.slices.counts.shape[1:]), cmap=style.count_colormap(), vmin=0,
            vmax=np.sqrt(self.top), animated=True,
        )  # fmt: skip
        ax.set(xlabel="column", ylabel="row", title=heading)
        rows, cols = np.nonzero(self.slices.left_out)
        size = min(5.0, 110.0 / max(self.slices.left_out.shape))
        ax.plot(cols, rows, "x", color=style.QUIET, ms=size, mew=0.6, ls="", animated=True)
        return ax, image

    def _add_bar(self, picture: Axes) -> None:
        beside = picture.inset_axes((1.04, 0.0, 0.045, 1.0))
        bar = style.colorbar(picture, self.light, "counts in one slice", cax=beside)
        step = style.nice_step(self.top, 4)
        ticks = np.unique(np.concatenate(([0.0, step / 4], np.arange(step, self.top + step, step))))
        ticks = ticks[ticks <= self.top * 1.0001]
        bar.set_ticks(np.sqrt(ticks), labels=[style.number(v, 3) for v in ticks])

    def _add_sums(self) -> Axes:
        """Counts of all pixels in each slice, in the colours of the flight so far."""
        slices = self.slices
        ax = self.figure.add_axes((0.10, 0.09, 0.86, 0.12))
        total = slices.counts[:, ~slices.left_out].sum(axis=1)
        middles = (slices.edges[:-1] + slices.edges[1:]) / 2
        self.colors = style.time_colormap()(Normalize(middles[0], middles[-1])(middles))[:, :3]
        ax.bar(middles, total, np.diff(slices.edges), color=self.colors, lw=0)
        ax.set(xlim=(slices.edges[0], slices.edges[-1]), ylim=(0, 1.05 * total.max()))
        ax.set(xlabel=f"delay after the laser sync ({slices.unit})", ylabel="all pixels")
        ax.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
        return ax

    def frame(self, k: int) -> Frame:
        """The picture of slice `k`; slices come in their order."""
        slices = self.slices
        low, high = float(slices.edges[k]), float(slices.edges[k + 1])
        self.light.set_data(np.sqrt(np.maximum(slices.counts[k], 0.0)))
        self.trail.set_data(self._trail_with(k))
        self.now.set_x(low)
        self.now.set_width(high - low)
        self.reading.set_text(f"{(low + high) / 2:8.0f} {slices.unit}".replace("-", "\u2212"))
        now, so_far = self.pictures
        return self.snapshot(
            (
                *((now, artist) for artist in (self.light, *now.lines)),
                *((so_far, artist) for artist in (self.trail, *so_far.lines)),
                (self.sums, self.now),
                (self.figure, self.reading),
            )
        )

    def _trail_with(self, k: int) -> Floats:
        """(rows, cols, 3), each pixel in the colour of its brightest slice up to this one."""
        excess = np.where(self.slices.left_out, 0.0, self.slices.counts[k] - self.base)
        brighter = excess > self.most
        self.most[brighter], self.when[brighter] = excess[brighter], k
        # Above the pixel's median slice alone: what is always there is no flight.
        strength = np.minimum(np.sqrt(self.most / self.top), 1.0)[..., np.newaxis]
        paper = np.array(to_rgb(style.WASH))
        shown: Floats = paper + strength * (self.colors[self.when] - paper)
        return shown
