"""What another camera, anywhere, at rest, would record of a reconstructed pulse.

Takes a LightPath and a Camera, gives an `Observation`: where and when its light would arrive.
Light is scattered equally in all directions and thins as 1/r²; nothing is said about absolute
brightness. NumPy only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import check_kinds, shown, whole_number
from lightflight.camera.model import Camera
from lightflight.display import Shown
from lightflight.errors import GeometryError
from lightflight.flight import Medium, arrival_time_from_event
from lightflight.path.on_bends import drawn, starts_of_pieces
from lightflight.path.tables import Polyline
from lightflight.units import std_from_fwhm

Floats = NDArray[np.float64]

DEFAULT_PULSE_FWHM_PS = 68.0
"""Pulse of the paper's laser, where a path does not say its own; ps."""
_MOST_STEPS = 10_000
"""Steps per pixel: more than any picture shows."""


@dataclass(frozen=True, eq=False, repr=False)
class Observation(Shown):
    """Light of a pulse as one camera at rest would see it, in small steps of path.

    Attributes
    ----------
    camera : Camera
        Who looks.
    row : array of float, shape (n,)
        Pixel coordinates of the steps in view; fractional.
    col : array of float
        (n,).
    arrival_ps : array of float, shape (n,)
        When the middle of the pulse arrives from there, on the path's clock, ps.
    event_time_ps : array of float, shape (n,)
        When it was there, ps.
    strength : array of float, shape (n,)
        Light of a step at the camera: length / distance², relative to the strongest.
    leg : array of int, shape (n,)
        0-based.
    pulse_std_ps : float
        Standard deviation of the pulse, ps.
    """

    camera: Camera

    row: Floats

    col: Floats

    arrival_ps: Floats

    event_time_ps: Floats

    strength: Floats

    leg: NDArray[np.int64]

    pulse_std_ps: float

    @cached_property
    def pixel(self) -> NDArray[np.int64]:
        """(n,), row * cols + col of every step."""
        rows, cols = self.camera.shape
        row = np.clip(np.floor(self.row + 0.5), 0, rows - 1).astype(np.int64)
        col = np.clip(np.floor(self.col + 0.5), 0, cols - 1).astype(np.int64)
        return row * cols + col

    def image(self) -> Floats:
        """(rows, cols), light of the whole flight, 0 … 1 of the brightest pixel."""
        light = self._summed()
        return np.asarray((light / max(light.max(initial=0.0), 1e-300)).reshape(self.camera.shape))

    def arrival_image(self) -> Floats:
        """(rows, cols), mean arrival time by pixel, ps; NaN where no light comes from."""
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = self._summed(self.arrival_ps) / self._summed()
        return np.asarray(mean.reshape(self.camera.shape))

    def _summed(self, values: Floats | float = 1.0) -> Floats:
        """(rows * cols,), values of the steps, weighed by their light and added up by pixel."""
        size = self.camera.shape[0] * self.camera.shape[1]
        light = self.strength * values
        return np.asarray(np.bincount(self.pixel, light, size), dtype=np.float64)

    def frames(self, arrival_times_ps: ArrayLike, *, response_std_ps: float = 0.0) -> Floats:
        """Light in every pixel at moments of arrival time.

        Parameters
        ----------
        arrival_times_ps : array of float, shape (k,)
            On the path's clock, ps.
        response_std_ps : float
            Standard deviation of the camera's own response, ps.

        Returns
        -------
        array of float, shape (k, rows, cols)
            Relative: 1 is the brightest pixel at its best moment.
        """
        moments = np.atleast_1d(np.asarray(arrival_times_ps, dtype=float))
        std = float(np.hypot(self.pulse_std_ps, response_std_ps))
        rows, cols = self.camera.shape
        pixel = self.pixel
        out = np.zeros((len(moments), rows * cols))
        for k, moment in enumerate(moments):
            z = (moment - self.arrival_ps) / std
            # Further away a Gaussian adds less than 2e-8 of its peak.
            near = np.abs(z) < 6.0
            weight = self.strength[near] * np.exp(-0.5 * z[near] ** 2)
            out[k] = np.bincount(pixel[near], weights=weight, minlength=rows * cols)
        peak = self._peak(std)
        return np.asarray((out / peak).reshape(len(moments), rows, cols))

    def _peak(self, std: float) -> float:
        """Light of the brightest pixel at the moment its mean light arrives."""
        if len(self.row) == 0:
            return 1.0
        when = self._summed(self.arrival_ps) / np.maximum(self._summed(), 1e-300)
        z = (self.arrival_ps - when[self.pixel]) / std
        return max(float(self._summed(np.exp(-0.5 * z**2)).max()), 1e-300)


def observe(
    path: Polyline, camera: Camera, *, medium: Medium | None = None, steps_per_pixel: int = 12
) -> Observation:
    """What a camera would record of the pulse that flies along a path.

    ``t_a = t + n_r |A - X| / c`` for every small step X of the path; its light thins as 1/r^2.
    Where a path forks, each arm is drawn as if it held all the light: a path knows of times, not of
    how much goes where.

    Parameters
    ----------
    path : LightPath or truth
        Anything with `vertices_mm` (m, 3), mm, and `vertex_times_ps` (m,), ps.
    camera : Camera
        Any camera, in the world frame of the path.
    medium : Medium, optional
        The path's own where not given.
    steps_per_pixel : int
        Steps of path per pixel crossed.

    Returns
    -------
    Observation
        Only what is in view.

    Raises
    ------
    GeometryError
        Where the camera sees no part of the path.
    ValueError
        For fewer than one step per pixel.
    """
    check_kinds("path", "camera", path=path, camera=camera, medium=medium)
    if not 1 <= whole_number("steps_per_pixel", steps_per_pixel) <= _MOST_STEPS:
        raise ValueError(
            f"steps_per_pixel must be from 1 to {_MOST_STEPS}, got {shown(steps_per_pixel)}"
        )
    medium = getattr(path, "medium", None) if medium is None else medium
    medium = Medium() if medium is None else medium
    vertices, times, of_leg = drawn(path)
    vertices = vertices.reshape(-1, 3)
    pieces = [
        _steps_of_leg(
            vertices[[start, k + 1]], times[[start, k + 1]], leg, camera, medium, steps_per_pixel
        )
        for k, (start, leg) in enumerate(zip(starts_of_pieces(path, of_leg), of_leg, strict=True))
    ]
    table = np.concatenate(pieces, axis=1) if pieces else np.zeros((6, 0))
    if table.shape[1] == 0:
        raise GeometryError("the camera sees no part of the path: turn it towards the path")
    row, col, arrival, event, strength, leg = table
    width = getattr(getattr(path, "source", None), "pulse_fwhm_ps", None) or DEFAULT_PULSE_FWHM_PS
    return Observation(
        camera=camera,
        row=row,
        col=col,
        arrival_ps=arrival,
        event_time_ps=event,
        strength=strength / strength.max(),
        leg=leg.astype(np.int64),
        pulse_std_ps=std_from_fwhm(float(width)),
    )


def camera_towards(
    path: Polyline, position_mm: ArrayLike, *, shape: tuple[int, int] | None = None
) -> Camera:
    """Camera at a point, turned towards a path, with the whole of it just in view.

    Parameters
    ----------
    path : LightPath or truth
        Anything with `vertices_mm` (m, 3), mm.
    position_mm : array of float, shape (3,)
        World, mm: where it stands.
    shape : (int, int), optional
        (rows, cols); None: as the path's own camera, else (32, 32).

    Returns
    -------
    Camera
        Without lens, upright, a tenth of the picture free on every side.

    Raises
    ------
    GeometryError
        Where the point is so near that part of the path would be beside or behind it.
    """
    own = getattr(path, "camera", None)
    rows, cols = shape or (own.shape if own is not None else (32, 32))
    # Of what has no bent legs the vertices alone are asked for.
    places = drawn(path)[0] if getattr(path, "bends", ()) else path.vertices_mm
    vertices = np.asarray(places, dtype=float).reshape(-1, 3)
    vertices = vertices[np.isfinite(vertices).all(axis=1)]
    if len(vertices) == 0:
        raise GeometryError("the path has no vertices: there is nothing to look at")
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    unit = Camera.looking_at(
        middle, position_mm=position_mm, focal_length_px=1.0, shape=(rows, cols)
    )
    x, y, depth = ((vertices - unit.center_mm) @ unit.world_from_camera[:3, :3]).T
    if not (depth > 1e-3 * float(np.linalg.norm(middle - unit.center_mm))).all():
        raise GeometryError(
            f"from {np.asarray(position_mm)} mm part of the path lies behind the camera: move the "
            "viewpoint further away"
        )
    # A margin of a tenth on every side.
    with np.errstate(divide="ignore"):
        focal = min(
            float((0.4 * cols / abs(x / depth)).min()), float((0.4 * rows / abs(y / depth)).min())
        )
    # A path that is one point would ask for an endless lens.
    focal = min(focal, 1e6)
    return Camera.looking_at(
        middle, position_mm=position_mm, focal_length_px=focal, shape=(rows, cols)
    )


def _steps_of_leg(
    ends: Floats, times: Floats, leg: int, camera: Camera, medium: Medium, steps_per_pixel: int
) -> Floats:
    """(6, n): row, col, arrival, event time, strength, leg of the steps in view."""
    # Coarse first: how many pixels a leg crosses says how finely to cut it.
    coarse = _points_between(ends, np.linspace(0.0, 1.0, 257))
    seen = camera.sees(coarse)
    if not seen.any():
        return np.zeros((6, 0))
    row, col = camera.pixels_from_points(coarse[seen])
    crossed = float(np.hypot(np.diff(row), np.diff(col)).sum())
    share = max(float(seen.mean()), 1.0 / 257)
    n = int(np.clip(np.ceil(crossed / share) * steps_per_pixel, 64, 200_000))
    # Middles of equal steps, so that no light is counted at a corner twice.
    fraction = (np.arange(n) + 0.5) / n
    points = _points_between(ends, fraction)
    points_seen = camera.sees(points)
    points, fraction = points[points_seen], fraction[points_seen]
    event = times[0] + fraction * (times[1] - times[0])
    arrival = arrival_time_from_event(
        points,
        event,
        camera_center_mm=camera.center_mm,
        return_group_index=medium.return_group_index,
    )
    row, col = camera.pixels_from_points(points)
    distance = np.linalg.norm(points - camera.center_mm, axis=1)
    strength = np.linalg.norm(ends[1] - ends[0]) / n / distance**2
    return np.stack((row, col, arrival, event, strength, np.full(len(event), float(leg))))


def _points_between(ends: Floats, fraction: Floats) -> Floats:
    """(n, 3), world, mm: points at these fractions between two ends."""
    return np.asarray(ends[0] + fraction[:, np.newaxis] * (ends[1] - ends[0]))
