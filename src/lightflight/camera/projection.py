"""How a camera sees: world points to pixels, pixels to rays, and the way of the light.

The part of `model.Camera` that has no say in how it is told or kept: OpenCV's signs (u = col,
v = row, y down, z forward) live here and in `lens`, and nowhere else.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.camera.lens import Lens
from lightflight.camera.refraction import Interface, rays_through, way_through
from lightflight.camera.way import Way, straight_way
from lightflight.errors import GeometryError
from lightflight.flight import return_time_from_points
from lightflight.materials import Material
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS
from lightflight.vectors import lengths

Floats = NDArray[np.float64]


class Projection:
    """World points, pixels, rays and ways of a camera; its fields are those of `model.Camera`."""

    matrix: NDArray[np.float64]
    distortion: NDArray[np.float64]
    world_from_camera: NDArray[np.float64]
    shape: tuple[int, int]
    interfaces: tuple[Interface, ...]
    stands_in: Material
    clock_offset_ps: float

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
        """Undistorted image plane from world points.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.

        Returns
        -------
        x, y : array of float, shape (...)
            Right and down, at unit depth; NaN for points on or behind the plane of the pupil, and
            for points before the last interface.
        """
        points = self._camera_points(self._seen_points(points_mm))
        depth = np.where(points[..., 2] > 0.0, points[..., 2], np.nan)
        return points[..., 0] / depth, points[..., 1] / depth

    def pixels_from_normalized(
        self, x: ArrayLike, y: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels from the undistorted image plane.

        Parameters
        ----------
        x, y : array of float, shape (...)
            Right and down, at unit depth.

        Returns
        -------
        row, col : array of float, shape (...)
            Fractional, px. NaN beyond the radius where the distortion polynomial folds back on
            itself: a real lens does not send light from there into the picture.
        """
        xd, yd = self._lens.distorted(
            np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        )
        k = self.matrix
        return k[1, 1] * yd + k[1, 2], k[0, 0] * xd + k[0, 1] * yd + k[0, 2]

    def pixels_from_points(
        self, points_mm: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels that see world points.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.

        Returns
        -------
        row, col : array of float, shape (...)
            Fractional, px; NaN behind the camera. They may lie outside the picture: ask `sees`.
        """
        return self.pixels_from_normalized(*self.normalized_from_points(points_mm))

    def sees(self, points_mm: ArrayLike) -> NDArray[np.bool_]:
        """Whether world points are in front of the camera and inside the outer pixel edges.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.

        Returns
        -------
        array of bool, shape (...)
            False for NaN.
        """
        row, col = self.pixels_from_points(points_mm)
        rows, cols = self.shape
        return np.asarray((row >= -0.5) & (row <= rows - 0.5) & (col >= -0.5) & (col <= cols - 0.5))

    def pixel_jacobian(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """Derivative of (row, col) by the world point, distortion included.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.

        Returns
        -------
        array of float, shape (..., 2, 3)
            px/mm; NaN behind the camera.
        """
        return self.pixels_and_slopes(points_mm)[1]

    def pixels_and_slopes(
        self, points_mm: ArrayLike, *, way: Way | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels that see world points, and how they follow them, in one go.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.
        way : Way, optional
            By `way_back`, where it is known already.

        Returns
        -------
        pixels : array of float, shape (..., 2)
            (row, col), as `pixels_from_points`.
        slopes : array of float, shape (..., 2, 3)
            px/mm, as `pixel_jacobian`.
        """
        plane, by_point = self.plane_and_slopes(points_mm, way=way)
        x_by_point, y_by_point = by_point[..., 0, :], by_point[..., 1, :]
        if not self._lens.is_ideal:
            bend = self._lens.jacobian(plane[..., 0], plane[..., 1])
            x_by_point, y_by_point = (
                of_plane[..., :1] * x_by_point + of_plane[..., 1:] * y_by_point
                for of_plane in (bend[..., 0, :], bend[..., 1, :])
            )
        k = self.matrix
        jacobian = np.empty(by_point.shape)
        jacobian[..., 0, :] = k[1, 1] * y_by_point
        jacobian[..., 1, :] = k[0, 0] * x_by_point + k[0, 1] * y_by_point
        pixels = self.pixels_from_normalized(plane[..., 0], plane[..., 1])
        places = np.empty(plane.shape)
        places[..., 0], places[..., 1] = pixels
        return places, jacobian

    def pixels_and_speeds(
        self, points_mm: ArrayLike, along_mm: ArrayLike
    ) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
        """Pixels that see world points, and how they run as each point moves one way.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.
        along_mm : array of float, shape (..., 3)
            Ways of the points per unit of what moves them, world, mm.

        Returns
        -------
        pixels : (array of float, array of float), shape (...)
            row, col, as `pixels_from_points`.
        speeds : (array of float, array of float), shape (...)
            px per unit: `pixel_jacobian` times `along_mm`, of which a third is worked out.
        """
        (x, y), (dx, dy) = self.plane_and_speeds(points_mm, along_mm)
        if not self._lens.is_ideal:
            bend = self._lens.jacobian(x, y)
            dx, dy = (bend[..., k, 0] * dx + bend[..., k, 1] * dy for k in (0, 1))
        k = self.matrix
        return self.pixels_from_normalized(x, y), (k[1, 1] * dy, k[0, 0] * dx + k[0, 1] * dy)

    def plane_and_speeds(
        self, points_mm: ArrayLike, along_mm: ArrayLike
    ) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
        """The same in the undistorted image plane: x, y at unit depth, and how they run.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.
        along_mm : array of float, shape (..., 3)
            Ways of the points per unit of what moves them, world, mm.

        Returns
        -------
        plane : (array of float, array of float), shape (...)
            x, y, as `normalized_from_points`.
        speeds : (array of float, array of float), shape (...)
            Per unit.
        """
        seen, along = points_mm, np.asarray(along_mm, dtype=np.float64)
        if self.interfaces:
            way = self.way_back(points_mm)
            seen, along = way.first_mm, np.einsum("...ij,...j->...i", way.first_by_point, along)
        points, along = self._camera_points(seen), along @ self.world_from_camera[:3, :3]
        z = np.where(points[..., 2] > 0.0, points[..., 2], np.nan)
        x, y = points[..., 0] / z, points[..., 1] / z
        ahead = along[..., 2]
        return (x, y), ((along[..., 0] - x * ahead) / z, (along[..., 1] - y * ahead) / z)

    def plane_and_slopes(
        self, points_mm: ArrayLike, *, way: Way | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Places in the undistorted image plane, and how they follow the points.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.
        way : Way, optional
            By `way_back`, where it is known already.

        Returns
        -------
        plane : array of float, shape (..., 2)
            (x, y) at unit depth, as `normalized_from_points`.
        slopes : array of float, shape (..., 2, 3)
            Per mm; NaN behind the camera.
        """
        if not self.interfaces:
            points = self._camera_points(points_mm)
        else:
            way = self.way_back(points_mm) if way is None else way
            points = self._camera_points(way.first_mm)
        z = np.where(points[..., 2:] > 0.0, points[..., 2:], np.nan)
        plane = points[..., :2] / z
        right_down, forward = self.world_from_camera[:3, :2].T, self.world_from_camera[:3, 2]
        slopes = (right_down - plane[..., np.newaxis] * forward) / z[..., np.newaxis]
        if self.interfaces and way is not None:
            slopes = slopes @ way.first_by_point
        return plane, slopes

    # ---- pixel -> world -------------------------------------------------------------------

    def normalized_from_pixels(
        self, row: ArrayLike, col: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Undistorted image plane from pixels.

        The distortion is inverted by Newton steps to machine precision.

        Parameters
        ----------
        row, col : array of float, shape (...)
            px, fractional or outside the picture allowed.

        Returns
        -------
        x, y : array of float, shape (...)
            Right and down, at unit depth; NaN pixels give NaN.

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
        x, y, lost = self._lens.undistorted(xd, yd)
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
        """Directions that pixels look along, before any interface (`lines_of_sight`: behind all).

        Parameters
        ----------
        row, col : array of float, shape (...)
            px, fractional or outside the picture allowed.

        Returns
        -------
        array of float, shape (..., 3)
            Unit vectors, world, from the centre A outwards.

        Raises
        ------
        GeometryError
            As `normalized_from_pixels` does.
        """
        return np.asarray(self.own_rays(row, col) @ self.world_from_camera[:3, :3].T)

    def own_rays(self, row: ArrayLike, col: ArrayLike) -> NDArray[np.float64]:
        """The same in the camera's own axes: of cameras with one lens they are one."""
        x, y = self.normalized_from_pixels(row, col)
        # A pixel that is NaN has no ray at all: without this, one with a depth.
        ray = np.stack([x, y, np.where(np.isnan(x), np.nan, 1.0)], axis=-1)
        ray /= lengths(ray)[..., np.newaxis]
        return np.asarray(ray)

    def lines_of_sight(
        self, row: ArrayLike, col: ArrayLike, *, own_rays: NDArray[np.float64] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Lines that pixels look along in the scene, behind all that the camera looks through.

        Parameters
        ----------
        row, col : array of float, shape (...)
            px, fractional or outside the picture allowed.
        own_rays : array of float, shape (..., 3), optional
            By `own_rays`, where they are known already.

        Returns
        -------
        origins_mm : array of float, shape (..., 3)
            World: the centre A, or where the ray leaves the last interface; NaN for a ray that
            never gets there.
        directions : array of float, shape (..., 3)
            Unit, world, outwards.
        optical_mm : array of float, shape (...)
            Group indices times lengths from the camera to the origin; 0 without interfaces.

        Raises
        ------
        GeometryError
            As `normalized_from_pixels` does.
        """
        own_rays = self.own_rays(row, col) if own_rays is None else own_rays
        rays = np.asarray(own_rays @ self.world_from_camera[:3, :3].T)
        if not self.interfaces:
            return np.broadcast_to(self.center_mm, rays.shape), rays, np.zeros(rays.shape[:-1])
        return rays_through(
            rays, center_mm=self.center_mm, front=self.stands_in, interfaces=self.interfaces
        )

    # ---- the way of the light -------------------------------------------------------------

    def way_back(self, points_mm: ArrayLike, *, return_group_index: float | None = None) -> Way:
        """How light of world points comes to the camera, and how long its way is.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.
        return_group_index : float, optional
            Of the scene's own medium; None: that behind the last interface.

        Returns
        -------
        Way
            Of the points, flat; the straight line where there is no interface.
        """
        points = np.asarray(points_mm, dtype=np.float64).reshape(-1, 3)
        last = self.interfaces[-1].beyond if self.interfaces else self.stands_in
        index = last.group_index if return_group_index is None else return_group_index
        if self.interfaces:
            way = way_through(
                points,
                center_mm=self.center_mm,
                front=self.stands_in,
                interfaces=self.interfaces,
                return_group_index=index,
            )
        else:
            way = straight_way(points, self.center_mm, index)
        if self.clock_offset_ps:
            late_mm = self.clock_offset_ps * SPEED_OF_LIGHT_MM_PER_PS
            way = replace(way, optical_mm=way.optical_mm + late_mm)
        return way.shaped(np.shape(points_mm)[:-1])

    def return_times_ps(
        self, points_mm: ArrayLike, *, return_group_index: float
    ) -> NDArray[np.float64]:
        """Time that light scattered at world points needs to the camera (method.md, Flight).

        As its clock counts it: later by `clock_offset_ps`.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.
        return_group_index : float
            Of the scene's own medium; those of what the camera looks through are its own.

        Returns
        -------
        array of float, shape (...)
            ps.
        """
        if not self.interfaces:
            times = return_time_from_points(
                points_mm, camera_center_mm=self.center_mm, return_group_index=return_group_index
            )
            return times + self.clock_offset_ps if self.clock_offset_ps else times
        way = self.way_back(points_mm, return_group_index=return_group_index)
        return np.asarray(way.optical_mm / SPEED_OF_LIGHT_MM_PER_PS)

    def sight_directions(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """Unit directions in which light of world points comes, before anything bends it.

        Parameters
        ----------
        points_mm : array of float, shape (..., 3)
            World, mm.

        Returns
        -------
        array of float, shape (..., 3)
            World, outwards: from the last interface, or the centre A, to the point.
        """
        points = np.asarray(points_mm, dtype=np.float64)
        step = points - (self.way_back(points).last_mm if self.interfaces else self.center_mm)
        return np.asarray(step / np.linalg.norm(step, axis=-1, keepdims=True))

    def _seen_points(self, points_mm: ArrayLike) -> ArrayLike:
        """Points (..., 3) that the pinhole sees world points at."""
        return self.way_back(points_mm).first_mm if self.interfaces else points_mm

    @cached_property
    def _lens(self) -> Lens:
        """The distortion, and its inverse."""
        return Lens(self.distortion)

    def _camera_points(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """World points (..., 3), mm, in the axes of the camera."""
        points = np.asarray(points_mm, dtype=np.float64)
        if points.ndim == 0 or points.shape[-1] != 3:
            raise ValueError(f"points_mm must have shape (..., 3), got {points.shape}")
        # Points are rows: world-from-camera on their right is its transpose, camera-from-world.
        return np.asarray((points - self.center_mm) @ self.world_from_camera[:3, :3])
