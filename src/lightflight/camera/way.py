"""How light of points comes to a camera: where from, how long, and how that follows the points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.vectors import lengths

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Way:
    """How light of n points comes to the camera.

    Attributes
    ----------
    first_mm : array of float, shape (n, 3)
        Where it meets the plane next to the camera: what the pinhole sees. NaN: it does not come.
    last_mm : array of float, shape (n, 3)
        Where it leaves the scene's medium.
    optical_mm : array of float, shape (n,)
        Group indices times lengths, all the way.
    first_by_point : array of float, shape (n, 3, 3)
        d(first) / d(point).
    optical_by_point : array of float, shape (n, 3)
        d(optical) / d(point).
    """

    first_mm: Floats
    last_mm: Floats
    optical_mm: Floats
    first_by_point: Floats
    optical_by_point: Floats

    def shaped(self, shape: tuple[int, ...]) -> Way:
        """The same with points in another shape (...)."""
        return Way(
            self.first_mm.reshape(*shape, 3),
            self.last_mm.reshape(*shape, 3),
            self.optical_mm.reshape(shape),
            self.first_by_point.reshape(*shape, 3, 3),
            self.optical_by_point.reshape(*shape, 3),
        )


def straight_way(points_mm: Floats, center_mm: Floats, group_index: float) -> Way:
    """The way in one medium: the pinhole sees the points (n, 3) themselves."""
    step = points_mm - center_mm
    length = lengths(step)
    by_itself = np.broadcast_to(np.eye(3), (len(points_mm), 3, 3))
    outwards = step / np.maximum(length, 1e-300)[:, np.newaxis]
    last = np.broadcast_to(center_mm, step.shape)
    return Way(points_mm, last, group_index * length, by_itself, group_index * outwards)
