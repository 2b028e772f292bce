"""What a picture needs to know about a path: points along it, with both times and their errors.

Takes a LightPath (or anything with `vertices_mm` and `vertex_times_ps`, such as a truth), gives a
`Trace` (dense points) and `PulsePlaces` (where on the path each measured pulse belongs). NumPy
only: figures, page and movie draw from the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.flight import Medium, return_time_from_points

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trace:
    """Points along a path, leg by leg, both ends of every leg included."""

    points_mm: Floats
    """(n, 3), world, mm."""

    event_time_ps: Floats
    """(n,), ps."""

    arrival_ps: Floats
    """(n,), ps; when light scattered there reaches the camera. NaN without a camera."""

    length_mm: Floats
    """(n,), mm along the path from vertex 0."""

    leg: NDArray[np.int64]
    """(n,), 0-based."""

    covariance: Floats
    """(n, 4, 4), x, y, z (mm) and t (ps) at this fraction of the leg; NaN where unknown."""

    in_view: NDArray[np.bool_]
    """(n,), True where the camera sees the point."""

    @property
    def std_mm(self) -> Floats:
        """(n,), mm: the longest semi-axis of the error ellipsoid across the leg."""
        return np.sqrt(np.maximum(across_axes(self)[0][:, 0], 0.0))

    @property
    def event_time_std_ps(self) -> Floats:
        """(n,), ps."""
        return np.sqrt(self.covariance[:, 3, 3])


def has_errors(path: Any) -> bool:
    """True where the path carries a finite covariance of the right size."""
    covariance = getattr(path, "covariance", None)
    if covariance is None:
        return False
    covariance = np.asarray(covariance, dtype=float)
    size = 4 * len(path.vertices_mm)
    return covariance.shape == (size, size) and bool(np.isfinite(np.diag(covariance)).all())


def _covariance_at(path: Any, leg: NDArray[np.int64], fraction: Floats) -> Floats:
    """(n, 4, 4): both ends of a leg propagated to a point at a fixed fraction of it."""
    if not has_errors(path):
        return np.full((len(leg), 4, 4), np.nan)
    blocks = np.asarray(path.covariance, dtype=float)
    m = len(path.vertices_mm)
    blocks = blocks.reshape(m, 4, m, 4).transpose(0, 2, 1, 3)
    f = fraction[:, np.newaxis, np.newaxis]
    start, end = blocks[leg, leg], blocks[leg + 1, leg + 1]
    cross = blocks[leg, leg + 1]
    both: Floats = (1 - f) ** 2 * start + f**2 * end
    return np.asarray(both + f * (1 - f) * (cross + np.swapaxes(cross, 1, 2)))


def trace_from_path(
    path: Any, *, camera: Any = None, medium: Any = None, per_leg: int = 65
) -> Trace:
    """Dense points along a path, with both times and the covariance.

    Parameters
    ----------
    path : LightPath, or a truth: needs `vertices_mm` (m, 3) and `vertex_times_ps` (m,).
    camera, medium : taken from the path where not given.
    per_leg : points on each leg, its two ends included.
    """
    camera = getattr(path, "camera", None) if camera is None else camera
    medium = getattr(path, "medium", None) if medium is None else medium
    vertices = np.asarray(path.vertices_mm, dtype=float).reshape(-1, 3)
    times = np.asarray(path.vertex_times_ps, dtype=float)
    n_legs = max(len(vertices) - 1, 0)
    leg = np.repeat(np.arange(n_legs), per_leg)
    fraction = np.tile(np.linspace(0.0, 1.0, per_leg), n_legs)
    points = vertices[leg] + fraction[:, np.newaxis] * (vertices[leg + 1] - vertices[leg])
    event = times[leg] + fraction * (times[leg + 1] - times[leg])
    lengths = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
    start = np.concatenate(([0.0], np.cumsum(lengths)))
    return Trace(
        points_mm=points,
        event_time_ps=event,
        arrival_ps=arrival_from_points(points, event, camera=camera, medium=medium),
        length_mm=start[leg] + fraction * lengths[leg],
        leg=leg,
        covariance=_covariance_at(path, leg, fraction),
        in_view=_in_view(points, camera),
    )


def _in_view(points: Floats, camera: Any) -> NDArray[np.bool_]:
    if camera is None or len(points) == 0:
        return np.ones(len(points), dtype=bool)
    return np.asarray(camera.sees(points), dtype=bool)


def arrival_from_points(
    points_mm: ArrayLike, event_time_ps: ArrayLike, *, camera: Any, medium: Any = None
) -> Floats:
    """Arrival time at the camera of light scattered at points; (...), ps, NaN without a camera."""
    event = np.asarray(event_time_ps, dtype=float)
    if camera is None:
        return np.full(event.shape, np.nan)
    medium = Medium() if medium is None else medium
    delay = return_time_from_points(
        points_mm,
        camera_center_mm=camera.center_mm,
        return_group_index=medium.return_group_index,
    )
    return np.asarray(event + delay)


def across_axes(trace: Trace) -> tuple[Floats, Floats]:
    """Error ellipse across the leg at every point.

    Returns variances (n, 2), mm², largest first, and the unit axes (n, 2, 3) they belong to, world.
    """
    n = len(trace.points_mm)
    variances, axes = np.full((n, 2), np.nan), np.zeros((n, 2, 3))
    for leg in np.unique(trace.leg):
        of_leg = trace.leg == leg
        points = trace.points_mm[of_leg]
        frame = frame_across(points[-1] - points[0])
        in_plane = frame @ trace.covariance[of_leg][:, :3, :3] @ frame.T
        if np.isfinite(in_plane).all():
            values, vectors = np.linalg.eigh(in_plane)
            variances[of_leg] = values[:, ::-1]
            axes[of_leg] = np.swapaxes(vectors, 1, 2)[:, ::-1] @ frame
        else:
            axes[of_leg] = frame
    return variances, axes


def frame_across(direction: ArrayLike) -> Floats:
    """Two unit vectors (2, 3) across a direction and across each other."""
    d = np.asarray(direction, dtype=float)
    size = np.linalg.norm(d)
    d = np.array([1.0, 0.0, 0.0]) if size == 0 else d / size
    helper = np.eye(3)[np.argmin(np.abs(d))]
    first = np.cross(d, helper)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(d, first)])


def position_at(path: Any, event_times_ps: ArrayLike) -> Floats:
    """(n, 3), world, mm: where the pulse is at these event times; NaN before and after the path."""
    own = getattr(path, "position_at", None)
    if own is not None:
        return np.asarray(own(event_times_ps), dtype=float)
    when = np.atleast_1d(np.asarray(event_times_ps, dtype=float))
    times = np.asarray(path.vertex_times_ps, dtype=float)
    vertices = np.asarray(path.vertices_mm, dtype=float)
    place = np.stack([np.interp(when, times, vertices[:, k]) for k in range(3)], axis=-1)
    place[(when < times[0]) | (when > times[-1])] = np.nan
    return place


def event_time_from_arrival_on(trace: Trace, arrival_ps: ArrayLike) -> Floats:
    """Event time of the point whose light arrives at these times; (...), ps, NaN outside.

    Unique, since along a path t_a grows whenever t does (n_p >= n_r).
    """
    arrival = np.asarray(arrival_ps, dtype=float)
    if len(trace.arrival_ps) == 0:
        return np.full(arrival.shape, np.nan)
    event = np.interp(arrival, trace.arrival_ps, trace.event_time_ps, left=np.nan, right=np.nan)
    return np.asarray(event)


@dataclass(frozen=True, eq=False)
class PulsePlaces:
    """Where on the path each measured pulse of `path.residuals` belongs."""

    row: NDArray[np.int64]
    """(n,)."""

    col: NDArray[np.int64]
    """(n,)."""

    leg: NDArray[np.int64]
    """(n,), 0-based; -1 where the pulse belongs to no leg."""

    points_mm: Floats
    """(n, 3), world: the point of the leg nearest to the pixel's ray; NaN without leg."""

    length_mm: Floats
    """(n,), mm along the path."""

    event_time_ps: Floats
    """(n,), of that point by the path."""

    measured_event_time_ps: Floats
    """(n,), ps: `event_time_ps` plus the residual. (Arrival minus the way to the camera would
    forget that a pixel's time belongs to its whole footprint, not to the ray of its centre.)"""

    arrival_ps: Floats
    """(n,), measured."""

    residual_ps: Floats
    """(n,), measured minus model."""

    std_ps: Floats
    """(n,)."""

    used: NDArray[np.bool_]
    """(n,), True where the fit used the pulse."""

    @property
    def pull(self) -> Floats:
        """(n,), residual / std."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.residual_ps / self.std_ps)


def nearest_on_leg(
    rays: ArrayLike, camera_center_mm: ArrayLike, start_mm: ArrayLike, end_mm: ArrayLike
) -> Floats:
    """Fraction along the line start → end where it comes nearest to each ray; (...).

    All (..., 3), world; rays start at the camera centre. Parallel lines give NaN.
    """
    r = np.asarray(rays, dtype=float)
    start = np.asarray(start_mm, dtype=float)
    along = np.asarray(end_mm, dtype=float) - start
    offset = start - np.asarray(camera_center_mm, dtype=float)
    along_r = np.sum(along * r, axis=-1)
    offset_r = np.sum(offset * r, axis=-1)
    denominator = np.sum(along * along, axis=-1) - along_r**2
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = (along_r * offset_r - np.sum(along * offset, axis=-1)) / denominator
    return np.asarray(np.where(denominator > 0, fraction, np.nan))


def places_from_path(path: Any) -> PulsePlaces:
    """Place every measured pulse of `path.residuals` on its leg.

    A path without residuals, or without a camera, gives an empty table.
    """
    table = getattr(path, "residuals", None)
    camera = getattr(path, "camera", None)
    if table is None or camera is None or len(table) == 0:
        table = np.zeros(0, dtype=[(n, float) for n in _RESIDUAL_FIELDS])
    row, col = table["row"].astype(np.int64), table["col"].astype(np.int64)
    leg = table["leg"].astype(np.int64)
    vertices = np.asarray(path.vertices_mm, dtype=float).reshape(-1, 3)
    times = np.asarray(path.vertex_times_ps, dtype=float)
    known = (leg >= 0) & (leg < len(vertices) - 1)
    points = np.full((len(leg), 3), np.nan)
    length, event = np.full(len(leg), np.nan), np.full(len(leg), np.nan)
    if camera is not None and known.any():
        on = leg[known]
        rays = camera.rays_from_pixels(row[known].astype(float), col[known].astype(float))
        f = nearest_on_leg(rays, camera.center_mm, vertices[on], vertices[on + 1])
        spans = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
        start = np.concatenate(([0.0], np.cumsum(spans)))
        points[known] = vertices[on] + f[:, np.newaxis] * (vertices[on + 1] - vertices[on])
        length[known] = start[on] + f * spans[on]
        event[known] = times[on] + f * (times[on + 1] - times[on])
    return PulsePlaces(
        row=row,
        col=col,
        leg=np.where(known, leg, -1),
        points_mm=points,
        length_mm=length,
        event_time_ps=event,
        measured_event_time_ps=event + table["residual_ps"].astype(float),
        arrival_ps=table["arrival_ps"].astype(float),
        residual_ps=table["residual_ps"].astype(float),
        std_ps=table["std_ps"].astype(float),
        used=table["used"].astype(bool),
    )


_RESIDUAL_FIELDS = (
    "row",
    "col",
    "leg",
    "arrival_ps",
    "model_ps",
    "residual_ps",
    "std_ps",
    "used",
)


def true_event_time_along(trace: Trace, truth: Any, *, camera: Any) -> Floats:
    """True event time on the camera's ray through every point of a trace; (n,), ps.

    Leg k of the trace is held against leg k of the truth (counted from the last leg where the
    truth has more of them); NaN where the truth has no such leg or no camera is known.
    """
    vertices = np.asarray(truth.vertices_mm, dtype=float)
    times = np.asarray(truth.vertex_times_ps, dtype=float)
    if camera is None or len(trace.leg) == 0:
        return np.full(len(trace.leg), np.nan)
    rays = trace.points_mm - camera.center_mm
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    n_legs = len(vertices) - 1
    leg = trace.leg + max(0, n_legs - int(trace.leg.max()) - 1)
    known = leg < n_legs
    leg = np.minimum(leg, n_legs - 1)
    fraction = nearest_on_leg(rays, camera.center_mm, vertices[leg], vertices[leg + 1])
    when = times[leg] + fraction * (times[leg + 1] - times[leg])
    return np.asarray(np.where(known, when, np.nan))
