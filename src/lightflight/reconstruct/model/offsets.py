"""How far places of the picture lie from the image of a leg, and how that follows the path.

The image of a straight leg is a line of the undistorted picture, in closed form; that of a bent
leg, or of any leg seen through interfaces, is a curve whose nearest point is looked for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.geometry import (
    Indices,
    PathState,
    add_vertex,
    nearest_fractions,
)
from lightflight.reconstruct.model.image_plane import mean_focal_px, pixels_of_undistorted
from lightflight.vectors import cross, summed

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]


def line_offsets(
    state: PathState,
    *,
    camera: Camera,
    legs: Indices,
    anchors: Floats,
) -> tuple[Floats, Floats]:
    """Signed distance of image points from the image of a leg, and its derivatives.

    Parameters
    ----------
    legs : array of int, shape (k,)
        Which leg.
    anchors : array of float, shape (k, 2)
        Undistorted (u, v): the camera's `mean_focal_px` times (x, y) on the normalized image plane.

    Returns
    -------
    offset : array of float, shape (k,)
        px, positive to the right of the flight in the picture (as `lateral_px`); NaN for a leg
        whose picture is no line.
    jacobian : array of float, shape (k, size)
        px per mm; the start time does not enter.
    """
    offset, jacobian = offsets_and_slopes(state, camera=camera, legs=legs, anchors=anchors)
    return offset, jacobian()


def offsets_and_slopes(
    state: PathState,
    *,
    camera: Camera,
    legs: Indices,
    anchors: Floats,
) -> tuple[Floats, Callable[[], Floats]]:
    """`line_offsets` whose derivatives are made when they are asked for."""
    curved = state.is_bent(legs) | bool(camera.interfaces)
    if curved.all() and len(curved):
        return _curve_offsets(state, camera, legs, anchors)
    offset, by_lines = _straight_offsets(state, camera, legs, anchors)
    if not curved.any():
        return offset, by_lines
    some = np.flatnonzero(curved)
    offset[some], by_curves = _curve_offsets(state, camera, legs[some], anchors[some])

    def jacobian() -> Floats:
        found = by_lines()
        found[some] = by_curves()
        return found

    return offset, jacobian


def _straight_offsets(
    state: PathState, camera: Camera, legs: Indices, anchors: Floats
) -> tuple[Floats, Callable[[], Floats]]:
    """`offsets_and_slopes` of straight legs, whose pictures are lines."""
    rotation, focal_px = camera.world_from_camera[:3, :3], mean_focal_px(camera)
    starts = state.leg_starts[legs]
    a = (state.vertices_mm[starts] - camera.center_mm) @ rotation
    b = (state.vertices_mm[legs + 1] - camera.center_mm) @ rotation
    normal = cross(a, b)
    size = np.hypot(normal[:, 0], normal[:, 1])
    # Seen end-on, or in the camera's own plane: a fit that tries such a step takes it back, since
    # no cost with NaN is lower.
    size = np.where(size > 0, size, np.nan)[:, np.newaxis]
    points = np.column_stack((anchors / focal_px, np.ones(len(anchors))))
    value = summed(normal / size * points)

    def jacobian() -> Floats:
        flat = np.column_stack((normal[:, :2] / size, np.zeros(len(legs))))
        by_normal = focal_px * (points - value[:, np.newaxis] * flat) / size
        # d(a x b).g = da.(b x g) + db.(g x a), then back from camera axes to world axes.
        by_start = cross(b, by_normal) @ rotation.T
        by_end = cross(by_normal, a) @ rotation.T
        found = np.zeros((len(legs), state.size))
        add_vertex(found, starts, by_start)
        add_vertex(found, legs + 1, by_end)
        return found

    return focal_px * value, jacobian


def _curve_offsets(
    state: PathState, camera: Camera, legs: Indices, anchors: Floats
) -> tuple[Floats, Callable[[], Floats]]:
    """`offsets_and_slopes` where a leg is a curve in the picture: bent, or seen through interfaces.

    From the point of that curve which is nearest; to first order it does not matter where it lies.
    """
    focal_px = mean_focal_px(camera)
    fraction = nearest_fractions(state, camera, legs, *pixels_of_undistorted(camera, anchors))
    # Nearest in undistorted pixels: two steps from what is nearest in the lens's own.
    for _ in range(2):
        points, step = state.points_mm(legs, fraction), state.tangents_mm(legs, fraction)
        place, run = camera.plane_and_speeds(points, step)
        fraction = fraction + _nearer(
            anchors - focal_px * np.stack(place, 1), focal_px * np.stack(run, 1)
        )
    points, step = state.points_mm(legs, fraction), state.tangents_mm(legs, fraction)
    plane, slopes = camera.plane_and_slopes(points)
    slopes, away = focal_px * slopes, anchors - focal_px * plane
    speed = np.einsum("nij,nj->ni", slopes, step)
    size = np.maximum(np.linalg.norm(speed, axis=1), 1e-12)
    fraction = fraction + _nearer(away, speed)
    # speed = (d u, d v), v down: the right-hand normal is (-dv, du).
    right = np.column_stack((-speed[:, 1], speed[:, 0])) / size[:, np.newaxis]
    offset = np.sum(away * right, axis=1)

    def jacobian() -> Floats:
        by_point = -np.einsum("ni,nij->nj", right, slopes)
        found = np.zeros((len(legs), state.size))
        add_vertex(found, state.leg_starts[legs], (1 - fraction)[:, np.newaxis] * by_point)
        add_vertex(found, legs + 1, fraction[:, np.newaxis] * by_point)
        for course, own in state.courses:
            here = np.flatnonzero(legs == course.leg)
            found[here, own] = course.by_bend(fraction[here], by_point[here])
        return found

    return offset, jacobian


def _nearer(away: Floats, speed: Floats) -> Floats:
    """Step (n,) of Newton's method towards places `away` (n, 2) of a curve run at `speed`."""
    size2 = np.maximum(summed(speed * speed), 1e-24)
    step: Floats = np.nan_to_num(summed(away * speed) / size2)
    return step
