"""A detour that nobody sees: what two seen legs say of the leg between them, and what they do not.

Light leaves the picture on one line and comes back on another that does not meet it, or later than
by the way through where they meet. The least that explains it are two mirrors and one unseen leg:
the first mirror a beyond where the light was last seen, the second b before where it is seen again,
with a + |M2 - M1| + b = c delay / n. One equation for a and b: the mirrors remain a family of one
parameter, told here as a - b. More legs of the same delay look the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.freedom import Freedom
from lightflight.reconstruct.model.geometry import PathState

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_PLACES = 801
"""At which a leg is asked whether the picture shows it: a tenth of a pixel of the whole picture."""
_LEAST_STD_MM = 1.0
"""Of a - b where light takes the straight way: less than mirrors are placed to."""


@dataclass(frozen=True, eq=False)
class Detour:
    """Where light was last seen, where it was seen again, and how far it went between.

    Attributes
    ----------
    leg : int
        The unseen leg.
    last_seen_mm : array of float, shape (3,)
        World, mm.
    seen_again_mm : array of float, shape (3,)
        World, mm.
    away : array of float, shape (3,)
        Unit, direction of the leg before.
    back : array of float, shape (3,)
        Unit, direction of the leg after.
    length_mm : float
        Way of the light from one to the other, mm.
    """

    leg: int
    last_seen_mm: Floats
    seen_again_mm: Floats
    away: Floats
    back: Floats
    length_mm: float

    @property
    def shortest_mm(self) -> float:
        """Straight from where it was last seen to where it is seen again, mm."""
        return float(np.linalg.norm(self.seen_again_mm - self.last_seen_mm))

    @property
    def corner_misses_mm(self) -> float:
        """By how much one mirror fails: gap of the two lines, and of the ways through it, mm."""
        gap = self.seen_again_mm - self.last_seen_mm
        cosine = float(self.away @ self.back)
        # Nearest approach of last + a away and again - b back, a and b not negative.
        sine2 = max(1.0 - cosine**2, 1e-12)
        a = max(float(gap @ (self.away - cosine * self.back)) / sine2, 0.0)
        b = max(float(gap @ (self.back - cosine * self.away)) / sine2, 0.0)
        skew = np.linalg.norm(gap - a * self.away - b * self.back)
        return float(np.hypot(skew, self.length_mm - a - b))


def detours_of(state: PathState, camera: Camera) -> tuple[Detour, ...]:
    """Every unseen leg of a path with what the picture shows of the legs about it.

    Parameters
    ----------
    state : PathState
        The path.
    camera : Camera
        Whose picture counts.

    Returns
    -------
    tuple of Detour
        In the order of flight.
    """
    return tuple(_detour(state, leg, camera) for leg in state.unseen)


def _detour(state: PathState, leg: int, camera: Camera) -> Detour:
    vertices = state.vertices_mm
    before = np.array([state.starts_mm[leg - 1], vertices[leg]])
    last, again = _seen_end(before, camera), vertices[leg + 1 : leg + 3]
    first = _seen_end(again[::-1], camera)
    ways = (vertices[leg] - last, vertices[leg + 1] - vertices[leg], first - vertices[leg + 1])
    units = [
        step / max(float(np.linalg.norm(step)), 1e-12)
        for step in (before[1] - before[0], again[1] - again[0])
    ]
    # A mirror drawn within the picture takes its way off again.
    signed = [float(ways[0] @ units[0]), float(np.linalg.norm(ways[1])), float(ways[2] @ units[1])]
    return Detour(leg, last, first, units[0], units[1], sum(signed))


def _seen_end(leg_mm: Floats, camera: Camera) -> Floats:
    """The point (3,) of a leg (2, 3) nearest to its end that the picture shows; else its start."""
    fraction = np.linspace(0.0, 1.0, _PLACES)[:, np.newaxis]
    points = (1.0 - fraction) * leg_mm[0] + fraction * leg_mm[1]
    seen = np.flatnonzero(camera.sees(points))
    point: Floats = points[seen[-1] if len(seen) else 0]
    return point


def mirrors(
    last_seen_mm: Floats, away: Floats, seen_again_mm: Floats, back: Floats, length_mm: float
) -> tuple[Floats, Floats]:
    """Two mirrors, equally far from where light is seen, that make a way of this length.

    Parameters
    ----------
    last_seen_mm, seen_again_mm : array of float, shape (3,)
        World, mm.
    away, back : array of float, shape (3,)
        Unit, directions of flight there.
    length_mm : float
        Way of the light between them, mm.

    Returns
    -------
    array of float, shape (3,), twice
        World, mm; at the very places where the light is seen if straight on is too far.
    """

    def placed(far: float) -> tuple[Floats, Floats]:
        return last_seen_mm + far * away, seen_again_mm - far * back

    low, high = 0.0, 0.5 * max(length_mm, 0.0)
    # The way grows with the distance of the mirrors, by 0 to 2 mm per mm: bisection.
    for _ in range(60):
        far = 0.5 * (low + high)
        one, other = placed(far)
        too_long = 2.0 * far + float(np.linalg.norm(other - one)) > length_mm
        low, high = (low, far) if too_long else (far, high)
    return placed(low)


def with_detours_level(freedom: Freedom, state: PathState, camera: Camera) -> Freedom:
    """The freedom with a prior on what nothing tells: a - b of every detour, 0 within its range.

    The mirrors may stand anywhere in the family: a - b runs from -s to s with s what the way is
    longer than the straight one, evenly for all that is known: its standard deviation is
    s / sqrt 3.

    Parameters
    ----------
    freedom : Freedom
        Of the vertices.
    state : PathState
        The path as it is now.
    camera : Camera
        Whose picture counts.

    Returns
    -------
    Freedom
        The same where all legs are seen.
    """
    rows, values = [], []
    for detour in detours_of(state, camera):
        spare = detour.length_mm - detour.shortest_mm
        std = max(spare / np.sqrt(3.0), _LEAST_STD_MM)
        row = np.zeros(state.size)
        first = 3 * detour.leg
        row[first : first + 3], row[first + 3 : first + 6] = detour.away, detour.back
        rows.append(row / std)
        at_zero = detour.away @ detour.last_seen_mm + detour.back @ detour.seen_again_mm
        values.append(float(at_zero) / std)
    if not rows:
        return freedom
    return replace(
        freedom,
        prior_rows=np.vstack((freedom.prior_rows, rows)),
        prior_values=np.append(freedom.prior_values, values),
    )
