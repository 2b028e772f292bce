"""A first path from legs in the picture: leg by leg, each starting where the last one ended.

Takes `ImageLeg`s (in the order of flight) and what is known of the source, gives a `PathState`
good enough for the joint fit to finish. One leg at a time it tries every direction in the leg's
viewing plane (a grid, then a refinement), so that no start value is needed and steep legs are
no trap; the corner between two legs is where the first one's line meets the second one's
viewing plane (Zheng et al. 2020, Fig. 4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.blocks import Block
from lightflight.camera.stand_in import meeting_point
from lightflight.errors import GeometryError
from lightflight.flight import Medium, Source
from lightflight.reconstruct.fit.through_glass import Pieces
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.image_plane import mean_focal_px, pixels_of_undistorted
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_GRID = 721
"""Directions tried per leg: every quarter degree of half a turn and back."""
_REFINED = 4
"""Grids of directions, each finer than the one before."""
_SAMPLES = 24
"""Points of a leg's smoothed arrival curve that the start is fitted to."""
_SHALLOW = np.sin(np.deg2rad(4.0))
"""A leg this near to the next one's viewing plane does not fix their corner."""


@dataclass(frozen=True, eq=False)
class LegCurve:
    """What one leg showed: rays along it and smoothed arrival times.

    Attributes
    ----------
    rays : array of float, shape (k, 3)
        Unit, world.
    arrival_ps : array of float, shape (k,)
        ps.
    plane_normal : array of float, shape (3,)
        Unit, of the viewing plane; ray x flight.
    center_mm : array of float, shape (3,)
        World, mm: where the rays come together.
    direction : array of float, shape (3,) or None
        The only one that is tried, world; None: all.
    """

    rays: Floats
    arrival_ps: Floats
    plane_normal: Floats
    center_mm: Floats
    direction: Floats | None = None

    def earlier(self, by_ps: float) -> LegCurve:
        """The same on a clock that is less late."""
        return replace(self, arrival_ps=self.arrival_ps - by_ps)


@dataclass(frozen=True, eq=False)
class Straight:
    """A leg that starts at a known place and time.

    Attributes
    ----------
    start_mm : array of float, shape (3,)
        World, mm.
    start_time_ps : float
        Event time at the start, ps.
    direction : array of float, shape (3,)
        Unit, world.
    cost : float
        Mean squared misfit of the arrival times, ps^2.
    """

    start_mm: Floats
    start_time_ps: float
    direction: Floats
    cost: float


def world_rays(camera: Camera, points_px: Floats) -> Floats:
    """Unit rays (n, 3) of undistorted picture points (n, 2), world frame."""
    focal = mean_focal_px(camera)
    in_camera = np.column_stack((points_px / focal, np.ones(len(points_px))))
    rays = in_camera @ camera.world_from_camera[:3, :3].T
    unit: Floats = rays / np.linalg.norm(rays, axis=1)[:, np.newaxis]
    return unit


def curve_from_leg(leg: ImageLeg, camera: Camera) -> LegCurve:
    """Rays and smoothed arrival times along a leg seen in the picture."""
    s = np.linspace(*leg.extent_px, _SAMPLES)
    return _curve(world_rays(camera, leg.points_px(s)), leg.arrival_ps(s), camera.center_mm)


def _curve(rays: Floats, arrival_ps: Floats, center_mm: Floats) -> LegCurve:
    normal = np.cross(rays[0], rays[-1])
    return LegCurve(rays, arrival_ps, normal / np.linalg.norm(normal), center_mm)


def curves_of_legs(legs: tuple[ImageLeg, ...], camera: Camera, medium: Medium) -> list[LegCurve]:
    """What each leg showed to one camera, on the clock that all count on.

    Parameters
    ----------
    legs : tuple of ImageLeg
        Legs as found in its picture.
    camera : Camera
        The camera.
    medium : Medium
        Group indices out and back.

    Returns
    -------
    list of LegCurve
        In their order, as seen in the scene's own medium.
    """
    if camera.interfaces:
        curves = _as_seen_in_one_medium(legs, camera, medium)
    else:
        curves = [curve_from_leg(leg, camera) for leg in legs]
    late_ps = camera.clock_offset_ps
    return [curve.earlier(late_ps) for curve in curves] if late_ps else curves


def _as_seen_in_one_medium(
    legs: tuple[ImageLeg, ...], camera: Camera, medium: Medium
) -> list[LegCurve]:
    """What each leg showed to a camera without interfaces that sees nearly the same.

    It stands where these legs' rays come from, and what their light needed more up to the
    interface is taken off the times.
    """
    sights, plain = [], replace(camera, interfaces=())
    for leg in legs:
        points = leg.points_px(np.linspace(*leg.extent_px, _SAMPLES))
        sights.append(camera.lines_of_sight(*pixels_of_undistorted(plain, points)))
    origins, rays, optical = (np.concatenate(part) for part in zip(*sights, strict=True))
    center = meeting_point(origins, rays)
    early = optical - medium.return_group_index * np.sum((origins - center) * rays, axis=1)
    curves = []
    for leg, own, more in zip(
        legs, np.split(rays, len(legs)), np.split(early, len(legs)), strict=True
    ):
        times = leg.arrival_ps(np.linspace(*leg.extent_px, _SAMPLES))
        curves.append(_curve(own, times - more / SPEED_OF_LIGHT_MM_PER_PS, center))
    return curves


def state_from_legs(
    legs: tuple[ImageLeg, ...],
    *,
    camera: Camera,
    source: Source,
    medium: Medium,
    depth_mm: float | None = None,
    told: tuple[int, Floats] | None = None,
    pieces: Pieces | None = None,
) -> PathState:
    """First guess of the whole path; the last vertex is the end of the last leg as seen.

    Parameters
    ----------
    legs : tuple of ImageLeg
        Legs as found in the picture, in the order of flight.
    camera : Camera
        The camera that sees it.
    source : Source
        What is known of where and when the pulse starts.
    medium : Medium
        Group indices out and back.
    depth_mm : float, optional
        How far from the camera a path from an unknown source enters the view, mm; None: as its
        times say, which few pulses do badly.
    told : (int, array of float, shape (3,)), optional
        A leg, by number, and the direction in which it is to fly; None: all as their times say.
    pieces : Pieces, optional
        Where glass stands in the beam, which leg of the flight each of `legs` is a piece of.

    Returns
    -------
    PathState
        Corners where one leg's line meets the next one's viewing plane; where glass stands in a
        leg, as if the light went straight through and were not late.

    Raises
    ------
    GeometryError
        Where a leg cannot follow the one before it.
    """
    curves = curves_of_legs(legs, camera, medium)
    if told is not None:
        curves[told[0]] = replace(curves[told[0]], direction=told[1])
    if pieces is not None:
        curves = _without_glass(pieces, curves, medium, known_start=source.position_mm is not None)
    return state_from_curves(curves, source=source, medium=medium, depth_mm=depth_mm)[0]


def state_from_curves(
    curves: Sequence[LegCurve], *, source: Source, medium: Medium, depth_mm: float | None = None
) -> tuple[PathState, float]:
    """The same from what each leg showed, to one camera or to several.

    Parameters
    ----------
    curves : sequence of LegCurve
        One for each leg, in the order of flight.
    source : Source
        What is known of where and when the pulse starts.
    medium : Medium
        Group indices out and back.
    depth_mm : float, optional
        As `state_from_legs`.

    Returns
    -------
    state : PathState
        As `state_from_legs`.
    cost : float
        By how much it misses the arrival times: sum over legs of the mean square, ps^2.

    Raises
    ------
    GeometryError
        Where a leg cannot follow the one before it.
    """
    if source.position_mm is None:
        first = _blind_first_leg(curves[0], medium, depth_mm)
    else:
        first = _first_leg_from_source(curves[0], source, medium)
    straights = [first]
    for seen, curve in pairwise(curves):
        straights.append(_following_leg(straights[-1], seen, curve, medium))
    last = straights[-1]
    ended, final = replace(curves[-1], rays=curves[-1].rays[-1:]), last.direction[np.newaxis]
    end = last.start_mm + _meetings(last.start_mm, final, ended)[0][0, 0] * last.direction
    vertices = np.array([leg.start_mm for leg in straights] + [end])
    return PathState(vertices, first.start_time_ps), sum(leg.cost for leg in straights)


def _without_glass(
    pieces: Pieces, curves: list[LegCurve], medium: Medium, *, known_start: bool
) -> list[LegCurve]:
    """One curve for all pieces of a leg, as if its light had met no glass square to its faces."""

    def late_ps(blocks: tuple[Block, ...]) -> float:
        ways = [(b.glass.group_index - medium.path_group_index) * b.thickness_mm for b in blocks]
        return float(sum(ways)) / SPEED_OF_LIGHT_MM_PER_PS

    late = late_ps(pieces.elsewhere) if known_start else 0.0
    found, left = [], iter(curves)
    for shown, between in zip(pieces.shown, pieces.between, strict=True):
        rays, times = [], []
        for number, piece in enumerate(shown):
            if piece is not None:
                curve = next(left)
                rays.append(curve.rays)
                times.append(curve.arrival_ps - late - late_ps(between[:number]))
        late += late_ps(between)
        found.append(_curve(np.concatenate(rays), np.concatenate(times), curve.center_mm))
    return found


def _in_plane_axes(curve: LegCurve) -> tuple[Floats, Floats]:
    """Axes of the viewing plane: along the flight in the picture, and away from the camera."""
    away = curve.rays[0] + curve.rays[-1]
    away = away / np.linalg.norm(away)
    along = np.cross(curve.plane_normal, away)
    return along, away


def _directions(curve: LegCurve, angles: Floats) -> Floats:
    """Unit directions in the viewing plane; angle 0 flies across, pi/2 towards the camera."""
    along, away = _in_plane_axes(curve)
    return np.cos(angles)[:, np.newaxis] * along - np.sin(angles)[:, np.newaxis] * away


def _first_angles(curve: LegCurve, angles: Floats) -> tuple[Floats, int]:
    """Angles that are tried first, and how often: one once where the direction is told."""
    if curve.direction is None:
        return angles, _REFINED
    along, away = _in_plane_axes(curve)
    return np.arctan2([-curve.direction @ away], [curve.direction @ along]), 1


def _meetings(start: Floats, directions: Floats, curve: LegCurve) -> tuple[Floats, Floats]:
    """Where each ray meets each direction: (directions, rays) mm from the start, and on the ray.

    NaN where the meeting point is behind the start or behind the camera.
    """
    length, depth = line_meetings(start, directions, curve)
    behind = (length <= 0) | (depth <= 0)
    length[behind] = depth[behind] = np.nan
    return length, depth


def line_meetings(start: Floats, directions: Floats, curve: LegCurve) -> tuple[Floats, Floats]:
    """The same along whole lines and rays, before and behind.

    Parameters
    ----------
    start : array of float, shape (3,)
        World, mm.
    directions : array of float, shape (d, 3)
        Unit, world.
    curve : LegCurve
        With r rays.

    Returns
    -------
    length : array of float, shape (d, r)
        From the start, mm.
    depth : array of float, shape (d, r)
        From where the rays come together, mm.
    """
    baseline, rays = start - curve.center_mm, curve.rays
    # Both lines lie in one plane up to noise: solve start + l d = center + m r in least squares.
    dr = directions @ rays.T
    db = directions @ baseline
    rb = rays @ baseline
    # Parallel lines meet nowhere: kept finite, they fall behind and out.
    determinant = np.maximum(1.0 - dr**2, 1e-15)
    length = (dr * rb - db[:, np.newaxis]) / determinant
    depth = (rb - dr * db[:, np.newaxis]) / determinant
    return length, depth


def _relative_arrivals(
    start: Floats, directions: Floats, curve: LegCurve, medium: Medium
) -> Floats:
    """Arrival time of light from each ray's meeting point, counted from the start's event time."""
    length, depth = _meetings(start, directions, curve)
    arrival: Floats = (
        medium.path_group_index * length + medium.return_group_index * depth
    ) / SPEED_OF_LIGHT_MM_PER_PS
    return arrival


def _refined(cost: Floats, angles: Floats) -> Floats:
    """A finer grid about the best finite cost."""
    best = int(np.nanargmin(cost))
    width = abs(float(angles[1] - angles[0]))
    finer: Floats = angles[best] + np.linspace(-1.5, 1.5, 61) * width
    return finer


def _best_direction(
    start: Floats,
    curve: LegCurve,
    medium: Medium,
    *,
    start_time_ps: float | None,
    start_time_std_ps: float = 0.0,
) -> Straight | None:
    """Direction (and start time, where it is not exact) that explains a leg from its start."""
    # All directions: steep legs towards and away from the camera are both possible.
    angles, rounds = _first_angles(curve, np.linspace(-np.pi, np.pi, 2 * _GRID)[:-1])
    best: Straight | None = None
    for _ in range(rounds):
        directions = _directions(curve, angles)
        relative = _relative_arrivals(start, directions, curve, medium)
        residual = curve.arrival_ps - relative
        # A corner in the picture may come out a little beyond the first rays: do without them.
        met = np.isfinite(residual)
        # A direction that misses most rays may fit the rest by chance.
        enough = met.sum(axis=1) >= 0.6 * len(curve.rays)
        residual = np.where(met, residual, 0.0)
        n_met = np.maximum(met.sum(axis=1), 1)
        mean = residual.sum(axis=1) / n_met
        if start_time_ps is None:
            start_times = mean
        elif start_time_std_ps > 0:
            # Mean of the prior and of the rays, these with 5 ps each.
            weight = 1.0 / (1.0 + 1.0 / (len(curve.rays) * (start_time_std_ps / 5.0) ** 2))
            start_times = start_time_ps + weight * (mean - start_time_ps)
        else:
            start_times = np.full(len(angles), start_time_ps)
        squared = np.where(met, residual - start_times[:, np.newaxis], 0.0) ** 2
        cost = np.where(enough, squared.sum(axis=1) / n_met, np.nan)
        if not np.isfinite(cost).any():
            return best
        i = int(np.nanargmin(cost))
        best = Straight(start, float(start_times[i]), directions[i], float(cost[i]))
        angles = _refined(cost, angles) if rounds > 1 else angles
    return best


def _first_leg_from_source(curve: LegCurve, source: Source, medium: Medium) -> Straight:
    start = np.asarray(source.position_mm, dtype=float)
    # Directions are searched in the plane through the source that the picture shows best.
    found = _best_direction(
        _flattened(start, curve),
        curve,
        medium,
        start_time_ps=source.emission_time_ps,
        start_time_std_ps=source.emission_time_std_ps,
    )
    if found is None:
        raise GeometryError(
            "no straight flight from the source explains the first leg in the picture: check "
            "position_mm of the source and the camera's pose, or leave the source unknown"
        )
    return Straight(start, found.start_time_ps, found.direction, found.cost)


def _flattened(place: Floats, curve: LegCurve) -> Floats:
    """The nearest point (3,) of a leg's viewing plane, world, mm."""
    off = float((place - curve.center_mm) @ curve.plane_normal)
    in_plane: Floats = place - off * curve.plane_normal
    return in_plane


def _blind_first_leg(curve: LegCurve, medium: Medium, depth_mm: float | None) -> Straight:
    """First leg with nothing known of the source: depth and time at entry are linear unknowns."""
    angles, rounds = _first_angles(curve, np.linspace(-0.5 * np.pi, 0.5 * np.pi, _GRID)[1:-1])
    best: Straight | None = None
    for _ in range(rounds):
        directions = _directions(curve, angles)
        # For unit depth at entry; arrival times scale with it.
        unit_start = curve.center_mm + curve.rays[0]
        after = replace(curve, rays=curve.rays[1:])
        relative = _relative_arrivals(unit_start + 1e-9 * directions[0], directions, after, medium)
        at_entry = medium.return_group_index / SPEED_OF_LIGHT_MM_PER_PS
        relative = np.column_stack((np.full(len(angles), at_entry), relative))
        mean_t = curve.arrival_ps.mean()
        centred = relative - relative.mean(axis=1)[:, np.newaxis]
        # Times scale with depth: a straight line through the origin, solved at once.
        depth = (centred @ (curve.arrival_ps - mean_t)) / np.sum(centred**2, axis=1)
        depth = depth if depth_mm is None else np.full(len(angles), depth_mm)
        residual = curve.arrival_ps - mean_t - depth[:, np.newaxis] * centred
        cost = np.where(depth > 0, np.mean(residual**2, axis=1), np.nan)
        if not np.isfinite(cost).any():
            break
        i = int(np.nanargmin(cost))
        entry_time = mean_t - depth[i] * relative[i].mean()
        entry = curve.center_mm + depth[i] * curve.rays[0]
        best = Straight(entry, float(entry_time), directions[i], float(cost[i]))
        angles = _refined(cost, angles) if rounds > 1 else angles
    if best is None:
        raise GeometryError(
            "the first leg's arrival times fit no straight flight: check the clock's direction "
            "(reversed_codes) and the laser period"
        )
    return best


def _following_leg(previous: Straight, seen: LegCurve, curve: LegCurve, medium: Medium) -> Straight:
    """Leg that starts on the line of the one before it, after that was last seen."""
    ended = replace(seen, rays=seen.rays[-1:])
    last_seen = _meetings(previous.start_mm, previous.direction[np.newaxis], ended)[0][0, 0]
    if not np.isfinite(last_seen):
        last_seen = 0.0
    approach = float(previous.direction @ curve.plane_normal)
    gap = float((curve.center_mm - previous.start_mm) @ curve.plane_normal)
    candidates = []
    if abs(approach) > 1e-9:
        candidates.append(gap / approach)
    # Light cannot turn later than it still arrives in time for the next leg.
    latest = _latest_corner(previous, curve, medium, last_seen)
    # Three percent of the way and 5 mm: the leg before is known only roughly yet.
    slack = 0.03 * max(last_seen, 1.0) + 5.0
    usable = [x for x in candidates if last_seen - slack < x < latest + slack]
    # Along the plane the meeting is anywhere: try many corners and let the times decide.
    if not usable or abs(approach) < _SHALLOW:
        usable = usable + list(np.linspace(max(last_seen - slack, 1e-3), latest + slack, 60))
    found = [_leg_from_corner(previous, x, curve, medium) for x in usable]
    finite = [leg for leg in found if leg is not None]
    if not finite:
        raise GeometryError(
            "a leg of the picture cannot start on the line of the leg before it: give n_legs, a "
            "starting path, or mask the pixels that do not belong to the flight"
        )
    return min(finite, key=lambda leg: leg.cost)


def _latest_corner(previous: Straight, curve: LegCurve, medium: Medium, last_seen: float) -> float:
    """Farthest corner from which light still reaches the next leg in time, mm along the line."""
    lengths = last_seen + np.linspace(0.0, 5000.0, 2001)
    corners = previous.start_mm + lengths[:, np.newaxis] * previous.direction
    event = previous.start_time_ps + medium.path_group_index * lengths / SPEED_OF_LIGHT_MM_PER_PS
    back = np.linalg.norm(corners - curve.center_mm, axis=1)
    arrival = event + medium.return_group_index * back / SPEED_OF_LIGHT_MM_PER_PS
    early = arrival <= curve.arrival_ps[0] + 5.0
    return float(lengths[early][-1]) if early.any() else last_seen


def _leg_from_corner(
    previous: Straight, length: float, curve: LegCurve, medium: Medium
) -> Straight | None:
    corner = previous.start_mm + length * previous.direction
    time = previous.start_time_ps + medium.path_group_index * length / SPEED_OF_LIGHT_MM_PER_PS
    found = _best_direction(_flattened(corner, curve), curve, medium, start_time_ps=float(time))
    if found is None:
        return None
    return Straight(corner, float(time), found.direction, found.cost)
