"""One look for every figure: colours, type, sizes, and the few marks all of them share.

Chosen to survive a photocopier and a colour-blind reader: the two clocks differ in lightness as
well as in hue (event time warm and mid, arrival time blue and dark), truth is black and dashed,
maps run through lightness once. Figures are made without pyplot: nothing opens a window, nothing
stays in a global list. Sizes are given in mm of paper.

Matplotlib is imported here and in the other modules of `view` only.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import ArrayLike

from lightflight.display import number as number

P = ParamSpec("P")
R = TypeVar("R")

MM_PER_INCH = 25.4

INK = "#1a2130"
"""Text, axes, truth."""
QUIET = "#667080"
"""Second-rank text and lines."""
HAIR = "#d9dde3"
"""Grids, frames, shadows."""
PAPER = "#ffffff"
"""Background."""
WASH = "#f3f5f8"
"""Panels, pixels without light."""
EVENT = "#d1480b"
"""Event time t, and the path itself."""
ARRIVAL = "#173f8a"
"""Arrival time t_a."""
OTHERS = ("#5f9ea0", "#8c6bb1", "#a6861a", "#7a7f87")
"""Other estimates laid beside the main one, in order."""
Dash = str | tuple[float, tuple[float, ...]]
OTHER_DASHES: tuple[Dash, ...] = ((0, (5, 1.4, 1, 1.4)), (0, (1.2, 1.2)), (0, (7, 2)), "solid")

VERDICT = {
    "trust": ("#1d7044", "#ffffff"),
    "check": ("#ffd24d", INK),
    "contradicted": ("#b3261e", "#ffffff"),
}
"""Ground and ink of a verdict's badge, as on the page; the word on it says the level."""

TRUTH_LINE: dict[str, Any] = {"color": INK, "lw": 0.9, "ls": (0, (4, 3))}
"""How truth is drawn: black and dashed."""

# Matplotlib wants its settings' names as literals, which a dictionary of ours cannot promise.
STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # ships with Matplotlib: the same picture everywhere
    "mathtext.fontset": "dejavusans",
    "font.size": 7.5,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 6.0,
    "axes.labelsize": 7.5,
    "axes.labelpad": 3.0,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.edgecolor": INK,
    "axes.facecolor": PAPER,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.6,
    "ytick.major.size": 2.6,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "grid.color": HAIR,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "lines.solid_capstyle": "round",
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "legend.borderaxespad": 0.3,
    "legend.labelspacing": 0.35,
    "figure.facecolor": PAPER,
    "figure.dpi": 150,
    "savefig.dpi": 200,
    "savefig.facecolor": PAPER,
    "image.interpolation": "nearest",
    "pdf.fonttype": 42,  # text stays text in an editor
    "svg.fonttype": "none",
    "svg.hashsalt": "lightflight",  # else names within the file are drawn anew each time
    "hatch.linewidth": 0.5,
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Use the package's look inside a `with` block; the user's own settings come back after."""
    with mpl.rc_context(STYLE):
        yield


def styled(function: Callable[P, R]) -> Callable[P, R]:
    """Run a drawing function under `figure_style`."""

    @functools.wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        with figure_style():
            return function(*args, **kwargs)

    return wrapper


def new_figure(width_mm: float = 120.0, height_mm: float = 80.0, **options: Any) -> Figure:
    """An empty figure of this size on paper, outside pyplot (it needs no `close`)."""
    # Not by pyplot: its list keeps every figure alive until it is closed.
    size = (width_mm / MM_PER_INCH, height_mm / MM_PER_INCH)
    figure = Figure(figsize=size, **options)
    FigureCanvasAgg(figure)  # can be drawn and measured at once
    return figure


def axes_or_new(ax: Axes | None, width_mm: float = 120.0, height_mm: float = 80.0) -> Axes:
    """The given axes, dressed in the style; or the only axes of a new figure."""
    if ax is None:
        # The layout leaves the outermost word no room of its own.
        layout = ConstrainedLayoutEngine(rect=(0.012, 0.0, 0.988, 1.0))
        return new_figure(width_mm, height_mm, layout=layout).add_subplot()
    return dress(ax)


def axes_in_mm(
    figure: Figure, page_mm: tuple[float, float], left: float, top: float, wide: float, high: float
) -> Axes:
    """New axes at a place given in mm from the upper left corner of the page."""
    width, height = page_mm
    bounds = (left / width, 1.0 - (top + high) / height, wide / width, high / height)
    return figure.add_axes(bounds)


def line_of_other(k: int) -> dict[str, Any]:
    """Colour and dashes of the k-th other estimate, as `plot` takes them; repeats after four."""
    return {"color": OTHERS[k % len(OTHERS)], "ls": OTHER_DASHES[k % len(OTHER_DASHES)]}


def dress(ax: Axes) -> Axes:
    """Bring axes that were made elsewhere to the style (spines, ticks, type)."""
    for side, spine in ax.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_linewidth(STYLE["axes.linewidth"])
        spine.set_color(INK)
    ax.tick_params(
        colors=INK,
        width=STYLE["xtick.major.width"],
        length=STYLE["xtick.major.size"],
        labelsize=STYLE["xtick.labelsize"],
    )
    ax.set_axisbelow(True)
    return ax


def _truncated(name: str, low: float, high: float, label: str) -> Colormap:
    colors = mpl.colormaps[name](np.linspace(low, high, 256))
    return ListedColormap(colors, name=label)


def time_colormap() -> Colormap:
    """Dark to light, for times: viridis without the yellow that vanishes on white paper."""
    return _truncated("viridis", 0.0, 0.93, "lightflight_time")


def signed_colormap() -> Colormap:
    """For signed maps; its ends differ in lightness, so that the sign survives grey printing."""
    return _truncated("PuOr_r", 0.02, 0.90, "lightflight_signed")


def count_colormap() -> Colormap:
    """Light to dark, for counts on a light page."""
    return _truncated("GnBu", 0.0, 1.0, "lightflight_counts")


def nice_step(span: float, about: int = 5) -> float:
    """A step of 1, 2, 2.5 or 5 times a power of ten that cuts `span` into about `about` pieces.

    Parameters
    ----------
    span : float
        Length to be cut.
    about : int, optional
        Number of pieces, roughly.

    Examples
    --------
    >>> nice_step(430.0), nice_step(0.07)
    (100.0, 0.01)
    """
    if not np.isfinite(span) or span <= 0:
        return 1.0
    raw = span / about
    power = 10.0 ** np.floor(np.log10(raw))
    steps = np.array([1.0, 2.0, 2.5, 5.0, 10.0]) * power
    return float(steps[np.argmin(np.abs(np.log(steps / raw)))])


def robust_limit(values: ArrayLike, *, percentile: float = 98.0, floor: float = 1e-12) -> float:
    """Half-width of a symmetric colour scale that a few outliers cannot stretch.

    Parameters
    ----------
    values : array
        Numbers of any shape; those that are not finite are left out.
    percentile : float, optional
        Share of the values that stay inside, per cent.
    floor : float, optional
        Smallest half-width.

    Examples
    --------
    >>> robust_limit([-1.0, 0.5, float("nan")], percentile=100.0)
    1.0
    """
    finite = np.abs(np.asarray(values, dtype=float))
    finite = finite[np.isfinite(finite)]
    if finite.size == 0:
        return 1.0
    # A map of zeros still needs a scale with two ends.
    return max(float(np.percentile(finite, percentile)), floor)


def words(text: str) -> str:
    r"""A name or sentence that came with a file, as Matplotlib shows it as it is.

    Examples
    --------
    >>> print(words("5$.h5"))
    5\$.h5
    """
    return text.replace("$", r"\$")


def title(ax: Axes, text: str, note: str = "", *, stacked: bool = False) -> None:
    """Bold title at the left, and a quiet second part at the right (or below it, if `stacked`)."""
    pad = STYLE["axes.titlepad"]
    lines = len(note.splitlines()) if stacked else 0
    ax.set_title(text, pad=pad + 10.0 * lines)
    if note:
        ax.annotate(
            note,
            (0.0 if stacked else 1.0, 1.0),
            xycoords="axes fraction",
            xytext=(0, pad),
            textcoords="offset points",
            ha="left" if stacked else "right",
            va="bottom",
            fontsize=7.0,
            color=QUIET,
        )


def message(ax: Axes, text: str) -> Axes:
    """Say in the middle of otherwise empty axes why there is nothing to see."""
    ax.set_axis_off()
    ax.text(
        0.5,
        0.5,
        text,
        transform=ax.transAxes,
        ha="center",
        va="center",
        color=QUIET,
        wrap=True,
    )
    return ax


def colorbar(ax: Axes, mappable: ScalarMappable, label: str, **options: Any) -> Colorbar:
    """A thin colour bar beside `ax`, labelled like an axis."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    options = {"fraction": 0.05, "pad": 0.03, "aspect": 26, **options}
    bar = figure.colorbar(mappable, ax=ax, **options)
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=2, width=0.5, labelsize=STYLE["ytick.labelsize"])
    bar.set_label(label, fontsize=STYLE["axes.labelsize"])
    return bar
