"""Flight: when light is where, and when the camera learns of it (sections 1-3 of the method).

Two times must never be confused: the *event time* t, at which the pulse is at a point, and the
*arrival time* t_a, at which light scattered there reaches the camera's entrance pupil. Every
function here is one formula; positions are world mm, times ps on one clock, angles rad unless
the name says deg.

Records: `Source`, `Medium`.
Along the path: `event_times_from_vertices`, `arrival_time_from_event`, `event_time_from_arrival`.
One pixel, one point: `distance_from_arrival`, `point_from_arrival`.
One leg, one camera: `arrival_time_from_viewing_angle` (half-angle law),
`apparent_speed_from_direction`, `elevation_from_direction`.
The paper's own chain: `arrival_time_from_propagation_time` (Eq. 1),
`propagation_time_from_projection` (Eq. 2).

Zheng, Sun, Wang, Faccio, Photonics Research 8, 1072 (2020).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.units import AIR_GROUP_INDEX, SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Medium:
    """Uniform medium: group index on the way of the pulse, and on the way to the camera.

    Windows or walls between path and camera are not part of the model.
    """

    path_group_index: float = AIR_GROUP_INDEX
    """n_p, along the path (fibre: about 1.47)."""

    return_group_index: float = AIR_GROUP_INDEX
    """n_r, from the path to the camera."""

    def __post_init__(self) -> None:
        for name in ("path_group_index", "return_group_index"):
            value = getattr(self, name)
            if not (np.isfinite(value) and 1.0 <= value <= 10.0):
                raise ValueError(f"{name} must lie between 1 and 10, got {value}")


def _checked_position(position: ArrayLike | None) -> tuple[float, float, float] | None:
    if position is None:
        return None
    xyz = np.asarray(position, dtype=float)
    if xyz.shape != (3,) or not np.isfinite(xyz).all():
        raise ValueError(
            f"position_mm must be three finite numbers (x, y, z) in mm, got {position!r}"
        )
    return float(xyz[0]), float(xyz[1]), float(xyz[2])


@dataclass(frozen=True)
class Source:
    """Where and when the pulse starts, as far as it is known. None means unknown: it is fitted."""

    position_mm: ArrayLike | None = None
    """(3,) world, mm; stored as a tuple."""

    position_std_mm: float | tuple[float, float, float] = field(default=0.0, kw_only=True)
    """One-sigma error of the position: one number, or one per axis; mm. 0: exact."""

    emission_time_ps: float | None = field(default=None, kw_only=True)
    """When the pulse left the source, on the calibrated clock; ps."""

    emission_time_std_ps: float = field(default=0.0, kw_only=True)
    """One-sigma error of the emission time, ps. 0: exact."""

    pulse_fwhm_ps: float | None = field(default=None, kw_only=True)
    """Full width at half maximum of the laser pulse, ps."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_mm", _checked_position(self.position_mm))
        std = np.asarray(self.position_std_mm, dtype=float)
        if std.shape not in ((), (3,)) or not np.isfinite(std).all() or (std < 0).any():
            raise ValueError(
                "position_std_mm must be one number or three, finite and >= 0, "
                f"got {self.position_std_mm!r}"
            )
        stored = float(std) if std.shape == () else (float(std[0]), float(std[1]), float(std[2]))
        object.__setattr__(self, "position_std_mm", stored)
        if self.emission_time_ps is not None and not np.isfinite(self.emission_time_ps):
            raise ValueError(f"emission_time_ps must be finite, got {self.emission_time_ps}")
        if not (np.isfinite(self.emission_time_std_ps) and self.emission_time_std_ps >= 0):
            raise ValueError(
                f"emission_time_std_ps must be finite and >= 0, got {self.emission_time_std_ps}"
            )
        fwhm = self.pulse_fwhm_ps
        if fwhm is not None and not (np.isfinite(fwhm) and fwhm > 0):
            raise ValueError(f"pulse_fwhm_ps must be positive and finite, got {fwhm}")

    @property
    def position_std_xyz_mm(self) -> Floats:
        """(3,) one-sigma error of the position, per world axis, mm."""
        return np.broadcast_to(np.asarray(self.position_std_mm, dtype=float), (3,)).copy()


def event_times_from_vertices(
    vertices_mm: ArrayLike, *, emission_time_ps: float, path_group_index: float = AIR_GROUP_INDEX
) -> Floats:
    """Event time at each vertex of a path: t_k = t_B + n_p (path length to k) / c.

    Parameters
    ----------
    vertices_mm : (m, 3), world, mm.

    Returns
    -------
    (m,), ps.
    """
    vertices = np.asarray(vertices_mm, dtype=float)
    lengths = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
    travelled = np.concatenate(([0.0], np.cumsum(lengths)))
    return emission_time_ps + path_group_index * travelled / SPEED_OF_LIGHT_MM_PER_PS


def return_time_from_points(
    points_mm: ArrayLike, *, camera_center_mm: ArrayLike, return_group_index: float
) -> Floats:
    """Time that scattered light needs to the camera: `n_r |A - X| / c`; (...), ps."""
    separation = np.asarray(camera_center_mm, dtype=float) - np.asarray(points_mm, dtype=float)
    distance: Floats = np.linalg.norm(separation, axis=-1)
    return return_group_index * distance / SPEED_OF_LIGHT_MM_PER_PS


def arrival_time_from_event(
    points_mm: ArrayLike,
    event_time_ps: ArrayLike,
    *,
    camera_center_mm: ArrayLike,
    return_group_index: float = AIR_GROUP_INDEX,
) -> Floats:
    """Arrival time of light scattered at points X at event times t: `t_a = t + n_r |A - X| / c`.

    Parameters
    ----------
    points_mm : (..., 3), world, mm.
    event_time_ps : (...), ps.

    Returns
    -------
    (...), ps, on the clock of `event_time_ps`.
    """
    return np.asarray(event_time_ps, dtype=float) + return_time_from_points(
        points_mm, camera_center_mm=camera_center_mm, return_group_index=return_group_index
    )


def event_time_from_arrival(
    points_mm: ArrayLike,
    arrival_ps: ArrayLike,
    *,
    camera_center_mm: ArrayLike,
    return_group_index: float = AIR_GROUP_INDEX,
) -> Floats:
    """Event time at known points from arrival times: `t = t_a - n_r |A - X| / c`; (...), ps."""
    return np.asarray(arrival_ps, dtype=float) - return_time_from_points(
        points_mm, camera_center_mm=camera_center_mm, return_group_index=return_group_index
    )


def distance_from_arrival(
    rays: ArrayLike,
    arrival_ps: ArrayLike,
    *,
    source_mm: ArrayLike,
    emission_time_ps: ArrayLike,
    camera_center_mm: ArrayLike,
    medium: Medium | None = None,
) -> Floats:
    """Distance along a pixel's ray to the point where light straight from the source scattered.

    With tau = t_a - t_B, `s = |A - B|`, q = r . (A - B), the point X = A + lambda r obeys

        n_p^2 (s^2 + 2 lambda q + lambda^2) = (c tau - n_r lambda)^2,

    solved in the form that stays exact when n_p = n_r, where it is
    lambda = ((c tau / n)^2 - s^2) / (2 (c tau / n + q)).

    Parameters
    ----------
    rays : (..., 3), unit, world, from the camera outwards.
    arrival_ps : (...), ps.
    source_mm : (..., 3), world, mm.

    Returns
    -------
    (...), mm; NaN where no point in front of the camera explains the arrival.
    """
    medium = Medium() if medium is None else medium
    n_path, n_return = medium.path_group_index, medium.return_group_index
    baseline = np.asarray(camera_center_mm, dtype=float) - np.asarray(source_mm, dtype=float)
    light_path = SPEED_OF_LIGHT_MM_PER_PS * (
        np.asarray(arrival_ps, dtype=float) - np.asarray(emission_time_ps, dtype=float)
    )
    q = np.sum(np.asarray(rays, dtype=float) * baseline, axis=-1)
    s_squared = np.sum(baseline**2, axis=-1)
    quadratic = n_path**2 - n_return**2
    linear = n_path**2 * q + n_return * light_path
    constant = n_path**2 * s_squared - light_path**2
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(linear**2 - quadratic * constant)
        near = -constant / (linear + root)
        far = -(linear + root) / quadratic if quadratic else np.full_like(near, np.nan)
        valid_near = (near > 0) & (light_path > n_return * near)
        valid_far = (far > 0) & (light_path > n_return * far)
    return np.where(valid_near, near, np.where(valid_far, far, np.nan))


def point_from_arrival(
    rays: ArrayLike,
    arrival_ps: ArrayLike,
    *,
    source_mm: ArrayLike,
    emission_time_ps: ArrayLike,
    camera_center_mm: ArrayLike,
    medium: Medium | None = None,
) -> Floats:
    """Point on each pixel's ray where light straight from the source scattered; (..., 3), mm.

    See `distance_from_arrival`; NaN where there is none.
    """
    distance = distance_from_arrival(
        rays,
        arrival_ps,
        source_mm=source_mm,
        emission_time_ps=emission_time_ps,
        camera_center_mm=camera_center_mm,
        medium=medium,
    )
    center = np.asarray(camera_center_mm, dtype=float)
    point: Floats = center + distance[..., np.newaxis] * np.asarray(rays, dtype=float)
    return point


def arrival_time_from_viewing_angle(
    viewing_angle: ArrayLike,
    *,
    foot_time_ps: ArrayLike,
    foot_distance_mm: ArrayLike,
    medium: Medium | None = None,
) -> Floats:
    """Half-angle law: arrival time of a straight leg in the plane through camera and leg.

    t_a = t_f + (p / c) (n_p tan psi + n_r sec psi); for one index n this is
    t_f + (n p / c) tan(pi/4 + psi/2). psi is the viewing angle from the foot of the
    perpendicular from the camera to the leg, positive in the direction of flight; p the length
    of that perpendicular and t_f the event time at its foot.

    Parameters
    ----------
    viewing_angle : (...), rad, in (-pi/2, pi/2).

    Returns
    -------
    (...), ps.
    """
    medium = Medium() if medium is None else medium
    psi = np.asarray(viewing_angle, dtype=float)
    scale = np.asarray(foot_distance_mm, dtype=float) / SPEED_OF_LIGHT_MM_PER_PS
    # (n_p sin + n_r) / cos cancels near psi = -pi/2 for one index; the half angle does not.
    half_angle = np.tan(np.pi / 4 + psi / 2)
    excess = medium.path_group_index - medium.return_group_index
    bracket = medium.return_group_index * half_angle + excess * np.tan(psi)
    result: Floats = np.asarray(foot_time_ps, dtype=float) + scale * bracket
    return result


def apparent_speed_from_direction(
    direction: ArrayLike, towards_camera: ArrayLike, *, medium: Medium | None = None
) -> Floats:
    """Length of path seen per unit arrival time: c / (n_p - n_r d.u); (...), mm/ps.

    d is the unit direction of flight and u the unit vector from the point to the camera, both
    (..., 3). Along u the light arrives as fast as it flies and the speed diverges.
    """
    medium = Medium() if medium is None else medium
    approach = np.sum(np.asarray(direction, float) * np.asarray(towards_camera, float), axis=-1)
    speed: Floats = SPEED_OF_LIGHT_MM_PER_PS / (
        medium.path_group_index - medium.return_group_index * approach
    )
    return speed


def elevation_from_direction(direction: ArrayLike, normal: ArrayLike) -> Floats:
    """Elevation of a leg out of the plane normal to n: alpha = asin(d.n); (...), rad.

    n is the backward optical axis (towards the camera) unless the user says otherwise, so that
    positive means towards the camera, as in the paper.
    """
    d = np.asarray(direction, dtype=float)
    n = np.asarray(normal, dtype=float)
    along = np.sum(d * n, axis=-1)
    # asin loses half the digits near +-90 deg; atan2 of the two components does not.
    across = np.linalg.norm(d - along[..., np.newaxis] * n, axis=-1)
    elevation: Floats = np.arctan2(along, across)
    return elevation


def arrival_time_from_propagation_time(
    propagation_time_ps: ArrayLike,
    *,
    start_distance_mm: ArrayLike,
    propagation_angle: ArrayLike,
    start_angle: ArrayLike,
    group_index: float = 1.0,
) -> Floats:
    """Eq. 1 of the paper: t_a = t + sqrt(s^2/c^2 + t^2 - 2 s t sin(alpha + theta) / c).

    Parameters
    ----------
    propagation_time_ps : t, since the pulse was at B; ps.
    start_distance_mm : `s = |BA|`, mm.
    propagation_angle : alpha, angle of the leg out of the reference plane, rad.
    start_angle : theta, signed: sin(theta) = (A - B).e / s with e the unit vector along viewing
        plane and reference plane, in the direction of flight; rad.
    group_index : n of the medium; the paper takes 1 (c is then the speed in the medium).

    Returns
    -------
    (...), ps since the pulse was at B.
    """
    speed = SPEED_OF_LIGHT_MM_PER_PS / group_index
    t = np.asarray(propagation_time_ps, dtype=float)
    s = np.asarray(start_distance_mm, dtype=float)
    sine = np.sin(np.asarray(propagation_angle, float) + np.asarray(start_angle, float))
    arrival: Floats = t + np.sqrt((s / speed) ** 2 + t**2 - 2 * s * t * sine / speed)
    return arrival


def propagation_time_from_projection(
    projected_length_mm: ArrayLike,
    *,
    start_distance_mm: ArrayLike,
    propagation_angle: ArrayLike,
    start_angle: ArrayLike,
    group_index: float = 1.0,
) -> Floats:
    """Eq. 2 of the paper: t = (1/c) s l cos(theta) / (l sin(alpha) + s cos(alpha + theta)).

    `projected_length_mm` is `l = |BE|`, where E is the point at which the viewing ray of the pixel
    meets the reference plane; the other parameters are those of
    `arrival_time_from_propagation_time`. Returns (...), ps since the pulse was at B.
    """
    speed = SPEED_OF_LIGHT_MM_PER_PS / group_index
    length = np.asarray(projected_length_mm, dtype=float)
    s = np.asarray(start_distance_mm, dtype=float)
    alpha = np.asarray(propagation_angle, dtype=float)
    theta = np.asarray(start_angle, dtype=float)
    travelled = s * length * np.cos(theta) / (length * np.sin(alpha) + s * np.cos(alpha + theta))
    time: Floats = travelled / speed
    return time
