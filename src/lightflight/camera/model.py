"""The camera: which ray each pixel looks along, and which pixel sees a point.

Takes world points (mm) or pixels (row, col), gives the other through a pinhole with OpenCV's
distortion model (`lens`). OpenCV's signs (u = col, v = row, y down, z forward) live in `projection`
and `lens` and nowhere else: outside them the world is right-handed, y up, and pixels are (row, col)
with the centre of the first pixel at (0, 0). Fitting a camera to measured points is `calibration`.
What it looks through, windows and walls of tanks, bends its rays once, here (`refraction`).

The camera is a point: its centre A is the entrance pupil, where arrival times are taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import finite_number, finite_numbers, pixels_of_shape
from lightflight.camera.lens import checked_distortion
from lightflight.camera.projection import Projection
from lightflight.camera.refraction import (
    Interface,
    checked_interfaces,
    moved_rigidly,
)
from lightflight.camera.rigid import (
    checked_covariance,
    checked_pose,
    pose_covariance_from_stds,
    pose_towards,
    read_only,
    rotation_from_vector,
)
from lightflight.camera.stored import (
    CLOCK_FIELDS as CLOCK_FIELDS,
    LENS_ERRORS as LENS_ERRORS,
    arrays_of_camera,
    fields_of_arrays,
)
from lightflight.display import Card, Shown, number, size_facts
from lightflight.errors import GeometryError
from lightflight.materials import AIR, Material

_NEAREST_MM, _FARTHEST_MM = 1e-9, 1e9
"""Lengths beyond these are no camera's, and overflow where they are squared."""


def _checked_matrix(matrix: ArrayLike) -> NDArray[np.float64]:
    """K (3, 3) of OpenCV, px; raises where it is none."""
    k = read_only(matrix)
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


@dataclass(frozen=True, eq=False, repr=False)
class Camera(Projection, Shown):
    """A calibrated camera: pinhole, OpenCV distortion, pose.

    Raises ValueError for wrong shapes and GeometryError for a matrix that is not a camera
    matrix, a pose that is not rigid, or one that mirrors.

    Attributes
    ----------
    matrix : array of float, shape (3, 3)
        px; OpenCV's K: u = fx x + s y + cx is the column, v = fy y + cy the row.
    distortion : array of float, shape (0 | 4 | 5 | 8 | 12 | 14,)
        OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y.
    world_from_camera : array of float, shape (4, 4)
        mm, rigid; camera axes x right, y down, z forward; last column: the centre A.
    shape : (int, int)
        (rows, cols) of the pixel array.
    pose_covariance : array of float, shape (6, 6), or None
        rad and mm: small rotation vector (world axes, about the centre), then shift of the
        centre (world axes). None: the pose is taken as exact.
    intrinsics_per_pose : array of float, shape (4 + n_distortion, 6), or None
        px and coefficients per rad and mm: how fx, fy, cx, cy and the
        distortion go along with an error of the pose where one fit gave both (a camera that stands
        farther away has the longer lens). None: they do not.
    focal_std_fraction : float
        One-sigma error of the focal length, both axes together, as a share of it. 0: exact.
    aspect_std : float
        One-sigma error of fy / fx, as a share: pixels that are not square. 0: exact.
    axis_std_px : float
        One-sigma error of cx and cy, where the optical axis meets the picture, px. 0: exact.
    distortion_std : float
        One-sigma error of the radial distortion k1. 0: exact.
    decentering_std : float
        One-sigma error of p1 and p2: a lens that sits askew or aside. 0: exact.
    interfaces : tuple of Interface
        Planes that it looks through, from the camera to the scene (`window` makes the two of a
        pane); an error of the pose is one of camera and interfaces together.
    stands_in : Material
        What it stands in, before the first interface.
    clock_offset_ps : float
        How much later than all others its clock tells the same instant, ps: a longer cable from the
        trigger; of several cameras before one flight, against the first one's.
    clock_offset_std_ps : float
        One-sigma error of that, ps; inf: nothing is known of it. 0: exact.
    """

    matrix: NDArray[np.float64]

    distortion: NDArray[np.float64]

    world_from_camera: NDArray[np.float64]

    shape: tuple[int, int]

    pose_covariance: NDArray[np.float64] | None = None

    intrinsics_per_pose: NDArray[np.float64] | None = None

    focal_std_fraction: float = field(default=0.0, kw_only=True)

    aspect_std: float = field(default=0.0, kw_only=True)

    axis_std_px: float = field(default=0.0, kw_only=True)

    distortion_std: float = field(default=0.0, kw_only=True)

    decentering_std: float = field(default=0.0, kw_only=True)

    interfaces: tuple[Interface, ...] = field(default=(), kw_only=True)

    stands_in: Material = field(default=AIR, kw_only=True)

    clock_offset_ps: float = field(default=0.0, kw_only=True)

    clock_offset_std_ps: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", pixels_of_shape(self.shape))
        object.__setattr__(self, "matrix", _checked_matrix(self.matrix))
        object.__setattr__(self, "distortion", checked_distortion(self.distortion))
        object.__setattr__(self, "world_from_camera", checked_pose(self.world_from_camera))
        if self.pose_covariance is not None:
            object.__setattr__(self, "pose_covariance", checked_covariance(self.pose_covariance))
        if self.intrinsics_per_pose is not None:
            slopes = read_only(self.intrinsics_per_pose)
            if slopes.shape != (4 + self.distortion.size, 6) or not np.isfinite(slopes).all():
                raise ValueError(
                    f"intrinsics_per_pose must be finite with shape ({4 + self.distortion.size}, "
                    f"6), got {slopes.shape}: one row for fx, fy, cx, cy and each distortion term"
                )
            object.__setattr__(self, "intrinsics_per_pose", slopes)
        for name in LENS_ERRORS:
            std = finite_number(name, getattr(self, name), "be finite and >= 0", low=0.0)
            object.__setattr__(self, name, std)
        offset = finite_number("clock_offset_ps", self.clock_offset_ps)
        object.__setattr__(self, "clock_offset_ps", offset)
        if self.clock_offset_std_ps != np.inf:
            name, must = "clock_offset_std_ps", "be >= 0, inf where nothing is known of it"
            std = finite_number(name, self.clock_offset_std_ps, must, low=0.0)
            object.__setattr__(self, name, std)
        if not isinstance(self.stands_in, Material):
            raise ValueError("stands_in must be a Material: Material(phase_index, group_index)")
        faces = checked_interfaces(self.interfaces, self.center_mm, -self.backward_axis)
        object.__setattr__(self, "interfaces", faces)

    @classmethod
    def facing_plane(
        cls,
        shape: tuple[int, int] = (32, 32),
        *,
        distance_mm: float = 535.0,
        field_of_view_mm: tuple[float, float] = (245.0, 245.0),
        center_mm: tuple[float, float] = (0.0, 0.0),
        position_std_mm: ArrayLike = 0.0,
        rotation_std_deg: ArrayLike = 0.0,
        field_of_view_std_mm: float = 0.0,
        distortion_std: float = 0.0,
    ) -> Camera:
        """Camera that looks straight at the plane z = 0, as in the paper (Fig. 2).

        Parameters
        ----------
        shape : (int, int)
            (rows, cols) of the pixel array.
        distance_mm : float
            Entrance pupil to the plane, mm.
        field_of_view_mm : (float, float)
            (width, height) between the outer pixel edges on z = 0, mm.
        center_mm : (float, float)
            (x, y) below which the pupil stands, world, mm.
        position_std_mm : float or array of float, shape (3,)
            One-sigma error of the pupil's place, one or one per world axis, mm. 0: exact.
        rotation_std_deg : float or array of float, shape (3,)
            One-sigma error of the rotation about the world axes, one or three, deg. 0: exact.
        field_of_view_std_mm : float
            One-sigma error of the width that the picture covers at that distance, mm; the height
            goes along. Told with the place kept: it is an error of the focal length. 0: exact.
        distortion_std : float
            One-sigma error of the radial distortion k1. 0: exact.

        Returns
        -------
        Camera
            Centre A = (cx, cy, distance); columns grow with +x, rows with -y.

        Raises
        ------
        GeometryError
            For a length that is not positive and finite.

        Examples
        --------
        >>> camera = Camera.facing_plane((32, 32), distance_mm=535.0)
        >>> camera.center_mm.tolist()
        [0.0, 0.0, 535.0]
        >>> row, col = camera.pixels_from_points((0.0, 0.0, 0.0))
        >>> float(row), float(col)
        (15.5, 15.5)
        """
        rows, cols = pixels_of_shape(shape)
        try:
            must = "be positive and at most 1e9"
            finite_number("distance_mm", distance_mm, must, low=_NEAREST_MM, high=_FARTHEST_MM)
            name, must = "field_of_view_mm", "be positive and at most 1e9, width and height"
            width, height = finite_numbers(
                name, field_of_view_mm, must, shapes=[(2,)], low=_NEAREST_MM, high=_FARTHEST_MM
            ).tolist()
        except ValueError as error:
            raise GeometryError(str(error)) from None
        must = "be finite and >= 0"
        spread = finite_number("field_of_view_std_mm", field_of_view_std_mm, must, low=0.0)
        center = finite_numbers("center_mm", center_mm, "be (x, y) in mm", shapes=[(2,)])
        matrix = [
            [cols * distance_mm / width, 0.0, (cols - 1) / 2.0],
            [0.0, rows * distance_mm / height, (rows - 1) / 2.0],
            [0.0, 0.0, 1.0],
        ]
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = (*center, distance_mm)
        return cls(
            np.array(matrix), np.empty(0), pose, (rows, cols),
            pose_covariance_from_stds(position_std_mm, rotation_std_deg),
            focal_std_fraction=spread / width, distortion_std=distortion_std,
        )  # fmt: skip

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
        target_mm : array of float, shape (3,)
            World, mm: what its middle looks at.
        position_mm : array of float, shape (3,)
            World, mm: its entrance pupil.
        focal_length_px : float
            Pixels per unit of tan(angle), both ways.
        shape : (int, int)
            (rows, cols) of the pixel array.

        Returns
        -------
        Camera
            Looking straight up or down, the top of its picture is -z.

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

    def _card(self) -> Card:
        x, y, z = self.center_mm
        pose = "taken as exact"
        if self.pose_covariance is not None:
            std = np.sqrt(np.diag(self.pose_covariance))[3:]
            pose = f"{', '.join(number(s, 2) for s in std)} mm"
        facts = [
            *size_facts(self.shape),
            ("entrance pupil", f"({number(x, 5)}, {number(y, 5)}, {number(z, 5)}) mm"),
            ("looks along", f"({', '.join(number(-a, 3) for a in self.backward_axis)})"),
            ("focal length", f"{number(self.matrix[0, 0], 5)} px"),
            ("lens", "with distortion" if np.any(self.distortion) else "without distortion"),
            ("pose" if self.pose_covariance is None else "pose known to", pose),
        ]
        if self.interfaces:
            through = (self.stands_in, *(face.beyond for face in self.interfaces))
            said = " | ".join(one.name or f"n = {number(one.phase_index, 5)}" for one in through)
            facts.append(("looks through", said))
        if self.clock_offset_ps or self.clock_offset_std_ps:
            offset = f"{number(self.clock_offset_ps, 5)} ± {number(self.clock_offset_std_ps, 2)} ps"
            facts.append(("clock is late by", offset))
        return Card("Camera", facts)

    # ---- pose and storage -----------------------------------------------------------------

    def perturbed(self, pose_delta: ArrayLike) -> Camera:
        """Camera turned and shifted a little.

        Parameters
        ----------
        pose_delta : array of float, shape (6,)
            Rotation vector (rad, world axes, about the centre), then shift of the centre (mm, world
            axes): the order of `pose_covariance`.

        Returns
        -------
        Camera
            Lens terms that were fitted together with the pose go along (`intrinsics_per_pose`), and
            so do the interfaces.

        Raises
        ------
        ValueError
            For another shape.
        """
        delta = np.asarray(pose_delta, dtype=np.float64)
        if delta.shape != (6,):
            raise ValueError(f"pose_delta must have shape (6,), got {delta.shape}")
        pose = self.world_from_camera.copy()
        turn = rotation_from_vector(delta[:3])
        pose[:3, :3] = turn @ pose[:3, :3]
        pose[:3, 3] += delta[3:]
        faces = moved_rigidly(self.interfaces, turn, self.center_mm, delta[3:])
        if self.intrinsics_per_pose is None:
            return self._at(pose, faces)
        change = self.intrinsics_per_pose @ delta
        matrix = self.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += change[:4]
        return replace(
            self,
            matrix=matrix,
            distortion=self.distortion + change[4:],
            world_from_camera=pose,
            interfaces=faces,
        )

    def _at(self, pose: NDArray[np.float64], faces: tuple[Interface, ...]) -> Camera:
        """The camera elsewhere: fits ask often, and what stays was checked when it was made."""
        there = copy(self)
        object.__setattr__(there, "world_from_camera", checked_pose(pose))
        faces = checked_interfaces(faces, there.center_mm, -there.backward_axis)
        object.__setattr__(there, "interfaces", faces)
        return there

    def with_lens_moved(
        self,
        *,
        focal_share: float = 0.0,
        aspect: float = 0.0,
        axis_px: tuple[float, float] = (0.0, 0.0),
        radial: float = 0.0,
        decentering: tuple[float, float] = (0.0, 0.0),
    ) -> Camera:
        """Camera with another lens before the same array.

        Parameters
        ----------
        focal_share : float, optional
            By which share fx and fy are longer.
        aspect : float, optional
            By which share fy is longer, beyond that.
        axis_px : (float, float), optional
            Added to (cx, cy), px.
        radial : float, optional
            Added to k1.
        decentering : (float, float), optional
            Added to (p1, p2).

        Returns
        -------
        Camera
            The same pose and stated errors.
        """
        if not (focal_share or aspect or any(axis_px) or radial or any(decentering)):
            return self
        matrix = self.matrix.copy()
        matrix[:2, :2] *= 1.0 + focal_share
        matrix[1, :2] *= 1.0 + aspect
        matrix[:2, 2] += axis_px
        if not (radial or any(decentering)):
            return replace(self, matrix=matrix)
        slopes = self.intrinsics_per_pose
        missing = max(0, 4 - self.distortion.size)
        distortion = np.append(self.distortion, np.zeros(missing))
        distortion[0] += radial
        distortion[2:4] += decentering
        if slopes is not None:
            slopes = np.vstack((slopes, np.zeros((missing, 6))))
        return replace(self, matrix=matrix, distortion=distortion, intrinsics_per_pose=slopes)

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """The camera as a flat dictionary of arrays, for a file."""
        return arrays_of_camera(self)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ArrayLike]) -> Camera:
        """The camera from what `to_arrays` gave.

        Parameters
        ----------
        arrays : mapping of str to array
            Others than the camera's are passed over.

        Returns
        -------
        Camera
            Equal to the one that was kept.

        Raises
        ------
        ValueError
            Naming a missing array.
        """
        return cls(**fields_of_arrays(arrays))  # type: ignore[arg-type]
