"""Where a pinhole with a lens sees points, for many points at once; no line of the package."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, eq=False)
class View:
    """A pinhole in the world: the axes are unit vectors, a pixel has its centre at whole numbers.

    Rows grow downwards, columns to the right; `forward` points into the scene.
    """

    centre: np.ndarray
    """(3,), world, mm."""
    axes: np.ndarray
    """(3, 3), rows: right, down, forward."""
    focal_px: tuple[float, float]
    """Pixels per unit of slope, along rows (down) and columns (right)."""
    shape: tuple[int, int] = (32, 32)
    lens: tuple[float, float] = (0.0, 0.0)
    """Radial stretch: 1 + lens[0] r² + lens[1] r⁴, r in units of slope."""
    axis_px: tuple[float, float] | None = None
    """(row, col) of the optical axis; None: the middle of the picture."""
    askew: tuple[float, float] = (0.0, 0.0)
    """Decentring along rows and columns (Brown and Conrady's), a and b: in units of slope, y grows
    by a (r² + 2 y²) + 2 b x y, x by b (r² + 2 x²) + 2 a x y."""

    def axis(self) -> tuple[float, float]:
        if self.axis_px is not None:
            return self.axis_px
        return self.shape[0] / 2 - 0.5, self.shape[1] / 2 - 0.5

    def image(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(row, col) of points (n, 3); NaN behind the pupil and where the lens polynomial folds."""
        right, down, depth = self.axes @ (points - self.centre).T
        with np.errstate(invalid="ignore", divide="ignore"):
            x = np.where(depth > 0.0, right / depth, np.nan)
            y = np.where(depth > 0.0, down / depth, np.nan)
        square = x**2 + y**2
        stretch = 1.0 + self.lens[0] * square + self.lens[1] * square**2
        folded = 1.0 + 3.0 * self.lens[0] * square + 5.0 * self.lens[1] * square**2 <= 0.0
        stretch = np.where(folded, np.nan, stretch)
        row0, col0 = self.axis()
        a, b = self.askew
        down = y * stretch + a * (square + 2.0 * y**2) + 2.0 * b * x * y
        right = x * stretch + b * (square + 2.0 * x**2) + 2.0 * a * x * y
        return row0 + self.focal_px[0] * down, col0 + self.focal_px[1] * right

    def inside(self, points: np.ndarray) -> np.ndarray:
        row, col = self.image(points)
        rows, cols = self.shape
        return (np.abs(row - rows / 2 + 0.5) < rows / 2) & (np.abs(col - cols / 2 + 0.5) < cols / 2)

    def corner_slope(self) -> float:
        """r of the picture's corner, in units of slope."""
        return float(
            np.hypot(self.shape[0] / 2 / self.focal_px[0], self.shape[1] / 2 / self.focal_px[1])
        )

    def moved(self, shift_mm: np.ndarray) -> View:
        """Standing elsewhere: the shift is (right, down, forward)."""
        return replace(self, centre=self.centre + np.asarray(shift_mm, dtype=float) @ self.axes)

    def turned(self, angles_rad: np.ndarray) -> View:
        """Turned in its place about its own axes (right, down, forward)."""
        about = Rotation.from_rotvec(np.asarray(angles_rad, dtype=float) @ self.axes)
        return replace(self, axes=about.apply(self.axes))

    def zoomed(self, share: float) -> View:
        """A focal length longer by a share of itself."""
        rows, cols = self.focal_px
        return replace(self, focal_px=(rows * (1.0 + share), cols * (1.0 + share)))


def view_over_plane(
    distance: float = 535.0,
    field: tuple[float, float] = (245.0, 245.0),
    middle: tuple[float, float] = (0.0, 0.0),
    shape: tuple[int, int] = (32, 32),
) -> View:
    """The paper's camera: `distance` above z = 0, of which it sees (width, height) in all."""
    return View(
        centre=np.array([middle[0], middle[1], distance]),
        axes=np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]),
        focal_px=(shape[0] * distance / field[1], shape[1] * distance / field[0]),
        shape=shape,
    )
