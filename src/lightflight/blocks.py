"""Blocks of glass that the beam crosses: two parallel faces, and where light meets them.

`Block` says what stands in the beam. Between two places on both sides light takes the way that is
stationary in optical length (Fermat), which is Snell's law at every face: `places_on_faces`. The
*phase* indices bend it, the *group* index of the glass times it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import POSITIVE, finite_number, finite_numbers
from lightflight.materials import AIR, Material

Floats = NDArray[np.float64]

_MOST_STEPS = 60
"""Of Newton's method; the length is convex, and four are usual."""
_STILL = 1e-14
"""Of a step, as a share of the way: rounding."""


@dataclass(frozen=True)
class Block:
    """A block of glass with two parallel faces, which the beam enters by one and leaves by other.

    Raises ValueError for a block that is none.

    Attributes
    ----------
    center_mm : ArrayLike
        (3,), its middle, between the faces; world, mm.
    normal : ArrayLike
        (3,), across its faces, of any length and either way; world.
    thickness_mm : float
        From face to face, mm.
    diameter_mm : float
        How wide the faces are, mm. Pixels that look at a disc of this size take no part.
    glass : Material
        What it is of: its phase index bends the beam, its group index times it.
    around : Material
        What it stands in.
    """

    center_mm: ArrayLike

    normal: ArrayLike

    thickness_mm: float = field(kw_only=True)

    diameter_mm: float = field(kw_only=True)

    glass: Material = field(kw_only=True)

    around: Material = field(default=AIR, kw_only=True)

    def __post_init__(self) -> None:
        for name, must in (
            ("center_mm", "be three finite numbers (x, y, z) in mm"),
            ("normal", "be three finite numbers, not all zero"),
        ):
            xyz = finite_numbers(name, getattr(self, name), must, shapes=[(3,)])
            object.__setattr__(self, name, tuple(float(x) for x in xyz))
        if not any(self.unit_normal):
            raise ValueError("normal must be three finite numbers, not all zero")
        for name in ("thickness_mm", "diameter_mm"):
            number = finite_number(name, getattr(self, name), "be positive, in mm", low=POSITIVE)
            object.__setattr__(self, name, number)
        for name in ("glass", "around"):
            if not isinstance(getattr(self, name), Material):
                raise ValueError(
                    f"{name} of a block must be a Material, which has a phase index and a group "
                    'index: Material.named("BK7", wavelength_nm=532), or Material(1.52, 1.55)'
                )

    @property
    def unit_normal(self) -> Floats:
        """(3,), across the faces; zero where none was told."""
        normal = np.asarray(self.normal, dtype=float)
        longest = np.abs(normal).max()
        unit: Floats = normal / longest if longest > 0.0 else normal
        return unit / np.linalg.norm(unit) if longest > 0.0 else unit

    def heights_and_radii_mm(self, points_mm: Floats) -> tuple[Floats, Floats]:
        """(n,) each: above the middle along the normal, and away from the axis; mm."""
        gap = np.asarray(points_mm, dtype=float) - np.asarray(self.center_mm)
        height = gap @ self.unit_normal
        radius = np.linalg.norm(gap - height[..., np.newaxis] * self.unit_normal, axis=-1)
        return height, radius

    def holds(self, points_mm: Floats) -> NDArray[np.bool_]:
        """(n,), True for places within the glass; on a face they are not."""
        height, radius = self.heights_and_radii_mm(points_mm)
        inside: NDArray[np.bool_] = np.abs(height) < 0.5 * self.thickness_mm - 1e-6
        return inside & (radius < 0.5 * self.diameter_mm)

    def is_between(self, start_mm: Floats, end_mm: Floats) -> bool:
        """Whether the straight way from one place to another meets its middle within its width."""
        height, _ = self.heights_and_radii_mm(np.stack((start_mm, end_mm)))
        if not height[0] * height[1] < 0.0:
            return False
        return self.aside_mm(start_mm, end_mm) <= 0.5 * self.diameter_mm

    def aside_mm(self, start_mm: Floats, end_mm: Floats) -> float:
        """How far from its axis the straight way between places on both sides meets its middle."""
        height, _ = self.heights_and_radii_mm(np.stack((start_mm, end_mm)))
        share = height[0] / (height[0] - height[1])
        middle = start_mm + share * (end_mm - start_mm)
        return float(self.heights_and_radii_mm(middle)[1])

    def rim_mm(self, n: int = 64) -> Floats:
        """(2 n, 3), places on the rims of both faces, world, mm."""
        first = np.cross(self.unit_normal, np.eye(3)[int(np.argmin(np.abs(self.unit_normal)))])
        first /= np.linalg.norm(first)
        angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)[:, np.newaxis]
        second = np.cross(self.unit_normal, first)
        rim = 0.5 * self.diameter_mm * (np.cos(angle) * first + np.sin(angle) * second)
        up = 0.5 * self.thickness_mm * self.unit_normal
        places: Floats = np.asarray(self.center_mm) + np.concatenate((rim - up, rim + up))
        return places


class Places(NamedTuple):
    """Where light meets faces on its way, and how that follows the two ends of the way."""

    points_mm: Floats
    """(2k, 3), in the order of flight; world, mm."""
    by_ends: Floats
    """(2k, 3, 6), derivatives by x, y, z of the start and of the end."""


def places_on_faces(start_mm: Floats, end_mm: Floats, blocks: Sequence[Block]) -> Places:
    """Where light that flies from one place to another meets the faces of blocks between them.

    Parameters
    ----------
    start_mm, end_mm : array of float, shape (3,)
        On both sides of all blocks, world, mm.
    blocks : sequence of Block
        k of them, in the order of flight; their faces go on for ever.

    Returns
    -------
    Places
        Of 2k faces.

    Notes
    -----
    S = sum n_i |P_(i+1) - P_i| is least, n_i the phase index of each stretch (method.md, Glass in
    the beam). S is convex in the places, each free in its face: a damped Newton descent. At its end
    dP = -S_PP^-1 S_PE dE (implicit function theorem).
    """
    points, axes = _on_chord(start_mm, end_mm, blocks)
    index = np.array([block.around.phase_index for block in blocks for _ in range(2)] + [1.0])
    index[1::2] = [block.glass.phase_index for block in blocks]
    index[-1] = blocks[-1].around.phase_index
    length = float(np.linalg.norm(end_mm - start_mm))

    def corners(places: Floats) -> Floats:
        return np.concatenate(([start_mm], places, [end_mm]))

    def optical(places: Floats) -> float:
        return float(index @ np.linalg.norm(np.diff(corners(places), axis=0), axis=1))

    n, here = len(points), optical(points)
    for _ in range(_MOST_STEPS):
        slope, curvature, _ = _derivatives(corners(points), index, axes)
        step = np.linalg.solve(curvature, -slope).reshape(n, 2)
        moved = np.einsum("ijk,ik->ij", axes, step)
        share = 1.0
        while optical(points + share * moved) > here * (1.0 + 1e-15) and share > 1e-6:
            share *= 0.5
        points = points + share * moved
        here = optical(points)
        if np.abs(step).max() < _STILL * length:
            break
    _, curvature, by_ends = _derivatives(corners(points), index, axes)
    follows = -np.linalg.solve(curvature, by_ends).reshape(n, 2, 6)
    return Places(points, np.einsum("ijk,ikl->ijl", axes, follows))


def _on_chord(start_mm: Floats, end_mm: Floats, blocks: Sequence[Block]) -> tuple[Floats, Floats]:
    """(2k, 3) places on the faces near the straight way, and (2k, 3, 2) what spans the faces."""
    points, axes, step = [], [], end_mm - start_mm
    for block in blocks:
        normal = block.unit_normal if block.unit_normal @ step > 0.0 else -block.unit_normal
        spanning = np.linalg.svd(normal[np.newaxis])[2][1:].T
        for side in (-0.5, 0.5):
            foot = np.asarray(block.center_mm) + side * block.thickness_mm * normal
            along = float((foot - start_mm) @ normal) / max(float(step @ normal), 1e-12)
            points.append(start_mm + along * step)
            axes.append(spanning)
    return np.array(points), np.array(axes)


def _derivatives(corners: Floats, index: Floats, axes: Floats) -> tuple[Floats, Floats, Floats]:
    """Of the optical length: slope (2n,), curvature (2n, 2n), and mixed with the ends (2n, 6)."""
    n = len(axes)
    steps = np.diff(corners, axis=0)
    length = np.linalg.norm(steps, axis=1)
    unit = steps / length[:, np.newaxis]
    # How the direction of each stretch turns as its end moves.
    turn = (np.eye(3) - unit[:, :, np.newaxis] * unit[:, np.newaxis]) * (index / length)[
        :, np.newaxis, np.newaxis
    ]
    slope, curvature, by_ends = np.zeros((n, 2)), np.zeros((n, 2, n, 2)), np.zeros((n, 2, 6))
    for i, axis in enumerate(axes):
        slope[i] = (index[i] * unit[i] - index[i + 1] * unit[i + 1]) @ axis
        curvature[i, :, i] = axis.T @ (turn[i] + turn[i + 1]) @ axis
        if i + 1 < n:
            across = -axis.T @ turn[i + 1] @ axes[i + 1]
            curvature[i, :, i + 1], curvature[i + 1, :, i] = across, across.T
    by_ends[0, :, :3] = -axes[0].T @ turn[0]
    by_ends[-1, :, 3:] = -axes[-1].T @ turn[-1]
    return slope.ravel(), curvature.reshape(2 * n, 2 * n), by_ends.reshape(2 * n, 6)
