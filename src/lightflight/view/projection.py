"""Three dimensions on a flat page: parallel projection, a box with labelled edges, tubes.

Takes world points (mm), gives page points in the same unit, so that flat Matplotlib axes with
equal aspect show a scene to scale, with type and line work like every other figure. World y is up
on the page. Figures and movie draw through this; an overlay on a photograph passes the photo's
own camera instead of a `Viewpoint`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from lightflight.view import style
from lightflight.view.types import Floats
from lightflight.view.viewpoint import Projector, Viewpoint

_MARGIN_PT = 26.0
"""Room around a box for the labels of its edges, points of type."""


def line(ax: Axes, view: Projector, points_mm: ArrayLike, **options: Any) -> None:
    """A polyline through world points (n, 3)."""
    x, y = view.project(points_mm).T
    ax.plot(x, y, **options)


def polygon(ax: Axes, view: Projector, points_mm: ArrayLike, **options: object) -> None:
    """A filled polygon through world points (n, 3)."""
    ax.add_patch(Polygon(view.project(points_mm), closed=True, **options))


def label(
    ax: Axes,
    view: Projector,
    point_mm: ArrayLike,
    text: str,
    *,
    offset_pt: tuple[float, float] = (0.0, 0.0),
    halo: bool = True,
    **options: Any,
) -> None:
    """Text at a world point, moved by points of type, with a white halo so lines do not cut it."""
    from matplotlib.patheffects import withStroke

    note = ax.annotate(
        text,
        tuple(view.project(point_mm)),
        xytext=offset_pt,
        textcoords="offset points",
        **{"ha": "center", "va": "center", "fontsize": 7.0, "annotation_clip": False, **options},
    )
    if halo:
        note.set_path_effects([withStroke(linewidth=2.2, foreground=style.PAPER)])


def ribbon_from_rings(rings: Floats, view: Projector) -> Floats | None:
    """Outline on the page of a straight tube given by its rings (n, sides, 3); (2n, 2).

    None where the tube is not finite, or is seen along its axis.
    """
    on_page = view.project(rings)
    if not np.isfinite(on_page).all():
        return None
    center = on_page.mean(axis=1)
    along = center[-1] - center[0]
    size = np.linalg.norm(along)
    if size < 1e-9:
        return None
    across = np.array([-along[1], along[0]]) / size
    height = (on_page - center[:, np.newaxis]) @ across
    high = center + height.max(axis=1)[:, np.newaxis] * across
    low = center + height.min(axis=1)[:, np.newaxis] * across
    return np.concatenate((high, low[::-1]))


def draw_box(ax: Axes, view: Viewpoint, box_mm: Floats) -> None:
    """Back walls with a grid and labelled edges of a box (2, 3), to scale; sets the limits."""
    ax.set_axis_off()
    ax.set_aspect("equal")
    viewer = view.towards_viewer
    # Walls at the back, whatever side is looked from, and scales on the edges in front.
    far = np.where(viewer > 0, box_mm[0], box_mm[1])
    near = np.where(viewer > 0, box_mm[1], box_mm[0])
    values = _tick_values(box_mm)
    for axis in range(3):
        _draw_wall(ax, view, box_mm, axis, far[axis], values)
    low = box_mm[0, 1]
    _draw_edge(ax, view, 0, np.array([np.nan, low, near[2]]), box_mm, values[0])
    _draw_edge(ax, view, 2, np.array([near[0], low, np.nan]), box_mm, values[2])
    _draw_edge(ax, view, 1, np.array([far[0], np.nan, near[2]]), box_mm, values[1])
    _fit_limits(ax, view, box_mm)


def _tick_values(box: Floats) -> list[Floats]:
    spans = np.ptp(box, axis=0)
    common = style.nice_step(float(spans.max()), 5)
    values = []
    for axis in range(3):
        # One spacing for all axes, to compare lengths; a short axis needs its own to have a tick at
        # all.
        step = common if spans[axis] >= 1.4 * common else style.nice_step(float(spans[axis]), 2)
        first = np.ceil(box[0, axis] / step) * step
        values.append(np.arange(first, box[1, axis] + 1e-9 * step, step) + 0.0)
    return values


def _draw_wall(
    ax: Axes, view: Viewpoint, box: Floats, axis: int, level: float, values: list[Floats]
) -> None:
    a, b = (k for k in range(3) if k != axis)
    corners = np.full((4, 3), level)
    corners[:, a] = box[[0, 1, 1, 0], a]
    corners[:, b] = box[[0, 0, 1, 1], b]
    polygon(ax, view, corners, facecolor="#f6f7f9", edgecolor=style.HAIR, linewidth=0.6, zorder=0.5)
    for across, other in ((a, b), (b, a)):
        for value in values[across]:
            ends = np.full((2, 3), level)
            ends[:, across] = value
            ends[:, other] = box[:, other]
            line(ax, view, ends, color=style.HAIR, lw=0.45, zorder=0.6)


def _draw_edge(
    ax: Axes, view: Viewpoint, axis: int, fixed: Floats, box: Floats, values: Floats
) -> None:
    """Ticks and label on one edge of the box; `fixed` holds its two constant coordinates."""
    ends = np.repeat(fixed[np.newaxis], 2, axis=0)
    ends[:, axis] = box[:, axis]
    line(ax, view, ends, color=style.QUIET, lw=0.7, zorder=0.7)
    page = view.project(ends)
    along = (page[1] - page[0]) / max(np.linalg.norm(page[1] - page[0]), 1e-9)
    out = np.array([-along[1], along[0]])
    # Labels stand outside the box.
    if out @ (page.mean(axis=0) - view.project(box.mean(axis=0))) < 0:
        out = -out
    ha = "center" if abs(out[0]) < 0.55 else "left" if out[0] > 0 else "right"
    va = "top" if out[1] < -0.55 else "center"
    for value in values:
        place = fixed.copy()
        place[axis] = value
        x, y = view.project(place)
        ax.annotate(
            "", (x, y), xytext=tuple(3.0 * out), textcoords="offset points",
            arrowprops={"arrowstyle": "-", "color": style.QUIET, "lw": 0.6, "shrinkA": 0,
                        "shrinkB": 0}, annotation_clip=False,
        )  # fmt: skip
        label(
            ax, view, place, f"{value:g}".replace("-", "\u2212"), offset_pt=tuple(4.5 * out),
            ha=ha, va=va, fontsize=6.5, halo=False,
        )  # fmt: skip
    shift = 14.5 if ha == "center" else 19.0
    label(
        ax, view, ends.mean(axis=0), f"{'xyz'[axis]} (mm)", offset_pt=tuple(shift * out),
        ha=ha, va=va, fontsize=7.5, halo=False,
    )  # fmt: skip


def _fit_limits(ax: Axes, view: Viewpoint, box: Floats) -> None:
    """Limits that hold the box and leave `_MARGIN_PT` around it."""
    corners = np.array(np.meshgrid(*box.T, indexing="ij")).reshape(3, -1).T
    page = view.project(corners)
    low, high = page.min(axis=0), page.max(axis=0)
    figure = ax.get_figure(root=True)
    assert figure is not None
    size_pt = 72.0 * np.array(figure.get_size_inches()) * ax.get_position().bounds[2:]
    # By points of type, not by data: labels keep their size when the figure does not.
    room = np.maximum(size_pt - 2.0 * _MARGIN_PT, 10.0)
    per_pt = float(((high - low) / room).max())
    middle = (low + high) / 2.0
    half = per_pt * size_pt / 2.0
    ax.set_xlim(middle[0] - half[0], middle[0] + half[0])
    ax.set_ylim(middle[1] - half[1], middle[1] + half[1])
