"""A recording at a glance, before anything is fitted: where its photons fall, and when.

Takes Histograms, gives Axes or a small Figure; for `lightflight info --plot`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from lightflight.view import style

if TYPE_CHECKING:
    from lightflight import Histograms

_SHADES = 3.0
"""Decades of counts that are told apart below the brightest."""


@style.styled
def draw_counts(hist: Histograms, ax: Axes | None = None) -> Axes:
    """Photons of every pixel, (rows, cols), on a logarithmic scale; pixels without any stay pale.

    The scale ends at the 99.9th percentile: a few screaming pixels do not hide the rest.

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
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    unit = "photons" if hist.poisson else "intensity"
    style.colorbar(
        ax, image, f"{unit} per pixel", extend="max" if photons.max() > top else "neither"
    )
    return ax


@style.styled
def draw_code_sum(hist: Histograms, ax: Axes | None = None) -> Axes:
    """Counts in every code: mean of the pixels (line), and what 95 % of them stay below (shade).

    A pulse that pixels see at different codes stands in the shade before it does in the mean.

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
    ax = style.axes_or_new(ax, 100, 70)
    cube = np.asarray(hist.counts).reshape(-1, hist.n_codes)
    seen = cube.any(axis=1)
    if not seen.any() or not hist.photon_codes.any():
        return style.message(ax, "there is not a single photon in it")
    codes = np.flatnonzero(hist.photon_codes)
    step = max(1, seen.sum() // 4096)  # of a megapixel camera an even sample tells as much
    kept = cube[seen][::step][:, codes].astype(float)
    mean, high = kept.mean(axis=0), np.percentile(kept, 95.0, axis=0)
    ax.fill_between(codes, 0, high, step="mid", color="#a9b9d6", lw=0, label="95 % of pixels")
    ax.step(codes, mean, where="mid", color=style.ARRIVAL, lw=0.9, label="mean of pixels")
    ax.set_xlim(codes[0] - 0.5, codes[-1] + 0.5)
    # The first live code of a TDC can hold many times the others: it may leave the page.
    ax.set_ylim(0, 1.08 * max(float(np.percentile(high, 99.9)), float(mean.max()), 1e-9))
    ax.set(xlabel=_code_label(hist), ylabel="counts per code")
    ax.legend(loc="upper right")
    return ax


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
    figure = style.new_figure(180, 72, layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    draw_counts(hist, left)
    draw_code_sum(hist, right)
    if title:
        figure.suptitle(style.words(title), x=0.01, ha="left", fontsize=9, fontweight="bold")
    return figure
