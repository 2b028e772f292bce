"""The state of a path in a fit: its vertices, when light enters, and what follows from both.

A polyline in space and time, whose legs may begin at a fork, be curves, or run through glass.
`geometry` says where pixels look along it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.flight import Medium
from lightflight.path.bends import Bend, BentCourse
from lightflight.path.glass import (
    Glass,
    glass_of,
    late_ps,
    on_faces,
    seat_map,
    seated,
    ways_in_glass_mm,
)
from lightflight.path.tree import forks_of, last_legs, leg_starts, way_before
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def _is_leg(legs: Indices | int, leg: int, n: int) -> NDArray[np.bool_]:
    """(n,), which of the legs (n,), or of one for all, are this one."""
    # `np.broadcast_to` would cost more than the comparison.
    return legs == leg if isinstance(legs, np.ndarray) else np.full(n, legs == leg)


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
    def vector(self) -> Floats:
        """(size,): the vertices one after another, the start time, coefficients of the bends."""
        coefficients = (bend.coefficients_mm.ravel() for bend in self.bends)
        return np.concatenate((self.vertices_mm.ravel(), [self.start_time_ps], *coefficients))

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
            here = _is_leg(legs, bend.leg, len(fraction))
            points[here] += bend.away_mm(fraction[here])
        return points

    def tangents_mm(self, legs: Indices | int, fraction: Floats) -> Floats:
        """d(place) / d(fraction) there, (n, 3), mm."""
        step = self.steps_mm[legs]
        if step.ndim == 1:
            step = np.broadcast_to(step, (len(fraction), 3))
        for bend in self.bends:
            here = _is_leg(legs, bend.leg, len(fraction))
            step = step.copy()
            step[here] += bend.away_slopes_mm(fraction[here])
        return step

    def ways_mm(self, legs: Indices | int, fraction: Floats) -> Floats:
        """Way of the light from the start of each leg to fractions (n,) of it, mm."""
        ways: Floats = fraction * self.lengths_mm[legs]
        for course, _ in self.courses:
            here = _is_leg(legs, course.leg, len(fraction))
            ways[here] = course.ways_mm(fraction[here])
        return ways

    def shares_of_way(self, legs: Indices | int, fraction: Floats) -> Floats:
        """Share of the time on each leg that has passed at fractions (n,) of it."""
        shares = fraction
        for course, _ in self.courses:
            here = _is_leg(legs, course.leg, len(fraction))
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

    def event_times_ps(self, legs: Indices | int, fraction: Floats, medium: Medium) -> Floats:
        """When the light is at places of legs (n,), ps."""
        times = self.vertex_times_ps(medium)
        begun = times[self.leg_starts]
        passed = self.shares_of_way(legs, fraction)
        events: Floats = begun[legs] + passed * (times[1:] - begun)[legs]
        return events

    @cached_property
    def free_moves(self) -> Floats:
        """(size, size), what moves of all numbers do where vertices on faces of glass follow."""
        moves = np.eye(self.size)
        if self.glass:
            n = self.vertices_mm.size
            moves[:n, :n] = seat_map(self.vertices_mm, self.glass)
        return moves

    def turn_deg(self, corner: int) -> float:
        """Angle by which the flight turns at a corner, deg."""
        before = self.tangents_mm(corner - 1, np.ones(1))[0]
        after = self.tangents_mm(corner, np.zeros(1))[0]
        # atan2 of both keeps small angles exact, where acos would not.
        cross = np.linalg.norm(np.cross(before, after))
        return float(np.rad2deg(np.arctan2(cross, before @ after)))


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
