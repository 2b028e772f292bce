"""Where the pixels look along a polyline, and when its light reaches them, with derivatives.

Exact in three dimensions: any direction, any camera pose and distortion, different indices on
the way out and back. The state of a path is its vertices and the event time at the first one;
`freedom.Freedom` says which of these a fit may move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.flight import Medium
from lightflight.path.bends import Bend, BentCourse
from lightflight.path.glass import (
    Glass,
    glass_of,
    late_jacobian,
    late_ps,
    on_faces,
    seat_map,
    seated,
    ways_in_glass_mm,
)
from lightflight.path.tree import forks_of, last_legs, leg_starts, way_before
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS
from lightflight.vectors import finite, lengths, summed

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.path.light_path import LightPath

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_MOST_FOOT_STEPS_BENT = 20
"""Of Newton's method on a curve, from the straight line between its ends: each leaves a tenth where
a pixel lies 3 px beside a curve whose radius is 30 px."""


@dataclass(frozen=True, eq=False)
class PathState:
    """A polyline and when the pulse enters it.

    Attributes
    ----------
    vertices_mm : array of float, shape (m, 3)
        World, mm.
    start_time_ps : float
        Event time at vertex 0, ps.
    unseen : tuple of int, optional
        Legs that run outside of every picture, by number: a detour by mirrors that nobody sees.
    forks : tuple of (int, int), optional
        Legs that begin at a vertex (leg, vertex) other than the end of the leg before: at a beam
        splitter two legs leave. Every leg ends at the vertex after its own number.
    bends : tuple of Bend, optional
        Legs that are smooth curves, in their order; all others are straight.
    glass : tuple of (int, Block), optional
        Legs within glass, from face to face, by number: their ends follow the other vertices.
    dark : tuple of int, optional
        Legs that no picture shows and that are no detour either: those in glass, and what of a leg
        through glass is out of view.
    """

    vertices_mm: Floats
    start_time_ps: float
    unseen: tuple[int, ...] = ()
    forks: tuple[tuple[int, int], ...] = ()
    bends: tuple[Bend, ...] = ()
    glass: Glass = ()
    dark: tuple[int, ...] = ()

    @property
    def size(self) -> int:
        """Numbers of the state: vertices (3m), start time, then coefficients bend by bend."""
        return self.vertices_mm.size + 1 + sum(bend.size for bend in self.bends)

    @property
    def n_legs(self) -> int:
        """Number of legs."""
        return len(self.vertices_mm) - 1

    @property
    def seen(self) -> tuple[int, ...]:
        """The legs that a picture may show, in the order of flight."""
        return tuple(k for k in range(self.n_legs) if k not in self.unseen and k not in self.dark)

    @cached_property
    def leg_starts(self) -> Indices:
        """(legs,), the vertex at which each leg begins; leg k ends at vertex k + 1."""
        return leg_starts(self.n_legs, self.forks)

    @cached_property
    def starts_mm(self) -> Floats:
        """(legs, 3), where each leg begins."""
        starts: Floats = self.vertices_mm[self.leg_starts]
        return starts

    @cached_property
    def steps_mm(self) -> Floats:
        """(legs, 3), from the start of each leg to its end."""
        steps: Floats = self.vertices_mm[1:] - self.starts_mm
        return steps

    @cached_property
    def courses(self) -> tuple[tuple[BentCourse, slice], ...]:
        """Of each bend, the course of its leg and where its numbers stand in the state."""
        found, first = [], self.vertices_mm.size + 1
        for bend in self.bends:
            ends = self.starts_mm[bend.leg], self.vertices_mm[bend.leg + 1]
            found.append((BentCourse(*ends, bend), slice(first, first + bend.size)))
            first += bend.size
        return tuple(found)

    def points_mm(self, legs: Indices | int, fraction: Floats) -> Floats:
        """Places (n, 3) on legs (n,), or one for all, at fractions (n,) of them; world, mm."""
        points: Floats = self.starts_mm[legs] + fraction[:, np.newaxis] * self.steps_mm[legs]
        for bend in self.bends:
            here = np.broadcast_to(legs == bend.leg, len(fraction))
            points[here] += bend.away_mm(fraction[here])
        return points

    def tangents_mm(self, legs: Indices | int, fraction: Floats) -> Floats:
        """d(place) / d(fraction) there, (n, 3), mm."""
        step = np.broadcast_to(self.steps_mm[legs], (len(fraction), 3))
        for bend in self.bends:
            here = np.broadcast_to(legs == bend.leg, len(fraction))
            step = step.copy()
            step[here] += bend.away_slopes_mm(fraction[here])
        return step

    def ways_mm(self, legs: Indices | int, fraction: Floats) -> Floats:
        """Way of the light from the start of each leg to fractions (n,) of it, mm."""
        ways: Floats = fraction * self.lengths_mm[legs]
        for course, _ in self.courses:
            here = np.broadcast_to(legs == course.leg, len(fraction))
            ways[here] = course.ways_mm(fraction[here])
        return ways

    def shares_of_way(self, legs: Indices | int, fraction: Floats) -> Floats:
        """Share of the time on each leg that has passed at fractions (n,) of it."""
        shares = fraction
        for course, _ in self.courses:
            here = np.broadcast_to(legs == course.leg, len(fraction))
            shares = shares.copy()
            shares[here] = course.ways_mm(fraction[here]) / self.lengths_mm[course.leg]
        return shares

    @cached_property
    def lengths_mm(self) -> Floats:
        """(legs,), way of the light along each."""
        lengths: Floats = np.linalg.norm(self.steps_mm, axis=1)
        for course, _ in self.courses:
            lengths[course.leg] = course.ways_mm(np.ones(1))[0]
        return lengths

    def is_bent(self, legs: Indices) -> NDArray[np.bool_]:
        """Which of the legs (n,) are curves."""
        if not self.bends:
            return np.zeros(len(legs), dtype=bool)
        return np.isin(legs, [bend.leg for bend in self.bends])

    @cached_property
    def legs_before(self) -> NDArray[np.bool_]:
        """(m, legs), which legs light has flown when it reaches each vertex."""
        flown = np.zeros((self.n_legs + 1, self.n_legs), dtype=bool)
        for leg, start in enumerate(self.leg_starts):
            flown[leg + 1] = flown[start]
            flown[leg + 1, leg] = True
        return flown

    @cached_property
    def last_legs(self) -> tuple[int, ...]:
        """Legs that nothing follows: the last one, and the end of every other arm."""
        return last_legs(self.leg_starts)

    @property
    def ends(self) -> tuple[int, ...]:
        """Vertices at which the light of the path begins, and then where that of each arm stops."""
        return (0, *(leg + 1 for leg in self.last_legs))

    @property
    def corners_seen(self) -> tuple[int, ...]:
        """Vertices at which one seen leg follows another: no fork, no end, no open mirror."""
        corners = {leg + 1 for leg in range(self.n_legs) if leg not in self.last_legs}
        forks = {vertex for _, vertex in self.forks}
        return tuple(sorted(corners - forks - set(self.open_vertices) - set(self.on_faces)))

    @property
    def on_faces(self) -> tuple[int, ...]:
        """Vertices on faces of glass: no unknowns, light goes straight on beyond it."""
        return on_faces(self.glass)

    @property
    def n_told(self) -> int:
        """Legs as one counts them: one that crosses glass is one."""
        return self.n_legs - 2 * len(self.glass)

    def as_told(self, number: int) -> int:
        """Number of a vertex, or of a leg, where vertices on faces are not counted."""
        return number - sum(face <= number for face in self.on_faces)

    @property
    def open_vertices(self) -> tuple[int, ...]:
        """Vertices that end a leg which is not seen."""
        return tuple(vertex for k in self.unseen for vertex in (k, k + 1))

    def has_legs(self, n_legs: int | None) -> bool:
        """Whether it has as many legs as were told, those that nobody saw counted or not."""
        return n_legs is None or n_legs in (self.n_told, self.n_told - len(self.unseen))

    def with_corner(self, leg: int, corner_mm: Floats) -> PathState:
        """The path with one more corner (3,), mm, on a leg that is seen; both pieces straight."""
        vertices = np.insert(self.vertices_mm, leg + 1, corner_mm, axis=0)
        unseen = tuple(k + (k > leg) for k in self.unseen)
        forks = tuple((k + (k > leg), v + (v > leg)) for k, v in self.forks)
        bends = tuple(replace(b, leg=b.leg + (b.leg > leg)) for b in self.bends if b.leg != leg)
        glass = tuple((k + (k > leg), block) for k, block in self.glass)
        dark = tuple(k + (k > leg) for k in self.dark)
        return PathState(vertices, self.start_time_ps, unseen, forks, bends, glass, dark)

    def without(self, corners: Sequence[int]) -> PathState:
        """The path without some of `corners_seen`; a leg that takes another's place is straight."""

        def number(k: int) -> int:
            """A leg's or a vertex's, once those before it are gone."""
            return k - sum(corner <= k for corner in corners)

        vertices = np.delete(self.vertices_mm, corners, axis=0)
        unseen = tuple(number(k) for k in self.unseen)
        forks = tuple((number(k), number(vertex)) for k, vertex in self.forks)
        joined = {k for corner in corners for k in (corner - 1, corner)}
        bends = tuple(replace(b, leg=number(b.leg)) for b in self.bends if b.leg not in joined)
        glass = tuple((number(k), block) for k, block in self.glass)
        dark = tuple(number(k) for k in self.dark)
        vertices = seated(vertices, glass)
        return PathState(vertices, self.start_time_ps, unseen, forks, bends, glass, dark)

    def prolonged(self, leg: int, fraction: float, medium: Medium, *, at_end: bool) -> PathState:
        """The same flight with a leg's end, or its start, at another fraction of it.

        Of a bent leg the curve stays; a start must be vertex 0, whose time goes along.
        """
        fractions = (0.0, fraction) if at_end else (fraction, 1.0)
        vertices, start_time = self.vertices_mm.copy(), self.start_time_ps
        bends = list(self.bends)
        for number, (course, _) in enumerate(self.courses):
            if course.leg == leg:
                part = course.part(*fractions)
                bends[number] = part.bend
                vertices[leg + 1 if at_end else 0] = part.end_mm if at_end else part.start_mm
                break
        else:
            vertices[leg + 1 if at_end else 0] = self.points_mm(leg, np.array([fraction]))[0]
        if not at_end:
            per_path = medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS
            start_time += float(per_path * self.ways_mm(leg, np.array([fraction]))[0])
        return replace(
            self, vertices_mm=vertices, start_time_ps=float(start_time), bends=tuple(bends)
        )

    def moved(self, step: Floats) -> PathState:
        """The state after adding `step` (size,): vertices in mm, start time in ps, then bends.

        Vertices on faces of glass go where light between the others meets these.
        """
        m = len(self.vertices_mm)
        return replace(
            self,
            vertices_mm=seated(self.vertices_mm + step[: 3 * m].reshape(m, 3), self.glass),
            start_time_ps=self.start_time_ps + float(step[3 * m]),
            bends=tuple(course.bend.moved(step[own]) for course, own in self.courses),
        )

    @cached_property
    def travelled_mm(self) -> Floats:
        """(m,), way of the light from vertex 0 to each vertex."""
        return way_before(self.leg_starts, self.lengths_mm)

    @cached_property
    def in_medium_mm(self) -> Floats:
        """(m,), the same without what lies in glass: what an index of the medium times."""
        if not self.glass:
            return self.travelled_mm
        in_medium: Floats = self.travelled_mm - ways_in_glass_mm(self.vertices_mm, self.glass)
        return in_medium

    def vertex_times_ps(self, medium: Medium) -> Floats:
        """Event time at each vertex, (m,), ps."""
        travelled = self.travelled_mm
        times: Floats = (
            self.start_time_ps + medium.path_group_index * travelled / SPEED_OF_LIGHT_MM_PER_PS
        )
        if self.glass:
            times = times + late_ps(self.vertices_mm, self.glass, medium.path_group_index)
        return times

    @cached_property
    def free_moves(self) -> Floats:
        """(size, size), what moves of all numbers do where vertices on faces of glass follow."""
        moves = np.eye(self.size)
        if self.glass:
            n = self.vertices_mm.size
            moves[:n, :n] = seat_map(self.vertices_mm, self.glass)
        return moves


def state_of_path(path: LightPath) -> PathState:
    """The state of a path that is already told, to start or to look from."""
    start_time = float(path.vertex_times_ps[0])
    # A truth to start from knows of no picture.
    unseen = tuple(getattr(path, "unseen_legs", ()))
    bends = tuple(getattr(path, "bends", ()))
    vertices = np.array(path.vertices_mm, dtype=float)
    medium = getattr(path, "medium", None)
    glass = () if medium is None else glass_of(vertices, medium.blocks)
    dark = tuple(leg for leg, _ in glass)
    return PathState(vertices, start_time, unseen, forks_of(path), bends, glass, dark)


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
    pixels = np.column_stack((rows, cols))
    bent = bool(state.is_bent(legs).any())
    for _ in range(_MOST_FOOT_STEPS_BENT if bent else 4):
        if bent:
            points, along = state.points_mm(legs, fraction), state.tangents_mm(legs, fraction)
        else:
            points, along = start + fraction[:, np.newaxis] * step, step
        seen, slopes = camera.pixels_and_slopes(points)
        speed = np.einsum("nij,nj->ni", slopes, along)
        change = summed((pixels - seen) * speed) / np.maximum(summed(speed**2), 1e-12)
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
