"""Light that goes to and fro between two mirrors: time of a round trip, distance of the mirrors.

Corners of such a path lie by turns on the one mirror and on the other. From a corner to the next
but one the light went to the other mirror and back; the law of reflection says which way each
mirror faces, without anything being told of either.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lightflight.display import with_error

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath

Floats = NDArray[np.float64]

_LEAST_CORNERS = 3
"""From the first corner to the third is one round trip: fewer have none."""
_STEP = 1e-100
"""Of a derivative by a complex step, mm: nothing is subtracted, so none is too small."""


@dataclass(frozen=True, eq=False, repr=False)
class RoundTrip:
    """What a path to and fro between two mirrors says of them.

    Attributes
    ----------
    time_ps : float
        From a mirror to the same one again, mean of all trips, ps.
    time_std_ps : float
        One-sigma error of `time_ps`, with all that the path's covariance holds: photons, pixels of
        the clock and what is shared, its scale above all; ps.
    distance_mm : float
        From mirror to mirror where the light meets them on average, square to both, mm.
    distance_std_mm : float
        One-sigma error of `distance_mm`, mm.
    axis : array of float, shape (3,)
        Unit, world: from the mirror of the path's first corner to the other.
    times_ps : array of float, shape (n,)
        Each trip, from corner k to corner k + 2, ps: light that walks along mirrors which are not
        parallel needs another time on each.
    times_std_ps : array of float, shape (n,)
        Their one-sigma errors, ps; neighbours share a leg, all share the clock's scale.
    time_std_parts_ps : Mapping of str to float
        `time_std_ps` by the classes of `LightPath.covariance_parts`, ps.
    """

    time_ps: float
    time_std_ps: float
    distance_mm: float
    distance_std_mm: float
    axis: Floats
    times_ps: Floats
    times_std_ps: Floats
    time_std_parts_ps: Mapping[str, float]

    def __repr__(self) -> str:
        time = with_error(self.time_ps, self.time_std_ps)
        distance = with_error(self.distance_mm, self.distance_std_mm)
        return f"RoundTrip({time} ps, mirrors {distance} mm apart, {len(self.times_ps)} trips)"


def round_trip_of_path(path: LightPath) -> RoundTrip | None:
    """Time of a round trip and distance of the mirrors, from a path's corners.

    With corners 1 ... n at r_k, t_k, legs along d_k before corner k and d_{k+1} after it::

        T_k = t_{k+2} - t_k,          T = mean of T_k
        a ~ sum over odd k of (d_{k+1} - d_k) - sum over even k,    |a| = 1
        L = (mean of even r_k - mean of odd r_k) . a

    d_{k+1} - d_k is square to the mirror of corner k. Errors are those of the path's covariance
    through the derivatives of T (constants) and L (by a complex step, exact).

    Parameters
    ----------
    path : LightPath
        The path; its source and where it leaves the view are no corners.

    Returns
    -------
    RoundTrip or None
        None for light that does not go to and fro: with fewer than three corners, with one that
        does not turn it back, with branches or bent legs, or where part of the way was not seen.
    """
    n_corners = len(path.vertices_mm) - 2
    bent = path.forks or path.bends or path.medium.blocks
    if n_corners < _LEAST_CORNERS or path.unseen_legs or bent:
        return None
    if not _turns_back(path.vertices_mm):
        return None
    m, trips = len(path.vertices_mm), np.arange(n_corners - 2)
    later = np.zeros((len(trips), m, 4))
    later[trips, trips + 3, 3] = 1.0
    later[trips, trips + 1, 3] = -1.0
    each = later.reshape(len(trips), 4 * m)
    times = each @ np.column_stack((path.vertices_mm, path.vertex_times_ps)).ravel()
    mean = each.mean(axis=0)
    axis, distance = _axis_and_distance(path.vertices_mm)
    by_vertices = _distance_by_vertices(path.vertices_mm)
    covariance = path.covariance
    return RoundTrip(
        time_ps=float(times.mean()),
        time_std_ps=_std(mean, covariance),
        distance_mm=float(distance),
        distance_std_mm=_std(by_vertices, covariance),
        axis=axis,
        times_ps=times,
        times_std_ps=np.array([_std(row, covariance) for row in each]),
        time_std_parts_ps={
            name: _std(mean, part) for name, part in path.covariance_parts.items()
        },
    )  # fmt: skip


def _turns_back(vertices_mm: Floats) -> bool:
    """Whether every corner turns the light by more than a right angle."""
    steps = np.diff(vertices_mm, axis=0)
    return bool(np.all(np.sum(steps[1:] * steps[:-1], axis=1) < 0.0))


def _axis_and_distance(vertices_mm: NDArray[Any]) -> tuple[NDArray[Any], Any]:
    """Unit axis from the first corner's mirror to the other, and their distance along it, mm."""
    steps = np.diff(vertices_mm, axis=0)
    # The plain square, not the absolute one: complex steps go through it.
    ahead = steps / np.sqrt(np.sum(steps * steps, axis=1))[:, np.newaxis]
    turn, corners = np.diff(ahead, axis=0), vertices_mm[1:-1]
    axis = turn[0::2].sum(axis=0) - turn[1::2].sum(axis=0)
    axis = axis / np.sqrt(np.sum(axis * axis))
    between = corners[1::2].mean(axis=0) - corners[0::2].mean(axis=0)
    return axis, np.sum(between * axis)


def _distance_by_vertices(vertices_mm: Floats) -> Floats:
    """d(distance) / d(x, y, z, t of all vertices); (4m,)."""
    m = len(vertices_mm)
    by = np.zeros((m, 4))
    for vertex in range(m):
        for axis in range(3):
            moved = vertices_mm.astype(np.complex128)
            moved[vertex, axis] += 1j * _STEP
            by[vertex, axis] = _axis_and_distance(moved)[1].imag / _STEP
    return by.ravel()


def _std(by_vertices: Floats, covariance: Floats) -> float:
    """Error of a number that follows the vertices (4m,) so; rounding may make none less than 0."""
    return float(np.sqrt(max(float(by_vertices @ covariance @ by_vertices), 0.0)))
