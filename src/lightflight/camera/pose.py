"""Where a camera may stand, from points and the directions it saw them in: linear first answers.

Takes world points (mm) and their normalised image coordinates (x right, y down), gives
world-from-camera poses (4, 4) to start a fit from; `calibration` refines them.

Source: Hartley & Zisserman, *Multiple View Geometry* (2004), sections 4.1, 4.4, 7.1, 8.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.camera.rigid import rotation_from_vector

Floats = NDArray[np.float64]


def is_planar(points: Floats) -> bool:
    """Whether points lie in one plane, to a millionth of their spread.

    Parameters
    ----------
    points : array of float, shape (n, 3)
        In any unit.

    Returns
    -------
    bool
        True for fewer than four points too.
    """
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(len(spread) < 3 or spread[2] <= 1e-6 * spread[0])


def _projection(points: Floats, image: Floats) -> Floats:
    """(3, k) of size 1 with image ~ P points, points (n, k) homogeneous: the linear transform."""
    zero = np.zeros_like(points)
    rows = np.concatenate(
        [
            np.hstack([points, zero, -image[:, :1] * points]),
            np.hstack([zero, points, -image[:, 1:2] * points]),
        ]
    )
    # The triangle has the same singular vectors, without a left basis as long as the data.
    return np.asarray(np.linalg.svd(np.linalg.qr(rows, mode="r"))[2][-1].reshape(3, -1))


def _homography(plane: Floats, image: Floats) -> Floats:
    """(3, 3) with image ~ H plane, by the normalised direct linear transform."""
    moves = []
    for values in (plane, image):
        center = values.mean(axis=0)
        scale = np.sqrt(2.0) / max(float(np.sqrt(((values - center) ** 2).sum(1).mean())), 1e-300)
        moves.append(
            np.array([[scale, 0, -scale * center[0]], [0, scale, -scale * center[1]], [0, 0, 1.0]])
        )
    a = np.column_stack([plane, np.ones(len(plane))]) @ moves[0].T
    b = np.column_stack([image, np.ones(len(image))]) @ moves[1].T
    return np.asarray(np.linalg.solve(moves[1], _projection(a, b) @ moves[0]))


def _nearest_rotation(matrix: Floats) -> Floats:
    """Rotation (3, 3) nearest to a matrix, by its singular vectors."""
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)


def _world_from_camera(rotation: Floats, translation: Floats) -> Floats:
    """Invert camera = R world + t."""
    pose = np.eye(4)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = -rotation.T @ translation
    return pose


def poses_from_plane(points: Floats, rays: Floats) -> list[Floats]:
    """World-from-camera candidates for points near a plane (Hartley & Zisserman, 4.1, 4.4, 8.1).

    Parameters
    ----------
    points : array of float, shape (n, 3)
        World, mm, at least 4.
    rays : array of float, shape (n, 2)
        Where each was seen in the undistorted image plane, x right and y down.

    Returns
    -------
    list of array, shape (4, 4)
        mm; two where the plane may be tilted either way.
    """
    center = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - center)
    # A right-handed set.
    axes[2] *= np.linalg.det(axes)
    h = _homography((points - center) @ axes[:2].T, rays)
    # Both columns are those of a rotation, up to one factor.
    h /= np.sqrt(np.linalg.norm(h[:, 0]) * np.linalg.norm(h[:, 1]))
    # A homography has no sign; the plane stands in front of the camera.
    if (h[2] @ [0.0, 0.0, 1.0]) < 0.0:
        h = -h
    rotation = _nearest_rotation(np.column_stack([h[:, 0], h[:, 1], np.cross(h[:, 0], h[:, 1])]))
    candidates = [rotation]
    # Seen from afar a plane tilted one way looks like the plane tilted the other way.
    sight = h[:, 2] / np.linalg.norm(h[:, 2])
    normal = rotation[:, 2]
    flipped = 2.0 * (normal @ sight) * sight - normal
    turn = np.cross(normal, flipped)
    sine, cosine = float(np.linalg.norm(turn)), float(normal @ flipped)
    if sine > 1e-9:
        about = rotation_from_vector(turn / sine * np.arctan2(sine, cosine))
        candidates.append(np.asarray(about @ rotation))
    return [_world_from_camera(r @ axes, h[:, 2] - r @ axes @ center) for r in candidates]


def poses_from_space(points: Floats, rays: Floats) -> list[Floats]:
    """World-from-camera candidate for points in space (Hartley & Zisserman, 7.1).

    Parameters
    ----------
    points : array of float, shape (n, 3)
        World, mm, at least 6, not in a plane.
    rays : array of float, shape (n, 2)
        Where each was seen in the undistorted image plane, x right and y down.

    Returns
    -------
    list of array, shape (4, 4)
        mm; empty where the points fix no pose.
    """
    center = points.mean(axis=0)
    scale = float(np.sqrt(((points - center) ** 2).sum(1).mean()))
    a = np.column_stack([(points - center) / scale, np.ones(len(points))])
    p = _projection(a, rays)
    # A projection has no size either; a rotation has determinant 1.
    size = np.cbrt(np.linalg.det(p[:, :3]))
    if not abs(size) > 1e-12:
        return []
    p /= size
    if p[2, 3] < 0.0:
        # The points stand behind: a mirror image explains them, no rotation does.
        p = -p
    rotation = _nearest_rotation(p[:, :3])
    return [_world_from_camera(rotation, scale * p[:, 3] - rotation @ center)]
