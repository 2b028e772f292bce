"""Legs in the picture: straight pieces in (u, v, t_a), found without being told how many.

Takes `Arrivals`, gives legs (`ImageLeg`) in the order of flight. No metric scale is needed: where
time per bin and camera distance are unknown, the chain ends here.

What makes a leg: its pulses lie on one straight line of the undistorted picture, and their
arrival times run smoothly along it, one way. Light that flies and returns in one medium reaches
the camera in the order in which it was scattered (triangle inequality), so legs never overlap
in t_a and their order is that of their times.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags
from lightflight.arguments import check_kinds, finite_number, shown, whole_number, yes_or_no
from lightflight.errors import NothingFoundError
from lightflight.reconstruct.legs.cut import cut_at_kink, part_where_curved
from lightflight.reconstruct.legs.ghosts import on_border, on_surfaces, overshone
from lightflight.reconstruct.legs.search import (
    SearchSettings,
    best_line,
    distinct_positions,
    fitted_line,
    fitted_times,
    refine_members,
)
from lightflight.reconstruct.model.image_plane import along_across, undistorted_px

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.timing.pulses.arrivals import Arrivals

Floats = NDArray[np.float64]

_LONG_PX = 8
"""A leg seen at so many places along its line is a leg, however broad or swift."""
_SLENDER = 6.0
"""A shorter one is longer than its breadth (rms) by this factor ..."""
_LEAST_RUN = 0.2
"""... and light takes longer than this from its one end to the other, in stds of a pulse."""
_MOST_GROUPS = 64
"""Far more legs than a picture holds, so that noise cannot keep the search busy."""
_GHOST_SHARE = 0.25
"""Legs of a computed cube dimmer per pixel than this share of the brightest are ghosts."""


@dataclass(frozen=True, eq=False, repr=False)
class ImageLeg:
    """One straight leg as the camera sees it, in undistorted pixels.

    A point at distance s (px) along the leg is at (u, v) = origin_px + s direction_px, and light
    from it arrives at sum_k time_coefficients[k] s^k.

    Attributes
    ----------
    members : array of int, shape (n,)
        Rows of the arrivals table that belong to the leg.
    origin_px : array of float, shape (2,)
        (u, v) of the middle of the leg; u = col, v = row.
    direction_px : array of float, shape (2,)
        Unit, in the direction of flight.
    extent_px : (float, float)
        First and last s at which the leg was seen, px from `origin_px`.
    time_coefficients : array of float, shape (k,)
        Polynomial of the arrival time in s, lowest power first; ps (or codes) per px^k.
    n_pixels : int
        Distinct pixel positions along the leg.
    residual_rms_ps : float
        rms of arrival times about the polynomial.
    breadth_px : float
        rms distance of its light from the line, px.
    view : int
        Which camera's picture shows it, where there are several.
    """

    members: NDArray[np.int64]
    origin_px: Floats
    direction_px: Floats
    extent_px: tuple[float, float]
    time_coefficients: Floats
    n_pixels: int
    residual_rms_ps: float
    breadth_px: float
    view: int = field(default=0, kw_only=True)

    def __repr__(self) -> str:
        (u0, v0), (u1, v1) = self.points_px(self.extent_px)
        first, last = self.span_ps
        return (
            f"ImageLeg({self.n_pixels} pixels, (u, v) ({u0:.1f}, {v0:.1f}) to "
            f"({u1:.1f}, {v1:.1f}) px, {first:.1f} to {last:.1f} ps, "
            f"rms {self.residual_rms_ps:.2g} ps)"
        )

    def points_px(self, s: ArrayLike) -> Floats:
        """(u, v) at distances `s` along the leg; (..., 2), px."""
        along = np.asarray(s, dtype=float)[..., np.newaxis]
        points: Floats = self.origin_px + along * self.direction_px
        return points

    def arrival_ps(self, s: ArrayLike) -> Floats:
        """Arrival time at distances `s` along the leg; (...), ps (codes without a scale)."""
        return np.polynomial.polynomial.polyval(np.asarray(s, dtype=float), self.time_coefficients)

    @property
    def apparent_speed_px_per_ps(self) -> float:
        """Mean speed in the picture over what was seen, px per ps (per code without a scale)."""
        first, last = self.span_ps
        return (self.extent_px[1] - self.extent_px[0]) / (last - first)

    @property
    def curvature_ps_per_px2(self) -> float:
        """d^2 t_a / ds^2; positive for straight light on a clock that runs forward."""
        c = self.time_coefficients
        return float(2 * c[2]) if len(c) > 2 else 0.0

    @property
    def span_ps(self) -> tuple[float, float]:
        """Arrival times at the first and the last point seen, ps."""
        first, last = self.arrival_ps(np.array(self.extent_px))
        return float(first), float(last)


Images = tuple[ImageLeg, ...]
"""Of one leg: one in each picture that shows it."""


def unwrapped_arrivals(
    arrival_ps: ArrayLike, *, period_ps: float | None, earliest_ps: float | None = None
) -> Floats:
    """Arrival times shifted by whole laser periods so that one flight is in one piece.

    Light cannot arrive before `earliest_ps`; where that is not known, the cut is put into the
    longest silence of the period. Returns (n,), ps.

    Parameters
    ----------
    arrival_ps : array_like, shape (n,)
        On the clock, ps.
    period_ps : float or None
        Laser period, ps; None: the clock does not start anew.
    earliest_ps : float, optional
        No light arrives before this, ps; None: not known.

    Returns
    -------
    array of float, shape (n,)
        ps.
    """
    times = np.asarray(arrival_ps, dtype=float)
    if period_ps is None or not len(times):
        return times.copy()
    if earliest_ps is None:
        folded = np.sort(np.mod(times[np.isfinite(times)], period_ps))
        if not len(folded):
            return times.copy()
        silence = np.diff(np.append(folded, folded[0] + period_ps))
        longest = int(np.argmax(silence))
        first = folded[(longest + 1) % len(folded)]
        earliest_ps = float(first - 0.5 * silence[longest])
        # The clock's own zero is kept: the greater part of the light stays within its period, and
        # a stray pulse, however far from the others, cannot move all of them.
        pieced = earliest_ps + np.mod(folded - earliest_ps, period_ps)
        earliest_ps -= period_ps * float(np.floor(np.median(pieced) / period_ps))
    unwrapped: Floats = earliest_ps + np.mod(times - earliest_ps, period_ps)
    return unwrapped


def find_legs(
    arrivals: Arrivals,
    *,
    camera: Camera | None = None,
    n_legs: int | None = None,
    min_pixels: int = 4,
    earliest_ps: float | None = None,
    convex: bool | None = None,
    computed_cube: bool = False,
    seed: int = 0,
) -> tuple[ImageLeg, ...]:
    """Legs of one flight, in the order of flight.

    Parameters
    ----------
    arrivals : Arrivals
        Pulses of one recording; hot, dead and background pixels take no part.
    camera : Camera, optional
        Undistorts the picture; None: pixels are taken as they are.
    n_legs : int, optional
        No more legs than this, the brightest, where the user knows; None: as many as the data
        show.
    min_pixels : int, optional
        Distinct pixel positions a leg must be seen by.
    earliest_ps : float, optional
        No light arrives before this time on the clock, ps (folds the period there).
    convex : bool, optional
        Straight light in one medium arrives on a curve that bends upwards (half-angle law); True
        refuses legs that do not. None: True where there is a camera.
    computed_cube : bool, optional
        The counts are a reconstruction (scaled intensities, `poisson=False`), whose border collects
        what it could not place: its two outermost rows and columns are left out.
    seed : int, optional
        Of the random search; the same seed gives the same legs.

    Raises
    ------
    NothingFoundError
        Where no straight leg stands out, with the number of usable pulses.
    """
    check_kinds("arrivals", arrivals=arrivals, camera=camera)
    if n_legs is not None and whole_number("n_legs", n_legs) < 1:
        raise ValueError(f"n_legs must be at least 1, got {shown(n_legs)}")
    if whole_number("min_pixels", min_pixels) < 2:
        raise ValueError(f"min_pixels must be at least 2, got {shown(min_pixels)}")
    seed = whole_number("seed", seed)
    if seed < 0:
        raise ValueError(f"seed must be at least 0, got {shown(seed)}")
    computed_cube = yes_or_no("computed_cube", computed_cube)
    convex = camera is not None if convex is None else yes_or_no("convex", convex)
    if earliest_ps is not None:
        finite_number("earliest_ps", earliest_ps)
    usable = flags.is_usable(arrivals.flags) & np.isfinite(arrivals.arrival_ps)
    rows = np.flatnonzero(usable)
    if len(rows) < min_pixels:
        raise NothingFoundError(
            f"only {len(rows)} pixels hold a usable pulse and a leg needs {min_pixels}: record "
            "longer, or look at the flags of the pixels (`lightflight info`)"
        )
    times = unwrapped_arrivals(
        arrivals.arrival_ps[rows], period_ps=arrivals.laser_period_ps, earliest_ps=earliest_ps
    )
    errors = arrivals.independent_std_ps[rows]
    typical_ps = float(np.median(arrivals.std_ps[rows]))
    settings = SearchSettings(
        min_pixels=min_pixels,
        # A third of a pulse: footprints and corners shift times by more than counting says.
        time_floor=0.35 * typical_ps,
        convex=convex,
        winged=computed_cube,
        seed=seed,
    )
    points = undistorted_px(camera, arrivals.row[rows], arrivals.col[rows])
    weights = np.maximum(arrivals.photons[rows], 1e-12)
    # Ghosts go first: many of them on a line would make a leg.
    flight = ~overshone(points, times, weights, typical_ps)
    pixels = arrivals.row[rows], arrivals.col[rows]
    surface = on_surfaces(*pixels, arrivals.shape, times, weights, typical_ps)
    flight &= ~surface
    if computed_cube:
        flight &= ~on_border(*pixels, arrivals.shape)
    n_pulses = len(rows)
    rows, points, times = rows[flight], points[flight], times[flight]
    errors, weights = errors[flight], weights[flight]
    std_ps = float(np.median(arrivals.std_ps[rows])) if len(rows) else typical_ps

    def found(*, parted: bool) -> list[ImageLeg]:
        groups = _disjoint_groups(points, times, errors, weights, settings, parted=parted)
        legs = [_image_leg(group, rows, points, times, errors, weights) for group in groups]
        legs = [leg for leg in legs if not is_flash(leg, std_ps=std_ps)]
        # Photons, not pixels: a ghost may be long, but it is dim.
        strength = [float(arrivals.photons[leg.members].sum()) for leg in legs]
        if computed_cube:
            legs, strength = without_dim_legs(legs, strength)
        return legs_in_turn(legs, strength, std_ps=std_ps)

    legs = found(parted=n_legs is None)
    if n_legs is not None and len(legs) < n_legs:
        legs = found(parted=True)
    if n_legs is not None:
        legs = _brightest(legs, n_legs, arrivals)
    if not legs:
        raise _no_leg(n_pulses, min_pixels, int(np.count_nonzero(surface)))
    return tuple(legs)


def _no_leg(n_pulses: int, min_pixels: int, n_about: int) -> NothingFoundError:
    """What to say where pulses make no leg; `n_about` of them took no part."""
    about = (
        f" ({n_about} took no part: they come from all about at one moment, as light on a wall, a "
        "leak or a beam ten pixels wide)"
    )
    return NothingFoundError(
        f"{n_pulses} pixels hold a pulse but no {min_pixels} of them lie on a straight line with "
        f"times that run smoothly along it{about if n_about else ''}: mask false pixels, or give a "
        "starting path"
    )


def is_flash(leg: ImageLeg, *, std_ps: float) -> bool:
    """True for a patch of pixels that light up at once, as broad as long: a screw that shines.

    Parameters
    ----------
    leg : ImageLeg
        The leg in question.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    """
    if leg.n_pixels >= _LONG_PX:
        return False
    run_ps = leg.span_ps[1] - leg.span_ps[0]
    return leg.n_pixels < _SLENDER * leg.breadth_px or run_ps < _LEAST_RUN * std_ps


def without_dim_legs(
    legs: list[ImageLeg], strength: list[float]
) -> tuple[list[ImageLeg], list[float]]:
    """Legs of a computed cube that are bright enough, per pixel, not to be its ghosts.

    Parameters
    ----------
    legs : list of ImageLeg
        Legs found.
    strength : list of float
        Photons of each.

    Returns
    -------
    legs : list of ImageLeg
        Those that stay.
    strength : list of float
        Theirs.
    """
    per_pixel = np.array([w / leg.n_pixels for leg, w in zip(legs, strength, strict=True)])
    bright = per_pixel > _GHOST_SHARE * per_pixel.max(initial=0.0)
    return (
        [leg for leg, keep in zip(legs, bright, strict=True) if keep],
        [w for w, keep in zip(strength, bright, strict=True) if keep],
    )


def legs_in_turn(legs: list[ImageLeg], strength: list[float], *, std_ps: float) -> list[ImageLeg]:
    """The brightest set of legs that follow one another in arrival time, in that order.

    Legs of one flight never overlap in t_a; of those that do, all but one are ghosts, wings or
    parts of another. Weighted interval scheduling; about a corner legs may overlap by two pixels
    of their own run and a pulse's width.

    Parameters
    ----------
    legs : list of ImageLeg
        Legs found, in any order.
    strength : list of float
        Photons of each.
    std_ps : float
        Typical standard deviation of a pulse, ps.

    Returns
    -------
    list of ImageLeg
        In the order of flight.
    """
    order = sorted(range(len(legs)), key=lambda k: sum(legs[k].span_ps))
    best: list[float] = []
    before: list[int] = []
    for i, k in enumerate(order):
        best.append(strength[k])
        before.append(-1)
        # Best chain that ends with this leg: the best that ended before it, and itself.
        for j in range(i):
            one, other = legs[order[j]], legs[k]
            overlap = one.span_ps[1] - other.span_ps[0]
            if overlap < _corner_ps(one, other, std_ps) and best[j] + strength[k] > best[i]:
                best[i], before[i] = best[j] + strength[k], j
    chain: list[ImageLeg] = []
    i = int(np.argmax(best)) if best else -1
    while i >= 0:
        chain.append(legs[order[i]])
        i = before[i]
    return chain[::-1]


def _corner_ps(one: ImageLeg, other: ImageLeg, std_ps: float) -> float:
    """By how much two legs that meet at a corner may seem to overlap in arrival time, ps."""
    two_px = [2.0 * abs(leg.time_coefficients[1]) for leg in (one, other)]
    spans = [float(np.ptp(leg.span_ps)) for leg in (one, other)]
    # A long leg runs on into the light of a short one; half of a leg inside another is a ghost.
    ghostly = max(0.5 * min(spans), two_px[int(np.argmax(spans))])
    return float(min(std_ps + sum(two_px), ghostly))


def _disjoint_groups(
    points: Floats,
    times: Floats,
    errors: Floats,
    weights: Floats,
    settings: SearchSettings,
    *,
    parted: bool,
) -> list[NDArray[np.int64]]:
    """Greedy search: the longest leg first, its pulses removed, until nothing stands out.

    `parted`: legs that run on a bend in the picture are cut into straight ones.
    """
    left = np.arange(len(times))
    groups: list[NDArray[np.int64]] = []
    while len(left) >= settings.min_pixels and len(groups) < _MOST_GROUPS:
        found = best_line(points[left], times[left], errors[left], weights[left], settings)
        if found is None:
            break
        members, halo = refine_members(
            points[left], times[left], errors[left], weights[left], found, settings
        )
        if not len(members):
            break
        pieces = cut_at_kink(
            points[left], times[left], errors[left], weights[left], members, settings
        )
        if parted:
            pieces = [
                part
                for piece in pieces
                for part in part_where_curved(points[left], weights[left], piece, settings)
            ]
        # Each piece is a leg of its own, but the halo of all is taken off at once.
        groups.extend(left[piece] for piece in pieces)
        left = left[~halo]
    return groups


def _brightest(legs: list[ImageLeg], n_legs: int, arrivals: Arrivals) -> list[ImageLeg]:
    """At most so many of the legs, those of most photons, still in the order of flight."""
    strength = [float(arrivals.photons[leg.members].sum()) for leg in legs]
    kept = sorted(np.argsort(strength)[::-1][:n_legs])
    return [legs[k] for k in kept]


def image_leg(arrivals: Arrivals, members: NDArray[np.intp], camera: Camera | None) -> ImageLeg:
    """The leg through pulses said to be its own; `members` (n,), rows of the arrivals table.

    Parameters
    ----------
    arrivals : Arrivals
        Pulses on the clock.
    members : array of int, shape (n,)
        Rows of the arrivals table.
    camera : Camera or None
        Undistorts the picture; None: pixels are taken as they are.

    Returns
    -------
    ImageLeg
        In the direction in which times grow.
    """
    return _image_leg(
        np.arange(len(members)),
        members,
        undistorted_px(camera, arrivals.row[members], arrivals.col[members]),
        arrivals.arrival_ps[members],
        arrivals.independent_std_ps[members],
        np.maximum(arrivals.photons[members], 1e-12),
    )


def _image_leg(
    group: NDArray[np.int64],
    rows: NDArray[np.intp],
    points: Floats,
    times: Floats,
    errors: Floats,
    weights: Floats,
) -> ImageLeg:
    """Line and time polynomial through one group of pulses."""
    origin, direction = fitted_line(points[group], weights[group])
    s, across = along_across(points[group], origin, direction)
    coefficients = fitted_times(s, times[group], errors[group])
    middle_slope = np.polynomial.polynomial.polyval(
        0.0, np.polynomial.polynomial.polyder(coefficients)
    )
    # The direction of flight is that in which light arrives later.
    if middle_slope < 0:
        direction, s = -direction, -s
        coefficients = coefficients * (-1.0) ** np.arange(len(coefficients))
    residual = times[group] - np.polynomial.polynomial.polyval(s, coefficients)
    return ImageLeg(
        members=rows[group],
        origin_px=origin,
        direction_px=direction,
        extent_px=(float(s.min()), float(s.max())),
        time_coefficients=coefficients,
        n_pixels=distinct_positions(s),
        residual_rms_ps=float(np.sqrt(np.mean(residual**2))),
        breadth_px=float(np.sqrt(np.average(across**2, weights=weights[group]))),
    )
