"""The plane of the undistorted picture, in pixels: straight legs are straight lines there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]


def undistorted_px(camera: Camera | None, row: ArrayLike, col: ArrayLike) -> Floats:
    """(u, v) in pixels of the ideal pinhole of the same focal length; (n, 2).

    Straight legs are straight there whatever the lens does. Without a camera the pixels
    themselves are returned.

    Parameters
    ----------
    camera : Camera or None
        Whose lens is taken off; None: nothing is.
    row : array_like, shape (n,)
        Row, px.
    col : array_like, shape (n,)
        Column, px.

    Returns
    -------
    array of float, shape (n, 2)
        (u, v), px.
    """
    rows, cols = np.asarray(row, dtype=float), np.asarray(col, dtype=float)
    if camera is None:
        return np.stack((cols, rows), axis=-1)
    x, y = camera.normalized_from_pixels(rows, cols)
    focal = mean_focal_px(camera)
    return np.stack((focal * x, focal * y), axis=-1)


def pixels_of_undistorted(camera: Camera, points_px: Floats) -> tuple[Floats, Floats]:
    """Rows and columns (n,) of undistorted points (n, 2), which `undistorted_px` is of."""
    plane = points_px / mean_focal_px(camera)
    return camera.pixels_from_normalized(plane[:, 0], plane[:, 1])


def along_across(points: Floats, origin_px: Floats, direction_px: Floats) -> tuple[Floats, Floats]:
    """Position of points (n, 2) along a line of the picture and distance to its right; (n,), px.

    Parameters
    ----------
    points : array of float, shape (n, 2)
        Undistorted (u, v) in the picture, px.
    origin_px : array of float, shape (2,)
        A point of the line, px.
    direction_px : array of float, shape (2,)
        Unit, along it.

    Returns
    -------
    along : array of float, shape (n,)
        px.
    across : array of float, shape (n,)
        px, positive to the right as the picture is shown.
    """
    offset = points - origin_px
    across = offset[:, 1] * direction_px[0] - offset[:, 0] * direction_px[1]
    return offset @ direction_px, across


def inside_edges_px(row: ArrayLike, col: ArrayLike, shape: tuple[int, int]) -> Floats:
    """(..., 4), how far inside of a picture's upper, lower, left and right edge places lie, px."""
    row, col = np.asarray(row, dtype=float), np.asarray(col, dtype=float)
    inside: Floats = np.stack(
        (row + 0.5, shape[0] - 0.5 - row, col + 0.5, shape[1] - 0.5 - col), axis=-1
    )
    return inside


def mean_focal_px(camera: Camera) -> float:
    """Geometric mean of the two focal lengths, px."""
    return float(np.sqrt(abs(camera.matrix[0, 0] * camera.matrix[1, 1])))


def decentering_of_corner(camera: Camera, corner_px: float) -> float:
    """p1 or p2 that shows light at a corner of the picture so much farther along its axis, px."""
    corner = np.array(camera.shape) / 2.0
    r2 = float(corner @ corner)
    return corner_px * mean_focal_px(camera) / (r2 + 2.0 * float(corner.min()) ** 2)


def radial_of_corner(camera: Camera, corner_px: float) -> float:
    """By how much k1 is larger where a corner of the picture is seen so much farther out, px."""
    corner = float(np.hypot(*camera.shape)) / 2.0
    return corner_px / (corner * (corner / mean_focal_px(camera)) ** 2)
