"""The footprint of a pixel on a leg, in three moments: share of the light, mean time, width.

A pixel's light comes from a stretch of the leg as long as the spot is wide, cut where the leg has a
corner. `footing` integrates over it and says how the moments follow the strength's slope, the
spot and the corners; `corner_distances` says how the corners follow the path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.geometry import Footprint, PathState

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(16)
"""Gauss-Legendre places and weights on [-1, 1]: 16 integrate any cut Gaussian to rounding."""
_SPOT_REACH = 4.0
"""Half width of a footprint, in standard deviations of the spot."""
_STEEPEST = 3.0
"""Largest slope of the log-strength that is believed, per px."""


@dataclass(frozen=True, eq=False)
class Moment:
    """One moment of the footprint and its derivatives; (n,) each.

    Attributes
    ----------
    value : array of float
        The moment.
    by_slope : array of float
        By d ln(strength) / d(along), times px.
    by_log_spot : array of float
        By the log of the spot's standard deviation.
    by_before : array of float
        By the place of the corner before the foot, per px.
    by_after : array of float
        By the place of the corner after the foot, per px.
    """

    value: Floats
    by_slope: Floats
    by_log_spot: Floats
    by_before: Floats
    by_after: Floats


@dataclass(frozen=True, eq=False)
class Footing:
    """Moments of one leg's footprint in each pixel near it.

    Attributes
    ----------
    log_share : Moment
        Log of the light, as a share of what the same leg without corners would give.
    offset_ps : Moment
        Mean arrival time minus that of the foot, ps.
    variance_ps2 : Moment
        Variance of the arrival time over the footprint, ps^2.
    third_ps3 : array of float, shape (n,)
        Third cumulant of it, ps^3.
    """

    log_share: Moment
    offset_ps: Moment
    variance_ps2: Moment
    third_ps3: Floats


@dataclass(frozen=True, eq=False)
class Corners:
    """Picture distance from each foot to the corners of its leg, signed, and its derivatives.

    Attributes
    ----------
    before : array of float, shape (n,)
        px, -inf where nothing cuts the light off.
    after : array of float, shape (n,)
        px, inf where nothing does.
    before_by_state : array of float, shape (n, size)
        px per mm.
    after_by_state : array of float, shape (n, size)
        px per mm.
    """

    before: Floats
    after: Floats
    before_by_state: Floats
    after_by_state: Floats


def footing(
    log_slope: Floats,
    time_slope: Floats,
    time_curvature: Floats,
    corners: Corners,
    *,
    spot_px: Floats | float,
) -> Footing:
    """Moments over the footprint of strength exp(log_slope s) under the spot, cut at corners.

    Parameters
    ----------
    log_slope : array of float, shape (n,)
        D ln(strength) / d(along), per px.
    time_slope, time_curvature : array of float, shape (n,)
        Of the arrival time along the leg, ps/px and ps/px^2.
    spot_px : array of float, shape (n,) or float
        Standard deviation of the spot, px.
    """
    spot_px = np.broadcast_to(spot_px, log_slope.shape)
    # The footprint ends where the spot does, or at the corner.
    low = np.maximum(-_SPOT_REACH * spot_px, corners.before)
    high = np.minimum(_SPOT_REACH * spot_px, corners.after)
    half = 0.5 * np.maximum(high - low, 0.0)
    s = 0.5 * (low + high)[:, np.newaxis] + half[:, np.newaxis] * _NODES
    # A spline between dim pixels may rise without reason; the footprint must not follow.
    kappa = np.clip(log_slope, -_STEEPEST, _STEEPEST)
    believed = np.abs(log_slope) < _STEEPEST

    # The slope keeps the strength at the foot as the reference, as the spline does.
    density = _density(s, kappa[:, np.newaxis], spot_px[:, np.newaxis])
    weight = _NODE_WEIGHTS * density * half[:, np.newaxis]
    total = weight.sum(axis=1)
    weight /= np.maximum(total, 1e-300)[:, np.newaxis]
    time = _time_at(s, time_slope[:, np.newaxis], time_curvature[:, np.newaxis])
    mean = np.sum(weight * time, axis=1)
    mean_s, mean_s2 = np.sum(weight * s, axis=1), np.sum(weight * s**2, axis=1)
    # All light is cut away: no moment has a meaning there, and none may move the path.
    dark = total < 1e-12

    off = time - mean[:, np.newaxis]
    spread = np.sum(weight * off**2, axis=1)

    def at_cut(where: Floats, inside: NDArray[np.bool_], sign: float) -> tuple[Floats, ...]:
        """Derivatives of (log share, mean time, variance) by the place of a cut."""
        cuts = inside & (half > 0) & ~dark
        place = np.where(cuts, where, 0.0)
        rate = np.where(
            cuts, sign * _density(place, kappa, spot_px) / np.maximum(total, 1e-300), 0.0
        )
        gap = _time_at(place, time_slope, time_curvature) - mean
        return rate, rate * gap, rate * (gap**2 - spread)

    before = at_cut(corners.before, corners.before > -_SPOT_REACH * spot_px, -1.0)
    after = at_cut(corners.after, corners.after < _SPOT_REACH * spot_px, 1.0)
    # The spline is the strength after the spot's smoothing: divide by what an uncut one holds.
    log_uncut = 0.5 * (kappa * spot_px) ** 2
    share = Moment(
        value=np.maximum(np.log(np.maximum(total, 1e-300)) - log_uncut, np.log(1e-12)),
        by_slope=np.where(believed & ~dark, mean_s - kappa * spot_px**2, 0.0),
        by_log_spot=np.where(dark, 0.0, mean_s2 / spot_px**2 - 1.0 - 2.0 * log_uncut),
        by_before=before[0],
        by_after=after[0],
    )
    time_s, time_s2 = np.sum(weight * time * s, axis=1), np.sum(weight * time * s**2, axis=1)
    offset = Moment(
        value=mean,
        by_slope=np.where(believed, time_s - mean * mean_s, 0.0),
        by_log_spot=(time_s2 - mean * mean_s2) / spot_px**2,
        by_before=before[1],
        by_after=after[1],
    )
    spread_s, spread_s2 = (
        np.sum(weight * off**2 * s, axis=1),
        np.sum(weight * off**2 * s**2, axis=1),
    )
    variance = Moment(
        value=spread,
        by_slope=np.where(believed, spread_s - spread * mean_s, 0.0),
        by_log_spot=(spread_s2 - spread * mean_s2) / spot_px**2,
        by_before=before[2],
        by_after=after[2],
    )
    return Footing(share, offset, variance, np.sum(weight * off**3, axis=1))


def _density(along: Floats, log_slope: Floats, spot_px: Floats) -> Floats:
    """Light per px at `along`, px from the foot: the spot times exp(log_slope along)."""
    norm = np.sqrt(2 * np.pi) * spot_px
    height: Floats = np.exp(-0.5 * (along / spot_px) ** 2 + log_slope * along) / norm
    return height


def _time_at(along: Floats, slope: Floats, curvature: Floats) -> Floats:
    """Arrival time at `along`, px from the foot, minus that of the foot, ps."""
    return slope * along + 0.5 * curvature * along**2


def corner_distances(
    state: PathState,
    print_: Footprint,
    leg: int,
    *,
    camera: Camera,
    cut_ends: tuple[bool, ...] = (False, False),
) -> Corners:
    """Picture distance from the feet of pixels on one leg to where it is cut before and after.

    Legs are cut at corners. The ends of the path are cuts only where `cut_ends` (first, lasts) says
    so: what lies beyond them is not always dark. Mirrors that nobody sees cut nothing: where they
    stand is open, and light that fades by the picture's edge would seem to place them.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    print_ : Footprint
        Feet of the pixels on the leg.
    leg : int
        Index of the leg.
    camera : Camera
        The camera that sees it.
    cut_ends : tuple of bool, optional
        Whether the light begins at the path's first vertex, and stops at its last, or at the end
        of each of its arms, in the order of `PathState.last_legs`.

    Returns
    -------
    Corners
        Signed distances, infinite where nothing cuts, and how they follow the state.
    """
    n, size = len(print_.fraction), state.size
    before, after = np.full(n, -np.inf), np.full(n, np.inf)
    by_before, by_after = np.zeros((n, size)), np.zeros((n, size))
    start = int(state.leg_starts[leg])
    at_start, at_end = state.tangents_mm(leg, np.array([0.0, 1.0]))

    def slide(vertex: int, step: Floats) -> Floats:
        """How a corner's image moves along the leg's, (3,), px per mm."""
        projection = np.nan_to_num(camera.pixel_jacobian(state.vertices_mm[vertex]))
        along = projection @ step
        moved: Floats = along @ projection / max(float(np.linalg.norm(along)), 1e-12)
        return moved

    open_at = {vertex for k in state.unseen for vertex in (int(state.leg_starts[k]), k + 1)}
    if (leg > 0 or cut_ends[0]) and start not in open_at:
        before = -print_.fraction * print_.px_per_leg
        by_before[:, 3 * start : 3 * start + 3] = slide(start, at_start)
    stops = dict(zip(state.last_legs, cut_ends[1:], strict=False))
    if stops.get(leg, leg not in state.last_legs) and leg + 1 not in open_at:
        after = (1 - print_.fraction) * print_.px_per_leg
        by_after[:, 3 * leg + 3 : 3 * leg + 6] = slide(leg + 1, at_end)
    return Corners(before, after, by_before, by_after)
