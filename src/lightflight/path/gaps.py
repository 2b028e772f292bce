"""Where light was lost from sight on its way: what is known of that stretch, and what is not."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.display import with_error
from lightflight.path.on_legs import sliding_maps
from lightflight.path.tree import Forks, starts_of
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath

Floats = NDArray[np.float64]

_PLACES = 2001
"""Along a leg, to find where the picture's edge cuts it: a hundredth of a pixel or better."""


@dataclass(frozen=True, eq=False, repr=False)
class Gap:
    """A stretch of a path that no picture showed: at least one leg, over at least two mirrors.

    Light went from `last_seen_mm` to `seen_again_mm` in `delay_ps`. Where the mirrors stand is
    open: the one that ends the leg before lies on its line, up to `farthest_mm` beyond where it was
    last seen, the one that begins the leg after likewise on its own. One leg cannot be told from
    several of the same delay.

    Attributes
    ----------
    after_leg : int
        The last leg that was seen, by number.
    last_seen_mm : array of float, shape (3,)
        Where it crosses the picture's edge; world, mm.
    seen_again_mm : array of float, shape (3,)
        Where the next leg crosses it; world, mm.
    delay_ps : float
        From the one event to the other, ps.
    delay_std_ps : float
        One-sigma error of `delay_ps`, ps.
    length_mm : float
        Way of the light in that time, in the path's medium, mm.
    shortest_mm : float
        Straight from the one place to the other, mm: no way is shorter.
    """

    after_leg: int
    last_seen_mm: Floats
    seen_again_mm: Floats
    delay_ps: float
    delay_std_ps: float
    length_mm: float
    shortest_mm: float

    @property
    def farthest_mm(self) -> float:
        """No mirror lies farther beyond the picture's edge than this, mm: there and back again."""
        return 0.5 * (self.length_mm + self.shortest_mm)

    @property
    def in_words(self) -> str:
        """Delay, way and the shortest there is."""
        delay = with_error(self.delay_ps, self.delay_std_ps)
        return f"{delay} ps, {self.length_mm:.1f} mm of way ({self.shortest_mm:.1f} mm straight)"

    def __repr__(self) -> str:
        return f"Gap(after leg {self.after_leg + 1}: {self.in_words})"


def checked_unseen(legs: object, n_legs: int, forks: Forks = ()) -> tuple[int, ...]:
    """Numbers of unseen legs, ascending.

    Parameters
    ----------
    legs : object
        As given.
    n_legs : int
        Of the path.
    forks : tuple of (int, int), optional
        Legs that begin at another vertex than the end of the leg before.

    Returns
    -------
    tuple of int

    Raises
    ------
    ValueError
        Unless each lies between two legs that are seen, and no fork at either of its ends.
    """
    try:
        numbers = tuple(sorted(int(k) for k in legs))  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        numbers = (-1,)
    apart = all(b - a > 1 for a, b in pairwise(numbers))
    if not apart or any(not 0 < k < n_legs - 1 for k in numbers):
        raise ValueError(
            f"unseen_legs must lie each between two legs of the {n_legs} that are seen, got {legs}"
        )
    # Where a mirror may stand anywhere on a line, nothing says where light would leave it.
    forked = {number for pair in forks for number in pair}
    if any(forked & {k, k + 1} for k in numbers):
        raise ValueError(f"a leg that nobody saw cannot begin or end at a fork, got {legs}")
    return numbers


def gaps_of_path(path: LightPath) -> tuple[Gap, ...]:
    """The stretches that nobody saw, in the order of flight.

    Parameters
    ----------
    path : LightPath
        The path.

    Returns
    -------
    tuple of Gap
        () where all legs were seen.
    """
    return tuple(_gap(path, leg) for leg in path.unseen_legs)


def _gap(path: LightPath, leg: int) -> Gap:
    """The delay is a difference of event times, each at a fixed fraction of its leg."""
    times = path.vertex_times_ps
    last, again = (
        _fraction_seen(path, leg - 1, last=True),
        _fraction_seen(path, leg + 1, last=False),
    )
    places, moments = [], []
    by_vertices = np.zeros(4 * len(times))
    for own, fraction, sign in ((leg - 1, last, -1.0), (leg + 1, again, 1.0)):
        start, end = _ends(path, own)
        places.append(start + fraction * (end - start))
        begun = times[starts_of(path)[own]]
        moments.append(float(begun + fraction * (times[own + 1] - begun)))
        by_vertices += sign * _moment_by_vertices(path, own, fraction)
    delay = moments[1] - moments[0]
    variance = float(by_vertices @ path.covariance @ by_vertices)
    return Gap(
        after_leg=leg - 1,
        last_seen_mm=places[0],
        seen_again_mm=places[1],
        delay_ps=delay,
        delay_std_ps=float(np.sqrt(max(variance, 0.0))),
        length_mm=delay * SPEED_OF_LIGHT_MM_PER_PS / path.medium.path_group_index,
        shortest_mm=float(np.linalg.norm(places[1] - places[0])),
    )


def _ends(path: LightPath, leg: int) -> tuple[Floats, Floats]:
    """Where a leg begins and ends, world, mm."""
    return path.vertices_mm[starts_of(path)[leg]], path.vertices_mm[leg + 1]


def _moment_by_vertices(path: LightPath, leg: int, fraction: float) -> Floats:
    """d(event time where the leg crosses the edge) / d(x, y, z, t of all vertices); (4m,).

    The crossing stays in its plane of sight: a vertex that slides along the leg moves no light.
    """
    start, end = _ends(path, leg)
    point = start + fraction * (end - start)
    row = sliding_maps(path, np.array([leg]), point[np.newaxis])[0, 3]
    by = np.zeros((len(path.vertex_times_ps), 4))
    by[starts_of(path)[leg]], by[leg + 1] = (1.0 - fraction) * row, fraction * row
    return by.ravel()


def _fraction_seen(path: LightPath, leg: int, *, last: bool) -> float:
    """Where the picture's edge cuts a leg: its last point in view, or its first."""
    fraction = np.linspace(0.0, 1.0, _PLACES)
    start, end = _ends(path, leg)
    seen = np.flatnonzero(path.camera.sees(start + fraction[:, np.newaxis] * (end - start)))
    if not len(seen):
        return 1.0 if last else 0.0
    return float(fraction[seen[-1 if last else 0]])
