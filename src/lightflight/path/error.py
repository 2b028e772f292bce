"""How far a reconstructed path is from the truth, by the metrics every table of ours uses."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightflight.arguments import check_kinds, yes_or_no
from lightflight.errors import GeometryError
from lightflight.path.on_bends import drawn
from lightflight.path.on_legs import extrapolated_position
from lightflight.path.tables import Polyline

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_METRIC_TIMES = 1000
"""Equal event times at which positions are compared (design of the metrics)."""


class PathError(NamedTuple):
    """Distance between a path and the truth.

    Attributes
    ----------
    position_rms_mm : float
        rms of `|X_hat(t) - X(t)|` at equal event times, mm.
    event_time_rms_ps : float
        rms of t_hat - t on the rays of the pixels that see the true path, ps.
    """

    position_rms_mm: float
    event_time_rms_ps: float


def path_error(
    path: Polyline, truth: Polyline, camera: Camera, *, whole: bool = False
) -> PathError:
    """Position and time error of a path against the truth.

    *Position*: rms `|X_hat(t) - X(t)|` at 1,000 equal event times of the true path; *time*: rms
    t_hat - t on the rays of the visible pixels. Both in view of the camera.

    Parameters
    ----------
    path, truth : LightPath, Scene or truth
        Anything with `vertices_mm` (m, 3), mm, and `vertex_times_ps` (m,), ps. Where `path` ends
        early, its last leg is prolonged.
    camera : Camera
        Says what is in view.
    whole : bool
        True: the position is taken from source to exit, in view or not.

    Returns
    -------
    PathError
        mm and ps; the time is NaN where no ray meets the path.

    Raises
    ------
    GeometryError
        Where the camera does not see the true path at all.
    """
    check_kinds("path", "truth", "camera", path=path, truth=truth, camera=camera)
    true_vertices, true_times = _polyline(truth)
    vertices, times = _polyline(path)
    event_times = np.linspace(true_times[0], true_times[-1], _METRIC_TIMES)
    true_position = extrapolated_position(true_vertices, true_times, event_times)
    visible = camera.sees(true_position)
    if not visible.any():
        raise GeometryError("the camera sees no part of the true path: check the camera's pose")
    compared = _up_to_exit(visible) if yes_or_no("whole", whole) else visible
    found = extrapolated_position(vertices, times, event_times)
    offset = np.linalg.norm(found - true_position, axis=1)[compared]
    time_offset = _time_offsets(true_vertices, true_times, vertices, times, camera)
    return PathError(
        float(np.sqrt(np.mean(offset**2))),
        float(np.sqrt(np.mean(time_offset**2))) if len(time_offset) else float("nan"),
    )


def _polyline(path: Polyline) -> tuple[Floats, Floats]:
    """Vertices (m, 3), mm, and their event times (m,), ps; bent legs in many straight pieces."""
    vertices, times, _ = drawn(path)
    return vertices, times


def _up_to_exit(visible: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True from the source to the last visible moment."""
    last = int(np.flatnonzero(visible)[-1])
    return np.arange(len(visible)) <= last


def _time_offsets(
    true_vertices: Floats, true_times: Floats, vertices: Floats, times: Floats, camera: Camera
) -> Floats:
    """t_hat - t on the ray of every pixel whose field the true path crosses, leg by leg."""
    pixel_rad = 1.0 / np.sqrt(abs(camera.matrix[0, 0] * camera.matrix[1, 1]))
    offsets = []
    for leg in range(len(true_times) - 1):
        sights = _sights_along_leg(true_vertices[leg], true_vertices[leg + 1], camera)
        if not len(sights[1]):
            continue
        true_time, _ = _times_on_rays(sights, true_vertices, true_times, leg)
        on_leg = np.isfinite(true_time)
        found = [_times_on_rays(sights, vertices, times, k) for k in range(len(times) - 1)]
        candidates, misses = (np.stack(part) for part in zip(*found, strict=True))
        # The leg that the ray meets; where several do (crossings), the one that was there then.
        nearest = np.min(misses, axis=0, initial=np.inf)
        gap = np.where(misses <= nearest + 0.5 * pixel_rad, np.abs(candidates - true_time), np.inf)
        gap[~np.isfinite(gap)] = np.inf
        best = np.argmin(gap, axis=0)
        offset = candidates[best, np.arange(len(true_time))] - true_time
        offsets.append(offset[on_leg & np.isfinite(offset)])
    return np.concatenate(offsets) if offsets else np.empty(0)


def _sights_along_leg(start: Floats, end: Floats, camera: Camera) -> tuple[Floats, Floats]:
    """Origins and directions, (n, 3) each, of the distinct pixels whose field a leg crosses."""
    # Twenty steps per pixel for a leg that just fills the picture.
    fraction = np.linspace(0, 1, 20 * max(camera.shape) + 1)[:, np.newaxis]
    points = (1 - fraction) * start + fraction * end
    points = points[camera.sees(points)]
    if not len(points):
        return np.empty((0, 3)), np.empty((0, 3))
    row, col = camera.pixels_from_points(points)
    # A point on the outer edge of the last pixel still belongs to that pixel.
    pixels = np.minimum(np.rint(np.column_stack((row, col))), np.array(camera.shape) - 1)
    pixels = np.unique(pixels, axis=0)
    origins, rays, _ = camera.lines_of_sight(pixels[:, 0], pixels[:, 1])
    return origins, rays


def _times_on_rays(
    sights: tuple[Floats, Floats], vertices: Floats, times: Floats, leg: int
) -> tuple[Floats, Floats]:
    """Event time at the point of a leg's line nearest to each ray, and how far that is off.

    Returns (n,), ps, NaN off the leg; and (n,), angle between ray and point, rad, inf off the leg.
    Corners lie outside the picture, so the line may be prolonged, but not beyond its neighbours.
    """
    origins, rays = sights
    start, step = vertices[leg], vertices[leg + 1] - vertices[leg]
    # Nearest approach of the line start + f step to the line origin + g ray.
    across = step - np.sum(rays * step, axis=1)[:, np.newaxis] * rays
    offset = origins - start
    towards = offset - np.sum(rays * offset, axis=1)[:, np.newaxis] * rays
    fraction = np.sum(across * towards, axis=1) / np.maximum(np.sum(across**2, axis=1), 1e-300)
    time = times[leg] + fraction * (times[leg + 1] - times[leg])
    first, last = leg == 0, leg == len(times) - 2
    outside = ((fraction < -0.02) & (not first)) | ((fraction > 1.02) & (not last))
    sight = start + fraction[:, np.newaxis] * step - origins
    miss = np.arctan2(np.linalg.norm(np.cross(rays, sight), axis=1), np.sum(rays * sight, axis=1))
    return np.where(outside, np.nan, time), np.where(outside, np.inf, miss)
