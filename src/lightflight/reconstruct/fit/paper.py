"""`paper`: the chain of Zheng et al. 2020, literal, as the baseline every table shows.

One pixel per position along a leg; least-squares pulse times; bad pixels replaced by the linear
interpolation of their neighbours; one angle alpha_i per arrival time (the inverse of Eq. 1 and
2); alpha is the value with the least RMSE to the alpha_i, their mean; legs one after another on
reference planes RP1, RP2 ... (Fig. 4), each starting where the line of the last one meets the
viewing plane of the next. The projection of a leg is the straight line through the centres of
mass of its light, column by column (row by row for a steep one); a pixel's time is taken to be
that of the point of this line nearest to the pixel's centre.

Where the paper is silent: with the emission time unknown, the time that makes the alpha_i of the
first leg agree best is taken; with the source unknown, the path starts in the entry pixel with
s = c t_a / n, which needs the time of entry as `emission_time_ps`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from lightflight import flags
from lightflight.errors import GeometryError
from lightflight.flight import Medium, point_from_arrival, return_time_from_points
from lightflight.path.light_path import LightPath
from lightflight.path.tables import RESIDUAL_DTYPE, Goodness
from lightflight.reconstruct.fit.paper_projection import (
    Projection,
    averaged,
    projection_of_leg,
)
from lightflight.reconstruct.fit.result import prior_in_words
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.reconstruct.model.freedom import view_end
from lightflight.reconstruct.model.geometry import PathState, vertex_time_jacobian
from lightflight.reconstruct.model.nudges import NUDGE
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import moved, shared_errors
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_WHAT_IT_STATES = (
    "The paper's estimator states the scatter of the alpha_i only: its error bars know "
    "nothing of the picture, the clock or the source."
)
_WHAT_IT_STATES_WITH_SHARED = (
    "The paper's estimator states the scatter of the alpha_i, and what the stated errors of "
    "camera, medium, source and clock move that all pixels share: its error bars know nothing of "
    "the picture or of each pixel's own clock."
)


@dataclass(frozen=True, eq=False)
class PlaneLeg:
    """A leg in its viewing plane: start on the reference plane, axes, and its angle.

    Attributes
    ----------
    start_mm : array of float, shape (3,)
        S_j, world, mm.
    start_time_ps : float
        Event time at the start, ps.
    along : array of float, shape (3,)
        Unit: viewing plane and reference plane meet along it, in the direction of flight.
    upright : array of float, shape (3,)
        Unit, in the viewing plane, normal to `along`, towards the camera.
    angles : array of float, shape (k,)
        alpha_i, rad.
    """

    start_mm: Floats
    start_time_ps: float
    along: Floats
    upright: Floats
    angles: Floats

    @property
    def angle(self) -> float:
        """alpha: the value of least RMSE to the alpha_i, rad."""
        return float(np.mean(self.angles))

    @property
    def angle_std(self) -> float:
        """Scatter of the alpha_i over the root of their number, rad."""
        return float(np.std(self.angles, ddof=1) / np.sqrt(len(self.angles)))


def plane_axes(rays: Floats, start: Floats, camera: Camera) -> tuple[Floats, Floats]:
    """(along, upright) of the viewing plane of a leg seen along `rays`, from its start.

    Parameters
    ----------
    rays : array of float, shape (k, 3)
        Unit, world, of the pixels on the leg's projection.
    start : array of float, shape (3,)
        Where the leg starts, world, mm.
    camera : Camera
        The camera that sees it.

    Returns
    -------
    along : array of float, shape (3,)
        Unit: viewing plane and reference plane meet along it, in the direction of flight.
    upright : array of float, shape (3,)
        Unit, in the viewing plane, normal to `along`, towards the camera.
    """
    n = camera.backward_axis
    # Viewing rays meet the reference plane (normal n, through the start) at the points E_i.
    depth = ((start - camera.center_mm) @ n) / (rays @ n)
    meeting = camera.center_mm + depth[:, np.newaxis] * rays
    # The projection starts at the start: its direction is that of the E_i seen from there.
    along = np.linalg.svd(meeting - start, full_matrices=False)[2][0]
    along = along - (along @ n) * n
    along = along / np.linalg.norm(along)
    if along @ (meeting[-1] - meeting[0]) < 0:
        along = -along
    normal = np.cross(along, camera.center_mm - start)
    upright = np.cross(normal, along)
    upright = upright / np.linalg.norm(upright)
    return along, upright if upright @ n > 0 else -upright


def angles_from_arrivals(
    rays: Floats,
    arrival_ps: Floats,
    *,
    start_mm: Floats,
    start_time_ps: float,
    along: Floats,
    upright: Floats,
    camera_center_mm: Floats,
    medium: Medium,
) -> Floats:
    """alpha_i of each arrival time: the one-to-one relation of Eq. 1 and 2, inverted.

    The closed form of `flight.point_from_arrival` in the viewing plane is that inverse; NaN where
    no angle explains the time. Returns (k,), rad.

    Parameters
    ----------
    rays : array of float, shape (k, 3)
        Unit, world.
    arrival_ps : array of float, shape (k,)
        ps.
    start_mm : array of float, shape (3,)
        Where the leg starts, world, mm.
    start_time_ps : float
        Event time there, ps.
    along : array of float, shape (3,)
        By `plane_axes`.
    upright : array of float, shape (3,)
        By `plane_axes`.
    camera_center_mm : array of float, shape (3,)
        World, mm.
    medium : Medium
        Group indices out and back.

    Returns
    -------
    array of float, shape (k,)
        rad; NaN where no angle explains the time.
    """
    in_plane = rays - (rays @ np.cross(along, upright))[:, np.newaxis] * np.cross(along, upright)
    in_plane /= np.linalg.norm(in_plane, axis=1)[:, np.newaxis]
    points = point_from_arrival(
        in_plane,
        arrival_ps,
        source_mm=start_mm,
        emission_time_ps=start_time_ps,
        camera_center_mm=camera_center_mm,
        medium=medium,
    )
    offset = points - start_mm
    angles: Floats = np.arctan2(offset @ upright, offset @ along)
    return angles


def paper_path(
    sightings: list[Sighting], setting: Setting, *, legs: tuple[ImageLeg, ...] | None
) -> LightPath:
    """The paper's reconstruction of a whole path; repeats are averaged in arrival time.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    setting : Setting
        Camera, source, medium and waypoints.
    legs : tuple of ImageLeg or None
        Legs as found in the picture.

    Returns
    -------
    LightPath
        With the scatter of the alpha_i as its only error.

    Raises
    ------
    GeometryError
        Where the source is unknown and no time of entry is given, or a leg cannot be placed.
    """
    if legs is None:
        raise ValueError("method='paper' finds its own legs: leave start out, or give n_legs")
    projections = [projection_of_leg(leg, sightings[0], setting.camera) for leg in legs]
    projections = [averaged(p, sightings) for p in projections]
    return path_from_projections(projections, sightings, setting)


def path_from_projections(
    projections: list[Projection], sightings: list[Sighting], setting: Setting
) -> LightPath:
    """Legs one after another on their reference planes (Fig. 4), from what each projects to.

    Parameters
    ----------
    projections : list of Projection
        One per leg, in the order of flight.
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    LightPath
        With the scatter of the alpha_i as its only error.

    Raises
    ------
    GeometryError
        Where the source is unknown and no time of entry is given, or a leg cannot be placed.
    """
    placed = _placed_legs(projections, setting)
    return _path_from_plane_legs(placed, projections, sightings, setting)


def _placed_legs(projections: list[Projection], setting: Setting) -> list[PlaneLeg]:
    camera, medium = setting.camera, setting.medium
    start, start_time = _start(projections[0], setting)
    placed: list[PlaneLeg] = []
    for number, seen in enumerate(projections):
        rays = camera.rays_from_pixels(seen.rows, seen.cols)
        if number:
            start, start_time = _corner(placed[-1], rays, camera, medium)
        along, upright = plane_axes(rays, start, camera)

        def angles_at(
            time: float,
            rays: Floats = rays,
            seen: Projection = seen,
            start: Floats = start,
            axes: tuple[Floats, Floats] = (along, upright),
        ) -> Floats:
            return angles_from_arrivals(
                rays,
                seen.arrival_ps,
                start_mm=start,
                start_time_ps=time,
                along=axes[0],
                upright=axes[1],
                camera_center_mm=camera.center_mm,
                medium=medium,
            )

        if start_time is None:
            start_time = _agreeing_time(seen, start, camera, medium, angles_at)
        angles = angles_at(start_time)
        angles = angles[np.isfinite(angles)]
        if len(angles) < 2:
            raise GeometryError(
                f"leg {number + 1}: no angle explains its arrival times from where the leg before "
                "it ended; the paper's chain stops here, try method='joint'"
            )
        placed.append(PlaneLeg(start, start_time, along, upright, angles))
    return placed


def _start(seen: Projection, setting: Setting) -> tuple[Floats, float | None]:
    source, camera = setting.source, setting.camera
    if source.position_mm is not None:
        return np.asarray(source.position_mm, dtype=float), source.emission_time_ps
    if source.emission_time_ps is None:
        raise GeometryError(
            "method='paper' starts from a known source, or from the entry pixel with s = c t_a / n "
            "which needs the time of entry: give position_mm or emission_time_ps of the source"
        )
    flight = seen.arrival_ps[0] - source.emission_time_ps
    distance = SPEED_OF_LIGHT_MM_PER_PS * flight / setting.medium.return_group_index
    ray = camera.rays_from_pixels(seen.rows[:1], seen.cols[:1])[0]
    if distance <= 0:
        raise GeometryError("the first light arrives before the time of entry given")
    return camera.center_mm + distance * ray, source.emission_time_ps


def _agreeing_time(
    seen: Projection,
    start: Floats,
    camera: Camera,
    medium: Medium,
    angles_at: Callable[[float], Floats],
) -> float:
    """Start time for which the alpha_i of the first leg scatter least, ps."""
    latest = float(
        seen.arrival_ps.min()
        - return_time_from_points(
            start,
            camera_center_mm=camera.center_mm,
            return_group_index=medium.return_group_index,
        )
    )

    def scatter(time: float) -> float:
        angles = angles_at(time)
        finite = np.isfinite(angles)
        return float(np.std(angles[finite])) if finite.sum() > 0.7 * len(angles) else 10.0

    # 1.5 ns: half a metre of flight before the first light was scattered.
    grid = latest + np.linspace(-1500.0, 300.0, 361)
    # Several minima are possible: the grid picks one, the refinement stays in it.
    costs = [scatter(float(time)) for time in grid]
    best = int(np.argmin(costs))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found = minimize_scalar(scatter, bounds=(low, high), method="bounded")
    return float(found.x)


def _direction(leg: PlaneLeg, angle: float | None = None) -> Floats:
    alpha = leg.angle if angle is None else angle
    direction: Floats = np.cos(alpha) * leg.along + np.sin(alpha) * leg.upright
    return direction


def _corner(leg: PlaneLeg, rays: Floats, camera: Camera, medium: Medium) -> tuple[Floats, float]:
    """E_j = S_(j+1): where a leg's line meets the viewing plane of the next, and when."""
    normal = np.cross(rays[0], rays[-1])
    direction = _direction(leg)
    approach = float(direction @ normal)
    if abs(approach) < 1e-9 * float(np.linalg.norm(normal)):
        raise GeometryError(
            "two legs lie in one viewing plane, so the paper's chain cannot tell where one ends "
            "and the other starts: try method='joint'"
        )
    length = float((camera.center_mm - leg.start_mm) @ normal) / approach
    time = leg.start_time_ps + medium.path_group_index * length / SPEED_OF_LIGHT_MM_PER_PS
    return leg.start_mm + length * direction, float(time)


def _path_from_plane_legs(
    placed: list[PlaneLeg],
    projections: list[Projection],
    sightings: list[Sighting],
    setting: Setting,
) -> LightPath:
    camera, medium = setting.camera, setting.medium
    vertices = _vertices(placed, projections, camera, np.array([leg.angle for leg in placed]))
    state = PathState(vertices, placed[0].start_time_ps)
    # The paper's errors: the scatter of the alpha_i alone, carried down the chain.
    by_angle = np.zeros((vertices.size + 1, len(placed)))
    for k in range(len(placed)):
        angles = np.array([leg.angle for leg in placed])
        # rad; the vertices follow smoothly, and rounding is far below.
        angles[k] += 1e-5
        moved = _vertices(placed, projections, camera, angles)
        by_angle[:-1, k] = (moved - vertices).ravel() / 1e-5
    to_vertices = vertex_time_jacobian(state, medium) @ by_angle
    variance = np.array([leg.angle_std**2 for leg in placed])
    parts = {"photon": (to_vertices * variance) @ to_vertices.T}
    by_shared = _by_shared_errors(placed, projections, setting)
    if by_shared.size:
        parts["shared"] = by_shared @ by_shared.T
    table = _residuals(placed, projections, camera, medium)
    n_interpolated = int(sum(p.interpolated.sum() for p in projections))
    return LightPath(
        vertices,
        state.vertex_times_ps(medium),
        sum(parts.values(), np.zeros_like(parts["photon"])),
        camera=camera,
        source=setting.source,
        medium=medium,
        method="paper",
        goodness=Goodness(
            chi2=float("nan"),
            dof=0,
            n_pulses=len(table),
            n_rejected=n_interpolated,
            residual_rms_ps=float(np.sqrt(np.mean(table["residual_ps"] ** 2))),
            error_floor_ps=0.0,
            converged=True,
        ),
        covariance_parts=parts,
        residuals=table,
        prior=prior_in_words(setting.source),
        statements=(_WHAT_IT_STATES if not by_shared.size else _WHAT_IT_STATES_WITH_SHARED,),
        truth=sightings[0].histograms.truth,
    )


def _by_shared_errors(
    placed: list[PlaneLeg], projections: list[Projection], setting: Setting
) -> Floats:
    """(4m, k): what one standard deviation of camera, medium, source, its time and clock moves."""

    def events(there: Setting, legs: list[PlaneLeg]) -> Floats:
        angles = np.array([leg.angle for leg in legs])
        vertices = _vertices(legs, projections, there.camera, angles)
        times = PathState(vertices, legs[0].start_time_ps).vertex_times_ps(there.medium)
        return np.column_stack((vertices, times)).ravel()

    nudged = [(there, projections) for there in _nudged_settings(setting)]
    nudged += [(setting, later) for later in _nudged_times(projections)]
    if not nudged:
        return np.zeros((0, 0))
    base = events(setting, placed)
    moved_events = [events(there, _placed_legs(seen, there)) for there, seen in nudged]
    return (np.column_stack(moved_events) - base[:, np.newaxis]) / NUDGE


def _nudged_settings(setting: Setting) -> list[Setting]:
    """The setting with each error that it states, one after the other, moved by `NUDGE` of it."""
    errors, source = shared_errors(setting), setting.source
    found = [moved(setting, errors, NUDGE * unit) for unit in np.eye(len(errors))]
    if source.position_mm is not None:
        place, stds = np.asarray(source.position_mm, dtype=float), source.position_std_xyz_mm
        found += [
            replace(setting, source=replace(source, position_mm=place + step))
            for step in np.diag(NUDGE * stds)[stds > 0]
        ]
    if source.emission_time_ps is not None and source.emission_time_std_ps > 0:
        later = source.emission_time_ps + NUDGE * source.emission_time_std_ps
        found.append(replace(setting, source=replace(source, emission_time_ps=later)))
    return found


def _nudged_times(projections: list[Projection]) -> list[list[Projection]]:
    """All projections with each shared error of the clock, one after the other, moved likewise."""
    n_modes = projections[0].modes_ps.shape[1]
    return [
        [replace(p, arrival_ps=p.arrival_ps + NUDGE * p.modes_ps[:, j]) for p in projections]
        for j in range(n_modes)
    ]


def _vertices(
    placed: list[PlaneLeg], projections: list[Projection], camera: Camera, angles: Floats
) -> Floats:
    """Corners for given angles of the legs, viewing planes kept; (m, 3), mm."""
    vertices = [placed[0].start_mm]
    for k, leg in enumerate(placed):
        direction = _direction(leg, float(angles[k]))
        if k + 1 < len(placed):
            following = placed[k + 1]
            normal = np.cross(following.along, following.upright)
            length = ((camera.center_mm - vertices[-1]) @ normal) / (direction @ normal)
            vertices.append(vertices[-1] + length * direction)
    last_ray = camera.rays_from_pixels(projections[-1].rows[-1:], projections[-1].cols[-1:])[0]
    offset = vertices[-1] - camera.center_mm
    across = np.cross(np.cross(placed[-1].along, placed[-1].upright), last_ray)
    seen = vertices[-1] - (offset @ across) / (direction @ across) * direction
    leaving = view_end(camera, seen, direction)
    vertices.append(seen if leaving is None else leaving.position_mm)
    return np.array(vertices)


def _residuals(
    placed: list[PlaneLeg], projections: list[Projection], camera: Camera, medium: Medium
) -> NDArray[np.void]:
    """Arrival times against those of the straight legs, pixel by pixel."""
    parts = []
    for number, (leg, seen) in enumerate(zip(placed, projections, strict=True)):
        direction = _direction(leg)
        rays = camera.rays_from_pixels(seen.rows, seen.cols)
        offset = camera.center_mm - leg.start_mm
        across = direction - (rays @ direction)[:, np.newaxis] * rays
        length = (across @ offset) / np.sum(across**2, axis=1)
        points = leg.start_mm + length[:, np.newaxis] * direction
        event = leg.start_time_ps + medium.path_group_index * length / SPEED_OF_LIGHT_MM_PER_PS
        table = np.zeros(len(rays), RESIDUAL_DTYPE)
        table["row"], table["col"] = np.rint(seen.rows), np.rint(seen.cols)
        table["leg"], table["event_time_ps"] = number, event
        table["arrival_ps"] = seen.arrival_ps
        table["model_ps"] = event + return_time_from_points(
            points,
            camera_center_mm=camera.center_mm,
            return_group_index=medium.return_group_index,
        )
        table["residual_ps"] = table["arrival_ps"] - table["model_ps"]
        table["std_ps"] = np.nan
        table["photons"] = seen.photons
        table["used"] = True
        table["flags"] = np.where(seen.interpolated, flags.INTERPOLATED, 0)
        parts.append(table)
    return np.concatenate(parts)
