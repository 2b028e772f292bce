"""Legs whose curve is told: what places measured on it say of a path.

A place says how far the curve runs from it, across; along the curve it says nothing. All places of
one curve may be off together, shifted and turned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.spatial.transform import Rotation

from lightflight.curves import DrawnCurve
from lightflight.path.bends import Bend, BentCourse
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.model.state import PathState

Floats = NDArray[np.float64]

_MOST_STEPS = 20
"""Of Gauss and Newton's, from a curve as told to where it stands; three are usual."""
_STILL = 1e-6
"""Of a step, in standard deviations: nothing moves by it."""
_STEP = 1e-5
"""Of the derivative by a shift (mm) or a turn (rad)."""


@dataclass(frozen=True, eq=False)
class ToldOfCurve:
    """What the places of a drawn curve say of a path; k rows of unit error.

    Attributes
    ----------
    rows : array of float, shape (k, size)
        Row i says rows[i] . state = values[i] +- 1.
    values : array of float, shape (k,)
        In standard deviations.
    moves : array of float, shape (k, 6)
        By how much `values` change where the whole curve stands elsewhere: a shift and a turn about
        each axis, of plausible size.
    """

    rows: Floats
    values: Floats
    moves: Floats


def course_on(state: PathState, leg: int) -> BentCourse:
    """The curve of a leg of a path, a straight one too."""
    for course, _ in state.courses:
        if course.leg == leg:
            return course
    flat = Bend(leg, np.eye(3)[:2], np.zeros((2, 1)))
    return BentCourse(state.starts_mm[leg], state.vertices_mm[leg + 1], flat)


def told_of_curve(state: PathState, curve: DrawnCurve) -> ToldOfCurve:
    r"""What a drawn curve says of the state of a path that is roughly right.

    With X(f) the leg's curve, P_i the places, f_i the foot of each and n two directions across,

    .. math:: n \cdot (X(f_i) - T(\theta) P_i) = 0 \pm \sigma, \qquad \theta = 0 \pm \Sigma,

    T a shift of all places and a turn about their middle. About the likeliest theta it is linear,
    and what is left of theta stands in the covariance of the rows, sigma^2 + G Sigma G^T.

    Parameters
    ----------
    state : PathState
        The path.
    curve : DrawnCurve
        Of one of its legs.

    Returns
    -------
    ToldOfCurve
        Of the places beside the leg; those beyond its ends tell nothing of it.
    """
    course, std = course_on(state, curve.leg), curve.point_std_mm
    stds = np.repeat([curve.position_std_mm, np.deg2rad(curve.turn_std_deg)], 3)
    found = np.zeros(6)
    for _ in range(_MOST_STEPS):
        fraction, across, off, by_move = _beside(course, curve, stds * found)
        by_std = by_move * stds
        step = np.linalg.solve(
            np.eye(6) + by_std.T @ by_std / std**2, by_std.T @ off / std**2 - found
        )
        found = found + step
        if np.abs(step).max() < _STILL:
            break
    whitening = np.linalg.cholesky(std**2 * np.eye(len(off)) + by_std @ by_std.T)

    def whitened(rows: Floats) -> Floats:
        scaled: Floats = solve_triangular(whitening, rows, lower=True)
        return scaled

    rows = whitened(_by_state(state, course, fraction, across))
    sizes = np.repeat([PLAUSIBLE["drawn_curve"].size, PLAUSIBLE["pose turn"].size], 3)
    here = rows @ state.vector
    return ToldOfCurve(rows, here - whitened(off + by_std @ found), whitened(by_move * sizes))


def _beside(
    course: BentCourse, curve: DrawnCurve, move: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Of n places beside a leg: fractions, directions across, distances, and these by moves.

    Parameters
    ----------
    course : BentCourse
        The leg.
    curve : DrawnCurve
        As told.
    move : array of float, shape (6,)
        Where it stands: shift, mm, and turn, rad.

    Returns
    -------
    fraction : array of float, shape (n,)
    across : array of float, shape (n, 2, 3)
        Unit.
    off : array of float, shape (2 n,)
        From each place to the leg along them, mm.
    by_move : array of float, shape (2 n, 6)
        By how much the places move along them, mm per mm and mm per rad.
    """
    places = moved_places(curve, move)
    fraction = nearest_on(course, places)
    beside = (fraction >= 0.0) & (fraction <= 1.0)
    fraction, places = fraction[beside], places[beside]
    along = course.tangents_mm(fraction)
    along = along / np.linalg.norm(along, axis=1)[:, np.newaxis]
    # The last two of each triad with the first along the leg.
    across = np.linalg.svd(along[:, np.newaxis, :])[2][:, 1:]

    def distances(points: Floats) -> Floats:
        found: Floats = np.einsum("nij,nj->ni", across, points).ravel()
        return found

    by_move = [
        distances(moved_places(curve, move + step)[beside] - places) / _STEP
        for step in _STEP * np.eye(6)
    ]
    off = distances(course.points_mm(fraction) - places)
    return fraction, across, off, np.column_stack(by_move)


def moved_places(curve: DrawnCurve, move: Floats) -> Floats:
    """Places (n, 3) of a curve, shifted (mm) and turned about their middle (rad) by (6,)."""
    places = curve.places_mm
    middle = places.mean(axis=0)
    turned: Floats = Rotation.from_rotvec(move[3:]).apply(places - middle)
    moved: Floats = turned + middle + move[:3]
    return moved


def nearest_on(course: BentCourse, places_mm: Floats) -> Floats:
    """(n,), fractions of a leg nearest to places (n, 3), mm."""
    step = course.end_mm - course.start_mm
    fraction: Floats = (places_mm - course.start_mm) @ step / float(step @ step)
    for _ in range(_MOST_STEPS):
        tangents = course.tangents_mm(fraction)
        ahead = np.sum((places_mm - course.points_mm(fraction)) * tangents, axis=1)
        change = ahead / np.sum(tangents**2, axis=1)
        fraction = fraction + change
        if np.abs(change).max(initial=0.0) < _STILL:
            break
    return fraction


def _by_state(state: PathState, course: BentCourse, fraction: Floats, across: Floats) -> Floats:
    """(2 n, size), derivatives of the distances along `across` (n, 2, 3) by the state."""
    n, leg = len(fraction), course.leg
    found = np.zeros((n, 2, state.size))
    start, end = 3 * int(state.leg_starts[leg]), 3 * (leg + 1)
    found[:, :, start : start + 3] += (1.0 - fraction)[:, np.newaxis, np.newaxis] * across
    found[:, :, end : end + 3] += fraction[:, np.newaxis, np.newaxis] * across
    for other, own in state.courses:
        if other.leg == leg:
            for k in range(2):
                found[:, k, own] = course.by_bend(fraction, across[:, k])
    return found.reshape(2 * n, state.size)
