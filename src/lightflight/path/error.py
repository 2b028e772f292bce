"""How far a reconstructed path is from the truth, by the metrics every table of ours uses."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightflight.arguments import check_kinds, yes_or_no
from lightflight.errors import GeometryError
from lightflight.path.on_bends import drawn, starts_of_pieces
from lightflight.path.on_legs import extrapolated_position
from lightflight.path.tables import Polyline
from lightflight.path.tree import last_legs, ways

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

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
    t_hat - t on the rays of the visible pixels. Both in view of the camera. Where light forks,
    positions are compared branch by branch: each true branch with the found one that comes nearest
    to it, and each found one that is left over with the nearest true one, so that an arm that was
    missed counts, and one that is not there too. Squares of all are averaged.

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
    up_to_exit = yes_or_no("whole", whole)
    true_branches, branches = _branches(truth), _branches(path)
    squares = [
        [_squares(own, other, camera, up_to_exit) for own in branches] for other in true_branches
    ]
    if not any(len(row[0]) for row in squares):
        raise GeometryError("the camera sees no part of the true path: check the camera's pose")
    off = [squares[k][m] for k, m in _nearest_pairs(squares)]
    time_offset = _time_offsets(_polyline(truth), _polyline(path), camera)
    return PathError(
        float(np.sqrt(np.mean(np.concatenate(off)))),
        float(np.sqrt(np.mean(time_offset**2))) if len(time_offset) else float("nan"),
    )


def _branches(path: Polyline) -> list[tuple[Floats, Floats]]:
    """Vertices (k, 3), mm, and event times (k,), ps, of each way of the light to an end."""
    vertices, times, starts = _polyline(path)
    chains = [[0, *(leg + 1 for leg in way)] for way in ways(starts)]
    return [(vertices[chain], times[chain]) for chain in chains]


def _squares(
    found: tuple[Floats, Floats], true: tuple[Floats, Floats], camera: Camera, up_to_exit: bool
) -> Floats:
    """(n,), mm^2: `|X_hat(t) - X(t)|^2` of one branch at the true event times that are compared."""
    event_times = np.linspace(true[1][0], true[1][-1], _METRIC_TIMES)
    true_position = extrapolated_position(*true, event_times)
    visible = camera.sees(true_position)
    compared = _up_to_exit(visible) if up_to_exit and visible.any() else visible
    offset = np.linalg.norm(extrapolated_position(*found, event_times) - true_position, axis=1)
    squares: Floats = offset[compared] ** 2
    return squares


def _nearest_pairs(squares: list[list[Floats]]) -> list[tuple[int, int]]:
    """Pairs (true branch, found branch): each with its nearest, until none is left over."""
    mean = np.array([[np.mean(own) if len(own) else np.nan for own in row] for row in squares])
    # A true branch that nobody could see says nothing of any that was found.
    seen = np.flatnonzero(np.isfinite(mean[:, 0]))
    pairs = [(int(k), int(np.argmin(mean[k]))) for k in seen]
    left = set(range(mean.shape[1])) - {m for _, m in pairs}
    return pairs + [(int(seen[np.argmin(mean[seen, m])]), m) for m in sorted(left)]


def _polyline(path: Polyline) -> tuple[Floats, Floats, Indices]:
    """Vertices (m, 3), mm, their event times (m,), ps, and the vertex where each leg begins.

    Bent legs come in many straight pieces.
    """
    vertices, times, of_leg = drawn(path)
    return vertices, times, starts_of_pieces(path, of_leg)


def _up_to_exit(visible: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True from the source to the last visible moment."""
    last = int(np.flatnonzero(visible)[-1])
    return np.arange(len(visible)) <= last


def _time_offsets(
    truth: tuple[Floats, Floats, Indices], path: tuple[Floats, Floats, Indices], camera: Camera
) -> Floats:
    """t_hat - t on the ray of every pixel whose field the true path crosses, leg by leg."""
    pixel_rad = 1.0 / np.sqrt(abs(camera.matrix[0, 0] * camera.matrix[1, 1]))
    true_vertices, _, true_starts = truth
    true_ends, ends, offsets = last_legs(true_starts), last_legs(path[2]), []
    for leg, start in enumerate(true_starts):
        sights = _sights_along_leg(true_vertices[start], true_vertices[leg + 1], camera)
        if not len(sights[1]):
            continue
        true_time, _ = _times_on_rays(sights, truth, leg, last=leg in true_ends)
        on_leg = np.isfinite(true_time)
        found = [_times_on_rays(sights, path, k, last=k in ends) for k in range(len(path[2]))]
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
    sights: tuple[Floats, Floats], path: tuple[Floats, Floats, Indices], leg: int, *, last: bool
) -> tuple[Floats, Floats]:
    """Event time at the point of a leg's line nearest to each ray, and how far that is off.

    Returns (n,), ps, NaN off the leg; and (n,), angle between ray and point, rad, inf off the leg.
    Corners lie outside the picture, so the line may be prolonged, but not beyond its neighbours.
    """
    origins, rays = sights
    vertices, times, starts = path
    first_vertex = starts[leg]
    start, step = vertices[first_vertex], vertices[leg + 1] - vertices[first_vertex]
    # Nearest approach of the line start + f step to the line origin + g ray.
    across = step - np.sum(rays * step, axis=1)[:, np.newaxis] * rays
    offset = origins - start
    towards = offset - np.sum(rays * offset, axis=1)[:, np.newaxis] * rays
    fraction = np.sum(across * towards, axis=1) / np.maximum(np.sum(across**2, axis=1), 1e-300)
    time = times[first_vertex] + fraction * (times[leg + 1] - times[first_vertex])
    outside = ((fraction < -0.02) & (leg != 0)) | ((fraction > 1.02) & (not last))
    sight = start + fraction[:, np.newaxis] * step - origins
    miss = np.arctan2(np.linalg.norm(np.cross(rays, sight), axis=1), np.sum(rays * sight, axis=1))
    return np.where(outside, np.nan, time), np.where(outside, np.inf, miss)
