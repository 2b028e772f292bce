"""What a picture needs to know about a path: points along it, with both times and their errors.

Takes a LightPath (or anything with `vertices_mm` and `vertex_times_ps`, such as a truth), gives a
`Trace` (dense points) and `PulsePlaces` (where on the path each measured pulse belongs). NumPy
only: figures, page and movie draw from the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.display import Shown
from lightflight.flight import Medium
from lightflight.path.glass import flown_path
from lightflight.path.on_bends import courses_of, covariance_on_bent_leg, positions_on
from lightflight.path.on_legs import covariance_on_legs, sliding_maps
from lightflight.path.tables import RESIDUAL_DTYPE, Polyline
from lightflight.path.tree import forks_of, starts_of, way_before, ways

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.path.light_path import LightPath

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Trace(Shown):
    """Points along a path, leg by leg, both ends of every leg included.

    Attributes
    ----------
    points_mm : array of float, shape (n, 3)
        World, mm.
    event_time_ps : array of float, shape (n,)
        ps.
    arrival_ps : array of float, shape (n,)
        ps; when light scattered there reaches the camera. NaN without a camera.
    length_mm : array of float, shape (n,)
        mm along the path from vertex 0; where it forks, along the way that leads there.
    leg : array of int, shape (n,)
        0-based.
    covariance : array of float, shape (n, 4, 4)
        X, y, z (mm) and t (ps) at this fraction of the leg (beside a leg that nobody saw: in this
        plane of sight); NaN where unknown.
    in_view : array of bool, shape (n,)
        True where the camera sees the point; on legs that nobody saw it never does.
    """

    points_mm: Floats

    event_time_ps: Floats

    arrival_ps: Floats

    length_mm: Floats

    leg: NDArray[np.int64]

    covariance: Floats

    in_view: NDArray[np.bool_]

    @property
    def std_mm(self) -> Floats:
        """(n,), mm: the longest semi-axis of the error ellipsoid across the leg."""
        return np.sqrt(np.maximum(across_axes(self)[0][:, 0], 0.0))

    @property
    def event_time_std_ps(self) -> Floats:
        """(n,), ps."""
        return np.sqrt(self.covariance[:, 3, 3])


def has_errors(path: Polyline) -> bool:
    """Whether a path carries a finite covariance of the right size.

    Parameters
    ----------
    path : LightPath or truth
        A truth has none.
    """
    covariance = getattr(path, "covariance", None)
    if covariance is None:
        return False
    covariance = np.asarray(covariance, dtype=float)
    size = 4 * len(np.asarray(path.vertices_mm))
    return covariance.shape == (size, size) and bool(np.isfinite(np.diag(covariance)).all())


def _covariance_at(
    path: Polyline, leg: NDArray[np.int64], fraction: Floats, points: Floats
) -> Floats:
    """(n, 4, 4): at a fixed fraction of the leg, or in the plane of sight beside an unseen one."""
    if not has_errors(path):
        return np.full((len(leg), 4, 4), np.nan)
    whole = np.asarray(getattr(path, "covariance", None), dtype=float)
    found = covariance_on_legs(whole, leg, fraction, starts=starts_of(path))
    if not unseen_legs_of(path):
        return found
    maps = sliding_maps(cast("LightPath", path), leg, points)
    held: Floats = maps @ found @ np.swapaxes(maps, 1, 2)
    return held


def trace_from_path(
    path: Polyline, *, camera: Camera | None = None, medium: Medium | None = None, per_leg: int = 65
) -> Trace:
    """Dense points along a path, with both times and the covariance.

    Parameters
    ----------
    path : LightPath or truth
        Needs `vertices_mm` (m, 3), mm, and `vertex_times_ps` (m,), ps.
    camera : Camera, optional
        Taken from the path where not given.
    medium : Medium, optional
        Taken from the path where not given.
    per_leg : int
        Points on each leg, its two ends included.

    Returns
    -------
    Trace
        Without a camera, arrival times are NaN and all is in view.
    """
    camera = getattr(path, "camera", None) if camera is None else camera
    medium = getattr(path, "medium", None) if medium is None else medium
    path = flown_path(path)
    vertices = np.asarray(path.vertices_mm, dtype=float).reshape(-1, 3)
    times = np.asarray(path.vertex_times_ps, dtype=float)
    n_legs = max(len(vertices) - 1, 0)
    leg = np.repeat(np.arange(n_legs), per_leg)
    fraction = np.tile(np.linspace(0.0, 1.0, per_leg), n_legs)
    starts = starts_of(path)
    first = starts[leg]
    points = vertices[first] + fraction[:, np.newaxis] * (vertices[leg + 1] - vertices[first])
    event = times[first] + fraction * (times[leg + 1] - times[first])
    lengths = np.linalg.norm(vertices[1:] - vertices[starts], axis=1)
    covariance = _covariance_at(path, leg, fraction, points)
    for course in courses_of(path):
        # `fraction` is of the leg's time, and so of its length.
        here, told = leg == course.leg, cast("LightPath", path)
        points[here] = positions_on(told, event[here])
        lengths[course.leg] = course.ways_mm(np.ones(1))[0]
        if has_errors(path):
            covariance[here] = covariance_on_bent_leg(told, course, fraction[here])
    return Trace(
        points_mm=points,
        event_time_ps=event,
        arrival_ps=arrival_from_points(points, event, camera=camera, medium=medium),
        length_mm=way_before(starts, lengths)[first] + fraction * lengths[leg],
        leg=leg,
        covariance=covariance,
        in_view=_in_view(points, camera) & ~np.isin(leg, unseen_legs_of(path)),
    )


def traces_of_branches(trace: Trace, path: Polyline) -> tuple[Trace, ...]:
    """The trace of each way of the light to an end, on which both times ascend.

    Parameters
    ----------
    trace : Trace
        Of the whole path.
    path : LightPath or truth
        Whose trace it is.

    Returns
    -------
    tuple of Trace
        In the order of the path's branches, legs numbered as in the whole; the trace itself where
        nothing forks.
    """
    if not forks_of(path):
        return (trace,)
    taken = [np.isin(trace.leg, way) for way in ways(starts_of(path))]
    return tuple(
        Trace(**{one.name: getattr(trace, one.name)[own] for one in fields(Trace)}) for own in taken
    )


def parted(trace: Trace, values: Floats) -> Floats:
    """Values along a trace, to be drawn as one line: NaN before each leg that forks off.

    Parameters
    ----------
    trace : Trace
        n points.
    values : array of float, shape (n, ...)
        Of each point.

    Returns
    -------
    array of float, shape (n + forks, ...)
    """
    next_leg = np.flatnonzero(np.diff(trace.leg)) + 1
    # A leg begins at the very vertex where the leg before ends, unless it forks off.
    apart = (trace.points_mm[next_leg] != trace.points_mm[next_leg - 1]).any(axis=1)
    # Rounding may part what is one place; a picometre is no fork.
    apart &= ~np.isclose(trace.points_mm[next_leg], trace.points_mm[next_leg - 1]).all(axis=1)
    return np.insert(np.asarray(values, dtype=float), next_leg[apart], np.nan, axis=0)


def unseen_legs_of(path: Polyline) -> tuple[int, ...]:
    """Legs, by number, that no picture showed; () of a truth.

    Parameters
    ----------
    path : LightPath or truth
        The path.
    """
    return tuple(getattr(path, "unseen_legs", ()))


def _in_view(points: Floats, camera: Camera | None) -> NDArray[np.bool_]:
    """(n,), True where the camera sees the point; everywhere without a camera."""
    if camera is None or len(points) == 0:
        return np.ones(len(points), dtype=bool)
    return np.asarray(camera.sees(points), dtype=bool)


def arrival_from_points(
    points_mm: ArrayLike,
    event_time_ps: ArrayLike,
    *,
    camera: Camera | None,
    medium: Medium | None = None,
) -> Floats:
    """Arrival time at the camera of light scattered at points: t_a = t + n_r |A - X| / c.

    Parameters
    ----------
    points_mm : array of float, shape (..., 3)
        World, mm.
    event_time_ps : array of float, shape (...)
        When the pulse was there, ps.
    camera : Camera or None
        None: nobody looks.
    medium : Medium or None
        None: air.

    Returns
    -------
    array of float, shape (...)
        ps, on the clock of `event_time_ps`; NaN without a camera.
    """
    event = np.asarray(event_time_ps, dtype=float)
    if camera is None:
        return np.full(event.shape, np.nan)
    medium = Medium() if medium is None else medium
    delay = camera.return_times_ps(points_mm, return_group_index=medium.return_group_index)
    return np.asarray(event + delay)


def across_axes(trace: Trace) -> tuple[Floats, Floats]:
    """Error ellipse across the leg at every point.

    Parameters
    ----------
    trace : Trace
        Points with their covariance.

    Returns
    -------
    variances : array of float, shape (n, 2)
        mm^2, largest first; NaN where the covariance is not known.
    axes : array of float, shape (n, 2, 3)
        Unit vectors they belong to, world.
    """
    n = len(trace.points_mm)
    variances, axes = np.full((n, 2), np.nan), np.zeros((n, 2, 3))
    for leg in np.unique(trace.leg):
        # One frame for the whole leg, a bent one too: outlines of its errors do not twist.
        of_leg = trace.leg == leg
        points = trace.points_mm[of_leg]
        frame = frame_across(points[-1] - points[0])
        in_plane = frame @ trace.covariance[of_leg][:, :3, :3] @ frame.T
        if np.isfinite(in_plane).all():
            values, vectors = np.linalg.eigh(in_plane)
            # eigh ascends; the largest goes first here.
            variances[of_leg] = values[:, ::-1]
            axes[of_leg] = np.swapaxes(vectors, 1, 2)[:, ::-1] @ frame
        else:
            axes[of_leg] = frame
    return variances, axes


def frame_across(direction: ArrayLike) -> Floats:
    """Two unit vectors across a direction and across each other.

    Parameters
    ----------
    direction : array of float, shape (3,)
        Of any length; zero stands for x.

    Returns
    -------
    array of float, shape (2, 3)
        With the direction a right-handed set.

    Examples
    --------
    >>> frame_across((0.0, 0.0, 2.0))
    array([[ 0.,  1.,  0.],
           [-1.,  0.,  0.]])
    """
    d = np.asarray(direction, dtype=float)
    size = np.linalg.norm(d)
    d = np.array([1.0, 0.0, 0.0]) if size == 0 else d / size
    # The axis furthest from the direction: their cross product cannot vanish.
    helper = np.eye(3)[np.argmin(np.abs(d))]
    first = np.cross(d, helper)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(d, first)])


def position_at(path: Polyline, event_times_ps: ArrayLike) -> Floats:
    """Where the pulse is at event times.

    Parameters
    ----------
    path : LightPath or truth
        Anything with `vertices_mm` (m, 3), mm, and `vertex_times_ps` (m,), ps.
    event_times_ps : array of float, shape (n,)
        ps.

    Returns
    -------
    array of float, shape (n, 3)
        World, mm; NaN before and after the path, and on legs that nobody saw.
    """
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
    """Event time of the point whose light arrives at these times.

    Unique, since along a path t_a grows whenever t does (n_p >= n_r).

    Parameters
    ----------
    trace : Trace
        With arrival times.
    arrival_ps : array of float, shape (...)
        ps.

    Returns
    -------
    array of float, shape (...)
        ps; NaN outside.
    """
    arrival = np.asarray(arrival_ps, dtype=float)
    if len(trace.arrival_ps) == 0:
        return np.full(arrival.shape, np.nan)
    event = np.interp(arrival, trace.arrival_ps, trace.event_time_ps, left=np.nan, right=np.nan)
    return np.asarray(event)


@dataclass(frozen=True, eq=False)
class PulsePlaces:
    """Where on the path each measured pulse of `path.residuals` belongs.

    Attributes
    ----------
    row : array of int
        (n,).
    col : array of int
        (n,).
    leg : array of int, shape (n,)
        0-based; -1 where the pulse belongs to no leg.
    points_mm : array of float, shape (n, 3)
        World: the point of the leg nearest to the pixel's ray; NaN without leg.
    length_mm : array of float, shape (n,)
        mm along the path.
    event_time_ps : array of float, shape (n,)
        Of that point by the path.
    measured_event_time_ps : array of float, shape (n,)
        ps: `event_time_ps` plus the residual. (Arrival minus the way to the camera would
        forget that a pixel's time belongs to its whole footprint, not to the ray of its centre.)
    arrival_ps : array of float, shape (n,)
        Measured.
    residual_ps : array of float, shape (n,)
        Measured minus model.
    std_ps : array of float
        (n,).
    used : array of bool, shape (n,)
        True where the fit used the pulse.
    """

    row: NDArray[np.int64]

    col: NDArray[np.int64]

    leg: NDArray[np.int64]

    points_mm: Floats

    length_mm: Floats

    event_time_ps: Floats

    measured_event_time_ps: Floats

    arrival_ps: Floats

    residual_ps: Floats

    std_ps: Floats

    used: NDArray[np.bool_]

    @property
    def pull(self) -> Floats:
        """(n,), residual / std."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.residual_ps / self.std_ps)


def nearest_on_leg(
    rays: ArrayLike, camera_center_mm: ArrayLike, start_mm: ArrayLike, end_mm: ArrayLike
) -> Floats:
    """Fraction along the line start -> end where it comes nearest to each ray.

    Parameters
    ----------
    rays : array of float, shape (..., 3)
        Unit vectors, world, from the camera outwards.
    camera_center_mm, start_mm, end_mm : array of float, shape (..., 3)
        World, mm; of the first, any point of each ray will do.

    Returns
    -------
    array of float, shape (...)
        0 at the start, 1 at the end, not clipped; NaN for parallel lines.
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


def places_from_path(path: Polyline) -> PulsePlaces:
    """Place every measured pulse of `path.residuals` on its leg.

    Parameters
    ----------
    path : LightPath or truth
        Without residuals, or without a camera, the table is empty.

    Returns
    -------
    PulsePlaces
        In the order of `residuals`.
    """
    table = getattr(path, "residuals", None)
    camera = getattr(path, "camera", None)
    if table is None or camera is None or len(table) == 0:
        table = np.zeros(0, RESIDUAL_DTYPE)
    row, col = table["row"].astype(np.int64), table["col"].astype(np.int64)
    leg = table["leg"].astype(np.int64)
    vertices = np.asarray(path.vertices_mm, dtype=float).reshape(-1, 3)
    times = np.asarray(path.vertex_times_ps, dtype=float)
    known = (leg >= 0) & (leg < len(vertices) - 1)
    points = np.full((len(leg), 3), np.nan)
    length, event = np.full(len(leg), np.nan), np.full(len(leg), np.nan)
    if camera is not None and known.any():
        on, starts = leg[known], starts_of(path)
        first = starts[on]
        origins, rays, _ = camera.lines_of_sight(row[known].astype(float), col[known].astype(float))
        f = nearest_on_leg(rays, origins, vertices[first], vertices[on + 1])
        spans = np.linalg.norm(vertices[1:] - vertices[starts], axis=1)
        for course in courses_of(path):
            spans[course.leg] = course.ways_mm(np.ones(1))[0]
        before = way_before(starts, spans)
        points[known] = vertices[first] + f[:, np.newaxis] * (vertices[on + 1] - vertices[first])
        length[known] = before[first] + f * spans[on]
        event[known] = times[first] + f * (times[on + 1] - times[first])
        for course in courses_of(path):
            # The fit says when light of each pulse was on the curve.
            here = leg == course.leg
            event[here] = table["event_time_ps"][here]
            points[here] = positions_on(cast("LightPath", path), event[here])
            share = (event[here] - times[course.leg]) / np.diff(times)[course.leg]
            length[here] = before[course.leg] + share * spans[course.leg]
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


def true_event_time_along(trace: Trace, truth: Polyline, *, camera: Camera | None) -> Floats:
    """True event time on the camera's ray through every point of a trace.

    Leg k of the trace is held against leg k of the truth (counted from the last leg where the
    truth has more of them); where the truth forks, against the leg that is nearest at its times.

    Parameters
    ----------
    trace : Trace
        Points along the path that was found.
    truth : LightPath or truth
        Needs `vertices_mm` (m, 3), mm, and `vertex_times_ps` (m,), ps.
    camera : Camera or None
        Whose rays.

    Returns
    -------
    array of float, shape (n,)
        ps; NaN where the truth has no such leg or no camera is known.
    """
    vertices = np.asarray(truth.vertices_mm, dtype=float)
    times = np.asarray(truth.vertex_times_ps, dtype=float)
    if camera is None or len(trace.leg) == 0:
        return np.full(len(trace.leg), np.nan)
    rays = camera.sight_directions(trace.points_mm)
    n_legs = len(vertices) - 1
    starts = starts_of(truth)
    if forks_of(truth):
        leg = _nearest_legs(trace, truth)
    else:
        leg = trace.leg + max(0, n_legs - int(trace.leg.max()) - 1)
    known = leg < n_legs
    leg = np.minimum(leg, n_legs - 1)
    first = starts[leg]
    fraction = nearest_on_leg(rays, trace.points_mm, vertices[first], vertices[leg + 1])
    when = times[first] + fraction * (times[leg + 1] - times[first])
    return np.asarray(np.where(known, when, np.nan))


def _nearest_legs(trace: Trace, truth: Polyline) -> NDArray[np.int64]:
    """(n,), for each leg of a trace the leg of the truth that is nearest to it at its times."""
    vertices = np.asarray(truth.vertices_mm, dtype=float)
    times = np.asarray(truth.vertex_times_ps, dtype=float)
    starts = starts_of(truth)
    t0, t1 = times[starts], times[1:]
    f = (trace.event_time_ps[:, np.newaxis] - t0) / (t1 - t0)
    places = vertices[starts] + f[:, :, np.newaxis] * (vertices[1:] - vertices[starts])
    off = np.linalg.norm(places - trace.points_mm[:, np.newaxis], axis=2)
    # Beyond its own ends a leg is only a line.
    off[(f < -0.5) | (f > 1.5)] = np.inf
    nearest = np.zeros(len(trace.leg), dtype=np.int64)
    for leg in np.unique(trace.leg):
        own = trace.leg == leg
        nearest[own] = int(np.argmin(np.median(off[own], axis=0)))
    return nearest
