"""Schemes of the explanation pages: frames, the delayed picture, the apparent speed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lightflight.camera.model import Camera
from lightflight.flight import Medium, arrival_time_from_event
from lightflight.view import style

_INK, _QUIET, _EVENT, _ARRIVAL = style.INK, style.QUIET, style.EVENT, style.ARRIVAL
_FIELD = "#dfe5ee"


def _bare(ax: Axes, *, x: tuple[float, float], y: tuple[float, float]) -> None:
    ax.set(xlim=x, ylim=y)
    ax.set_aspect("equal")
    ax.set_axis_off()


def _arrow(
    ax: Axes, start: tuple[float, float], end: tuple[float, float], color: str = _INK, **more: float
) -> None:
    ax.annotate(
        "", end, xytext=start,
        arrowprops={"arrowstyle": "-|>,head_width=0.25,head_length=0.5", "color": color,
                    "lw": more.get("lw", 1.4), "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip


def _eye(ax: Axes, x: float, y: float) -> None:
    ax.plot([x], [y], "s", ms=8, color=_INK)


@style.styled
def world_frame() -> Figure:
    """World frame from the front and from above: x right, y up, z towards the camera."""
    figure = style.new_figure(180, 78)
    front = figure.add_axes((0.02, 0.04, 0.44, 0.84))
    _bare(front, x=(-20, 100), y=(-18, 82))
    front.fill([10, 80, 80, 10], [2, 2, 72, 72], color=_FIELD)
    front.text(45, 74, "field of view", ha="center", fontsize=7.5, color=_QUIET)
    _arrow(front, (-12, -10), (18, -10))
    _arrow(front, (-12, -10), (-12, 20))
    front.text(20, -10, "x", va="center", fontweight="bold")
    front.text(-12, 22, "y", ha="center", fontweight="bold")
    front.plot([-12], [-10], "o", ms=7, mfc=style.PAPER, mec=_INK)
    front.plot([-12], [-10], "o", ms=2, color=_INK)
    front.text(-9, -16, "z (towards the viewer)", fontsize=7.5, color=_QUIET)
    front.plot([0, 90], [18, 30], color=_EVENT, lw=1.5)
    _arrow(front, (40, 23.3), (48, 24.4), _EVENT)
    front.plot([0], [18], "o", color=_INK, ms=5)
    front.text(1, 11, "source B", ha="left", fontsize=8)
    style.title(front, "From the front, as the camera sees it")
    above = figure.add_axes((0.52, 0.04, 0.46, 0.84))
    _bare(above, x=(-20, 100), y=(-22, 78))
    above.fill([45, 10, 80], [66, 0, 0], color=_FIELD)
    above.axhline(0, color=_QUIET, lw=0.8, ls=":")
    above.text(99, 1.5, "plane z = 0", ha="right", fontsize=7.5, color=_QUIET)
    _eye(above, 45, 66)
    above.text(49, 66, "camera A", va="center", fontsize=8)
    _arrow(above, (45, 30), (45, 44))
    above.text(47, 37, "n", fontweight="bold")
    _arrow(above, (-12, -16), (18, -16))
    _arrow(above, (-12, -16), (-12, 14))
    above.text(20, -16, "x", va="center", fontweight="bold")
    above.text(-12, 16, "z", ha="center", fontweight="bold")
    above.plot([0, 90], [0, 14], color=_EVENT, lw=1.5)
    _arrow(above, (60, 9.3), (68, 10.6), _EVENT)
    above.plot([0], [0], "o", color=_INK, ms=5)
    above.text(-3, 3, "B", ha="right", fontsize=8)
    above.annotate("α", (32, 2.0), fontsize=9, color=_EVENT)
    style.title(above, "From above")
    return figure


@style.styled
def pixel_frame() -> Figure:
    """Pixels: row 0 at the top, the centre of the first pixel is (0, 0)."""
    figure = style.new_figure(134, 54)
    ax = figure.add_axes((0.02, 0.02, 0.96, 0.86))
    _bare(ax, x=(-3.0, 11.0), y=(3.8, -1.6))
    for row in range(4):
        for col in range(5):
            first = row == 0 and col == 0
            ax.fill(
                [col - 0.46, col + 0.46, col + 0.46, col - 0.46],
                [row - 0.46, row - 0.46, row + 0.46, row + 0.46],
                color="#f0b895" if first else _FIELD,
            )
    ax.plot([0], [0], "o", ms=3, color=_INK)
    _arrow(ax, (-0.5, -0.95), (2.2, -0.95))
    ax.text(2.35, -0.95, "col = u", va="center", fontweight="bold")
    _arrow(ax, (-0.95, -0.5), (-0.95, 2.2))
    ax.text(-1.1, 2.6, "row = v", ha="right", fontweight="bold")
    ax.annotate(
        "centre of the first pixel: (0, 0)", (0.05, 0.05), xytext=(5.3, 0.4), fontsize=8,
        va="center", arrowprops={"arrowstyle": "-", "color": _QUIET, "lw": 0.8},
    )  # fmt: skip
    ax.annotate(
        "its outer corner: (−0.5, −0.5)", (-0.46, -0.46), xytext=(5.3, -0.7), fontsize=8,
        va="center", arrowprops={"arrowstyle": "-", "color": _QUIET, "lw": 0.8},
    )  # fmt: skip
    ax.text(5.3, 2.1, "what is up in the world (+y)\nis up in the picture (small row)",
            fontsize=8, va="center", color=_QUIET)  # fmt: skip
    style.title(ax, "Pixels, as the camera sees them")
    return figure


@style.styled
def clocks_scheme() -> Figure:
    """A flash at X at event time t reaches the camera at arrival time t_a."""
    figure = style.new_figure(150, 70)
    ax = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    _bare(ax, x=(-8, 118), y=(-12, 50))
    ax.plot([0, 105], [0, 9], color=_EVENT, lw=1.6)
    _arrow(ax, (78, 6.7), (88, 7.5), _EVENT)
    ax.plot([0], [0], "o", color=_INK, ms=6)
    ax.text(0, -6, "source B, emission time $t_B$", ha="left", fontsize=8)
    x, y = 45.0, 45.0 * 9 / 105
    ax.plot([x], [y], "o", color=_EVENT, ms=7)
    ax.text(
        x + 2, y - 6, "X, event time  $t = t_B + n_p\\,\\ell\\,/\\,c$", fontsize=8, color=_EVENT
    )
    _eye(ax, 58, 42)
    ax.text(61, 42, "camera A, arrival time\n$t_a = t + n_r\\,|A - X|\\,/\\,c$", fontsize=8,
            color=_ARRIVAL, va="center")  # fmt: skip
    ax.plot([x, 58], [y, 42], color=_ARRIVAL, lw=1.2, ls=(0, (4, 2)))
    _arrow(ax, (50.1, 18.9), (52.3, 25.3), _ARRIVAL)
    ax.text(18, 4.6, "$\\ell$", color=_EVENT, fontsize=10)
    return figure


@style.styled
def code_frame() -> Figure:
    """Forward and reversed codes along one laser period; the same photon in both."""
    figure = style.new_figure(150, 62)
    ax = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    _bare(ax, x=(-22, 104), y=(-8, 44))
    for place, name, reverse in ((26.0, "forward", False), (8.0, "reversed", True)):
        for k in range(10):
            low = 90 - 9 * (k + 1) if reverse else 9 * k
            at_photon = low < 29.0 < low + 9
            ax.fill(
                [low + 0.3, low + 8.7, low + 8.7, low + 0.3],
                [place, place, place + 7, place + 7],
                color="#f0b895" if at_photon else _FIELD,
            )
            ax.text(low + 4.5, place + 3.5, str(k), ha="center", va="center", fontsize=8)
        ax.text(-2, place + 3.5, f"{name}\ncodes", ha="right", va="center", fontsize=8)
        _arrow(ax, (88, place - 1.8) if reverse else (2, place - 1.8),
               (70, place - 1.8) if reverse else (20, place - 1.8), _QUIET, lw=0.9)  # fmt: skip
    for x, words in ((0, "sync"), (90, "next sync")):
        ax.plot([x, x], [0, 37], color=_INK, lw=1.0)
        ax.text(x, 38.5, words, ha="center", fontsize=8)
    ax.plot([29, 29], [0, 37], color=_EVENT, lw=1.4)
    ax.text(29, 38.5, "photon", ha="center", fontsize=8, color=_EVENT)
    _arrow(ax, (0, -3), (98, -3))
    ax.text(49, -7.5, "delay after the sync", ha="center", fontsize=8)
    return figure


@style.styled
def apparent_speed() -> Figure:
    """A pulse across the field: where it is and where it is seen, and its apparent speed."""
    camera = Camera.facing_plane()
    x = np.linspace(-400.0, 400.0, 801)
    points = np.stack((x, np.zeros_like(x), np.zeros_like(x)), axis=1)
    event = (x - x[0]) * Medium().path_group_index / 0.299792458
    arrival = arrival_time_from_event(
        points, event, camera_center_mm=camera.center_mm, return_group_index=1.00027
    )
    figure = style.new_figure(150, 66)
    left = figure.add_axes((0.10, 0.19, 0.37, 0.66))
    left.plot(event - event[400], x, color=_EVENT, label="the pulse")
    left.plot(arrival - arrival[400], x, color=_ARRIVAL, label="its picture")
    left.set(xlabel="time since the middle (ps)", ylabel="place across the field (mm)")
    left.legend(loc="upper left")
    style.title(left, "Where it is, where it is seen")
    right = figure.add_axes((0.60, 0.19, 0.37, 0.66))
    speed = np.gradient(x, arrival) / 0.299792458
    right.axhline(1 / 1.00027, color=_EVENT)
    right.plot(x, speed, color=_ARRIVAL)
    right.set(xlabel="place across the field (mm)", ylabel="apparent speed (c)", ylim=(0, None))
    style.title(right, "How fast it seems")
    return figure


SCHEMES = {
    "frame-world": world_frame,
    "frame-pixels": pixel_frame,
    "two-clocks": clocks_scheme,
    "frame-codes": code_frame,
    "apparent-speed": apparent_speed,
}
"""Name of the picture in docs/images, and what draws it."""
