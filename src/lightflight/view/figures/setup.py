"""A set-up drawn over the picture that it belongs to, before anything is fitted.

A mirrored or turned picture, a swapped field of view and a source in other units show here: the
first leg must come from the source, and the axes must point as they do in the lab.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from lightflight.reconstruct.legs.plausible import distance_mm, pixel_sides_mm
from lightflight.reconstruct.model.image_plane import mean_focal_px, pixels_of_undistorted
from lightflight.view import style
from lightflight.view.figures.recording import draw_counts
from lightflight.view.solids import field_of_view

if TYPE_CHECKING:
    from lightflight import Camera, Histograms, Source
    from lightflight.reconstruct.legs.find import ImageLeg

_AXIS_SHARE = 0.14
"""Length of the drawn world axes, as a share of the field of view."""
_SHOWN_FIELDS = 0.75
"""A source farther out than so many pictures is pointed at from the border."""


@style.styled
def setup_figure(
    hist: Histograms,
    camera: Camera,
    source: Source,
    legs: Sequence[ImageLeg] = (),
    *,
    title: str = "",
) -> Figure:
    """Picture of a recording with field of view, source, axes and legs laid over it.

    Parameters
    ----------
    hist : Histograms
        The recording.
    camera : Camera
        As told.
    source : Source
        As told.
    legs : sequence of ImageLeg, optional
        Found in the picture of that camera.
    title : str, optional
        Heading.

    Returns
    -------
    Figure
        To be saved or shown.
    """
    figure = style.new_figure(130, 110, layout="constrained")
    ax = draw_counts(hist, figure.subplots())
    rows, cols = camera.shape
    width, height = pixel_sides_mm(camera, source)
    far = distance_mm(camera, source)
    note = f"field of view {cols * width:.4g} x {rows * height:.4g} mm at {far:.4g} mm"
    ax.set_title(f"{style.words(title)}\n{note}" if title else note, loc="left", fontsize=8)
    for number, leg in enumerate(legs, start=1):
        _draw_leg(ax, camera, leg, number)
    _draw_axes(ax, camera, far)
    if source.position_mm is not None:
        _draw_source(ax, camera, np.asarray(source.position_mm, dtype=float))
    ax.add_patch(Rectangle((-0.5, -0.5), cols, rows, fill=False, ec=style.QUIET, lw=0.8))
    ax.set(xlim=(-0.5 - cols / 4, cols * 1.25 - 0.5), ylim=(rows * 1.25 - 0.5, -0.5 - rows / 4))
    return figure


@style.styled
def lab_figure(camera: Camera, source: Source, *, title: str = "") -> Figure:
    """A set-up from above and from the front, before there is any recording.

    Parameters
    ----------
    camera : Camera
        As told.
    source : Source
        As told; without a place it is not drawn.
    title : str, optional
        Heading.

    Returns
    -------
    Figure
        To be saved or shown.
    """
    figure = style.new_figure(160, 85, layout="constrained")
    above, front = figure.subplots(1, 2)
    outline, eye = field_of_view(camera, np.zeros(3)), camera.center_mm
    place = None if source.position_mm is None else np.asarray(source.position_mm, dtype=float)
    for ax, (a, b), heading in ((above, (0, 2), "from above"), (front, (0, 1), "from the front")):
        ax.plot(outline[:, a], outline[:, b], color=style.ARRIVAL, lw=1.2, label="field of view")
        for corner in outline[[0, 8, 16, 24]]:
            ax.plot(*np.stack((eye, corner))[:, [a, b]].T, color=style.HAIR, lw=0.8, zorder=0)
        ax.plot(eye[a], eye[b], "s", color=style.INK, ms=6, label="entrance pupil")
        if place is not None:
            ax.plot(place[a], place[b], "o", color=style.EVENT, ms=6, label="source")
        ax.set(xlabel=f"{'xyz'[a]} (mm)", ylabel=f"{'xyz'[b]} (mm)")
        ax.set_aspect("equal", adjustable="datalim")
        style.title(ax, heading)
    figure.legend(
        *front.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8
    )
    figure.suptitle(style.words(title), x=0.01, ha="left", fontsize=9)
    return figure


def _draw_leg(ax: Axes, camera: Camera, leg: ImageLeg, number: int) -> None:
    """An arrow in the direction of flight."""
    row, col = pixels_of_undistorted(camera, leg.points_px(np.array(leg.extent_px)))
    ax.annotate(
        "", (col[1], row[1]), (col[0], row[0]),
        arrowprops={"arrowstyle": "->", "color": style.EVENT, "lw": 1.4},
    )  # fmt: skip
    ax.text(col[1], row[1], f" {number}", color=style.EVENT, fontsize=8, va="center")


def _draw_axes(ax: Axes, camera: Camera, far_mm: float) -> None:
    """The world's axes from the middle of the picture, at the source's distance."""
    rows, cols = camera.shape
    ray = camera.rays_from_pixels(np.array([(rows - 1) / 2]), np.array([(cols - 1) / 2]))[0]
    middle = camera.center_mm + far_mm * ray
    length = _AXIS_SHARE * cols * far_mm / mean_focal_px(camera)
    for name, direction in zip("xyz", np.eye(3), strict=True):
        ends = np.stack([middle, middle + length * direction])
        row, col = camera.pixels_from_points(ends)
        if np.isfinite([row, col]).all():
            ax.annotate(
                name, (col[0], row[0]), (col[1], row[1]), color=style.INK, fontsize=8,
                ha="center", va="center",
                arrowprops={"arrowstyle": "<-", "color": style.INK, "lw": 0.9},
            )  # fmt: skip


def _draw_source(ax: Axes, camera: Camera, place_mm: np.ndarray) -> None:
    """Where the source lies in the picture, or beyond which border."""
    row, col = (float(x) for x in camera.pixels_from_points(place_mm))
    rows, cols = camera.shape
    if not np.isfinite([row, col]).all():
        ax.set_xlabel("column (the source lies behind the camera)")
        return
    off = np.array([col - (cols - 1) / 2, row - (rows - 1) / 2])
    beyond = float(np.max(np.abs(off) / (_SHOWN_FIELDS * np.array([cols, rows]))))
    shown = off / max(beyond, 1.0) + np.array([(cols - 1) / 2, (rows - 1) / 2])
    words = "source" if beyond <= 1.0 else f"source, at ({col:.0f}, {row:.0f}) px"
    ax.plot(*shown, marker="*", ms=11, color=style.ARRIVAL, clip_on=False)
    ax.annotate(words, shown, (4, -14), textcoords="offset points", color=style.ARRIVAL, fontsize=7)
