"""Solids of a scene: tubes, spheres, mirrors, the camera's field; points and triangles, mm.

NumPy only; glTF is made of these.
"""

from __future__ import annotations

from dataclasses import fields
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from lightflight.path.trace import Trace, across_axes, frame_across
from lightflight.view.types import Floats, Whole

if TYPE_CHECKING:
    from lightflight import Camera

Solid = tuple[Floats, Whole]

_FARTHEST_MM = 1e30
"""Squares of more have no place in single precision."""

_TUBE_SHARE = 0.022
"""Radius of a magnified error tube as a share of the scene's longest side."""


def _rings(rings: Floats) -> Solid:
    """Points (n * sides, 3) and triangles of a tube through rings (n, sides, 3)."""
    n, sides = rings.shape[:2]
    here = np.arange(n - 1)[:, np.newaxis] * sides + np.arange(sides)
    beside = np.arange(n - 1)[:, np.newaxis] * sides + (np.arange(sides) + 1) % sides
    first = np.stack((here, beside, here + sides), axis=-1)
    second = np.stack((beside, beside + sides, here + sides), axis=-1)
    return rings.reshape(-1, 3), np.concatenate((first.reshape(-1, 3), second.reshape(-1, 3)))


def _joined(solids: list[Solid]) -> Solid:
    points, triangles, first = [], [], 0
    for some_points, some_triangles in solids:
        points.append(some_points)
        triangles.append(some_triangles + first)
        first += len(some_points)
    return np.concatenate(points), np.concatenate(triangles)


def tube_along(vertices_mm: ArrayLike, radius_mm: float, *, sides: int = 12) -> Solid:
    """A round tube along every leg of a polyline (m, 3); a row of NaN parts it."""
    vertices = np.asarray(vertices_mm, dtype=float)
    turn = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    solids = []
    for start, end in pairwise(vertices):
        if not np.isfinite([start, end]).all():
            continue
        across = frame_across(end - start)
        circle = radius_mm * (np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1])
        solids.append(_rings(np.stack((start + circle, end + circle))))
    return _joined(solids)


def error_rings(trace: Trace, leg: int, *, magnification: float, sides: int) -> Floats:
    """One-sigma error ellipses across a leg; (n, sides, 3), world, mm; NaN without errors."""
    of_leg = trace.leg == leg
    part = Trace(**{one.name: getattr(trace, one.name)[of_leg] for one in fields(Trace)})
    variances, axes = across_axes(part)
    radii = magnification * np.sqrt(np.maximum(variances, 0.0))
    turn = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    circle = np.stack((np.cos(turn), np.sin(turn)), axis=1)
    frame = axes.copy()
    # The axes may flip from one ring to the next: a tube needs them to follow on.
    for i in range(1, len(frame)):
        for k in range(2):
            if frame[i, k] @ frame[i - 1, k] < 0:
                frame[i, k] *= -1
    offsets = np.einsum("sk,nk,nkx->nsx", circle, radii, frame)
    return np.asarray(part.points_mm[:, np.newaxis, :] + offsets)


def error_tube(trace: Trace, magnification: float, *, sides: int = 16) -> Solid | None:
    """Tubes of one-sigma error around every leg, enlarged; None without errors of any size."""
    solids = []
    for leg in np.unique(trace.leg):
        rings = error_rings(trace, int(leg), magnification=magnification, sides=sides)
        if not (np.abs(rings) < _FARTHEST_MM).all():  # NaN, too
            return None
        solids.append(_rings(rings))
    return _joined(solids) if solids else None


def magnification_of(trace: Trace, extent_mm: float) -> float:
    """Factor of 1, 2, 5, 10 ... that makes the typical error of a trace visible in a scene.

    Parameters
    ----------
    trace : Trace
        Dense points along the path.
    extent_mm : float
        The scene's longest side, mm.
    """
    size = trace.std_mm[np.isfinite(trace.std_mm)]
    if size.size == 0 or not np.median(size) > 0:
        return 1.0
    return nice_factor(_TUBE_SHARE * extent_mm / float(np.median(size)))


def nice_factor(ratio: float, *, largest: float = 1e4) -> float:
    """Largest of 1, 2, 5, 10, 20 ... that is not above `ratio`; never below 1.

    Examples
    --------
    >>> nice_factor(730.0), nice_factor(0.3)
    (500.0, 1.0)
    """
    if not np.isfinite(ratio) or ratio <= 1.0:
        return 1.0
    ratio = min(ratio, largest)
    power = 10.0 ** np.floor(np.log10(ratio))
    # The hair of room: 5.0 must give 5, whatever its last bit.
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= ratio * 1.0001))


def mirror_outline(
    before_mm: ArrayLike, corner_mm: ArrayLike, after_mm: ArrayLike, *, size_mm: float
) -> Floats:
    """Square (4, 3) that a flat mirror at a corner would fill; world, mm."""
    corner = np.asarray(corner_mm, dtype=float)
    incoming = corner - np.asarray(before_mm, dtype=float)
    outgoing = np.asarray(after_mm, dtype=float) - corner
    incoming = incoming / np.linalg.norm(incoming)
    outgoing = outgoing / np.linalg.norm(outgoing)
    # The law of reflection: the normal halves the angle between the two legs.
    normal = outgoing - incoming
    size = np.linalg.norm(normal)
    # Light that goes straight on has no mirror: any square across it will do.
    normal = outgoing if size < 1e-9 else normal / size
    # Upright like a mirror on a table; one that lies flat gets another edge.
    up = np.array([0.0, 1.0, 0.0])
    up = up - (up @ normal) * normal
    if np.linalg.norm(up) < 0.1:
        up = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    up /= np.linalg.norm(up)
    side = np.cross(normal, up)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * size_mm / 2
    return np.asarray(corner + corners[:, :1] * side + corners[:, 1:] * up)


def mirror_square(before: ArrayLike, corner: ArrayLike, after: ArrayLike, size_mm: float) -> Solid:
    """A mirror as two triangles."""
    square = mirror_outline(before, corner, after, size_mm=size_mm)
    return square, np.array([[0, 1, 2], [0, 2, 3]])


def sphere(center_mm: ArrayLike, radius_mm: float, *, rings: int = 9, sides: int = 16) -> Solid:
    """A ball."""
    polar = np.linspace(0.0, np.pi, rings)
    turn = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    points = np.stack(
        (
            np.outer(np.sin(polar), np.cos(turn)),
            np.outer(np.cos(polar), np.ones(sides)),
            np.outer(np.sin(polar), np.sin(turn)),
        ),
        axis=-1,
    )
    return _rings(np.asarray(center_mm, dtype=float) + radius_mm * points)


def field_of_view(camera: Camera, depth_point_mm: ArrayLike) -> Floats:
    """Outer edge of a camera's field on the plane through a point, facing the camera; (33, 3).

    Its corners are points 0, 8, 16, 24.

    Parameters
    ----------
    camera : Camera
        Who looks.
    depth_point_mm : array
        World point in whose depth the field is cut, mm; shape (3,).
    """
    rows, cols = camera.shape
    top, bottom, left, right = -0.5, rows - 0.5, -0.5, cols - 0.5
    edge = np.array(
        [(top, left), (top, right), (bottom, right), (bottom, left), (top, left)], dtype=float
    )
    # Eight points on a side: a lens with distortion bends the edges of its picture.
    f = np.linspace(0, 1, 9)[:-1, np.newaxis]
    outline = np.concatenate([(1 - f) * edge[i] + f * edge[i + 1] for i in range(4)] + [edge[-1:]])
    origins, rays, _ = camera.lines_of_sight(outline[:, 0], outline[:, 1])
    forward = -camera.backward_axis
    depth = (np.asarray(depth_point_mm, dtype=float) - origins) @ forward
    return np.asarray(origins + rays * (depth / (rays @ forward))[:, np.newaxis])


def field_lines(camera: Camera, depth_point_mm: ArrayLike) -> Floats:
    """The camera's field as line segments (n, 2, 3): four rays and the outline."""
    outline = field_of_view(camera, depth_point_mm)
    rays = [np.stack((camera.center_mm, outline[k])) for k in (0, 8, 16, 24)]
    sides = [np.stack(pair) for pair in pairwise(outline)]
    return np.stack(rays + sides)
