"""Before the experiment: how much light a wanted error takes, and where to put the camera.

Takes a scene or path and the errors a user wants; gives, for each place of the camera, the error
that a given light reaches and the photons, seconds and pixels that the wanted one takes, all from
the Cramér-Rao bound (`bounds`). No recording is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import (
    POSITIVE,
    check_kinds,
    finite_number,
    finite_numbers,
    pixels_of_shape,
    shown,
)
from lightflight.camera.model import Camera
from lightflight.camera.rigid import pose_towards
from lightflight.display import Card, Drawn, Tabled, number
from lightflight.errors import GeometryError
from lightflight.flight import Medium, arrival_time_from_viewing_angle
from lightflight.path.light_path import LightPath
from lightflight.path.tree import leg_starts
from lightflight.reconstruct.limits.bounds import Bounds, bounds
from lightflight.reconstruct.limits.conditions import spot_std_of
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]

_LEAST, _MOST = 1.0, 1e9
"""Photons in the brightest pixel between which the wanted light is looked for."""

_STEEP_DEG = 20.0
"""Legs steeper than this are spoken of, deg."""


@dataclass(frozen=True, eq=False, repr=False)
class Placement:
    """One place of the camera, and what it allows.

    Attributes
    ----------
    name : str
        As the user calls it.
    camera : Camera
        The camera there.
    bounds : Bounds
        What the light asked about allows.
    angle_deg_per_ps : array of float, shape (legs,)
        Error of each leg's angle per ps of independent error in every pixel, its start known;
        deg/ps.
    photons_per_pixel : float
        Expected signal photons in the brightest pixel for the wanted error; NaN if none was wanted,
        inf if no light reaches it.
    seconds : float
        Recording time for those, s; NaN without a rate.
    floor_mm : float
        Position rms that light without end would leave, mm: the share of the priors.
    """

    name: str
    camera: Camera
    bounds: Bounds
    angle_deg_per_ps: Floats
    photons_per_pixel: float
    seconds: float
    floor_mm: float

    def __repr__(self) -> str:
        return f"Placement({self.name}: {_in_view(self.bounds)})"


@dataclass(frozen=True, eq=False, repr=False)
class ArrayChoice:
    """The same lens with another number of pixels behind the same field of view.

    Attributes
    ----------
    shape : (int, int)
        (rows, cols).
    bounds : Bounds
        What the same light in all (photons over the whole picture) allows.
    """

    shape: tuple[int, int]
    bounds: Bounds

    def __repr__(self) -> str:
        rows, cols = self.shape
        return f"ArrayChoice({rows} \u00d7 {cols} pixels: {_in_view(self.bounds)})"


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Drawn, Tabled):
    """Answers of `plan`, best placement first.

    Attributes
    ----------
    placements : tuple of Placement
        Places of the camera that see the path, by position error.
    blind : mapping of str to str
        Places that do not, by name, with the reason.
    arrays : tuple of ArrayChoice
        Pixel numbers at the best place, coarsest first.
    wanted : mapping of str to float
        The wanted errors, by name.
    rate_hz : float or None
        Signal photons per second in the brightest pixel of the first placement.
    statements : tuple of str
        What to know before going into the lab, one sentence each.
    """

    placements: tuple[Placement, ...]
    blind: Mapping[str, str]
    arrays: tuple[ArrayChoice, ...]
    wanted: Mapping[str, float]
    rate_hz: float | None
    statements: tuple[str, ...]

    def _card(self) -> Card:
        wanted = ", ".join(f"{name} {value:g}" for name, value in self.wanted.items())
        facts = [("prior", self.placements[0].bounds.prior)] if self.placements else []
        facts += [("wanted", wanted)] if wanted else []
        facts += [(place.name, _in_view(place.bounds)) for place in self.placements]
        facts += [(name, f"does not see the path: {why}") for name, why in self.blind.items()]
        facts += [
            (f"{one.shape[0]} \u00d7 {one.shape[1]} pixels", _in_view(one.bounds))
            for one in self.arrays
        ]
        return Card("Plan", facts + [("", sentence) for sentence in self.statements])


def _in_view(bounds: Bounds) -> str:
    position, time = number(bounds.position_rms_mm), number(bounds.event_time_rms_ps)
    return f"{position} mm and {time} ps rms in view"


def plan(
    subject: object,
    *,
    position_rms_mm: float | None = None,
    event_time_rms_ps: float | None = None,
    angle_std_deg: float | None = None,
    photons_per_pixel: float = 40_000.0,
    rate_hz: float | None = None,
    camera: Camera | None = None,
    cameras: Mapping[str, Camera | ArrayLike] | None = None,
    array_shapes: Sequence[tuple[int, int]] = ((16, 16), (32, 32), (64, 64), (128, 128)),
    **conditions: object,
) -> Plan:
    """Plan an experiment: photons, seconds, pixels for a wanted error, and where to stand.

    Parameters
    ----------
    subject : object
        A Scene or LightPath, as for `bounds`.
    position_rms_mm, event_time_rms_ps, angle_std_deg : float, optional
        Errors wanted (the worst leg's angle); all that are given must hold.
    photons_per_pixel : float, optional
        Expected signal photons in the brightest pixel, for the errors stated.
    rate_hz : float, optional
        Signal photons per second in the brightest pixel, as the set-up stands.
    camera : Camera, optional
        Stands in for that of the subject.
    cameras : mapping of str to Camera or array_like, optional
        Other places by name: a Camera, or (x, y, z) in mm to which the same camera is moved and
        turned towards the middle of the path. There it collects as much light as here, up to the
        distance squared.
    array_shapes : sequence of (int, int), optional
        Pixel numbers to compare behind the same field of view.
    **conditions : object
        Passed on to `bounds` (source, medium, waypoints, pixel_std_ps ...).

    Raises
    ------
    GeometryError
        Where no camera sees the path.
    ValueError
        For a wanted error or rate that is not positive.
    """
    wanted = _wanted(position_rms_mm, event_time_rms_ps, angle_std_deg)
    if rate_hz is not None:
        finite_number("rate_hz", rate_hz, "be positive", low=POSITIVE)
    check_kinds(camera=camera)
    finite_number("photons_per_pixel", photons_per_pixel, "be positive", low=POSITIVE)
    if not isinstance(cameras, Mapping | None):
        raise TypeError(f"cameras must be a mapping of names, got {shown(cameras)}")
    if not isinstance(array_shapes, list | tuple):
        raise TypeError(f"array_shapes must be a list of (rows, cols), got {shown(array_shapes)}")
    array_shapes = [pixels_of_shape(shape) for shape in array_shapes]
    camera = camera or getattr(subject, "camera", None)
    if camera is None or not hasattr(subject, "vertices_mm"):
        raise ValueError("plan needs a camera: a Scene has one, or give camera=")
    middle = _middle_of(subject)
    places = {"as given": camera}
    for name, place in (cameras or {}).items():
        places[name] = place if isinstance(place, Camera) else moved_to(camera, place, middle)
    found, blind = [], {}
    for name, there in places.items():
        light = photons_per_pixel * _light_share(camera, there, middle)
        try:
            found.append(
                _placement(name, subject, there, light, wanted, rate_hz, photons_per_pixel,
                           conditions)
            )  # fmt: skip
        except GeometryError as error:
            blind[name] = str(error)
    if not found:
        raise GeometryError(
            "; ".join(f"{name}: {reason}" for name, reason in blind.items())
            if len(blind) > 1
            else next(iter(blind.values()))
        )
    found.sort(key=lambda place: place.bounds.position_rms_mm)
    arrays = tuple(_array(subject, found[0], shape, conditions) for shape in array_shapes)
    return Plan(
        tuple(found), blind, arrays, wanted, rate_hz, _statements_of_plan(found, wanted, rate_hz)
    )


def moved_to(camera: Camera, position_mm: ArrayLike, target_mm: ArrayLike) -> Camera:
    """The same camera at `position_mm` (3,), turned towards `target_mm` (3,), not rolled.

    Parameters
    ----------
    camera : Camera
        The camera that sees it.
    position_mm : array_like, shape (3,)
        World, mm.
    target_mm : array_like, shape (3,)
        What it looks at, world, mm.

    Returns
    -------
    Camera
        Same lens and pixels, its pose known as well along its own axes.

    Raises
    ------
    GeometryError
        Where the two points coincide.
    """
    must = "be three finite numbers in mm"
    position = finite_numbers("a camera's place", position_mm, must, shapes=[(3,)])
    forward = np.asarray(target_mm, dtype=float) - position
    distance = float(np.linalg.norm(forward))
    if distance < 1e-6:
        raise GeometryError("the camera stands in the middle of the path: move it away")
    forward = forward / distance
    # The horizon stays level; looking straight up or down, the old right stays right.
    right, down, _ = camera.world_from_camera[:3, :3].T
    up = -down
    # Up and forward in one line do not say how the camera is rolled.
    if np.linalg.norm(np.cross(up, forward)) < 1e-3:
        up = np.cross(right, forward)
    pose = pose_towards(position, forward, up)
    # The errors turn with the camera: they are told along the world's axes.
    turn = np.kron(np.eye(2), pose[:3, :3] @ camera.world_from_camera[:3, :3].T)
    covariance, slopes = camera.pose_covariance, camera.intrinsics_per_pose
    return replace(
        camera,
        world_from_camera=pose,
        pose_covariance=None if covariance is None else turn @ covariance @ turn.T,
        intrinsics_per_pose=None if slopes is None else slopes @ turn.T,
    )


def angle_deg_per_ps(path: LightPath | Any, camera: Camera, medium: Medium | None = None) -> Floats:
    """(legs,), deg of a leg's angle per ps of independent error in each pixel that sees it.

    The start of a leg is taken as known in place and time. In the plane of camera and leg, the
    arrival time at a fixed viewing angle changes with the leg's angle; the sum over pixels of
    that change squared is the information. NaN for a leg out of view. From the half-angle law
    (`flight.arrival_time_from_viewing_angle`): steep legs that run away from the camera are
    sharp, those that come towards it are not.

    Parameters
    ----------
    path : LightPath or object
        Anything with `vertices_mm` (m, 3), world, mm.
    camera : Camera
        The camera that sees it.
    medium : Medium, optional
        Group indices; None: air.

    Returns
    -------
    array of float, shape (legs,)
        deg/ps.
    """
    medium = Medium() if medium is None else medium
    vertices = np.asarray(path.vertices_mm, dtype=float)
    step_deg = 1e-3
    found = np.full(len(vertices) - 1, np.nan)
    starts = leg_starts(len(found), tuple(getattr(path, "forks", ())))
    for k, (start, end) in enumerate(zip(vertices[starts], vertices[1:], strict=True)):
        offset = camera.center_mm - start
        direction = (end - start) / np.linalg.norm(end - start)
        towards = offset - (offset @ direction) * direction
        # The leg points at the camera: its picture is a point, and no angle can be told.
        if np.linalg.norm(towards) < 1e-9:
            continue
        towards = towards / np.linalg.norm(towards)
        psi = _viewing_angles_of_pixels(start, end, camera, direction, towards)
        flat = np.array([offset @ direction, offset @ towards])
        low, high = (
            _arrivals_of_tilted(psi, flat, sign * np.radians(step_deg), medium)
            for sign in (-1.0, 1.0)
        )
        # Both sides: the even part of the curve falls out.
        slope = (high - low) / (2.0 * step_deg)
        information = float(np.sum(slope**2))
        found[k] = 1.0 / np.sqrt(information) if information > 0 else np.nan
    return found


def _viewing_angles_of_pixels(
    start: Floats, end: Floats, camera: Camera, direction: Floats, towards: Floats
) -> Floats:
    """Viewing angle (n,) from the perpendicular, rad, one per pixel of picture along the leg."""
    fraction = np.linspace(0.0, 1.0, 4001)
    points = start + fraction[:, np.newaxis] * (end - start)
    points = points[camera.sees(points)]
    if len(points) < 2:
        return np.empty(0)
    row, col = camera.pixels_from_points(points)
    along = np.append(0.0, np.cumsum(np.hypot(np.diff(row), np.diff(col))))
    at = np.interp(np.arange(0.5, along[-1]), along, np.arange(len(points)))
    offset = points[np.rint(at).astype(int)] - camera.center_mm
    angle: Floats = np.arctan2(offset @ direction, -(offset @ towards))
    return angle


def _arrivals_of_tilted(psi: Floats, camera_mm: Floats, tilt: float, medium: Medium) -> Floats:
    """Arrival times at fixed rays of a leg from (0, 0) tilted by `tilt` towards the camera.

    camera_mm (2,): the camera along and across the untilted leg; psi as seen from that leg's
    perpendicular.
    """
    direction = np.array([np.cos(tilt), np.sin(tilt)])
    along = camera_mm @ direction
    foot_distance = camera_mm @ np.array([-direction[1], direction[0]])
    return arrival_time_from_viewing_angle(
        psi - tilt,
        foot_time_ps=medium.path_group_index * along / SPEED_OF_LIGHT_MM_PER_PS,
        foot_distance_mm=foot_distance,
        medium=medium,
    )


def _wanted(
    position_rms_mm: float | None, event_time_rms_ps: float | None, angle_std_deg: float | None
) -> dict[str, float]:
    wanted = {
        "position_rms_mm": position_rms_mm,
        "event_time_rms_ps": event_time_rms_ps,
        "angle_std_deg": angle_std_deg,
    }
    for name, value in wanted.items():
        if value is not None:
            finite_number(name, value, "be positive", low=POSITIVE)
    return {name: float(value) for name, value in wanted.items() if value is not None}


def _middle_of(subject: Any) -> Floats:
    vertices = np.asarray(subject.vertices_mm, dtype=float)
    begun = vertices[leg_starts(len(vertices) - 1, tuple(getattr(subject, "forks", ())))]
    lengths = np.linalg.norm(vertices[1:] - begun, axis=1)
    middles = 0.5 * (vertices[1:] + begun)
    middle: Floats = (lengths @ middles) / lengths.sum()
    return middle


def _light_share(here: Camera, there: Camera, middle: Floats) -> float:
    """Light in a pixel there over here: the pixel sees more of the leg from afar, but dimmer.

    A pixel's light is strength x seen length / distance^2, and the seen length grows with the
    distance: one power of it is left.
    """
    near = float(np.linalg.norm(here.center_mm - middle))
    return near / float(np.linalg.norm(there.center_mm - middle))


def _placement(
    name: str,
    subject: object,
    camera: Camera,
    light: float,
    wanted: Mapping[str, float],
    rate_hz: float | None,
    light_here: float,
    conditions: Mapping[str, Any],
) -> Placement:
    def at(photons: float) -> Bounds:
        return bounds(subject, camera=camera, photons_per_pixel=photons, **conditions)

    # What light without end leaves is what the priors leave: no light reaches less.
    brightest = at(_MOST)
    photons = _photons_for(at, wanted, brightest)
    here = at(light)
    # A leg that crosses glass is told in its pieces.
    legs = here.path if here.path.medium.blocks else subject
    rate = None if rate_hz is None else rate_hz * light / light_here
    return Placement(
        name=name,
        camera=camera,
        bounds=here,
        angle_deg_per_ps=angle_deg_per_ps(
            legs, camera, conditions.get("medium") or getattr(subject, "medium", None)
        ),
        photons_per_pixel=photons,
        seconds=float("nan") if rate is None else photons / rate,
        floor_mm=brightest.position_rms_mm,
    )


def _falls_short(found: Bounds, wanted: Mapping[str, float]) -> bool:
    reached = {
        "position_rms_mm": found.position_rms_mm,
        "event_time_rms_ps": found.event_time_rms_ps,
        "angle_std_deg": float(found.angle_std_deg.max()),
    }
    return any(not reached[name] <= value for name, value in wanted.items())


def _photons_for(
    at: Callable[[float], Bounds], wanted: Mapping[str, float], brightest: Bounds
) -> float:
    """Least light for the wanted errors, to 1 %: the bound falls steadily as light grows."""
    if not wanted:
        return float("nan")
    if _falls_short(brightest, wanted):
        return float("inf")
    low, high = np.log(_LEAST), np.log(_MOST)
    # In logarithms: one percent of the light.
    while high - low > 0.01:
        middle = 0.5 * (low + high)
        low, high = (
            (middle, high) if _falls_short(at(float(np.exp(middle))), wanted) else (low, middle)
        )
    return float(np.exp(high))


def _array(
    subject: object, place: Placement, shape: tuple[int, int], conditions: Mapping[str, Any]
) -> ArrayChoice:
    """The bound with other pixels: the picture's light is the same, spread over more or fewer."""
    camera = resized(place.camera, shape)
    ratio = camera.matrix[0, 0] / place.camera.matrix[0, 0]
    spot = conditions.get("spot_std_px")
    there = {
        **conditions,
        "spot_std_px": spot_std_of(subject, finer=ratio) if spot is None else float(spot) * ratio,
    }
    guess = place.bounds.photons_per_pixel
    for _ in range(2):  # expected photons in all are proportional to those in the brightest pixel
        found = bounds(subject, camera=camera, photons_per_pixel=guess, **there)
        guess *= place.bounds.photons / found.photons
    return ArrayChoice(shape, found)


def resized(camera: Camera, shape: tuple[int, int]) -> Camera:
    """The same lens and field of view behind an array of `shape` (rows, cols) pixels.

    Parameters
    ----------
    camera : Camera
        The camera that sees it.
    shape : (int, int)
        (rows, cols), .

    Returns
    -------
    Camera
        Rays to the picture's edges are kept.
    """
    rows, cols = (new / old for new, old in zip(shape, camera.shape, strict=True))
    matrix = np.array(camera.matrix)
    matrix[0] *= cols
    matrix[1] *= rows
    # The first pixel's centre is (0, 0), so edges and not centres keep their place.
    matrix[0, 2] += 0.5 * (cols - 1.0)
    matrix[1, 2] += 0.5 * (rows - 1.0)
    return replace(camera, matrix=matrix, shape=shape)


def _statements_of_plan(
    places: Sequence[Placement], wanted: Mapping[str, float], rate_hz: float | None
) -> tuple[str, ...]:
    best = places[0]
    said = list(best.bounds.statements)
    if np.isinf(best.photons_per_pixel):
        said.append(
            "No light reaches the wanted error: what is uncertain of source, pose and clock "
            f"alone leaves {best.floor_mm:.2g} mm; measure those better."
        )
    elif wanted and rate_hz is None:
        said.append("Give the rate in the brightest pixel (photons per second) for a time.")
    if len(places) > 1:
        said.append(
            f"Of {len(places)} places of the camera, {best.name!r} is best: "
            f"{best.bounds.position_rms_mm:.2g} mm against {places[-1].bounds.position_rms_mm:.2g} "
            f"mm for {places[-1].name!r}."
        )
    said += _steepness(best)
    return tuple(said)


def _steepness(place: Placement) -> list[str]:
    """Which legs are seen sharply: away from the camera is sharp, towards it is not."""
    said = []
    for k, leg in enumerate(place.bounds.path.legs):
        value = place.angle_deg_per_ps[k]
        if abs(leg.angle_deg) < _STEEP_DEG or not np.isfinite(value):
            continue
        steep = "towards" if leg.angle_deg > 0 else "away from"
        word = "blunt" if leg.angle_deg > 0 else "sharp"
        said.append(
            f"Leg {k + 1} runs steeply {steep} the camera ({leg.angle_deg:+.0f}°): its angle is "
            f"{word}, {value:.2g}° per ps of error in each pixel."
        )
    return said
