"""Legs in the pictures of several cameras: which show one leg, and in which order the light flew.

Each camera's legs are in order by themselves; their arrival times are not, because the ways back
differ and clocks may be off. Two images are of one leg where light of its own speed on one line
explains the places and times of both but for what the clocks are apart. What
is left open is the order of legs that no camera sees together: of all orders that keep each
camera's own, that whose first path misses the times by least.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from lightflight.errors import GeometryError
from lightflight.flight import Medium
from lightflight.reconstruct.fit.start import (
    LegCurve,
    curves_of_legs,
    line_meetings,
    state_from_curves,
)
from lightflight.reconstruct.legs.find import ImageLeg, Images
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.image_plane import mean_focal_px
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]

_SAME_STDS, _SAME_PX = 0.5, 1.0
"""Two images are of one leg where its times miss theirs by less, rms, in stds of a pulse, and its
image by less than this, px."""
_DEPTHS = (0.5, 1.0, 2.0, 4.0)
"""That a leg is looked for at, in distances of the two cameras from each other."""
_MOST_TRIALS = 30
"""Of depths, from each: those of one leg are found in ten."""
_BEHIND = 100.0
"""What a place behind the camera counts, in the same units."""
_APART_STDS = 3.0
"""... and the clocks are apart by no more, in plausible and stated offsets."""
_MOST_ORDERS = 24
"""Orders of flight that are tried: those of two legs among two others are six."""


@dataclass(frozen=True)
class _Pair:
    """Two images that may be of one leg."""

    misfit: float
    one: int
    other: int
    later_ps: float
    """By how much the second's clock is later."""


def state_from_images(
    legs: Sequence[ImageLeg], setting: Setting, *, std_ps: float
) -> tuple[PathState, tuple[Images, ...]]:
    """First guess of the path from legs in several pictures, and the images of each of its legs.

    Parameters
    ----------
    legs : sequence of ImageLeg
        Of each picture in the order of flight.
    setting : Setting
        Cameras, source, medium and waypoints.
    std_ps : float
        Typical standard deviation of a pulse, ps.

    Returns
    -------
    state : PathState
        As `start.state_from_legs`.
    images : tuple of tuple of ImageLeg
        Of each leg, in the order of flight.

    Raises
    ------
    GeometryError
        Where no order of the legs makes a path.
    """
    views = [leg.view for leg in legs]
    curves = _curves(legs, setting)
    groups, late_ps = _grouped(legs, curves, setting, std_ps)
    chains = tuple(
        tuple(groups[k] for k in range(len(legs)) if views[k] == view) for view in set(views)
    )
    # Of a leg with several images that of the camera that shows most of the flight starts best.
    shown = {view: sum(leg.n_pixels for leg in legs if leg.view == view) for view in set(views)}
    best: tuple[float, PathState, tuple[int, ...]] | None = None
    problem: GeometryError | None = None
    for order in islice(_orders(chains), _MOST_ORDERS):
        told = []
        for group in order:
            own = [k for k in range(len(legs)) if groups[k] == group]
            first = max(own, key=lambda k: (shown[views[k]], legs[k].n_pixels))
            told.append(curves[first].earlier(late_ps[views[first]]))
        try:
            state, cost = state_from_curves(told, source=setting.source, medium=setting.medium)
        except GeometryError as reason:
            problem = problem or reason
            continue
        if best is None or cost < best[0]:
            best = cost, state, order
    if best is None:
        assert problem is not None
        raise problem
    images = tuple(
        tuple(legs[k] for k in range(len(legs)) if groups[k] == group) for group in best[2]
    )
    return best[1], images


def _curves(legs: Sequence[ImageLeg], setting: Setting) -> list[LegCurve]:
    """What each image showed, to a camera in the scene's own medium."""
    found: dict[int, LegCurve] = {}
    for view, camera in enumerate(setting.cameras):
        own = [k for k, leg in enumerate(legs) if leg.view == view]
        shown = curves_of_legs(tuple(legs[k] for k in own), camera, setting.medium) if own else []
        found |= dict(zip(own, shown, strict=True))
    return [found[k] for k in range(len(legs))]


def _grouped(
    legs: Sequence[ImageLeg], curves: Sequence[LegCurve], setting: Setting, std_ps: float
) -> tuple[list[int], list[float]]:
    """Which leg of the flight each image is of, by number, and how late each camera's clock is.

    The surest pairs first; one that would turn the order of a picture round is none.
    """
    views = [leg.view for leg in legs]
    pairs = []
    for one, other in combinations(range(len(legs)), 2):
        if views[one] == views[other]:
            continue
        px_rad = 1.0 / mean_focal_px(setting.cameras[views[other]])
        misfit, later = _misfit(curves[one], curves[other], setting.medium, std_ps, px_rad)
        stated = [setting.cameras[views[k]].clock_offset_std_ps for k in (one, other)]
        most = _APART_STDS * float(np.hypot.reduce([PLAUSIBLE["clock_offset"].size, *stated]))
        if misfit < 1.0 and abs(later) < most:
            pairs.append(_Pair(misfit, one, other, later))
    groups, taken = list(range(len(legs))), []
    for pair in sorted(pairs, key=lambda one: one.misfit):
        ids = {groups[pair.one], groups[pair.other]}
        together = [views[k] for k in range(len(legs)) if groups[k] in ids]
        trial = [min(ids) if group in ids else group for group in groups]
        chains = tuple(
            tuple(trial[k] for k in range(len(legs)) if views[k] == view) for view in set(views)
        )
        if len(set(together)) == len(together) and next(_orders(chains), None) is not None:
            groups = trial
            taken.append(pair)
    return groups, _late_clocks(taken, views, len(setting.cameras))


def _late_clocks(pairs: list[_Pair], views: list[int], n_views: int) -> list[float]:
    """How much later than the first one's each camera's clock is, as legs seen by both tell; ps."""
    links = [(views[pair.one], views[pair.other], pair.later_ps) for pair in pairs]
    links += [(other, one, -later) for one, other, later in links]
    late: dict[int, float] = {}
    for root in range(n_views):
        # A camera that shares no leg with those before is taken at its word.
        found = {root: 0.0} if root not in late else {}
        while found:
            late |= found
            told = {to for of, to, _ in links if of in late and to not in late}
            found = {
                to: float(np.median([late[of] + by for of, end, by in links
                                     if end == to and of in late]))
                for to in told
            }  # fmt: skip
    return [late[view] for view in range(n_views)]


def _misfit(
    one: LegCurve, other: LegCurve, medium: Medium, std_ps: float, px_rad: float
) -> tuple[float, float]:
    """How far two images are from those of one straight leg, and by how much the second is later.

    Rms of what is left of the second's places, in `_SAME_PX` of a pixel that is `px_rad` wide,
    and of both images' times, in `_SAME_STDS` of a pulse, each camera's clock by itself;
    the leg lies in the first's viewing plane, at two depths that are fitted.
    """

    def left(log_depths: Floats) -> tuple[Floats, float]:
        start, end = (
            one.center_mm + depth * ray
            for depth, ray in zip(np.exp(log_depths), one.rays[[0, -1]], strict=True)
        )
        # Depths that run away to nothing leave no direction.
        along = (end - start) / max(float(np.linalg.norm(end - start)), np.finfo(float).tiny)
        misses, means = [], []
        for curve in (one, other):
            length, depth = (each[0] for each in line_meetings(start, along[np.newaxis], curve))
            ways = medium.path_group_index * length + medium.return_group_index * depth
            late = curve.arrival_ps - ways / SPEED_OF_LIGHT_MM_PER_PS
            means.append(late.mean())
            misses.append((late - late.mean()) / (_SAME_STDS * std_ps))
        points = start + length[:, np.newaxis] * along - other.center_mm
        far = np.linalg.norm(points, axis=1)
        aside = points @ other.plane_normal / (far * px_rad * _SAME_PX)
        # Behind a camera nothing is seen.
        behind = np.where(depth > 0.0, 0.0, _BEHIND)
        return np.concatenate((*misses, aside + behind)), float(means[1] - means[0])

    def misses_at(log_depths: Floats) -> Floats:
        return left(log_depths)[0]

    baseline = max(float(np.linalg.norm(other.center_mm - one.center_mm)), 1.0)
    best = np.inf, 0.0
    for guess in _DEPTHS:
        at = np.full(2, np.log(guess * baseline))
        found = least_squares(misses_at, at, max_nfev=_MOST_TRIALS)
        rms = float(np.sqrt(np.mean(found.fun**2)))
        best = min(best, (rms, left(found.x)[1]))
    return best


def _orders(chains: tuple[tuple[int, ...], ...]) -> Iterator[tuple[int, ...]]:
    """All orders of legs in which those of each chain keep theirs."""
    chains = tuple(chain for chain in chains if chain)
    if not chains:
        yield ()
    for first in dict.fromkeys(chain[0] for chain in chains):
        if not any(first in chain[1:] for chain in chains):
            rest = tuple(chain[1:] if chain[0] == first else chain for chain in chains)
            yield from ((first, *after) for after in _orders(rest))
