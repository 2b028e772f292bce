"""Paths with bent legs to begin a fit with: from straight legs, and from chains of short ones.

A search for straight legs cuts one curve into several, joined by corners that turn by little. The
places of such a chain say roughly where the curve runs.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.path.bends import Bend, BentCourse, shapes_at
from lightflight.reconstruct.model.geometry import PathState

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_MOST_TURN_DEG = 60.0
"""Corners that turn by less may stand for a curve, deg: of one that turns by a right angle in view
a search makes two legs or more, whose corners turn by half of that."""
_PLACES = 65
"""Of a chain of legs that its curve is laid through."""


def axes_across(start_mm: Floats, end_mm: Floats, camera: Camera) -> Floats:
    """Axes of a bend: across the line between a leg's ends, in the picture and in depth.

    Parameters
    ----------
    start_mm, end_mm : array of float, shape (3,)
        World, mm.
    camera : Camera
        Whose picture counts.

    Returns
    -------
    array of float, shape (2, 3)
        Unit, across the line and each other; any pair for a leg that points at the camera.
    """
    along = (end_mm - start_mm) / np.linalg.norm(end_mm - start_mm)
    away = camera.sight_directions(0.5 * (start_mm + end_mm))
    depth = away - (away @ along) * along
    size = float(np.linalg.norm(depth))
    if size < 1e-9:
        depth = np.linalg.svd(along[np.newaxis])[2][1]
        size = 1.0
    depth = depth / size
    return np.stack((np.cross(along, depth), depth))


def with_bend(
    state: PathState, leg: int, orders: int, camera: Camera, *, more_in_picture: int = 0
) -> PathState:
    """The path with so many shapes of a bend on a leg; what the leg had of them stays.

    Parameters
    ----------
    state : PathState
        The path.
    leg : int
        Index of the leg.
    orders : int
        Shapes of each axis.
    camera : Camera
        Whose picture says what is depth.
    more_in_picture : int, optional
        How many of the last shapes are of the picture alone.

    Returns
    -------
    PathState
        The same flight.
    """
    had = next((bend for bend in state.bends if bend.leg == leg), None)
    if had is None:
        axes = axes_across(state.starts_mm[leg], state.vertices_mm[leg + 1], camera)
        had = Bend(leg, axes, np.zeros((2, orders)))
    others = [bend for bend in state.bends if bend.leg != leg]
    own = had.with_orders(orders, more_in_picture)
    bends = sorted((*others, own), key=lambda bend: bend.leg)
    return replace(state, bends=tuple(bends))


def with_axes_across(state: PathState, camera: Camera) -> PathState:
    """The path whose bends have axes across the lines between their ends as these are now.

    Along that line a shape would make of one parabola another.

    Parameters
    ----------
    state : PathState
        The path.
    camera : Camera
        Whose picture says what is depth.

    Returns
    -------
    PathState
        Its curves as near to those it had as shapes across can make them.
    """
    bends = []
    for bend in state.bends:
        axes = axes_across(state.starts_mm[bend.leg], state.vertices_mm[bend.leg + 1], camera)
        found = axes @ bend.vectors_mm.T
        found[1, bend.orders - bend.more_in_picture :] = 0.0
        bends.append(replace(bend, axes=axes, coefficients_mm=found))
    return replace(state, bends=tuple(bends))


def runs_of_corners(state: PathState) -> list[tuple[int, ...]]:
    """Corners, one after the other, that turn by little: each stretch of them, the longest first.

    Parameters
    ----------
    state : PathState
        The path.

    Returns
    -------
    list of tuple of int
        Vertices; every stretch of a long one is there, too.
    """
    shallow = {k for k in state.corners_seen if state.turn_deg(k) < _MOST_TURN_DEG}
    runs = [
        tuple(range(first, last + 1))
        for first in sorted(shallow)
        for last in sorted(shallow)
        if last >= first and shallow.issuperset(range(first, last + 1))
    ]
    return sorted(runs, key=len, reverse=True)


def bent_for_run(
    state: PathState, corners: tuple[int, ...], orders: int, camera: Camera
) -> PathState:
    """The path with one bent leg for those that meet at some corners.

    Parameters
    ----------
    state : PathState
        The path.
    corners : tuple of int
        Vertices, one after the other.
    orders : int
        Shapes of each axis.
    camera : Camera
        Whose picture says what is depth.

    Returns
    -------
    PathState
        The curve runs through the legs as well as its shapes can.
    """
    leg = corners[0] - 1
    legs = range(leg, corners[-1] + 1)
    places = np.vstack([state.points_mm(k, np.linspace(0.0, 1.0, _PLACES)) for k in legs])
    merged = with_bend(state.without(corners), leg, orders, camera)
    course = next(one for one, _ in merged.courses if one.leg == leg)
    bends = [_laid_through(course, places) if b.leg == leg else b for b in merged.bends]
    return replace(merged, bends=tuple(bends))


def _laid_through(course: BentCourse, places_mm: Floats) -> Bend:
    """The bend of a leg that comes nearest to places (n, 3), mm."""
    step = course.end_mm - course.start_mm
    fraction = (places_mm - course.start_mm) @ step / float(step @ step)
    away = places_mm - course.start_mm - np.outer(fraction, step)
    shapes = shapes_at(fraction, course.bend.orders)
    coefficients = np.linalg.lstsq(shapes, away @ course.bend.axes.T, rcond=None)[0].astype(float)
    return replace(course.bend, coefficients_mm=coefficients.T)
