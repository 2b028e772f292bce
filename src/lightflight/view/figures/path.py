"""The path in space: 3D with error tubes, camera, field of view, source and mirrors.

Takes a LightPath, gives Axes. The vertical axis of the page is world y, as in the paper's set-up.
Errors far below the width of a line are drawn magnified; the factor is written in the picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from lightflight.path.on_bends import drawn_outline_mm
from lightflight.path.tables import Polyline
from lightflight.path.trace import (
    Trace,
    parted,
    position_at,
    trace_from_path,
    unseen_legs_of,
)
from lightflight.path.tree import corners_of, forks_of, last_legs, outline_mm, starts_of
from lightflight.view import style
from lightflight.view.projection import draw_box, label, line, polygon, ribbon_from_rings
from lightflight.view.solids import error_rings, field_of_view, magnification_of, mirror_outline
from lightflight.view.types import Floats
from lightflight.view.viewpoint import PhotoView, Projector, Viewpoint

if TYPE_CHECKING:
    from lightflight import Camera, LightPath


_SHADOW: dict[str, Any] = {"color": "#c3c9d2", "lw": 0.9}
_TUBE_SIDES = 24


@style.styled
def draw_path_3d(
    path: LightPath,
    ax: Axes | None = None,
    *,
    truth: Polyline | None = None,
    others: Mapping[str, LightPath] | None = None,
    magnification: float | None = None,
    show_truth: bool = True,
    whole_scene: bool = False,
    time_mark_ps: float | None = None,
    legend: bool = True,
    view: Viewpoint | None = None,
) -> Axes:
    """Draw a path in (x, y, z) with its errors, the field of view, source and mirrors.

    Parameters
    ----------
    path : LightPath
        The path.
    ax : Axes, optional
        Ordinary axes; None makes a figure of 160 x 100 mm.
    truth : Polyline, optional
        Vertices to draw dashed; taken from the path where it knows one.
    others : mapping of str to LightPath, optional
        Other estimates by name, drawn thinner.
    magnification : float, optional
        Of the one-sigma error tubes; None chooses 1, 2, 5, 10 ... and says so.
    show_truth : bool, optional
        False leaves the truth out, though the box still holds it.
    whole_scene : bool, optional
        True makes the box large enough for the camera.
    time_mark_ps : float, optional
        Spacing of event-time marks along the path, ps; None chooses.
    view : Viewpoint, optional
        Where the viewer stands; parallel projection, so lengths along an axis compare.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 160, 100) if ax is None else ax
    view = Viewpoint() if view is None else view
    truth = getattr(path, "truth", None) if truth is None else truth
    trace = trace_from_path(path)
    box = scene_box(path, truth, whole_scene=whole_scene)
    truth = truth if show_truth else None
    extent = float(np.ptp(box, axis=0).max())
    factor = magnification_of(trace, extent) if magnification is None else magnification
    draw_box(ax, view, box)
    _draw_shadows(ax, view, trace, box)
    _draw_field(ax, view, path, box, whole_scene=whole_scene)
    _draw_scene(ax, view, path, trace, truth, others or {}, factor, extent=extent)
    _draw_time_marks(ax, view, path, time_mark_ps)
    # The legend may be drawn elsewhere, later: the axes remember what the tubes were enlarged by.
    ax._lightflight_magnification = factor  # type: ignore[attr-defined]
    if legend:
        ax.legend(*legend_entries(ax, path), loc="upper left", bbox_to_anchor=(0.0, 1.0))
    return ax


@style.styled
def draw_path_on_photo(
    path: LightPath,
    photo: ArrayLike,
    photo_camera: Camera,
    ax: Axes | None = None,
    *,
    truth: Polyline | None = None,
    magnification: float = 1.0,
) -> Axes:
    """Lay a path over a photograph of the set-up (paper, Fig. 6a).

    Parameters
    ----------
    path : LightPath
        The path.
    photo : array
        (rows, cols) or (rows, cols, 3 | 4), picture as Matplotlib's `imshow` takes it.
    photo_camera : Camera
        Camera that took it, in the same world frame as the path.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.
    truth : Polyline, optional
        What to compare with; taken from the path where it knows one.
    magnification : float, optional
        Factor by which errors are drawn larger.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        Where photo and camera differ in shape.
    """
    picture = np.asarray(photo)
    if picture.shape[:2] != tuple(photo_camera.shape):
        raise ValueError(
            f"the photo has {picture.shape[:2]} pixels and its camera {photo_camera.shape}: "
            "give the camera of this photo at this size"
        )
    rows, cols = picture.shape[:2]
    ax = style.axes_or_new(None, 120, 120 * rows / cols) if ax is None else ax
    ax.imshow(picture, cmap="gray", interpolation="antialiased")
    ax.set_axis_off()
    truth = getattr(path, "truth", None) if truth is None else truth
    trace = trace_from_path(path)
    extent = float(np.ptp(scene_box(path, truth, whole_scene=False), axis=0).max())
    _draw_scene(ax, PhotoView(photo_camera), path, trace, truth, {}, magnification, extent=extent)
    ax.set(xlim=(-0.5, cols - 0.5), ylim=(rows - 0.5, -0.5))
    return ax


def _draw_scene(
    ax: Axes,
    view: Projector,
    path: LightPath,
    trace: Trace,
    truth: Polyline | None,
    others: Mapping[str, LightPath],
    factor: float,
    *,
    extent: float,
) -> None:
    """Mirrors, tubes, estimates, truth and the path, in whatever projection."""
    _draw_mirrors(ax, view, path, size_mm=0.055 * extent)
    _draw_tubes(ax, view, trace, factor)
    for k, (name, other) in enumerate(others.items()):
        marks = style.line_of_other(k) | {"lw": 1.2, "zorder": 7, "label": f"{name} estimate"}
        line(ax, view, drawn_outline_mm(other), **marks)
    _draw_line(ax, view, trace, unseen_legs_of(path))
    if truth is not None:
        line(ax, view, outline_mm(truth), **style.TRUTH_LINE, zorder=9, label="truth")
    _draw_ends(ax, view, path)


def scene_box(
    path: LightPath, truth: Polyline | None = None, *, whole_scene: bool = False
) -> Floats:
    """(2, 3): lowest and highest world coordinate of a scene with some room around it, mm."""
    points = [np.asarray(path.vertices_mm, dtype=float).reshape(-1, 3)]
    if truth is not None:
        points.append(np.asarray(truth.vertices_mm, dtype=float))
    if whole_scene and getattr(path, "camera", None) is not None:
        points.append(np.asarray(path.camera.center_mm, dtype=float)[np.newaxis])
        points.append(field_of_view(path.camera, points[0].mean(axis=0)))
    every = np.concatenate(points)
    # A ray that misses the plane of the scene leaves the field of view infinite.
    every = every[np.isfinite(every).all(axis=1)]
    if len(every) == 0:
        every = np.zeros((1, 3))
    low, high = every.min(axis=0), every.max(axis=0)
    size = max(float((high - low).max()), 1.0)
    # A flat scene still needs some depth around it, or nothing can be seen of its errors.
    pad = np.maximum(0.04 * size, 0.5 * (0.16 * size - (high - low)))
    return np.array([low - pad, high + pad])


def _draw_shadows(ax: Axes, view: Viewpoint, trace: Trace, box: Floats) -> None:
    """Projections on the floor and on the back wall: without them a drawing has no depth."""
    for axis in (1, 2):
        points = trace.points_mm.copy()
        points[:, axis] = box[0 if view.towards_viewer[axis] > 0 else 1, axis]
        line(ax, view, parted(trace, points), zorder=1, **_SHADOW)


def _draw_field(
    ax: Axes, view: Viewpoint, path: LightPath, box: Floats, *, whole_scene: bool
) -> None:
    camera = getattr(path, "camera", None)
    if camera is None:
        return
    if whole_scene:
        outline = field_of_view(camera, np.asarray(path.vertices_mm, dtype=float).mean(axis=0))
        # The corners of the picture, see `field_of_view`.
        for corner in outline[[0, 8, 16, 24]]:
            line(
                ax, view, np.stack((camera.center_mm, corner)), color=style.ARRIVAL, lw=0.5,
                alpha=0.6, zorder=3,
            )  # fmt: skip
        polygon(
            ax, view, outline, facecolor=style.ARRIVAL, edgecolor=style.ARRIVAL, alpha=0.09,
            linewidth=0.8, zorder=3,
        )  # fmt: skip
        x, y = view.project(camera.center_mm)
        ax.plot(x, y, "s", ms=5, color=style.INK, zorder=10)
        label(ax, view, camera.center_mm, "camera", offset_pt=(0, 9))
        return
    for wall in field_walls(camera, box):
        polygon(ax, view, wall, facecolor=style.ARRIVAL, alpha=0.08, edgecolor="none", zorder=3)
        line(
            ax, view, np.vstack((wall, wall[:1])), color=style.ARRIVAL, lw=0.6, alpha=0.55,
            zorder=3,
        )  # fmt: skip


def field_walls(camera: Camera, box: Floats) -> list[Floats]:
    """The left and right edge of the camera's field inside a box; each (4, 3), world, mm.

    A wall that leaves the box sideways, or a camera that does not look along z, gives none.
    """
    rows, cols = camera.shape
    walls = []
    for col in (-0.5, cols - 0.5):
        ray = camera.rays_from_pixels((rows - 1) / 2.0, col)
        # A wall through the box from back to front exists only where the camera looks along z.
        if abs(ray[2]) < 0.3:
            return []
        x = [camera.center_mm[0] + ray[0] * (z - camera.center_mm[2]) / ray[2] for z in box[:, 2]]
        if min(x) < box[0, 0] or max(x) > box[1, 0]:
            continue
        (low, high), (back, front) = box[:, 1], box[:, 2]
        walls.append(
            np.array(
                [(x[0], low, back), (x[1], low, front), (x[1], high, front), (x[0], high, back)]
            )
        )
    return walls


def _draw_mirrors(ax: Axes, view: Projector, path: LightPath, *, size_mm: float) -> None:
    for _, before, corner, after in corners_of(path):
        square = mirror_outline(before, corner, after, size_mm=size_mm)
        polygon(ax, view, square, facecolor="#c9d3df", edgecolor=style.INK, linewidth=0.7, zorder=5)


def _draw_tubes(ax: Axes, view: Projector, trace: Trace, factor: float) -> None:
    outlines = []
    for leg in np.unique(trace.leg):
        rings = error_rings(trace, int(leg), magnification=factor, sides=_TUBE_SIDES)
        outline = ribbon_from_rings(rings, view)
        if outline is not None:
            outlines.append(outline)
    # Not a patch each: their limits, which the box sets anyway, took half of the time.
    tubes = PolyCollection(outlines, facecolor=style.EVENT, alpha=0.20, lw=0, zorder=6)
    ax.add_collection(tubes, autolim=False)


def _draw_line(ax: Axes, view: Projector, trace: Trace, unseen: tuple[int, ...]) -> None:
    """The path itself; thin where the camera does not see it, dotted where nobody did."""
    open_ = np.isin(trace.leg, unseen)[:, np.newaxis]
    told = np.where(open_, np.nan, trace.points_mm)
    line(ax, view, parted(trace, told), color=style.EVENT, lw=0.8, zorder=8)
    if open_.any():
        guessed = np.where(open_, trace.points_mm, np.nan)
        line(ax, view, parted(trace, guessed), color=style.EVENT, lw=0.8, ls=(0, (1, 3)), zorder=8,
             label="one way of many (dotted: unseen)")  # fmt: skip
    seen = trace.points_mm.copy()
    # NaN parts the line where the pulse is out of view.
    seen[~trace.in_view] = np.nan
    line(ax, view, parted(trace, seen), color=style.EVENT, lw=2.2, zorder=8,
         label="path (thick: seen)")  # fmt: skip


def _draw_time_marks(ax: Axes, view: Viewpoint, path: LightPath, step_ps: float | None) -> None:
    times = np.asarray(path.vertex_times_ps, dtype=float)
    if len(times) < 2 or not np.isfinite(times).all():
        return
    step = style.nice_step(float(np.ptp(times)), 4) if step_ps is None else step_ps
    # None at vertex 0: the source is labelled there.
    marks = np.arange(step, np.ptp(times), step)
    # Each way of the light has its own; where two run together they are the same.
    chains = getattr(path, "branches", (path,))
    spots = {
        (float(mark), *point.round(6)): point
        for chain in chains
        for mark, point in zip(marks, position_at(chain, times[0] + marks), strict=True)
    }
    for (mark, *_), point in spots.items():
        if not np.isfinite(point).all():
            continue
        x, y = view.project(point)
        ax.plot(x, y, "o", ms=3.6, mfc=style.PAPER, mec=style.EVENT, mew=1.0, zorder=10)
        text = f"{mark / 1000:g} ns" if step >= 100 else f"{mark:g} ps"
        label(ax, view, point, text, offset_pt=(0, 7.5), fontsize=6.5, color=style.EVENT, zorder=12)


def _draw_ends(ax: Axes, view: Projector, path: LightPath) -> None:
    vertices = np.asarray(path.vertices_mm, dtype=float)
    source = getattr(path, "source", None)
    known = source is not None and source.position_mm is not None
    x, y = view.project(vertices).T
    ax.plot(x[0], y[0], "o", ms=5.5, color=style.INK, zorder=11)
    label(ax, view, vertices[0], "source" if known else "entry", offset_pt=(0, -9), zorder=12)
    starts = starts_of(path)
    for leg in last_legs(starts):
        ax.annotate(
            "",
            (x[leg + 1], y[leg + 1]),
            xytext=(x[starts[leg]], y[starts[leg]]),
            arrowprops={"arrowstyle": "-|>,head_width=0.22,head_length=0.45",
                        "color": style.EVENT, "lw": 0.0, "shrinkA": 0, "shrinkB": -5},
            zorder=11,
        )  # fmt: skip
        label(ax, view, vertices[leg + 1], "exit", offset_pt=(2, 8), zorder=12)
    open_ = getattr(path, "open_vertices", ())
    splitters = {vertex for _, vertex in forks_of(path)}
    for i, _, corner, end in corners_of(path):
        after = view.project(corner) - view.project(end)
        # On the side of the mirror that the outgoing leg leaves free.
        side = 1.0 if after[0] >= 0 else -1.0
        # Where a mirror stands that ends a way nobody saw is open.
        name = f"{'S' if i in splitters else 'M'}{i}" + ("?" if i in open_ else "")
        label(ax, view, vertices[i], name, offset_pt=(11 * side, 0), zorder=12)


def legend_entries(ax: Axes, path: LightPath) -> tuple[list[Artist], list[str]]:
    """Handles and words for a legend of `draw_path_3d`, the magnification of the tubes included."""
    handles, labels = ax.get_legend_handles_labels()
    trace = trace_from_path(path)
    factor = getattr(ax, "_lightflight_magnification", 1.0)
    if np.isfinite(trace.std_mm).any():
        enlarged = "" if factor == 1 else f", enlarged {factor:g}\u00d7"
        handles.append(Patch(facecolor=style.EVENT, alpha=0.3, lw=0))
        labels.append(f"error tube (1\u03c3{enlarged})")
    if getattr(path, "camera", None) is not None:
        handles.append(Patch(facecolor=style.ARRIVAL, alpha=0.18, lw=0))
        labels.append("field of view")
    handles.append(Line2D([], [], **_SHADOW))
    labels.append("shadow")
    return handles, labels
