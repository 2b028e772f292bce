"""Where a viewer stands: world points (mm) on a flat page, in parallel projection or a photograph.

NumPy only: figures, films and the small pictures of a campaign's page look from the same side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from lightflight.display import Shown
from lightflight.view.types import Floats

if TYPE_CHECKING:
    from lightflight import Camera


class Projector(Protocol):
    """Anything that puts world points on a page."""

    def project(self, points_mm: ArrayLike) -> Floats:
        """(..., 3) world, mm, to (..., 2) on the page."""
        ...


@dataclass(frozen=True, repr=False)
class Viewpoint(Shown):
    """A viewer infinitely far away, looking at the scene from a direction.

    Attributes
    ----------
    azimuth_deg : float
        0: from the side of +z (where the paper's camera stands); positive: from the right.
    elevation_deg : float
        Above the x-z plane.
    """

    azimuth_deg: float = -24.0

    elevation_deg: float = 22.0

    @property
    def towards_viewer(self) -> Floats:
        """(3,), unit, world."""
        az, el = np.deg2rad(self.azimuth_deg), np.deg2rad(self.elevation_deg)
        return np.array([np.sin(az) * np.cos(el), np.sin(el), np.cos(az) * np.cos(el)])

    @property
    def page_axes(self) -> Floats:
        """(2, 3): world directions of the page's right and up, unit."""
        az = np.deg2rad(self.azimuth_deg)
        right = np.array([np.cos(az), 0.0, -np.sin(az)])
        return np.array([right, np.cross(self.towards_viewer, right)])

    def project(self, points_mm: ArrayLike) -> Floats:
        """(..., 3) world, mm, to (..., 2) on the page, mm."""
        return np.asarray(np.asarray(points_mm, dtype=float) @ self.page_axes.T)


@dataclass(frozen=True, repr=False)
class PhotoView(Shown):
    """The page is a photograph, and `camera` took it: x = column, y = row, px.

    Attributes
    ----------
    camera : Camera
        The camera of the photograph.
    """

    camera: Camera

    def project(self, points_mm: ArrayLike) -> Floats:
        """(..., 3) world, mm, to (..., 2) px; NaN behind the camera."""
        row, col = self.camera.pixels_from_points(np.asarray(points_mm, dtype=float))
        return np.stack((col, row), axis=-1)
