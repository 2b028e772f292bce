"""Where a camera stands and how it is turned: poses, rotations and their covariance.

Takes vectors, (4, 4) poses and (6, 6) covariances in world axes, mm and rad, gives them checked:
a pose that scales, shears or mirrors is refused here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import finite_numbers
from lightflight.errors import GeometryError

# Rigid to this much: poses arrive as text with six or seven digits.
_RIGID_TOLERANCE = 1e-5
_LARGEST_STD = 1e15
"""mm or deg: its square is a number still."""


def read_only(values: ArrayLike) -> NDArray[np.float64]:
    """Copy that cannot be written to.

    Parameters
    ----------
    values : array_like
        Numbers.

    Returns
    -------
    array of float64
        Of the same shape.

    Raises
    ------
    ValueError
        For texts, objects and what is ragged.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"a camera is made of numbers, got {values!r:.60}") from None
    array.setflags(write=False)
    return array


def rotation_from_vector(rotation_vector: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrix from a rotation vector (Rodrigues' formula).

    R = 1 + (sin a / a) W + ((1 - cos a) / a^2) W^2 with W = [w]_x and a = |w|.

    Parameters
    ----------
    rotation_vector : array of float, shape (3,)
        Axis times angle, rad; right-handed.

    Returns
    -------
    array of float, shape (3, 3)
        Turns column vectors: x' = R x.

    Examples
    --------
    >>> (rotation_from_vector((0.0, 0.0, np.pi / 2)) @ (1.0, 0.0, 0.0)).round(12) + 0.0
    array([0., 1., 0.])
    """
    w = np.asarray(rotation_vector, dtype=np.float64)
    angle = float(np.linalg.norm(w))
    cross = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    # sinc forms stay exact at angle -> 0 (numpy's sinc carries a pi).
    sine = np.sinc(angle / np.pi)
    versine = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def pose_towards(position_mm: ArrayLike, forward: ArrayLike, up: ArrayLike) -> NDArray[np.float64]:
    """Pose at a place, looking along `forward`, the top of the picture towards `up`.

    Parameters
    ----------
    position_mm : array of float, shape (3,)
        World, mm: the entrance pupil.
    forward : array of float, shape (3,)
        Unit vector, world: where the optical axis points.
    up : array of float, shape (3,)
        World; need not be square to `forward`, but must not lie along it.

    Returns
    -------
    array of float, shape (4, 4)
        world_from_camera, mm; camera axes x right, y down, z forward.
    """
    ahead = np.asarray(forward, dtype=np.float64)
    right = np.cross(ahead, np.asarray(up, dtype=np.float64))
    right = right / np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack((right, np.cross(ahead, right), ahead))
    pose[:3, 3] = position_mm
    return pose


def checked_pose(world_from_camera: ArrayLike) -> NDArray[np.float64]:
    """Rigid pose; one that is rounded is put right.

    Parameters
    ----------
    world_from_camera : array of float, shape (4, 4)
        mm.

    Returns
    -------
    array of float, shape (4, 4)
        The nearest rigid one, read-only.

    Raises
    ------
    ValueError
        Where the shape is another.
    GeometryError
        Where it scales, shears or mirrors, or is not finite.
    """
    pose = read_only(world_from_camera).copy()
    if pose.shape != (4, 4):
        raise ValueError(f"world_from_camera must have shape (4, 4), got {pose.shape}")
    if not np.isfinite(pose).all():
        raise GeometryError("world_from_camera holds NaN or inf: give a rigid 4 x 4 matrix in mm")
    rotation = pose[:3, :3]
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if error > _RIGID_TOLERANCE or tuple(pose[3]) != (0.0, 0.0, 0.0, 1.0):
        raise GeometryError(
            f"world_from_camera is not rigid (off by {error:.2g}): its upper left 3 x 3 must be "
            "a rotation and its last row 0 0 0 1; scale and shear do not belong there"
        )
    if np.linalg.det(rotation) < 0.0:
        raise GeometryError(
            "world_from_camera mirrors the scene (determinant -1): camera axes are x right, "
            "y down, z forward, a right-handed set"
        )
    if error > 1e-14:
        # Nearest rotation, so that a rounded pose does not spoil round trips.
        left, _, right = np.linalg.svd(rotation)
        pose[:3, :3] = left @ right
    pose.setflags(write=False)
    return pose


def pose_covariance_from_stds(
    position_std_mm: ArrayLike = 0.0, rotation_std_deg: ArrayLike = 0.0
) -> NDArray[np.float64] | None:
    """Covariance (6, 6) of a pose from errors of place and rotation; None: exact.

    Parameters
    ----------
    position_std_mm : float or array of float, shape (3,)
        Of the place, one or one per world axis, mm.
    rotation_std_deg : float or array of float, shape (3,)
        Of the rotation about the world axes, one or three, deg.

    Returns
    -------
    array of float, shape (6, 6), or None
        As `Camera.pose_covariance`.

    Raises
    ------
    ValueError
        For an error below zero, or no number.
    """
    must = f"be one number or three, not negative, and at most {_LARGEST_STD:g}"
    place, rotation = (
        finite_numbers(name, told, must, shapes=[(), (3,)], low=0.0, high=_LARGEST_STD)
        for name, told in (
            ("position_std_mm", position_std_mm), ("rotation_std_deg", rotation_std_deg),
        )
    )  # fmt: skip
    # Rotation before place, as `Camera.pose_covariance` has them.
    std = np.concatenate([np.broadcast_to(one, 3) for one in (np.deg2rad(rotation), place)])
    return np.diag(std**2) if std.any() else None


def checked_covariance(covariance: ArrayLike) -> NDArray[np.float64]:
    """Covariance of a pose.

    Parameters
    ----------
    covariance : array of float, shape (6, 6)
        As `Camera.pose_covariance`.

    Returns
    -------
    array of float, shape (6, 6)
        The same, read-only.

    Raises
    ------
    ValueError
        Where the shape is another.
    GeometryError
        Where it is not finite, not symmetric, or has a negative variance.
    """
    c = read_only(covariance)
    if c.shape != (6, 6):
        raise ValueError(f"pose_covariance must have shape (6, 6), got {c.shape}")
    if not np.isfinite(c).all():
        raise GeometryError("pose_covariance holds NaN or inf: pass None for an exact pose")
    scale = np.sqrt(np.abs(np.diag(c)))
    if not np.allclose(c, c.T, rtol=0.0, atol=1e-9 * float(np.max(scale, initial=0.0)) ** 2):
        raise GeometryError("pose_covariance is not symmetric: check its order of rows")
    if np.linalg.eigvalsh(c).min() < -1e-9 * float(np.max(scale, initial=0.0)) ** 2:
        raise GeometryError("pose_covariance has a negative variance: it is not a covariance")
    return c
