"""The camera: which ray each pixel looks along, and which pixel sees a point.

Takes world points (mm) or pixels (row, col), gives the other through a pinhole with OpenCV's
distortion model. OpenCV's signs (u = col, v = row, y down, z forward) live in this module and
nowhere else: outside it the world is right-handed, y up, and pixels are (row, col) with the
centre of the first pixel at (0, 0). Fitting a camera to measured points is
`camera_calibration.py`.

The camera is a point: its centre A is the entrance pupil, where arrival times are taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.errors import GeometryError

_DISTORTION_SIZES = (0, 4, 5, 8, 12, 14)
_NEWTON_STEPS = 60
_NEWTON_TOLERANCE = 4e-16
# Rigid to this much: poses arrive as text with six or seven digits.
_RIGID_TOLERANCE = 1e-5


def rotation_from_vector(rotation_vector: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrix (3, 3) from a rotation vector (3,), rad (Rodrigues' formula)."""
    w = np.asarray(rotation_vector, dtype=np.float64)
    angle = float(np.linalg.norm(w))
    cross = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    # sinc forms stay exact at angle -> 0 (numpy's sinc carries a pi).
    sine = np.sinc(angle / np.pi)
    versine = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def pose_towards(position_mm: ArrayLike, forward: ArrayLike, up: ArrayLike) -> NDArray[np.float64]:
    """Pose (4, 4) at a place, looking along the unit vector `forward`, the picture's top `up`.

    `up` (3,) need not be square to `forward`, but must not lie along it.
    """
    ahead = np.asarray(forward, dtype=np.float64)
    right = np.cross(ahead, np.asarray(up, dtype=np.float64))
    right = right / np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack((right, np.cross(ahead, right), ahead))
    pose[:3, 3] = position_mm
    return pose


def _read_only(values: ArrayLike) -> NDArray[np.float64]:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _checked_matrix(matrix: ArrayLike) -> NDArray[np.float64]:
    k = _read_only(matrix)
    if k.shape != (3, 3):
        raise ValueError(f"matrix must have shape (3, 3), got {k.shape}: give OpenCV's K in px")
    if not np.isfinite(k).all():
        raise GeometryError("matrix holds NaN or inf: give finite focal lengths and centre in px")
    if k[1, 0] != 0.0 or tuple(k[2]) != (0.0, 0.0, 1.0):
        raise GeometryError(
            f"matrix must be [[fx, s, cx], [0, fy, cy], [0, 0, 1]], got {k.tolist()}: "
            "check that it is K and not its transpose or inverse"
        )
    if k[0, 0] <= 0.0 or k[1, 1] <= 0.0:
        raise GeometryError(
            f"focal lengths must be positive, got fx = {k[0, 0]:g}, fy = {k[1, 1]:g} px: "
            "flip the picture's axes in the recording, not in the camera"
        )
    return k


def _checked_pose(world_from_camera: ArrayLike) -> NDArray[np.float64]:
    pose = np.array(world_from_camera, dtype=np.float64)
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


def _checked_distortion(distortion: ArrayLike) -> NDArray[np.float64]:
    k = _read_only(np.ravel(np.asarray(distortion, dtype=np.float64)))
    if k.size not in _DISTORTION_SIZES:
        raise ValueError(
            f"distortion must have 0, 4, 5, 8, 12 or 14 numbers in OpenCV's order, got {k.size}"
        )
    if not np.isfinite(k).all():
        raise GeometryError("distortion holds NaN or inf: pass () for a lens without distortion")
    return k


def _tilt_matrix(tilt_x: float, tilt_y: float) -> NDArray[np.float64]:
    """Homography (3, 3) of a tilted sensor, OpenCV's tau_x, tau_y in rad."""
    cx, sx, cy, sy = np.cos(tilt_x), np.sin(tilt_x), np.cos(tilt_y), np.sin(tilt_y)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]])
    about_y = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
    r = about_y @ about_x
    onto_sensor = np.array([[r[2, 2], 0.0, -r[0, 2]], [0.0, r[2, 2], -r[1, 2]], [0.0, 0.0, 1.0]])
    return np.asarray(onto_sensor @ r)


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera: pinhole, OpenCV distortion, pose.

    Raises ValueError for wrong shapes and GeometryError for a matrix that is not a camera
    matrix, a pose that is not rigid, or one that mirrors.
    """

    matrix: NDArray[np.float64]
    """(3, 3), px; OpenCV's K: u = fx x + s y + cx is the column, v = fy y + cy the row."""

    distortion: NDArray[np.float64]
    """(0 | 4 | 5 | 8 | 12 | 14,), OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y."""

    world_from_camera: NDArray[np.float64]
    """(4, 4), mm, rigid; camera axes x right, y down, z forward; last column: the centre A."""

    shape: tuple[int, int]
    """(rows, cols) of the pixel array."""

    pose_covariance: NDArray[np.float64] | None = None
    """(6, 6), rad and mm: small rotation vector (world axes, about the centre), then shift of
    the centre (world axes). None: the pose is taken as exact."""

    intrinsics_per_pose: NDArray[np.float64] | None = None
    """(4 + n_distortion, 6), px and coefficients per rad and mm: how fx, fy, cx, cy and the
    distortion go along with an error of the pose where one fit gave both (a camera that stands
    farther away has the longer lens). None: they do not."""

    def __post_init__(self) -> None:
        shape = tuple(int(n) for n in self.shape)
        if len(shape) != 2 or min(shape) < 1:
            raise ValueError(f"shape must be (rows, cols), both at least 1, got {self.shape}")
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "matrix", _checked_matrix(self.matrix))
        object.__setattr__(self, "distortion", _checked_distortion(self.distortion))
        object.__setattr__(self, "world_from_camera", _checked_pose(self.world_from_camera))
        if self.pose_covariance is not None:
            object.__setattr__(self, "pose_covariance", _checked_covariance(self.pose_covariance))
        if self.intrinsics_per_pose is not None:
            slopes = _read_only(self.intrinsics_per_pose)
            if slopes.shape != (4 + self.distortion.size, 6) or not np.isfinite(slopes).all():
                raise ValueError(
                    f"intrinsics_per_pose must be finite with shape ({4 + self.distortion.size}, "
                    f"6), got {slopes.shape}: one row for fx, fy, cx, cy and each distortion term"
                )
            object.__setattr__(self, "intrinsics_per_pose", slopes)

    @classmethod
    def facing_plane(
        cls,
        shape: tuple[int, int] = (32, 32),
        *,
        distance_mm: float = 535.0,
        field_of_view_mm: tuple[float, float] = (245.0, 245.0),
        center_mm: tuple[float, float] = (0.0, 0.0),
    ) -> Camera:
        """Camera that looks straight at the plane z = 0, as in the paper (Fig. 2).

        Parameters
        ----------
        shape : (rows, cols)
        distance_mm : entrance pupil to the plane, mm
        field_of_view_mm : (width, height) between the outer pixel edges on z = 0, mm
        center_mm : (x, y) below which the pupil stands, mm

        Returns
        -------
        Camera
            Centre A = (cx, cy, distance); columns grow with +x, rows with -y.
        """
        rows, cols = int(shape[0]), int(shape[1])
        width, height = (float(v) for v in field_of_view_mm)
        for name, value in (
            ("distance_mm", float(distance_mm)),
            ("field_of_view_mm", width),
            ("field_of_view_mm", height),
        ):
            if not (np.isfinite(value) and value > 0.0):
                raise GeometryError(f"{name} must be positive and finite, got {value}")
        matrix = [
            [cols * distance_mm / width, 0.0, (cols - 1) / 2.0],
            [0.0, rows * distance_mm / height, (rows - 1) / 2.0],
            [0.0, 0.0, 1.0],
        ]
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = (*center_mm, distance_mm)
        return cls(np.array(matrix), np.empty(0), pose, (rows, cols))

    @classmethod
    def looking_at(
        cls,
        target_mm: ArrayLike,
        *,
        position_mm: ArrayLike,
        focal_length_px: float,
        shape: tuple[int, int] = (32, 32),
    ) -> Camera:
        """Camera anywhere, turned towards a point and held upright (world y up), without lens.

        Parameters
        ----------
        target_mm : (3,), world, mm: what its middle looks at.
        position_mm : (3,), world, mm: its entrance pupil.
        focal_length_px : pixels per unit of tan(angle), both ways.
        shape : (rows, cols)

        Raises
        ------
        GeometryError
            Where position and target are one point, or a number is not finite.
        """
        rows, cols = int(shape[0]), int(shape[1])
        position, target = np.asarray(position_mm, float), np.asarray(target_mm, float)
        forward = target - position
        distance = float(np.linalg.norm(forward))
        if position.shape != (3,) or not (np.isfinite(distance) and distance > 0):
            raise GeometryError(
                f"position_mm {position} and target_mm {target} must be two different points (3,)"
            )
        if not (np.isfinite(focal_length_px) and focal_length_px > 0):
            raise GeometryError(
                f"focal_length_px must be positive and finite, got {focal_length_px}"
            )
        forward = forward / distance
        up = np.array([0.0, 1.0, 0.0])
        if abs(forward[1]) > 1 - 1e-9:  # straight up or down: the top of the picture is -z
            up = np.array([0.0, 0.0, -1.0])
        pose = pose_towards(position, forward, up)
        matrix = np.diag([focal_length_px, focal_length_px, 1.0])
        matrix[:2, 2] = (cols - 1) / 2.0, (rows - 1) / 2.0
        return cls(matrix, np.empty(0), pose, (rows, cols))

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from lightflight.display import html_from_record

        return html_from_record(self)

    @property
    def center_mm(self) -> NDArray[np.float64]:
        """(3,), mm, world: the entrance pupil A."""
        return np.asarray(self.world_from_camera[:3, 3])

    @property
    def backward_axis(self) -> NDArray[np.float64]:
        """(3,), unit, world: n, from the scene towards the camera along the optical axis."""
        return np.asarray(-self.world_from_camera[:3, 2])

    # ---- world -> pixel -------------------------------------------------------------------

    def normalized_from_points(
        self, points_mm: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Undistorted image plane (x right, y down, at unit depth) from world points (..., 3), mm.

        NaN for points on or behind the plane of the pupil.
        """
        x, y, z = np.moveaxis(self._camera_points(points_mm), -1, 0)
        depth = np.where(z > 0.0, z, np.nan)
        return x / depth, y / depth

    def pixels_from_normalized(
        self, x: ArrayLike, y: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(row, col) from the undistorted image plane (x right, y down).

        NaN beyond the radius where the distortion polynomial folds back on itself: a real lens
        does not send light from there into the picture.
        """
        xd, yd = self._distorted(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        k = self.matrix
        return k[1, 1] * yd + k[1, 2], k[0, 0] * xd + k[0, 1] * yd + k[0, 2]

    def pixels_from_points(
        self, points_mm: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(row, col), fractional, that see world points (..., 3), mm; NaN behind the camera.

        The pixel may lie outside the picture: ask `sees`.
        """
        return self.pixels_from_normalized(*self.normalized_from_points(points_mm))

    def sees(self, points_mm: ArrayLike) -> NDArray[np.bool_]:
        """True for world points (..., 3), mm, in front and inside the outer pixel edges."""
        row, col = self.pixels_from_points(points_mm)
        rows, cols = self.shape
        return np.asarray((row >= -0.5) & (row <= rows - 0.5) & (col >= -0.5) & (col <= cols - 0.5))

    def pixel_jacobian(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """(..., 2, 3), px/mm: derivative of (row, col) by the world point, distortion included."""
        points = self._camera_points(points_mm)
        z = np.where(points[..., 2:] > 0.0, points[..., 2:], np.nan)
        x, y = points[..., :1] / z, points[..., 1:2] / z
        right, down, forward = self.world_from_camera[:3, :3].T
        # How the place in the image plane moves, (..., 3), and how the lens bends that, (..., 2).
        x_by_point, y_by_point = (right - x * forward) / z, (down - y * forward) / z
        x_by_plane, y_by_plane = np.moveaxis(self._distortion_jacobian(x[..., 0], y[..., 0]), -2, 0)
        k = self.matrix
        row_by_plane = k[1, 1] * y_by_plane
        col_by_plane = k[0, 0] * x_by_plane + k[0, 1] * y_by_plane
        return np.stack(
            [
                by_plane[..., :1] * x_by_point + by_plane[..., 1:] * y_by_point
                for by_plane in (row_by_plane, col_by_plane)
            ],
            axis=-2,
        )

    # ---- pixel -> world -------------------------------------------------------------------

    def normalized_from_pixels(
        self, row: ArrayLike, col: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Undistorted image plane (x right, y down) from pixels, fractional or outside allowed.

        The distortion is inverted by Newton steps to machine precision. NaN pixels give NaN.

        Raises
        ------
        GeometryError
            Where no undistorted point exists (the distortion folds before it gets there);
            `offenders` marks the pixels.
        """
        row_, col_ = np.broadcast_arrays(
            np.asarray(row, dtype=np.float64), np.asarray(col, dtype=np.float64)
        )
        k = self.matrix
        yd = (row_ - k[1, 2]) / k[1, 1]
        xd = (col_ - k[0, 2] - k[0, 1] * yd) / k[0, 0]
        if not self._has_distortion:
            return xd, yd
        if self._tilt is not None:
            back = np.linalg.inv(self._tilt)
            w = back[2, 0] * xd + back[2, 1] * yd + back[2, 2]
            xd, yd = (
                (back[0, 0] * xd + back[0, 1] * yd + back[0, 2]) / w,
                (back[1, 0] * xd + back[1, 1] * yd + back[1, 2]) / w,
            )
        x, y, lost = self._undistorted(xd, yd)
        if lost.any():
            first = tuple(int(i) for i in np.argwhere(lost)[0])
            raise GeometryError(
                f"the distortion cannot be undone at {int(lost.sum())} pixels, the first at "
                f"(row, col) = ({row_[first]:g}, {col_[first]:g}): its polynomial folds back "
                "before it gets there; calibrate with points out to the corners",
                offenders=lost,
            )
        return x, y

    def rays_from_pixels(self, row: ArrayLike, col: ArrayLike) -> NDArray[np.float64]:
        """Unit rays (..., 3), world, from the centre A outwards, of pixels (row, col).

        Raises GeometryError as `normalized_from_pixels` does.
        """
        x, y = self.normalized_from_pixels(row, col)
        ray = np.stack([x, y, np.where(np.isnan(x), np.nan, 1.0)], axis=-1)
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        return np.asarray(ray @ self.world_from_camera[:3, :3].T)

    # ---- pose and storage -----------------------------------------------------------------

    def perturbed(self, pose_delta: ArrayLike) -> Camera:
        """Camera turned and shifted by (6,): rotation vector (rad, world axes, about the
        centre), then shift of the centre (mm, world axes); the order of `pose_covariance`.

        Lens terms that were fitted together with the pose go along (`intrinsics_per_pose`).
        """
        delta = np.asarray(pose_delta, dtype=np.float64)
        if delta.shape != (6,):
            raise ValueError(f"pose_delta must have shape (6,), got {delta.shape}")
        pose = self.world_from_camera.copy()
        pose[:3, :3] = rotation_from_vector(delta[:3]) @ pose[:3, :3]
        pose[:3, 3] += delta[3:]
        if self.intrinsics_per_pose is None:
            return replace(self, world_from_camera=pose)
        change = self.intrinsics_per_pose @ delta
        matrix = self.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += change[:4]
        return replace(
            self,
            matrix=matrix,
            distortion=self.distortion + change[4:],
            world_from_camera=pose,
        )

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """The camera as a flat dictionary of arrays, for a file."""
        arrays: dict[str, NDArray[Any]] = {
            "matrix": np.array(self.matrix),
            "distortion": np.array(self.distortion),
            "world_from_camera": np.array(self.world_from_camera),
            "shape": np.array(self.shape, dtype=np.int64),
        }
        for name in ("pose_covariance", "intrinsics_per_pose"):
            if getattr(self, name) is not None:
                arrays[name] = np.array(getattr(self, name))
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ArrayLike]) -> Camera:
        """The camera from what `to_arrays` gave; ValueError names a missing array."""
        needed = ("matrix", "distortion", "world_from_camera", "shape")
        missing = [name for name in needed if name not in arrays]
        if missing:
            raise ValueError(f"a stored camera lacks {', '.join(missing)}")
        rows, cols = (int(n) for n in np.asarray(arrays["shape"]).ravel())
        matrix, distortion, pose = (np.asarray(arrays[name], float) for name in needed[:3])
        errors = {
            name: np.asarray(arrays[name], dtype=np.float64)
            for name in ("pose_covariance", "intrinsics_per_pose")
            if name in arrays
        }
        return cls(matrix, distortion, pose, (rows, cols), **errors)

    # ---- lens -----------------------------------------------------------------------------

    def _camera_points(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        points = np.asarray(points_mm, dtype=np.float64)
        if points.ndim == 0 or points.shape[-1] != 3:
            raise ValueError(f"points_mm must have shape (..., 3), got {points.shape}")
        return np.asarray((points - self.center_mm) @ self.world_from_camera[:3, :3])

    @cached_property
    def _has_distortion(self) -> bool:
        return bool(np.any(self.distortion != 0.0))

    @cached_property
    def _coefficients(self) -> tuple[float, ...]:
        """k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4, zeros where the lens has fewer."""
        padded = np.zeros(14)
        padded[: self.distortion.size] = self.distortion
        return tuple(float(v) for v in padded[:12])

    @cached_property
    def _tilt(self) -> NDArray[np.float64] | None:
        if self.distortion.size < 14 or not np.any(self.distortion[12:]):
            return None
        return _tilt_matrix(float(self.distortion[12]), float(self.distortion[13]))

    @cached_property
    def _fold_radius2(self) -> float:
        """Square of the undistorted radius where the radial polynomial stops growing."""
        k1, k2, _, _, k3, k4, k5, k6, *_ = self._coefficients
        above, below = np.array([k3, k2, k1, 1.0]), np.array([k6, k5, k4, 1.0])
        # With q = r^2 the radius is r N/D and its derivative (N D + 2 q (N' D - N D')) / D^2.
        slope = np.convolve(np.polyder(above), below) - np.convolve(above, np.polyder(below))
        turn = np.convolve(above, below) + np.append(2.0 * slope, 0.0)
        roots = [complex(root) for root in (*np.roots(turn), *np.roots(below))]
        real = [z.real for z in roots if abs(z.imag) < 1e-9 * (1.0 + abs(z)) and z.real > 0.0]
        return min(real, default=np.inf)

    def _lens(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """OpenCV's radial, tangential and thin-prism terms, without the sensor tilt."""
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self._coefficients
        q = x * x + y * y
        gain = (1.0 + q * (k1 + q * (k2 + q * k3))) / (1.0 + q * (k4 + q * (k5 + q * k6)))
        xd = x * gain + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x) + q * (s1 + q * s2)
        yd = y * gain + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y + q * (s3 + q * s4)
        return xd, yd

    def _lens_jacobian(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], ...]:
        """Derivatives (xd by x, xd by y, yd by x, yd by y) of `_lens`."""
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self._coefficients
        q = x * x + y * y
        above = 1.0 + q * (k1 + q * (k2 + q * k3))
        below = 1.0 + q * (k4 + q * (k5 + q * k6))
        gain = above / below
        slope = (
            k1 + q * (2.0 * k2 + q * 3.0 * k3) - gain * (k4 + q * (2.0 * k5 + q * 3.0 * k6))
        ) / below
        prism_x, prism_y = 2.0 * (s1 + 2.0 * q * s2), 2.0 * (s3 + 2.0 * q * s4)
        cross = 2.0 * slope * x * y
        xx = gain + 2.0 * slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x
        xy = cross + 2.0 * p1 * x + 2.0 * p2 * y + prism_x * y
        yx = cross + 2.0 * p1 * x + 2.0 * p2 * y + prism_y * x
        yy = gain + 2.0 * slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y
        return xx, xy, yx, yy

    def _distorted(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if not self._has_distortion:
            return x, y
        inside = x * x + y * y < self._fold_radius2
        xd, yd = self._lens(np.where(inside, x, np.nan), np.where(inside, y, np.nan))
        if self._tilt is None:
            return xd, yd
        t = self._tilt
        w = t[2, 0] * xd + t[2, 1] * yd + t[2, 2]
        return (
            (t[0, 0] * xd + t[0, 1] * yd + t[0, 2]) / w,
            (t[1, 0] * xd + t[1, 1] * yd + t[1, 2]) / w,
        )

    def _distortion_jacobian(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(..., 2, 2): derivative of the distorted (x, y) by the undistorted one."""
        if not self._has_distortion:
            return np.broadcast_to(np.eye(2), (*np.shape(x), 2, 2))
        inside = x * x + y * y < self._fold_radius2
        x, y = np.where(inside, x, np.nan), np.where(inside, y, np.nan)
        lens = np.stack(self._lens_jacobian(x, y), axis=-1).reshape(*np.shape(x), 2, 2)
        if self._tilt is None:
            return lens
        t = self._tilt
        lensed = np.stack([*self._lens(x, y), np.ones_like(x)], axis=-1) @ t.T
        w = lensed[..., 2, None, None]
        tilt = (t[:2, :2] - lensed[..., :2, None] * (t[2, :2] / w)) / w
        return np.asarray(tilt @ lens)

    def _undistorted(
        self, xd: NDArray[np.float64], yd: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Inverse of `_lens` by Newton steps: (x, y, where it failed).

        From the distorted point Newton is monotone for a radial polynomial of one curvature;
        the step is halved where the residual does not shrink, for the others.
        """
        x, y = np.array(xd), np.array(yd)
        ex, ey = self._residual(x, y, xd, yd)
        scale = 1.0 + np.hypot(xd, yd)
        for _ in range(_NEWTON_STEPS):
            error = np.hypot(ex, ey)
            if not (error > _NEWTON_TOLERANCE * scale).any():
                break
            xx, xy, yx, yy = self._lens_jacobian(x, y)
            with np.errstate(divide="ignore", invalid="ignore"):
                determinant = xx * yy - xy * yx
                step_x = (yy * ex - xy * ey) / determinant
                step_y = (xx * ey - yx * ex) / determinant
            share = np.ones_like(x)
            for _ in range(30):
                fx, fy = self._residual(x - share * step_x, y - share * step_y, xd, yd)
                worse = ~(np.hypot(fx, fy) < error)
                if not worse.any():
                    break
                share = np.where(worse, 0.5 * share, share)
            share = np.where(worse, 0.0, share)
            if not share.any():
                break
            x, y = np.where(worse, x, x - share * step_x), np.where(worse, y, y - share * step_y)
            ex, ey = np.where(worse, ex, fx), np.where(worse, ey, fy)
        # 1e-13 and not the tolerance: the last bits of the residual are rounding.
        lost = ~(np.hypot(ex, ey) <= 1e-13 * scale) | ~(x * x + y * y < self._fold_radius2)
        return x, y, np.asarray(lost & ~np.isnan(xd) & ~np.isnan(yd))

    def _residual(
        self,
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        xd: NDArray[np.float64],
        yd: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        fx, fy = self._lens(x, y)
        return fx - xd, fy - yd


def _checked_covariance(covariance: ArrayLike) -> NDArray[np.float64]:
    c = _read_only(covariance)
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
