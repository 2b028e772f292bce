"""A camera that looks through nothing and sees nearly what one behind a window sees.

Behind the last interface all rays come nearly from one point, nearer or farther than the camera (a
tank looks shallow). A camera that stands there needs no refraction: good to a mm and some tenths
of a pixel, which starts a search; no fit ends with it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_GRID = 9
"""Rays across the picture and down that the stand-in is fitted to."""


def meeting_point(origins_mm: Floats, rays: Floats) -> Floats:
    """The point (3,) nearest to all lines, in least squares; origins and unit rays (n, 3)."""
    across = np.eye(3) - rays[:, :, np.newaxis] * rays[:, np.newaxis]
    pull = np.einsum("nij,nj->i", across, origins_mm)
    point: Floats = np.linalg.lstsq(across.sum(axis=0), pull, rcond=None)[0]
    return point


def stand_in_of(camera: Camera, return_group_index: float) -> tuple[Camera, float]:
    """A camera without interfaces that sees nearly the same, and how much more its light needs.

    Parameters
    ----------
    camera : Camera
        Without interfaces it stands in for itself.
    return_group_index : float
        Of the scene's medium.

    Returns
    -------
    stand_in : Camera
        Pinhole, no errors stated.
    more_mm : float
        Optical length to add to index times distance, the same for all pixels.
    """
    if not camera.interfaces:
        return camera, 0.0
    rows, cols = camera.shape
    row, col = (
        index.ravel()
        for index in np.meshgrid(
            np.linspace(0, rows - 1, _GRID), np.linspace(0, cols - 1, _GRID), indexing="ij"
        )
    )
    origins, rays, optical = camera.lines_of_sight(row, col)
    known = np.isfinite(optical)
    origins, rays, optical, row, col = (each[known] for each in (origins, rays, optical, row, col))
    center = meeting_point(origins, rays)
    more = optical - return_group_index * np.sum((origins - center) * rays, axis=1)
    x, y, z = (rays @ camera.world_from_camera[:3, :3]).T
    ones = np.ones(len(row))
    matrix = np.eye(3)
    matrix[0] = np.linalg.lstsq(np.column_stack((x / z, y / z, ones)), col, rcond=None)[0]
    matrix[1, 1:] = np.linalg.lstsq(np.column_stack((y / z, ones)), row, rcond=None)[0]
    pose = camera.world_from_camera.copy()
    pose[:3, 3] = center
    plain = replace(
        camera, matrix=matrix, distortion=np.empty(0), world_from_camera=pose, interfaces=(),
        pose_covariance=None, intrinsics_per_pose=None,
    )  # fmt: skip
    return plain, float(more.mean())
