"""Where the pixels look along a polyline, and when its light reaches them, with derivatives.

Exact in three dimensions: any direction, any camera pose and distortion, different indices on
the way out and back. The state of a path is its vertices and the event time at the first one;
`freedom.Freedom` says which of these a fit may move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.flight import Medium
from lightflight.path.glass import late_jacobian
from lightflight.reconstruct.model.state import (
    PathState as PathState,  # many take it from here
    state_of_path as state_of_path,
)
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS
from lightflight.vectors import finite, lengths, summed

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_MOST_FOOT_STEPS_BENT = 20
"""Of Newton's method on a curve, from the straight line between its ends: each leaves a tenth where
a pixel lies 3 px beside a curve whose radius is 30 px."""


@dataclass(frozen=True, eq=False)
class Footprint:
    """Where each pixel looks along its leg, and what follows.

    Attributes
    ----------
    leg : array of int, shape (n,)
        Index of the leg.
    fraction : array of float, shape (n,)
        Foot of the pixel along the leg: 0 at its start, 1 at its end; may lie outside.
    lateral_px : array of float, shape (n,)
        Distance of the pixel's centre from the leg in the picture, px, signed: positive to the
        right of the flight as the picture is shown (row down).
    arrival_ps : array of float, shape (n,)
        Arrival time of light from the foot, ps.
    slope_ps_per_px : array of float, shape (n,)
        d(arrival time) / d(picture length), ps per px.
    px_per_leg : array of float, shape (n,)
        d(picture length) / d(fraction), px.
    distance_mm : array of float, shape (n,)
        Foot to the camera, or to the last interface that it looks through, mm.
    """

    leg: Indices
    fraction: Floats
    lateral_px: Floats
    arrival_ps: Floats
    slope_ps_per_px: Floats
    px_per_leg: Floats
    distance_mm: Floats


def nearest_fractions(
    state: PathState,
    camera: Camera,
    legs: Indices,
    rows: Floats,
    cols: Floats,
    own_rays: Floats | None = None,
) -> Floats:
    """Fraction of its leg that each pixel sees nearest to its centre; (n,).

    "Nearest" is in pixels, where the spot is round: Newton's method from the nearest approach
    in space to the straight line between the leg's ends.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    camera : Camera
        The camera that sees it.
    legs : array of int, shape (n,)
        The leg of each pixel.
    rows : array of float, shape (n,)
        Pixel rows.
    cols : array of float, shape (n,)
        Pixel columns.
    own_rays : array of float, shape (n, 3), optional
        By `Camera.own_rays`, where they are known already.

    Returns
    -------
    array of float, shape (n,)
        0 at the start, 1 at the end; may lie outside.
    """
    origins, rays, _ = camera.lines_of_sight(rows, cols, own_rays=own_rays)
    start, step = state.starts_mm[legs], state.steps_mm[legs]
    across = step - summed(rays * step)[:, np.newaxis] * rays
    offset = origins - start
    offset = offset - summed(rays * offset)[:, np.newaxis] * rays
    # A leg along the ray has no nearest point; any will do, none counts.
    size = np.maximum(summed(across**2), 1e-12)
    fraction: Floats = summed(across * offset) / size
    bent = bool(state.is_bent(legs).any())
    for _ in range(_MOST_FOOT_STEPS_BENT if bent else 4):
        if bent:
            points, along = state.points_mm(legs, fraction), state.tangents_mm(legs, fraction)
        else:
            points, along = start + fraction[:, np.newaxis] * step, step
        (row, col), (down, right) = camera.pixels_and_speeds(points, along)
        towards = (rows - row) * down + (cols - col) * right
        change = towards / np.maximum(down**2 + right**2, 1e-12)
        # Near a vanishing point the picture speeds up along the leg: keep Newton on a leash.
        change = np.clip(finite(change), -0.5, 0.5)
        fraction = fraction + change
        if np.abs(change).max(initial=0.0) < 1e-4:  # Newton: the next would be 1e-8
            break
    return fraction


def footprints(
    state: PathState,
    *,
    camera: Camera,
    medium: Medium,
    legs: Indices | int,
    rows: ArrayLike,
    cols: ArrayLike,
) -> Footprint:
    """Footprint of each pixel on its leg; `rows`, `cols` are (n,), `legs` too or one for all.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    camera : Camera
        The camera that sees it.
    medium : Medium
        Group indices out and back.
    legs : array of int, shape (n,) or int
        The leg of each pixel, or one for all.
    rows : array_like, shape (n,)
        Pixel rows.
    cols : array_like, shape (n,)
        Pixel columns.

    Returns
    -------
    Footprint
        (n,) each.

    Notes
    -----
    Implements t_a = t_k + (n_p f l + n_r |A - X(f)|) / c at the foot X(f) of each pixel (method.md,
    Flight).
    """
    return footprints_and_slopes(state, camera, medium, legs, rows, cols)[0]


def arrival_jacobian(
    state: PathState,
    *,
    camera: Camera,
    medium: Medium,
    legs: Indices | int,
    rows: ArrayLike,
    cols: ArrayLike,
) -> tuple[Footprint, Floats]:
    """Footprints, and d(arrival time) / d(vertices (3m), start time); (n, size).

    The foot is the point nearest to the pixel in the picture; how it slides when the leg moves
    is included to first order (exactly where the pixel's centre is on the leg).

    Parameters
    ----------
    state : PathState
        The path as it is now.
    camera : Camera
        The camera that sees it.
    medium : Medium
        Group indices out and back.
    legs : array of int, shape (n,) or int
        The leg of each pixel, or one for all.
    rows : array_like, shape (n,)
        Pixel rows.
    cols : array_like, shape (n,)
        Pixel columns.

    Returns
    -------
    print_ : Footprint
        (n,) each.
    jacobian : array of float, shape (n, size)
        ps per mm and ps per ps.
    """
    print_, jacobian = footprints_and_slopes(state, camera, medium, legs, rows, cols)
    return print_, jacobian()


def overshoots(
    state: PathState, print_: Footprint, *, camera: Camera
) -> tuple[Floats, Callable[[], Floats]]:
    """How far pixels lie beyond the corners of their own leg, and what gives the derivative.

    A leg ends at its corner, so light that belongs to it lies before: (n,) px, 0 for every pixel
    within, and (n, size) px per mm. The ends of the path are no corners.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    print_ : Footprint
        Where each pixel looks along its leg.
    camera : Camera
        The camera that sees it.

    Returns
    -------
    beyond : array of float, shape (n,)
        Signed, 0 within the leg, px.
    jacobian : callable
        Gives array of float, shape (n, size), px per mm.
    """
    f = print_.fraction
    ends = np.zeros(state.n_legs, dtype=bool)
    ends[list(state.last_legs)] = True
    ends = ends[print_.leg]
    beyond = np.where((f > 1) & ~ends, f - 1, 0.0)
    beyond = np.where((f < 0) & (print_.leg > 0), f, beyond)

    def jacobian() -> Floats:
        out = np.flatnonzero(beyond)
        found = np.zeros((len(f), state.size))
        if len(out):
            legs = print_.leg[out]
            # The pixel stays, so only the corner that it lies beyond matters, not the other end.
            corner = np.where(f[out] > 1, legs + 1, state.leg_starts[legs])
            step = state.tangents_mm(legs, np.where(f[out] > 1, 1.0, 0.0))
            projection = np.nan_to_num(camera.pixel_jacobian(state.vertices_mm[corner]))
            speed = np.einsum("nij,nj->ni", projection, step)
            size = np.maximum(np.linalg.norm(speed, axis=1), 1e-12)
            slide = np.einsum("nij,ni->nj", projection, speed) / size[:, np.newaxis]
            rows = np.zeros((len(out), found.shape[1]))
            add_vertex(rows, corner, -slide)
            found[out] = rows
        return found

    return beyond * print_.px_per_leg, jacobian


def footprints_and_slopes(
    state: PathState,
    camera: Camera,
    medium: Medium,
    legs: Indices | int,
    rows: ArrayLike,
    cols: ArrayLike,
    own_rays: Floats | None = None,
) -> tuple[Footprint, Callable[[], Floats]]:
    """`arrival_jacobian` whose derivatives are made when they are asked for: half of the work."""
    rows, cols = np.asarray(rows, dtype=float), np.asarray(cols, dtype=float)
    n = len(rows)
    legs = np.broadcast_to(legs, n)
    starts = state.leg_starts[legs]
    fraction = nearest_fractions(state, camera, legs, rows, cols, own_rays)
    points, step = state.points_mm(legs, fraction), state.tangents_mm(legs, fraction)
    back = camera.way_back(points, return_group_index=medium.return_group_index)
    seen, projection = camera.pixels_and_slopes(points, way=back)
    # A path on its way through the search may run behind the camera, where nothing is seen.
    projection = finite(projection)
    speed = np.einsum("nij,nj->ni", projection, step)
    # A leg that points at the camera has no length in the picture.
    px_per_leg = np.maximum(lengths(speed), 1e-12)
    offset = np.column_stack((rows, cols)) - seen
    # speed = (d row, d col): the right-hand normal in (row down, col right) is (col, -row).
    lateral = (offset[:, 0] * speed[:, 1] - offset[:, 1] * speed[:, 0]) / px_per_leg
    later = back.optical_by_point / SPEED_OF_LIGHT_MM_PER_PS
    times = state.vertex_times_ps(medium)
    per_path = medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS
    length = lengths(step)
    way = per_path * fraction * length
    for course, _ in state.courses:
        here = np.flatnonzero(legs == course.leg)
        way[here] = per_path * course.ways_mm(fraction[here])
    arrival = times[starts] + way + back.optical_mm / SPEED_OF_LIGHT_MM_PER_PS
    along = per_path * length + summed(later * step)
    result = Footprint(
        leg=legs,
        fraction=fraction,
        lateral_px=lateral,
        arrival_ps=arrival,
        slope_ps_per_px=along / px_per_leg,
        px_per_leg=px_per_leg,
        distance_mm=lengths(points - back.last_mm),
    )

    def jacobian() -> Floats:
        # How the foot slides along the leg per mm that its point moves in the picture.
        slide = np.einsum("nij,ni->nj", projection, speed) / (px_per_leg**2)[:, np.newaxis]
        # Moving the point at fixed fraction by dX changes the return, and slides the foot back.
        with_point = later - along[:, np.newaxis] * slide
        unit = step / length[:, np.newaxis]
        found = np.zeros((n, state.size))
        add_vertex(found, starts, (1 - fraction)[:, np.newaxis] * with_point)
        add_vertex(found, legs + 1, fraction[:, np.newaxis] * with_point)
        later_by_step = per_path * fraction[:, np.newaxis] * unit
        for course, own in state.courses:
            here = np.flatnonzero(legs == course.leg)
            _, by_step, by_bend = course.ways_and_slopes(fraction[here])
            later_by_step[here] = per_path * by_step
            found[here, own] = per_path * by_bend + course.by_bend(fraction[here], with_point[here])
        add_vertex(found, starts, -later_by_step)
        add_vertex(found, legs + 1, later_by_step)
        # The time of the light before the leg.
        found += _later_jacobian(state, medium)[starts]
        found[:, state.vertices_mm.size] = 1.0
        return found

    return result, jacobian


def add_vertex(jacobian: Floats, vertex: Indices, gradient: Floats) -> None:
    """Add the gradients (n, 3) by vertices (n,) to their columns of a jacobian (n, size)."""
    rows = np.arange(len(jacobian))[:, np.newaxis]
    jacobian[rows, 3 * vertex[:, np.newaxis] + np.arange(3)] += gradient


def travelled_jacobian(state: PathState) -> Floats:
    """d(path length up to vertex k) / d(state); (m, size), zero for the start time."""
    m, steps = len(state.vertices_mm), state.steps_mm
    unit = steps / np.linalg.norm(steps, axis=1)[:, np.newaxis]
    out = np.zeros((m, state.size))
    flown = state.legs_before
    for course, own in state.courses:
        _, by_step, by_bend = course.ways_and_slopes(np.ones(1))
        unit[course.leg] = by_step[0]
        out[flown[:, course.leg], own] = by_bend
    by_vertex = np.zeros((m, m, 3))
    for leg, start in enumerate(state.leg_starts):
        # Every vertex that light reaches by this leg is farther by what the leg grows.
        by_vertex[flown[:, leg], start] -= unit[leg]
        by_vertex[flown[:, leg], leg + 1] += unit[leg]
    out[:, : 3 * m] = by_vertex.reshape(m, 3 * m)
    return out


def _later_jacobian(state: PathState, medium: Medium) -> Floats:
    """d(time from vertex 0 to vertex k) / d(state); (m, size), ps per mm."""
    later = medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS * travelled_jacobian(state)
    if state.glass:
        n = state.vertices_mm.size
        later[:, :n] += late_jacobian(state.vertices_mm, state.glass, medium.path_group_index)
    return later


def vertex_time_jacobian(state: PathState, medium: Medium) -> Floats:
    """d(x, y, z, t of every vertex) / d(state); (4m, size)."""
    m = len(state.vertices_mm)
    out = np.zeros((m, 4, state.size))
    for k in range(m):
        out[k, :3, 3 * k : 3 * k + 3] = np.eye(3)
    out[:, 3] = _later_jacobian(state, medium)
    out[:, 3, 3 * m] = 1.0
    return out.reshape(4 * m, state.size)
