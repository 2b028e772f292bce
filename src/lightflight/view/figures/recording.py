"""A recording at a glance, before anything is fitted: where its photons fall, and when.

Takes Histograms, gives Axes or a small Figure; for `lightflight info --plot`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from lightflight.recording.description import codes_of_pulses, pixels_that_scream_in_a_scene
from lightflight.view import style

if TYPE_CHECKING:
    from lightflight import Histograms

_FEWEST_CODES = 16
"""Shown on either side of the pulses at least."""
_SHADES = 3.0
"""Decades of counts that are told apart below the brightest."""


@style.styled
def draw_counts(hist: Histograms, ax: Axes | None = None) -> Axes:
    """Photons of every pixel, (rows, cols), on a logarithmic scale; pixels without any stay pale.

    Screaming pixels are crossed out, and the scale is that of the others.

    Parameters
    ----------
    hist : Histograms
        The recording.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 80, 70)
    photons = np.asarray(hist.photons, dtype=float)
    screams = screaming_pixels(hist)
    photons = np.where(screams, 0.0, photons)
    lit = photons[photons > 0]
    if lit.size == 0:
        return style.message(ax, "there is not a single photon in it")
    top = float(np.percentile(lit, 99.9))
    low = max(float(lit.min()), top * 10.0**-_SHADES)
    # A hair apart at both ends: a picture of one count per pixel has a scale too.
    norm = LogNorm(low * 0.999, max(top, low * 1.001))
    shown = np.ma.masked_less_equal(photons, 0)
    ax.set_facecolor(style.WASH)
    image = ax.imshow(shown, cmap=style.count_colormap(), norm=norm)
    ax.set(xlabel="column", ylabel="row")
    rows, cols = np.nonzero(screams)
    if rows.size:
        words = f"{rows.size} screaming, left out"
        size = min(5.0, 150.0 / max(hist.shape))
        ax.plot(cols, rows, "x", color=style.QUIET, ms=size, mew=0.6, ls="", label=words)
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, frameon=False)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    unit = "photons" if hist.poisson else "intensity"
    style.colorbar(
        ax, image, f"{unit} per pixel", extend="max" if photons.max() > top else "neither"
    )
    return ax


@style.styled
def draw_code_sum(
    hist: Histograms, ax: Axes | None = None, *, codes: tuple[int, int] | None = None
) -> Axes:
    """Counts in every code: mean of the pixels (line), and what 99 % of them stay below (shade).

    A pulse that pixels see at different codes stands in the shade before it does in the mean.
    Screaming pixels are left out.

    Parameters
    ----------
    hist : Histograms
        The recording.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.
    codes : (int, int), optional
        First and last code that are shown; None: all.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 100, 70)
    shown, kept = _sample(hist)
    if not kept.size:
        return style.message(ax, "there is not a single photon in it")
    if codes is not None:
        inside = (shown >= codes[0]) & (shown <= codes[1])
        shown, kept = shown[inside], kept[:, inside]
    mean, high = kept.mean(axis=0), np.percentile(kept, 99.0, axis=0)
    ax.fill_between(shown, 0, high, step="mid", color="#a9b9d6", lw=0, label="99 % of pixels")
    ax.step(shown, mean, where="mid", color=style.ARRIVAL, lw=0.9, label="mean of pixels")
    ax.set_xlim(shown[0] - 0.5, shown[-1] + 0.5)
    # The first live code of a TDC can hold many times the others: it may leave the page.
    ax.set_ylim(0, 1.08 * max(float(np.percentile(high, 99.9)), float(mean.max()), 1e-9))
    ax.set(xlabel=_code_label(hist), ylabel="counts per code")
    ax.legend(loc="upper right")
    return ax


def screaming_pixels(hist: Histograms) -> NDArray[np.bool_]:
    """(rows, cols), True for pixels that fire whatever the light does; never all that are lit."""
    photons = np.asarray(hist.photons, dtype=float)
    screams = pixels_that_scream_in_a_scene(hist, photons)
    return screams if (photons[~screams] > 0).any() else np.zeros_like(screams)


def _sample(hist: Histograms) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Codes of photons, and the counts in them of pixels that are lit and do not scream."""
    photons = np.asarray(hist.photons, dtype=float)
    seen = np.flatnonzero((photons > 0) & ~screaming_pixels(hist))
    step = max(1, seen.size // 4096)  # of a megapixel camera an even sample tells as much
    cube, codes = (
        np.asarray(hist.counts).reshape(-1, hist.n_codes),
        np.flatnonzero(hist.photon_codes),
    )
    return codes, cube[seen[::step]][:, codes].astype(float)


def _code_label(hist: Histograms) -> str:
    width = "" if hist.bin_width_ps is None else f" of {hist.bin_width_ps:g} ps"
    return f"code{width}" + (" (larger is earlier)" if hist.reversed_codes else "")


@style.styled
def recording_figure(hist: Histograms, *, title: str = "") -> Figure:
    """Where and when the photons of a recording fall.

    Parameters
    ----------
    hist : Histograms
        The recording.
    title : str, optional
        Heading.

    Returns
    -------
    Figure
        The page, to be saved or shown.
    """
    light = codes_of_pulses(hist)
    # The layout leaves the outermost word no room of its own.
    layout = ConstrainedLayoutEngine(rect=(0.012, 0.0, 0.988, 1.0))
    figure = style.new_figure(180, 84, layout=layout)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    draw_counts(hist, left)
    if light is None:
        draw_code_sum(hist, right)
        answer = "no pulse in it: is there light, and is the laser's sync connected?"
    else:
        spare = max(_FEWEST_CODES, light[1] - light[0])
        around = light[0] - spare, light[1] + spare
        draw_code_sum(hist, right, codes=around)
        answer = f"pulses at codes {light[0]} to {light[1]} of {hist.n_codes}"
        _draw_whole_range(right, hist, around)
    heading = f"{style.words(title)}: {answer}" if title else answer
    figure.suptitle(heading, x=0.01, ha="left", fontsize=9, fontweight="bold")
    return figure


def _draw_whole_range(ax: Axes, hist: Histograms, around: tuple[int, int]) -> None:
    """Where the codes that are shown stand among all of them, above the axes."""
    codes, kept = _sample(hist)
    if around[0] <= codes[0] and around[1] >= codes[-1]:
        return
    whole = ax.inset_axes((0.0, 1.06, 1.0, 0.16))
    mean = kept.mean(axis=0)
    whole.fill_between(codes, 0, mean, step="mid", color=style.ARRIVAL, lw=0, alpha=0.5)
    whole.axvspan(*around, color=style.EVENT, alpha=0.18, lw=0)
    whole.set(
        xlim=(codes[0], codes[-1]), ylim=(0, 1.1 * np.percentile(mean, 99.9) + 1e-9), yticks=[]
    )
    whole.xaxis.tick_top()
    whole.tick_params(labelsize=6)
