"""Covariance of points on a path's legs, and what of it no light shows.

A mirror that ends a way nobody saw may stand anywhere along its leg: a point at a fixed fraction of
that leg slides with it, in place and time alike, and the flight stays what it was. Where such a leg
is drawn or told, its points are held in their planes of sight instead.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.path.tree import starts_of
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath

Floats = NDArray[np.float64]


def covariance_on_legs(
    covariance: Floats, leg: NDArray[np.int64], fraction: Floats, *, starts: NDArray[np.int64]
) -> Floats:
    """Both ends of a leg propagated to points at a fixed fraction of it.

    Parameters
    ----------
    covariance : array of float, shape (4m, 4m)
        x, y, z (mm) and t (ps) of every vertex.
    leg : array of int, shape (n,)
        Leg of each point.
    fraction : array of float, shape (n,)
        0 at its start, 1 at its end.
    starts : array of int, shape (n_legs,)
        The vertex at which each leg begins.

    Returns
    -------
    array of float, shape (n, 4, 4)
        mm and ps.
    """
    m = len(covariance) // 4
    blocks = covariance.reshape(m, 4, m, 4).transpose(0, 2, 1, 3)
    f = fraction[:, np.newaxis, np.newaxis]
    first = starts[leg]
    start, end = blocks[first, first], blocks[leg + 1, leg + 1]
    cross = blocks[first, leg + 1]
    both: Floats = (1 - f) ** 2 * start + f**2 * end
    return np.asarray(both + f * (1 - f) * (cross + np.swapaxes(cross, 1, 2)))


def sliding_maps(path: LightPath, leg: NDArray[np.int64], points_mm: Floats) -> Floats:
    """What takes the sliding along its leg off the error of each point.

    Parameters
    ----------
    path : LightPath
        The path.
    leg : array of int, shape (n,)
        Leg of each point.
    points_mm : array of float, shape (n, 3)
        World, mm.

    Returns
    -------
    array of float, shape (n, 4, 4)
        P, for P C P^T; the identity on legs that no unseen leg touches.
    """
    maps = np.tile(np.eye(4), (len(leg), 1, 1))
    beside = {k + side for k in path.unseen_legs for side in (-1, 1)}
    here = np.flatnonzero(np.isin(leg, sorted(beside)))
    if not len(here):
        return maps
    own = leg[here]
    step = path.vertices_mm[own + 1] - path.vertices_mm[starts_of(path)[own]]
    along = step / np.linalg.norm(step, axis=1)[:, np.newaxis]
    rays = path.camera.sight_directions(points_mm[here])
    # What the picture shows of the flight's direction: the plane of sight is square to it.
    flat = along - np.sum(along * rays, axis=1)[:, np.newaxis] * rays
    flat = flat / np.sum(flat * along, axis=1)[:, np.newaxis]
    later = np.full((len(here), 1), path.medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS)
    # A shift of s along the leg moves the point by s u and its time by s n / c.
    maps[here, :, :3] -= np.hstack((along, later))[:, :, np.newaxis] * flat[:, np.newaxis, :]
    return maps


def extrapolated_position(vertices_mm: Floats, vertex_times_ps: Floats, times_ps: Floats) -> Floats:
    """Position on a polyline at event times, first and last leg prolonged.

    Parameters
    ----------
    vertices_mm : array of float, shape (m, 3)
        World, mm.
    vertex_times_ps : array of float, shape (m,)
        Ascending, ps.
    times_ps : array of float, shape (n,)
        Event times, ps.

    Returns
    -------
    array of float, shape (n, 3)
        World, mm.
    """
    leg = np.clip(
        np.searchsorted(vertex_times_ps, times_ps, side="right") - 1, 0, len(vertex_times_ps) - 2
    )
    t0, t1 = vertex_times_ps[leg], vertex_times_ps[leg + 1]
    fraction = ((times_ps - t0) / (t1 - t0))[:, np.newaxis]
    position: Floats = (1 - fraction) * vertices_mm[leg] + fraction * vertices_mm[leg + 1]
    return position
