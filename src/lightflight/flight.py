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
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import POSITIVE, finite_number, finite_numbers
from lightflight.blocks import Block
from lightflight.units import AIR_GROUP_INDEX, SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]


_ERROR = "be finite and >= 0"
INDEX_SLACK_STDS = 5.0
"""A group index may lie below one by this many of its stated errors."""
_SAME_MEDIUM = 0.02
"""Two group indices nearer than this are of one medium, found or told; water is 0.36 from air."""


@dataclass(frozen=True)
class Medium:
    """What the light crosses: group index on the way of the pulse, and on the way to the camera.

    Uniform, but for blocks of glass in the beam. Windows and walls of tanks between path and camera
    are the camera's (`Camera.interfaces`).

    Attributes
    ----------
    path_group_index : float
        n_p, along the path (fibre: about 1.47).
    return_group_index : float
        n_r, from the path to the camera.
    path_group_index_std : float
        One-sigma error of n_p. 0: exact.
    return_group_index_std : float
        One-sigma error of n_r. 0: exact.
    index_correlation : float
        Of those two errors: 1, one medium both ways; 0, two that know nothing of each other.
    blocks : tuple of Block
        Blocks of glass that the beam crosses.
    """

    path_group_index: float = AIR_GROUP_INDEX

    return_group_index: float = AIR_GROUP_INDEX

    path_group_index_std: float = field(default=0.0, kw_only=True)

    return_group_index_std: float = field(default=0.0, kw_only=True)

    index_correlation: float = field(default=1.0, kw_only=True)

    blocks: tuple[Block, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        for name in ("path_group_index", "return_group_index"):
            std = finite_number(f"{name}_std", getattr(self, f"{name}_std"), _ERROR, low=0.0)
            # A fitted index of air may fall below one within its error.
            lowest = 1.0 - INDEX_SLACK_STDS * std
            value = getattr(self, name)
            finite_number(name, value, "lie between 1 and 10", low=lowest, high=10.0)
        correlation = self.index_correlation
        must = "lie between -1 and 1"
        finite_number("index_correlation", correlation, must, low=-1.0, high=1.0)
        object.__setattr__(self, "blocks", self._checked_blocks())

    def _checked_blocks(self) -> tuple[Block, ...]:
        """The blocks; ValueError where they are none, told twice, or stand in another medium."""
        told = (self.blocks,) if isinstance(self.blocks, Block) else self.blocks
        if not (isinstance(told, tuple | list) and all(isinstance(one, Block) for one in told)):
            raise ValueError(f"blocks must be a list of lightflight.Block, got {told!r:.60}")
        slack = _SAME_MEDIUM + INDEX_SLACK_STDS * self.path_group_index_std
        for block in told:
            index = block.around.group_index
            if abs(index - self.path_group_index) > slack:
                raise ValueError(
                    f"a block of glass stands in a medium of group index {index:g}, and the "
                    f"path_group_index is {self.path_group_index:g}: say what it stands in (around)"
                )
        if any(one == other for one, other in combinations(told, 2)):
            raise ValueError("blocks must differ, and one of them is told twice: leave one out")
        return tuple(told)


def _checked_position(position: ArrayLike | None) -> tuple[float, float, float] | None:
    """(x, y, z), mm, as a tuple; ValueError for what is no place."""
    if position is None:
        return None
    must = "be three finite numbers (x, y, z) in mm"
    xyz = finite_numbers("position_mm", position, must, shapes=[(3,)])
    return float(xyz[0]), float(xyz[1]), float(xyz[2])


@dataclass(frozen=True)
class Source:
    """Where and when the pulse starts, as far as it is known. None means unknown: it is fitted.

    Attributes
    ----------
    position_mm : ArrayLike or None
        (3,) world, mm; stored as a tuple.
    position_std_mm : float or (float, float, float)
        One-sigma error of the position: one number, or one per axis; mm. 0: exact.
    emission_time_ps : float or None
        When the pulse left the source, on the calibrated clock; ps.
    emission_time_std_ps : float
        One-sigma error of the emission time, ps. 0: exact.
    pulse_fwhm_ps : float or None
        Full width at half maximum of the laser pulse, ps.
    """

    position_mm: ArrayLike | None = None

    position_std_mm: float | tuple[float, float, float] = field(default=0.0, kw_only=True)

    emission_time_ps: float | None = field(default=None, kw_only=True)

    emission_time_std_ps: float = field(default=0.0, kw_only=True)

    pulse_fwhm_ps: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_mm", _checked_position(self.position_mm))
        must = "be one number or three, finite and >= 0"
        told = self.position_std_mm
        std = finite_numbers("position_std_mm", told, must, shapes=[(), (3,)], low=0.0)
        stored = float(std) if std.shape == () else (float(std[0]), float(std[1]), float(std[2]))
        object.__setattr__(self, "position_std_mm", stored)
        if self.emission_time_ps is not None:
            finite_number("emission_time_ps", self.emission_time_ps)
        finite_number("emission_time_std_ps", self.emission_time_std_ps, _ERROR, low=0.0)
        if self.pulse_fwhm_ps is not None:
            must = "be positive and finite"
            finite_number("pulse_fwhm_ps", self.pulse_fwhm_ps, must, low=POSITIVE)

    @property
    def position_std_xyz_mm(self) -> Floats:
        """(3,) one-sigma error of the position, per world axis, mm."""
        return np.broadcast_to(np.asarray(self.position_std_mm, dtype=float), (3,)).copy()


def event_times_from_vertices(
    vertices_mm: ArrayLike, *, emission_time_ps: float, path_group_index: float = AIR_GROUP_INDEX
) -> Floats:
    """Event time at each vertex of a path: t_k = t_B + n_p (path length to k) / c.

    Source: method.md, Flight.

    Parameters
    ----------
    vertices_mm : array of float, shape (m, 3)
        World, mm.
    emission_time_ps : float
        t_B, when the pulse is at vertex 0, ps.
    path_group_index : float
        n_p.

    Returns
    -------
    array of float, shape (m,)
        ps.

    Examples
    --------
    >>> event_times_from_vertices(
    ...     [[0, 0, 0], [299.792458, 0, 0]], emission_time_ps=5.0, path_group_index=1.0
    ... ).round(9)
    array([   5., 1005.])
    """
    vertices = np.asarray(vertices_mm, dtype=float)
    lengths = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
    travelled = np.concatenate(([0.0], np.cumsum(lengths)))
    return emission_time_ps + path_group_index * travelled / SPEED_OF_LIGHT_MM_PER_PS


def return_time_from_points(
    points_mm: ArrayLike, *, camera_center_mm: ArrayLike, return_group_index: float
) -> Floats:
    """Time that scattered light needs to the camera: ``n_r |A - X| / c`` (method.md, Flight).

    Parameters
    ----------
    points_mm : array of float, shape (..., 3)
        X, world, mm.
    camera_center_mm : array of float, shape (3,)
        A, world, mm.
    return_group_index : float
        n_r.

    Returns
    -------
    array of float, shape (...)
        ps.
    """
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
    """Arrival time of light scattered at known places: ``t_a = t + n_r |A - X| / c``.

    Source: method.md, Flight.

    Parameters
    ----------
    points_mm : array of float, shape (..., 3)
        X, world, mm.
    event_time_ps : array of float, shape (...)
        t, when the pulse is there, ps.
    camera_center_mm : array of float, shape (3,)
        A, world, mm.
    return_group_index : float
        n_r.

    Returns
    -------
    array of float, shape (...)
        ps, on the clock of `event_time_ps`.
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
    """Event time at known places from arrival times: ``t = t_a - n_r |A - X| / c`` (method.md).

    Parameters
    ----------
    points_mm : array of float, shape (..., 3)
        X, world, mm.
    arrival_ps : array of float, shape (...)
        t_a, ps.
    camera_center_mm : array of float, shape (3,)
        A, world, mm.
    return_group_index : float
        n_r.

    Returns
    -------
    array of float, shape (...)
        ps, on the clock of `arrival_ps`.
    """
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

    With tau = t_a - t_B, ``s = |A - B|``, q = r . (A - B), the point X = A + lambda r obeys

        n_p^2 (s^2 + 2 lambda q + lambda^2) = (c tau - n_r lambda)^2,

    solved in the form that stays exact when n_p = n_r, where it is
    lambda = ((c tau / n)^2 - s^2) / (2 (c tau / n + q)) (method.md, One pixel, one point).

    Parameters
    ----------
    rays : array of float, shape (..., 3)
        Unit vectors, world, from the camera outwards.
    arrival_ps : array of float, shape (...)
        t_a, ps.
    source_mm : array of float, shape (..., 3)
        B, world, mm: where the light comes from, straight.
    emission_time_ps : array of float, shape (...)
        t_B, when it left there, ps.
    camera_center_mm : array of float, shape (3,)
        A, world, mm.
    medium : Medium, optional
        None: air.

    Returns
    -------
    array of float, shape (...)
        lambda, mm; NaN where no point in front of the camera explains the arrival.
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
        # Both exact where n_p = n_r, which leaves no far root.
        near = -constant / (linear + root)
        far = -(linear + root) / quadratic if quadratic else np.full_like(near, np.nan)
        # Squared, the equation also holds for light that would fly a negative way.
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
    """Point on each pixel's ray where light straight from the source scattered: X = A + lambda r.

    Parameters
    ----------
    rays : array of float, shape (..., 3)
        Unit vectors, world, from the camera outwards.
    arrival_ps : array of float, shape (...)
        t_a, ps.
    source_mm : array of float, shape (..., 3)
        B, world, mm: where the light comes from, straight.
    emission_time_ps : array of float, shape (...)
        t_B, when it left there, ps.
    camera_center_mm : array of float, shape (3,)
        A, world, mm.
    medium : Medium, optional
        None: air.

    Returns
    -------
    array of float, shape (..., 3)
        World, mm; NaN where `distance_from_arrival`, which finds lambda, has none.
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
    t_f + (n p / c) tan(pi/4 + psi/2) (method.md, One leg: the half-angle law).

    Parameters
    ----------
    viewing_angle : array of float, shape (...)
        psi, rad, in (-pi/2, pi/2), from the foot of the perpendicular from the camera to the leg,
        positive in the direction of flight.
    foot_time_ps : array of float, shape (...)
        t_f, event time at the foot, ps.
    foot_distance_mm : array of float, shape (...)
        p, length of the perpendicular, mm.
    medium : Medium, optional
        None: air.

    Returns
    -------
    array of float, shape (...)
        ps, on the clock of `foot_time_ps`.
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
    """Length of path seen per unit arrival time: c / (n_p - n_r d.u).

    Along u the light arrives as fast as it flies and the speed diverges.

    Parameters
    ----------
    direction : array of float, shape (..., 3)
        d, unit vector in the direction of flight, world.
    towards_camera : array of float, shape (..., 3)
        u, unit vector from the point to the camera, world.
    medium : Medium, optional
        None: air.

    Returns
    -------
    array of float, shape (...)
        mm/ps.
    """
    medium = Medium() if medium is None else medium
    approach = np.sum(np.asarray(direction, float) * np.asarray(towards_camera, float), axis=-1)
    speed: Floats = SPEED_OF_LIGHT_MM_PER_PS / (
        medium.path_group_index - medium.return_group_index * approach
    )
    return speed


def twin_from_direction(
    direction: ArrayLike, towards_camera: ArrayLike, *, medium: Medium | None = None
) -> Floats:
    r"""The other direction of flight that looks as fast across the line of sight.

    .. math:: f(\theta) = \frac{\sin\theta}{n_p - n_r \cos\theta}

    is how fast light seems to run across, in c, theta from its direction to the way back to the
    camera. Where the way out is slower than the way back, f is largest at cos(theta) = n_r / n_p,
    and any lower value is that of two directions, whose cosines sum to
    2 n_p n_r f^2 / (1 + n_r^2 f^2). In one medium there is no other: f = cot(theta / 2) / n.

    Parameters
    ----------
    direction : array of float, shape (3,)
        d, unit vector in the direction of flight, world.
    towards_camera : array of float, shape (3,)
        u, unit vector from the point to the camera, world.
    medium : Medium, optional
        None: air.

    Returns
    -------
    array of float, shape (3,)
        Unit, in the plane of d and u; NaN where there is no other direction.
    """
    medium = Medium() if medium is None else medium
    out, back = medium.path_group_index, medium.return_group_index
    d, u = np.asarray(direction, dtype=float), np.asarray(towards_camera, dtype=float)
    cosine = float(d @ u)
    across = d - cosine * u
    sine = float(np.linalg.norm(across))
    if out <= back or sine == 0.0:
        return np.full(3, np.nan)
    seems = sine / (out - back * cosine)
    other = 2.0 * out * back * seems**2 / (1.0 + (back * seems) ** 2) - cosine
    twin: Floats = other * u + np.sqrt(max(0.0, 1.0 - other**2)) * across / sine
    return twin


def elevation_from_direction(direction: ArrayLike, normal: ArrayLike) -> Floats:
    """Elevation of a leg out of the plane normal to n: alpha = asin(d.n).

    Parameters
    ----------
    direction : array of float, shape (..., 3)
        d, unit vector in the direction of flight, world.
    normal : array of float, shape (3,)
        n, unit vector, world: the backward optical axis (towards the camera) unless the user says
        otherwise, so that positive means towards the camera, as in the paper.

    Returns
    -------
    array of float, shape (...)
        rad.
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
    """Arrival time of the paper: t_a = t + sqrt(s^2/c^2 + t^2 - 2 s t sin(alpha + theta) / c).

    Parameters
    ----------
    propagation_time_ps : array of float, shape (...)
        t, since the pulse was at B, ps.
    start_distance_mm : array of float, shape (...)
        ``s = |BA|``, mm.
    propagation_angle : array of float, shape (...)
        alpha, angle of the leg out of the reference plane, rad.
    start_angle : array of float, shape (...)
        theta, rad, signed: sin(theta) = (A - B).e / s with e the unit vector along viewing plane
        and reference plane, in the direction of flight.
    group_index : float
        n of the medium; the paper takes 1 (c is then the speed in the medium).

    Returns
    -------
    array of float, shape (...)
        ps since the pulse was at B.

    References
    ----------
    Zheng et al. 2020, Eq. 1.
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
    """Flight time of the paper: t = (1/c) s l cos(theta) / (l sin(alpha) + s cos(alpha + theta)).

    Parameters
    ----------
    projected_length_mm : array of float, shape (...)
        ``l = |BE|``, mm, where E is the point at which the pixel's viewing ray meets the reference
        plane.
    start_distance_mm : array of float, shape (...)
        ``s = |BA|``, mm.
    propagation_angle : array of float, shape (...)
        alpha, angle of the leg out of the reference plane, rad.
    start_angle : array of float, shape (...)
        theta, rad, as for `arrival_time_from_propagation_time`.
    group_index : float
        n of the medium.

    Returns
    -------
    array of float, shape (...)
        ps since the pulse was at B.

    References
    ----------
    Zheng et al. 2020, Eq. 2.
    """
    speed = SPEED_OF_LIGHT_MM_PER_PS / group_index
    length = np.asarray(projected_length_mm, dtype=float)
    s = np.asarray(start_distance_mm, dtype=float)
    alpha = np.asarray(propagation_angle, dtype=float)
    theta = np.asarray(start_angle, dtype=float)
    travelled = s * length * np.cos(theta) / (length * np.sin(alpha) + s * np.cos(alpha + theta))
    time: Floats = travelled / speed
    return time
