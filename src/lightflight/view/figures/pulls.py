"""Pulls, distances in units of the stated errors, against what the unit normal expects of them.

Takes a LightPath or pulls, gives Axes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from lightflight.path.trace import places_from_path
from lightflight.view import style
from lightflight.view.types import Floats

if TYPE_CHECKING:
    from lightflight import LightPath

_FEWEST_FOR_BARS = 10
"""Pulls that make a histogram; fewer are dots."""


def draw_unit_normal(ax: Axes, pulls: Floats, *, what: str, vertical: bool = False) -> None:
    """Histogram of pulls, and what the unit normal expects in its bins.

    Few pulls are no histogram: each is a dot below the curve.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    pulls : array of float, shape (n,)
        n > 0.
    what : str
        What is counted: "pulses".
    vertical : bool, optional
        True lays the bars along the vertical axis.
    """
    z = np.linspace(-4, 4, 161)
    normal = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    # A pull beyond the page is shown at its edge: outliers must not vanish.
    shown = np.clip(pulls, -3.999, 3.999)
    if pulls.size < _FEWEST_FOR_BARS:
        _draw_dots(ax, np.sort(shown), vertical=vertical)
    else:
        edges = np.linspace(-4.0, 4.0, 2 * min(12, max(4, pulls.size // 8)) + 1)
        ax.hist(
            shown, edges.tolist(), color="#a9b9d6", edgecolor=style.PAPER,
            orientation="horizontal" if vertical else "vertical", linewidth=0.5,
        )  # fmt: skip
        normal *= pulls.size * (edges[1] - edges[0])
        (ax.set_xlabel if vertical else ax.set_ylabel)(what)
    ax.plot(*((normal, z) if vertical else (z, normal)), color=style.INK, lw=1.0)
    (ax.set_ylim if vertical else ax.set_xlim)(-4, 4)


def _draw_dots(ax: Axes, pulls: Floats, *, vertical: bool) -> None:
    """A dot for each pull, in ascending order one above the other: nothing to count."""
    heights = np.linspace(0.06, 0.26, pulls.size) if pulls.size > 1 else np.array([0.16])
    ax.plot(*((heights, pulls) if vertical else (pulls, heights)), "o", ms=3.0, color=style.ARRIVAL)
    if vertical:
        ax.set(xlim=(0, 0.45), xticks=())
    else:
        ax.set(ylim=(0, 0.45), yticks=())


def write_note(ax: Axes, *lines: str) -> None:
    """Numbers in the corner of such a picture, and what its line is."""
    text = "\n".join((*lines, "line: unit normal"))
    ax.text(0.98, 0.97, text, transform=ax.transAxes, ha="right", va="top", fontsize=6.5)


@style.styled
def draw_pulls(
    path: LightPath, ax: Axes | None = None, *, vertical: bool = False, note: bool = True
) -> Axes:
    """Histogram of residual / error of the pulses used, against the unit normal.

    Parameters
    ----------
    path : LightPath
        The path.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.
    vertical : bool, optional
        True lays the bars along the vertical axis.
    note : bool, optional
        False leaves out the numbers.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 70, 60)
    places = places_from_path(path)
    pulls = places.pull[places.used & np.isfinite(places.pull)]
    if pulls.size == 0:
        return style.message(ax, "the path carries no residuals")
    draw_unit_normal(ax, pulls, what="pulses", vertical=vertical)
    if note:
        spread = float(pulls.std(ddof=1)) if pulls.size > 1 else float("nan")
        write_note(
            ax,
            f"n = {pulls.size}",
            f"mean {style.number(float(pulls.mean()), 2)}",
            f"std {style.number(spread, 3)}",
        )
    (ax.set_ylabel if vertical else ax.set_xlabel)("residual / its error")
    return ax
