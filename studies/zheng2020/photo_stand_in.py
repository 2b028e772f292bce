"""A picture of the paper's set-up, rendered: table, laser, mirrors, camera seen from the side.

Stands in for the photograph of Fig. 6(a), which is not published in a usable form; a real one
goes into `draw_path_on_photo` in the same way, with the camera that took it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.camera.model import Camera
from lightflight.simulate import Scene

Floats = NDArray[np.float64]

_LIGHT = np.array([-0.35, 0.85, 0.40]) / np.linalg.norm([-0.35, 0.85, 0.40])
_HOLE_MM = 25.0


def rendered_set_up(
    scene: Scene, *, shape: tuple[int, int] = (360, 860)
) -> tuple[NDArray[np.uint8], Camera]:
    """Picture (rows, cols, 3) of a scene's laser and mirrors on a table, and the camera for it."""
    vertices = np.asarray(scene.vertices_mm, dtype=float)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    size = float(np.ptp(vertices, axis=0).max())
    place = middle + size * np.array([-0.30, 0.62, 1.35])
    camera = Camera.looking_at(
        middle, position_mm=place, focal_length_px=1.15 * shape[1], shape=shape
    )
    table = float(vertices[:, 1].min() - 0.12 * size)
    boxes = [_laser_box(vertices, size), *(_mirror_box(v, size) for v in vertices[1:-1])]
    rows, cols = np.indices(shape)
    rays = camera.rays_from_pixels(rows.ravel().astype(float), cols.ravel().astype(float))
    color = _table_color(place, rays, table)
    depth = np.where(rays[:, 1] < 0, (table - place[1]) / np.minimum(rays[:, 1], -1e-9), np.inf)
    for low, high, tint in boxes:
        low[1] = table
        hit, normal = _box_hits(place, rays, low, high)
        front = hit < depth
        shade = 0.30 + 0.70 * np.clip(normal @ _LIGHT, 0.0, 1.0)
        color[front] = shade[front, np.newaxis] * tint
        depth = np.minimum(depth, hit)
    picture = np.clip(255.0 * color, 0, 255).reshape(*shape, 3).astype(np.uint8)
    return picture, camera


def _table_color(place: Floats, rays: Floats, table: float) -> Floats:
    """Dark wall above, an optical table with its holes below."""
    down = rays[:, 1] < -1e-9
    color = np.full((len(rays), 3), 0.16) + 0.10 * np.clip(rays[:, 1:2] + 0.4, 0.0, 1.0)
    distance = (table - place[1]) / rays[down, 1]
    spot = place + distance[:, np.newaxis] * rays[down]
    away = np.hypot(
        *(np.mod(spot[:, axis] + 0.5 * _HOLE_MM, _HOLE_MM) - 0.5 * _HOLE_MM for axis in (0, 2))
    )
    tone = np.where(away < 3.0, 0.20, 0.46) * np.exp(-distance / 3500.0)
    color[down] = tone[:, np.newaxis] * np.array([0.95, 1.0, 1.06])
    return color


def _laser_box(vertices: Floats, size: float) -> tuple[Floats, Floats, Floats]:
    tip = vertices[0] - np.array([0.01 * size, 0.0, 0.0])
    half = 0.035 * size
    low = tip - np.array([0.22 * size, half, half])
    return low, tip + np.array([0.0, half, half]), np.array([0.30, 0.33, 0.40])


def _mirror_box(corner: Floats, size: float) -> tuple[Floats, Floats, Floats]:
    half = np.array([0.012, 0.045, 0.045]) * size
    return corner - half, corner + half, np.array([0.72, 0.76, 0.82])


def _box_hits(place: Floats, rays: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Distance along each ray to an upright box, inf for a miss, and the face's normal."""
    with np.errstate(divide="ignore"):
        first, second = (low - place) / rays, (high - place) / rays
    near, far = np.minimum(first, second), np.maximum(first, second)
    enter = near.max(axis=1)
    hit = (enter < far.min(axis=1)) & (enter > 0)
    normal = np.zeros_like(rays)
    axis = near.argmax(axis=1)
    normal[np.arange(len(rays)), axis] = -np.sign(rays[np.arange(len(rays)), axis])
    return np.where(hit, enter, np.inf), normal
