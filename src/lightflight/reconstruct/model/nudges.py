"""How the picture of a path follows errors of camera and medium: derivatives without a second look.

A camera that moves sees what it would see if the path moved the other way, so its columns are
those of the vertices. A lens moves the leg's image in the picture and the foot slides along it. An
index makes the way longer. None of these asks again which point of a leg a pixel sees nearest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.camera.refraction import Interface, moved_rigidly
from lightflight.flight import Medium
from lightflight.reconstruct.model.geometry import Footprint, PathState
from lightflight.reconstruct.model.image_plane import mean_focal_px
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS
from lightflight.vectors import cross

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

NUDGE = 1e-3
"""Step of a shared error for its derivative, in its own standard deviations."""
_PROBE = 1e-6
"""Step in the normalized image plane for the lens's own derivative: 1e-3 px."""


@dataclass(frozen=True, eq=False)
class Nudges:
    """What one standard deviation of each of k shared errors does to one camera and the medium.

    Attributes
    ----------
    camera : Camera
        As it sees now.
    turn_rad : array of float, shape (k, 3)
        World axes, about the centre.
    shift_mm : array of float, shape (k, 3)
        Of the centre, world.
    index : array of float, shape (k, 2)
        Of the medium, out and back.
    late_ps : array of float, shape (k,)
        Of the clock's zero.
    lenses : dict of int to Camera
        For errors that change the lens, or what the camera looks through: the same pose, seen
        through them after `NUDGE` of the error.
    """

    camera: Camera
    turn_rad: Floats
    shift_mm: Floats
    index: Floats
    late_ps: Floats
    lenses: dict[int, Camera]

    def __len__(self) -> int:
        return len(self.index)

    def as_moves(self, state: PathState) -> Floats:
        """Moves of the state (size, k) that look to the camera like its own; the lens stays.

        A bend turns with its leg; what of it turns into the leg's own direction slides the curve
        along itself, and is left out.
        """
        out = state.vertices_mm - self.camera.center_mm
        moves = -cross(self.turn_rad[:, np.newaxis], out) - self.shift_mm[:, np.newaxis]
        still = [moves.reshape(len(self), out.size).T, np.zeros(len(self))]
        for bend in state.bends:
            turned = -cross(self.turn_rad[:, np.newaxis], bend.vectors_mm[np.newaxis])
            still.append((turned @ bend.axes.T).transpose(2, 1, 0).reshape(bend.size, len(self)))
        return np.vstack(still)

    def arrivals(
        self, state: PathState, print_: Footprint, by_state: Floats, medium: Medium
    ) -> Floats:
        """d(arrival time at the foot) / d(error) of n pixels, ps.

        Parameters
        ----------
        state : PathState
            The path.
        print_ : Footprint
            Where each of n pixels looks along its leg.
        by_state : array of float, shape (n, size)
            d(arrival time) / d(state).
        medium : Medium
            Whose times these are.

        Returns
        -------
        array of float, shape (n, k)
            ps per standard deviation.
        """
        columns: Floats = by_state @ self.as_moves(state)
        if self.late_ps.any():
            columns += self.late_ps
        if self.index.any():
            before = state.in_medium_mm[state.leg_starts[print_.leg]]
            out = before + state.ways_mm(print_.leg, print_.fraction)
            ways = np.column_stack((out, print_.distance_mm))
            columns += ways @ self.index.T / SPEED_OF_LIGHT_MM_PER_PS
        if self.lenses:
            feet = state.points_mm(print_.leg, print_.fraction)
            # The image runs away under the pixel, which then sees an earlier point of the leg.
            slide = self.slides(feet, state.tangents_mm(print_.leg, print_.fraction))
            columns -= print_.slope_ps_per_px[:, np.newaxis] * slide
            columns += self._later(feet, medium)
        return columns

    def _later(self, points_mm: Floats, medium: Medium) -> Floats:
        """How much longer light of points (n, 3) needs to the camera, ps per standard deviation.

        Nothing where the camera looks through no interface: a lens takes no time.
        """
        found = np.zeros((len(points_mm), len(self)))
        if not self.camera.interfaces:
            return found
        index = medium.return_group_index
        here = self.camera.return_times_ps(points_mm, return_group_index=index)
        for k, other in self.lenses.items():
            there = other.return_times_ps(points_mm, return_group_index=index)
            found[:, k] = (there - here) / NUDGE
        return found

    def slides(self, points_mm: Floats, along_mm: Floats) -> Floats:
        """How far the lens moves the images of points along their legs, px.

        Parameters
        ----------
        points_mm : array of float, shape (n, 3)
            World.
        along_mm : array of float, shape (n, 3)
            Directions of the legs.

        Returns
        -------
        array of float, shape (n, k)
            px per standard deviation; zero for errors that leave the lens.
        """
        found = np.zeros((len(points_mm), len(self)))
        if not self.lenses:
            return found
        speed = np.einsum("nij,nj->ni", self.camera.pixel_jacobian(points_mm), along_mm)
        speed = np.nan_to_num(speed)
        unit = speed / np.maximum(np.linalg.norm(speed, axis=1), 1e-12)[:, np.newaxis]
        seen = np.column_stack(self.camera.pixels_from_points(points_mm))
        for k, lens in self.lenses.items():
            there = np.column_stack(lens.pixels_from_points(points_mm))
            found[:, k] = np.nan_to_num(np.sum((there - seen) * unit, axis=1)) / NUDGE
        return found

    def undistorted(self, points_px: Floats) -> dict[int, Floats]:
        """Points (n, 2) of the undistorted picture after `step` of each error of the lens.

        Parameters
        ----------
        points_px : array of float, shape (n, 2)
            (u, v) of pixels, px, as the camera sees them now.

        Returns
        -------
        dict of int to array of float, shape (n, 2)
            The same pixels, to first order.
        """
        if not self.lenses:
            return {}
        plane = points_px / mean_focal_px(self.camera)
        here = _projected(self.camera, plane)
        # Columns: how a pixel moves with x and with y of the plane.
        probes = [(_projected(self.camera, plane + d) - here) / _PROBE for d in _PROBE * np.eye(2)]
        inverse = np.linalg.inv(np.stack(probes, axis=-1))
        return {
            k: mean_focal_px(lens)
            * (plane - np.einsum("nij,nj->ni", inverse, _projected(lens, plane) - here))
            for k, lens in self.lenses.items()
        }


def _projected(camera: Camera, plane: Floats) -> Floats:
    """Pixels (n, 2) of points (n, 2) of the normalized image plane."""
    return np.column_stack(camera.pixels_from_normalized(plane[:, 0], plane[:, 1]))


def nudge_between(seen: Camera, there: Camera) -> tuple[Floats, Floats, Camera | None]:
    """Turn (3,), shift (3,) and, where it is another, the lens at the same pose.

    Parameters
    ----------
    seen : Camera
        As it is.
    there : Camera
        A little moved.

    Returns
    -------
    turn_rad : array of float, shape (3,)
        World axes, for small turns.
    shift_mm : array of float, shape (3,)
        World.
    lens : Camera or None
        None: the lens stays.
    """
    turned = there.world_from_camera[:3, :3] @ seen.world_from_camera[:3, :3].T
    # The part that is no rotation is of second order.
    turn = 0.5 * (turned - turned.T)[[2, 0, 1], [1, 2, 0]]
    shift = there.center_mm - seen.center_mm
    same = np.array_equal(there.matrix, seen.matrix)
    moved = moved_rigidly(seen.interfaces, turned, seen.center_mm, shift)
    same &= np.allclose(_numbers(moved), _numbers(there.interfaces), rtol=0.0, atol=1e-11)
    if same and np.array_equal(there.distortion, seen.distortion):
        return turn, shift, None
    faces = moved_rigidly(there.interfaces, turned.T, there.center_mm, -shift)
    return turn, shift, replace(there, world_from_camera=seen.world_from_camera, interfaces=faces)


def _numbers(interfaces: tuple[Interface, ...]) -> Floats:
    """All that says where planes stand and how they bend."""
    rows = [(*face.point_mm, *face.normal, face.beyond.phase_index) for face in interfaces]  # type: ignore[misc]
    return np.array(rows, dtype=float)
