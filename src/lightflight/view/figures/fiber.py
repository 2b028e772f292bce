"""Recordings without a metric scale: the path in the picture and its arrival times, (u, v, t_a).

Takes Histograms, Arrivals and the legs `find_legs` saw, gives a Figure. Nothing here claims mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from lightflight import flags as fl
from lightflight.view import style
from lightflight.view.figures.camera import unfolded_arrivals
from lightflight.view.figures.timing import leg_mark
from lightflight.view.types import Floats, Whole

if TYPE_CHECKING:
    from lightflight import Arrivals, Histograms
    from lightflight.reconstruct.legs.find import ImageLeg


_MOST_STRAYS = 300
"""Pulses on no leg that are drawn one by one."""

_LEG_COLORS = (style.EVENT, style.ARRIVAL, "#5f9ea0", "#8c6bb1", "#a6861a", style.INK)


def leg_color(leg: int) -> str:
    """Colour of a leg in the picture; repeats after six, its marker does not."""
    return _LEG_COLORS[leg % len(_LEG_COLORS)]


@style.styled
def fiber_figure(
    hist: Histograms,
    arrivals: Arrivals,
    legs: Sequence[ImageLeg],
    track: ArrayLike | None = None,
    *,
    headline: str = "",
    track_name: str = "independent track",
) -> Figure:
    """What can be seen without a scale: brightness, arrival times, the legs found (185 x 122 mm).

    Parameters
    ----------
    hist : Histograms
        The recording.
    arrivals : Arrivals
        Arrivals found in it.
    legs : sequence of ImageLeg
        Legs seen in the picture (`find_legs`), in the order of flight.
    track : array, optional
        (n, 3), an independent track to compare with: arrival time (unit of `arrivals`), u = column,
        v = row, px; NaN rows are left out.
    headline, track_name : str, optional
        Words for the title and for the legend.

    Returns
    -------
    Figure
        The page, to be saved or shown.
    """
    unit = "ps" if getattr(hist, "bin_width_ps", None) is not None else "codes"
    other = None if track is None else _checked_track(track)
    times = unfolded_arrivals(arrivals)
    figure = style.new_figure(185, 122)
    picture = figure.add_axes((0.07, 0.10, 0.50, 0.74))
    _draw_picture(picture, hist, arrivals, legs, times, other, track_name, unit)
    across = figure.add_axes((0.72, 0.53, 0.26, 0.31))
    down = figure.add_axes((0.72, 0.10, 0.26, 0.31))
    members = _members_of(legs, len(times))
    for ax, axis, name in ((across, 0, "column u (px)"), (down, 1, "row v (px)")):
        _draw_against_time(ax, arrivals, legs, members, times, other, axis)
        ax.set_ylabel(name)
        ax.set_xlabel(f"arrival time ({unit})")
    style.title(across, "Motion in the picture")
    if headline:
        figure.text(0.07, 0.955, headline, fontsize=12, fontweight="bold", va="center")
    figure.text(0.07, 0.905, _summary(legs, unit), fontsize=8, color=style.QUIET, va="center")
    return figure


def _checked_track(track: ArrayLike) -> Floats:
    rows = np.asarray(track, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"track must have shape (n, 3): time, u, v; got {rows.shape}")
    return np.asarray(rows[np.isfinite(rows).all(axis=1)])


def _members_of(legs: Sequence[ImageLeg], n: int) -> Whole:
    """(n,), leg of each row of the arrivals table; -1 for none."""
    of_row = np.full(n, -1, dtype=np.int64)
    for k, leg in enumerate(legs):
        of_row[leg.members] = k
    return of_row


def _draw_picture(
    ax: Axes,
    hist: Histograms,
    arrivals: Arrivals,
    legs: Sequence[ImageLeg],
    times: Floats,
    track: Floats | None,
    track_name: str,
    unit: str,
) -> None:
    rows, cols = arrivals.shape
    # The root, so that faint parts of the path are seen beside bright ones.
    light = np.sqrt(np.maximum(np.asarray(hist.photons, dtype=float), 0.0))
    ax.imshow(light, cmap="Greys", vmin=0, vmax=1.7 * max(float(light.max()), 1e-12))
    use = np.isfinite(times) & fl.is_usable(arrivals.flags)
    on_leg = use & (_members_of(legs, len(times)) >= 0)
    stray = use & ~on_leg
    size = (180.0 / max(rows, cols)) ** 2
    # Where nearly every cell has something to say, marks would drown the light: a count will do.
    few = int(stray.sum()) <= _MOST_STRAYS
    if few:
        ax.scatter(
            arrivals.col[stray], arrivals.row[stray], s=0.25 * size, lw=0.6, marker="x",
            c=style.QUIET,
        )  # fmt: skip
    dots = ax.scatter(
        arrivals.col[on_leg], arrivals.row[on_leg], s=0.55 * size, c=times[on_leg],
        cmap=style.time_colormap(), lw=0, zorder=3,
    )  # fmt: skip
    if track is not None:
        ax.plot(track[:, 1], track[:, 2], ".", ms=1.6, color=style.INK, zorder=4, label=track_name)
    for k, leg in enumerate(legs):
        ends = leg.points_px(np.array(leg.extent_px))
        ax.annotate(
            "", tuple(ends[1]), xytext=tuple(ends[0]), zorder=5,
            arrowprops={"arrowstyle": "-|>,head_width=0.3,head_length=0.6",
                        "color": leg_color(k), "lw": 1.5, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
        _number_leg(ax, ends, k)
    if stray.any():
        word = (
            f"on no leg ({int(stray.sum())})" if few else f"{int(stray.sum())} on no leg, not drawn"
        )
        mark = "x" if few else ""
        ax.plot([], [], marker=mark, ls="none", color=style.QUIET, ms=3.5, mew=0.6, label=word)
    ax.set(xlim=(-0.5, cols - 0.5), ylim=(rows - 0.5, -0.5))
    ax.set(xlabel="column u (px)", ylabel="row v (px)")
    if on_leg.any():
        style.colorbar(ax, dots, f"arrival time ({unit})")
    ax.fill_between([], [], color="#c9c9c9", lw=0, label="all light")
    ax.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2, columnspacing=1.2,
        handlelength=1.2,
    )  # fmt: skip


def _number_leg(ax: Axes, ends: Floats, k: int) -> None:
    along = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
    side = np.array([along[1], -along[0]])
    side = side if side[1] < 0 else -side  # above the leg: row numbers grow downwards
    number = ax.annotate(
        f"{k + 1}",
        tuple(ends.mean(axis=0)),
        xytext=(11 * side[0], -11 * side[1]),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=7.5,
        fontweight="bold",
        color=leg_color(k),
        zorder=6,
    )
    number.set_path_effects([withStroke(linewidth=2.4, foreground=style.PAPER)])


def _draw_against_time(
    ax: Axes,
    arrivals: Arrivals,
    legs: Sequence[ImageLeg],
    members: Whole,
    times: Floats,
    track: Floats | None,
    axis: int,
) -> None:
    """One picture coordinate against arrival time: pulses, legs, and the independent track."""
    where = (arrivals.col, arrivals.row)[axis]
    if track is not None:
        ax.plot(track[:, 0], track[:, 1 + axis], ".", ms=1.6, color=style.INK, zorder=2)
    for k, leg in enumerate(legs):
        mine = members == k
        ax.plot(
            times[mine], where[mine], leg_mark(k), ms=2.0, mfc="none", mec=leg_color(k), mew=0.5,
            ls="none", alpha=0.55, zorder=3,
        )  # fmt: skip
        s = np.linspace(leg.extent_px[0], leg.extent_px[1], 101)
        ax.plot(leg.arrival_ps(s), leg.points_px(s)[:, axis], color=leg_color(k), lw=1.4, zorder=4)
    # Rows grow downwards, as in the picture.
    if axis == 1:
        ax.invert_yaxis()


def _summary(legs: Sequence[ImageLeg], unit: str) -> str:
    if not legs:
        return "no leg was found"
    word = "1 leg" if len(legs) == 1 else f"{len(legs)} legs"
    speeds = [abs(leg.apparent_speed_px_per_ps) for leg in legs]
    per = "ps" if unit == "ps" else "code"
    span = (
        f"{style.number(min(speeds), 3)}"
        if len(legs) == 1
        else f"{style.number(min(speeds), 3)} to {style.number(max(speeds), 3)}"
    )
    return f"{word}  \u00b7  apparent speed {span} px per {per}  \u00b7  no metric scale assumed"
