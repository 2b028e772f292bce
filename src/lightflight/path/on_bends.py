"""Places, directions and errors on the bent legs of a path, by event time.

A leg's event times run evenly with the way of the light: at a share of the time between its two
vertices it has flown that share of the curve's length.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from lightflight.path.bends import BentCourse
from lightflight.path.glass import flown_path
from lightflight.path.on_legs import extrapolated_position
from lightflight.path.tree import forks_of, leg_starts, n_legs_of, outline_mm

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath
    from lightflight.path.tables import Polyline

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

PIECES = 64
"""Straight pieces that a bent leg is drawn in: a sagitta of 20 mm to 5 um."""


def course_of_leg(path: LightPath, leg: int) -> BentCourse | None:
    """The curve of a leg of a path; None: it is straight."""
    return next((course for course in courses_of(path) if course.leg == leg), None)


def courses_of(path: Polyline) -> tuple[BentCourse, ...]:
    """The curves of all bent legs of a path; () of a truth."""
    vertices = np.asarray(path.vertices_mm, dtype=float)
    return tuple(
        BentCourse(vertices[bend.leg], vertices[bend.leg + 1], bend)
        for bend in getattr(path, "bends", ())
    )


def positions_on(path: LightPath, times_ps: Floats) -> Floats:
    """Places of the pulse at event times (n,), first and last leg prolonged; (n, 3), mm."""
    positions = extrapolated_position(path.vertices_mm, path.vertex_times_ps, times_ps)
    leg = path.leg_at(times_ps) if path.bends else np.zeros(0, dtype=np.int64)
    for course in courses_of(path):
        here = leg == course.leg
        positions[here] = course.points_mm(_fractions(path, course, times_ps[here]))
    return positions


def drawn(path: Polyline) -> tuple[Floats, Floats, Indices]:
    """The path as a chain of straight pieces, bent legs in many.

    Parameters
    ----------
    path : LightPath or truth
        The path; a truth has no bent legs. Of one that forks, whose legs are all straight, piece k
        begins where `starts_of_pieces` says.

    Returns
    -------
    places_mm : array of float, shape (k, 3)
        World, mm; the vertices themselves where no leg is bent.
    event_times_ps : array of float, shape (k,)
        ps.
    leg : array of int, shape (k - 1,)
        The leg that each piece belongs to.
    """
    path = flown_path(path)
    vertex_times = np.asarray(path.vertex_times_ps, dtype=float)
    bent = {bend.leg for bend in getattr(path, "bends", ())}
    if not bent:
        vertices = np.asarray(path.vertices_mm, dtype=float)
        return vertices, vertex_times, np.arange(n_legs_of(path))
    times, legs = [vertex_times[:1]], []
    for leg in range(len(vertex_times) - 1):
        n = PIECES if leg in bent else 1
        start, end = vertex_times[leg : leg + 2]
        times.append(np.append(start + (end - start) * np.arange(1, n) / n, end))
        legs.append(np.full(n, leg))
    event = np.concatenate(times)
    return positions_on(cast("LightPath", path), event), event, np.concatenate(legs)


def starts_of_pieces(path: Polyline, leg: Indices) -> Indices:
    """The place at which each piece of `drawn` begins; piece k ends at place k + 1.

    Parameters
    ----------
    path : LightPath or truth
        The path: with branches or with bent legs, never with both.
    leg : array of int, shape (k - 1,)
        The leg of each piece, by `drawn`.

    Returns
    -------
    array of int, shape (k - 1,)
    """
    return leg_starts(len(leg), forks_of(path))


def drawn_outline_mm(path: Polyline) -> Floats:
    """The path as one line, to be drawn: as `outline_mm`, bent legs in many straight pieces."""
    return drawn(path)[0] if getattr(path, "bends", ()) else outline_mm(path)


def whole_covariance(path: LightPath) -> Floats:
    """Covariance of x, y, z, t of every vertex, then of all coefficients of bends."""
    of_bends = path.bend_covariance
    if not path.bends or of_bends is None:
        return path.covariance
    n = len(path.covariance)
    above = np.hstack((path.covariance, of_bends[:n]))
    return np.vstack((above, np.hstack((of_bends[:n].T, of_bends[n:]))))


def columns_of_bend(path: LightPath, leg: int) -> Indices:
    """Where the coefficients of a leg's bend stand in `whole_covariance`."""
    first = len(path.covariance)
    for bend in path.bends:
        if bend.leg == leg:
            return np.arange(first, first + bend.size)
        first += bend.size
    return np.zeros(0, dtype=np.int64)


def point_jacobian(path: LightPath, course: BentCourse, share: Floats) -> tuple[Floats, Indices]:
    """How places on a bent leg, each at a share of the leg's time, follow the path.

    Parameters
    ----------
    path : LightPath
        The path.
    course : BentCourse
        The curve of the leg.
    share : array of float, shape (n,)
        Of the time between the leg's two vertices.

    Returns
    -------
    jacobian : array of float, shape (n, 4, 8 + 2 J)
        x, y, z (mm) and t (ps) by x, y, z, t of the leg's two vertices, then by the coefficients of
        its bend.
    places : array of int, shape (8 + 2 J,)
        Where those stand in `whole_covariance`.

    Notes
    -----
    The way s(f) = tau L is the same share of the length: what lengthens the curve slides the place
    along it by (tau dL - ds) / |X'| (method.md, Bent legs).
    """
    leg, n = course.leg, len(share)
    length = float(course.ways_mm(np.ones(1))[0])
    fraction = course.fractions_at(share * length)
    _, by_step, by_bend = course.ways_and_slopes(np.append(fraction, 1.0))
    tangents = course.tangents_mm(fraction)
    along = tangents / np.linalg.norm(tangents, axis=1)[:, np.newaxis]
    found = np.zeros((n, 4, 8 + course.bend.size))
    for axis in range(3):
        found[:, axis, axis], found[:, axis, 4 + axis] = 1 - fraction, fraction
        found[:, axis, 8:] = course.by_bend(fraction, np.tile(np.eye(3)[axis], (n, 1)))
    slides = np.zeros((n, 8 + course.bend.size))
    slides[:, 4:7] = np.outer(share, by_step[-1]) - by_step[:-1]
    slides[:, :3] = -slides[:, 4:7]
    slides[:, 8:] = np.outer(share, by_bend[-1]) - by_bend[:-1]
    found[:, :3] += along[:, :, np.newaxis] * slides[:, np.newaxis]
    found[:, 3, 3], found[:, 3, 7] = 1 - share, share
    places = np.concatenate((np.arange(4 * leg, 4 * leg + 8), columns_of_bend(path, leg)))
    return found, places


def position_jacobian(
    path: LightPath, course: BentCourse, time_ps: float
) -> tuple[Floats, Indices]:
    """How a place on a bent leg at a fixed event time follows the path; (3, 8 + 2 J).

    As `point_jacobian`, less the velocity times what its time does.
    """
    t0, t1 = path.vertex_times_ps[course.leg : course.leg + 2]
    share = np.array([(time_ps - t0) / (t1 - t0)])
    found, places = point_jacobian(path, course, share)
    length = float(course.ways_mm(np.ones(1))[0])
    tangent = course.tangents_mm(course.fractions_at(share * length))[0]
    velocity = tangent / np.linalg.norm(tangent) * length / (t1 - t0)
    return found[0, :3] - np.outer(velocity, found[0, 3]), places


def covariance_on_bent_leg(path: LightPath, course: BentCourse, share: Floats) -> Floats:
    """(n, 4, 4), of x, y, z (mm) and t (ps) at shares (n,) of a bent leg's time."""
    jacobian, places = point_jacobian(path, course, share)
    own = whole_covariance(path)[np.ix_(places, places)]
    found: Floats = jacobian @ own @ np.swapaxes(jacobian, 1, 2)
    return found


def angle_variance(
    path: LightPath, course: BentCourse, ends: Indices, by_ends: Floats, by_tangent: Floats
) -> float:
    """Variance of a bent leg's elevation at its start, rad^2.

    Parameters
    ----------
    path : LightPath
        The path.
    course : BentCourse
        The curve of the leg.
    ends : array of int, shape (6,)
        Where x, y, z of its two vertices stand in `whole_covariance`.
    by_ends : array of float, shape (6,)
        How the angle follows them, rad per mm.
    by_tangent : array of float, shape (3,)
        How it follows the tangent at the start, rad per mm.

    Returns
    -------
    float
    """
    by_bend = course.slopes_by_bend(np.zeros(1), by_tangent[np.newaxis])[0]
    places = np.concatenate((ends, columns_of_bend(path, course.leg)))
    weights = np.concatenate((by_ends, by_bend))
    return float(weights @ whole_covariance(path)[np.ix_(places, places)] @ weights)


def _fractions(path: LightPath, course: BentCourse, times_ps: Floats) -> Floats:
    """Fractions (n,) of a bent leg at event times (n,)."""
    t0, t1 = path.vertex_times_ps[course.leg : course.leg + 2]
    share = (times_ps - t0) / (t1 - t0)
    return course.fractions_at(share * float(course.ways_mm(np.ones(1))[0]))
