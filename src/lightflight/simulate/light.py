"""Light: from a scene to photons in pixels, before the clock reads them.

The path is cut into segments far smaller than a pixel. Each gets the number of its photons that
some pixel catches, a Poisson number; every such photon then has its own place in the segment,
its own moment in the pulse, its own pixel and its own delay. Expected counts and mean arrival
times come from the same segments by summation (`expected_light`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from numpy.typing import NDArray

from lightflight.errors import GeometryError
from lightflight.path.tree import leg_starts
from lightflight.simulate.optics import Catch
from lightflight.simulate.scattering import (
    cos4_from_directions,
    inverse_square_from_distance,
    polarizations_from_vertices,
    rayleigh_from_directions,
    rim_of_camera,
    vignetting_from_directions,
)
from lightflight.simulate.scene import Scene
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SEGMENTS_PER_PIXEL = 64
_LONGEST_SEGMENT_MM = 0.5
_MOST_SEGMENTS_PER_LEG = 400_000
_BEAM_NODES = 7
_BEAM_REACH_STD = 6.0


@dataclass(frozen=True, eq=False)
class Segments:
    """Short straight pieces of the path that the camera may see; every array (n,).

    Attributes
    ----------
    leg : array of int
        Leg the segment belongs to.
    length_mm : array of float
        Path length at its middle, mm.
    size_mm : array of float
        Its length, mm.
    strength : array of float
        Light sent towards the camera, relative, before blur and pixels.
    row : array of float
        Image of its start, pixel.
    row_step : array of float
        Change of `row` to its end.
    col : array of float
        Image of its start, pixel.
    col_step : array of float
        Change of `col` to its end.
    arrival_ps : array of float
        Arrival time of light from its start, ps.
    arrival_step_ps : array of float
        Change of `arrival_ps` to its end.
    """

    leg: Ints
    length_mm: Floats
    size_mm: Floats
    strength: Floats
    row: Floats
    row_step: Floats
    col: Floats
    col_step: Floats
    arrival_ps: Floats
    arrival_step_ps: Floats

    def __len__(self) -> int:
        return len(self.leg)


@dataclass(frozen=True, eq=False)
class ExpectedLight:
    """Mean of the light caught, per leg; relative until scaled.

    Attributes
    ----------
    counts : array of float, shape (legs, rows, cols)
        Signal.
    mean_arrival_ps : array of float, shape (legs, rows, cols)
        Signal-weighted mean arrival time, without the pixel's own delay, ps; NaN where no light
        falls.
    """

    counts: Floats
    mean_arrival_ps: Floats


def beam_frame(direction: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors across a direction of flight.

    Parameters
    ----------
    direction : array of float, shape (3,)
        Unit vector d.

    Returns
    -------
    first, second : array of float, shape (3,)
        Normal to d and to each other.
    """
    # The axis farthest from the direction: the cross product is then never short.
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, other)
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)


def beam_std_mm(scene: Scene) -> float:
    """Standard deviation of the beam across its direction.

    Parameters
    ----------
    scene : Scene
        Its `beam_diameter_mm` counts.

    Returns
    -------
    float
        A quarter of the 1/e^2 diameter: exp(-r^2 / 2 s^2) is 1/e^2 at r = 2 s; mm.
    """
    return scene.beam_diameter_mm / 4.0


def _edges_of_leg(scene: Scene, start: Floats, end: Floats) -> Floats:
    """Places of the segment edges along one leg, mm from its start."""
    length = float(np.linalg.norm(end - start))
    coarse = np.linspace(0.0, 1.0, 257)
    row, col = scene.camera.pixels_from_points(start + coarse[:, np.newaxis] * (end - start))
    steps = np.hypot(np.diff(row), np.diff(col))
    margin = 4 * scene.detector.catch.reach_px + 2
    rows, cols = scene.shape
    with np.errstate(invalid="ignore"):
        near = (np.abs(row - rows / 2) < rows / 2 + margin) & (
            np.abs(col - cols / 2) < cols / 2 + margin
        )
    near = near[1:] | near[:-1]
    # the longest image of one coarse step decides: segments stay even along a leg
    longest = float(np.nanmax(steps[near], initial=0.0)) * (len(coarse) - 1)
    # A sharp spot falls off within a small part of a pixel: segments must be finer still.
    per_pixel = _SEGMENTS_PER_PIXEL * max(1.0, 0.2 / scene.detector.psf_std_px)
    wanted = max(longest * per_pixel, length / _LONGEST_SEGMENT_MM, 16.0)
    return np.linspace(0.0, length, int(min(np.ceil(wanted), _MOST_SEGMENTS_PER_LEG)) + 1)


def _strength_at(scene: Scene, leg: int, points: Floats, length_mm: Floats) -> Floats:
    """Light per mm sent into the lens from points on one leg; relative."""
    step = scene.leg_steps_mm[leg]
    distance = np.linalg.norm(scene.camera.center_mm - points, axis=1)
    towards = -scene.camera.sight_directions(points)
    strength = scene.strength(length_mm, leg)
    if scene.inverse_square:
        strength = strength * inverse_square_from_distance(distance)
    if scene.cos4_falloff:
        strength = strength * cos4_from_directions(towards, scene.camera.backward_axis)
    if scene.vignetting > 0.0:
        strength = strength * vignetting_from_directions(
            towards,
            scene.camera.backward_axis,
            rim=rim_of_camera(scene.camera),
            loss=scene.vignetting,
        )
    if scene.scattering == "rayleigh":
        field = None
        if scene.polarization is not None:
            field = polarizations_from_vertices(scene.vertices_mm, scene.polarization)[leg]
        strength = strength * rayleigh_from_directions(
            step / np.linalg.norm(step), towards, polarization=field
        )
    return strength


def arrival_at(scene: Scene, points: Floats, length_mm: Floats) -> Floats:
    """Arrival time (n,), ps, of light from points of the beam that far along the path, mm."""
    # Two indices: the beam may run through a fibre, and its light comes back through air.
    flight = scene.medium.path_group_index * length_mm / SPEED_OF_LIGHT_MM_PER_PS
    back = scene.camera.return_times_ps(points, return_group_index=scene.medium.return_group_index)
    arrival: Floats = scene.emission_time_ps + flight + back + scene.late_at(length_mm)
    return arrival


def segments_from_scene(scene: Scene) -> Segments:
    """The path in short pieces, those that the camera cannot see left out.

    Within a segment (at most 1/64 pixel and 0.5 mm) position in the picture and arrival time are
    linear, and strength and catch constant: 1e-5 ps and 1e-3 of the blur from the exact path.

    Parameters
    ----------
    scene : Scene
        Path, camera and air.

    Returns
    -------
    Segments
        In the order of the path; none where the camera sees nothing.
    """
    vertices, starts = scene.flown_mm, scene.leg_starts_mm
    begun = vertices[leg_starts(scene.n_pieces, scene.forks)]
    parts: list[tuple[Floats, ...]] = []
    for leg in range(scene.n_pieces):
        start, end = begun[leg], vertices[leg + 1]
        edges = _edges_of_leg(scene, start, end)
        direction = (end - start) / np.linalg.norm(end - start)
        at_edges = start + edges[:, np.newaxis] * direction
        middle = 0.5 * (edges[1:] + edges[:-1])
        row, col = scene.camera.pixels_from_points(at_edges)
        arrival = arrival_at(scene, at_edges, starts[leg] + edges)
        seen = _may_be_caught(scene, row, col)
        strength = np.zeros(len(middle))
        strength[seen] = _strength_at(
            scene, leg, start + middle[seen, np.newaxis] * direction, starts[leg] + middle[seen]
        )
        columns = (
            np.full(len(middle), float(leg)), starts[leg] + middle, np.diff(edges), strength,
            row[:-1], np.diff(row), col[:-1], np.diff(col), arrival[:-1], np.diff(arrival),
        )  # fmt: skip
        parts.append(tuple(column[seen & (strength > 0)] for column in columns))
    joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return Segments(joined[0].astype(np.int64), *joined[1:])


def _may_be_caught(scene: Scene, row: Floats, col: Floats) -> NDArray[np.bool_]:
    """True for segments (between edges) whose light some pixel may catch."""
    margin = scene.detector.catch.reach_px + 1.0 + _BEAM_REACH_STD * _beam_std_px(scene)
    n_rows, n_cols = scene.shape
    with np.errstate(invalid="ignore"):
        edge = (row > -margin) & (row < n_rows - 1 + margin) & (col > -margin)
        edge &= col < n_cols - 1 + margin
    finite = np.isfinite(row) & np.isfinite(col)
    return np.asarray((edge[1:] | edge[:-1]) & finite[1:] & finite[:-1])


def _beam_std_px(scene: Scene) -> float:
    """Width of the beam in the picture where it is widest, pixel (one sigma)."""
    if scene.beam_diameter_mm == 0.0:
        return 0.0
    begun = scene.flown_mm[leg_starts(scene.n_pieces, scene.forks)]
    fraction = np.linspace(0.0, 1.0, 65)[:, np.newaxis]
    points = np.concatenate(
        [start + fraction * step for start, step in zip(begun, scene.leg_steps_mm, strict=True)]
    )
    points = points[scene.camera.sees(points)]
    if not len(points):
        return 0.0
    jacobian = scene.camera.pixel_jacobian(points)
    return float(np.linalg.norm(jacobian, axis=(1, 2)).max()) * beam_std_mm(scene)


# --- expected light ---------------------------------------------------------------------


def _beam_nodes(scene: Scene) -> list[tuple[float, float, float]]:
    """Quadrature of the beam's cross-section: (offset 1 mm, offset 2 mm, weight)."""
    std = beam_std_mm(scene)
    if std == 0.0:
        return [(0.0, 0.0, 1.0)]
    node, weight = hermegauss(_BEAM_NODES)
    weight = weight / weight.sum()
    return [
        (std * x, std * y, wx * wy)
        for x, wx in zip(node, weight, strict=True)
        for y, wy in zip(node, weight, strict=True)
    ]


def _middles(scene: Scene, segments: Segments, first: float, second: float) -> tuple[Floats, ...]:
    """(row, col, arrival time) of the segments' middles, `first` and `second` mm off axis."""
    if first == second == 0.0:
        return (
            segments.row + 0.5 * segments.row_step,
            segments.col + 0.5 * segments.col_step,
            segments.arrival_ps + 0.5 * segments.arrival_step_ps,
        )
    points = points_on_path(scene, segments.leg, segments.length_mm)
    frames = leg_frames(scene)
    points = points + first * frames[0][segments.leg] + second * frames[1][segments.leg]
    row, col = scene.camera.pixels_from_points(points)
    return row, col, arrival_at(scene, points, segments.length_mm)


def leg_frames(scene: Scene) -> tuple[Floats, Floats]:
    """Unit vectors across each leg.

    Parameters
    ----------
    scene : Scene
        Its vertices count.

    Returns
    -------
    first, second : array of float, shape (legs, 3)
        See `beam_frame`.
    """
    steps = scene.leg_steps_mm
    frames = [beam_frame(step / np.linalg.norm(step)) for step in steps]
    return np.array([a for a, _ in frames]), np.array([b for _, b in frames])


def points_on_path(scene: Scene, leg: Ints, length_mm: Floats) -> Floats:
    """Positions at path lengths on given legs.

    Parameters
    ----------
    scene : Scene
        Its vertices count.
    leg : array of int, shape (n,)
        Leg of each point.
    length_mm : array of float, shape (n,)
        Path length from the first vertex, mm.

    Returns
    -------
    array of float, shape (n, 3)
        World, mm.
    """
    vertices, steps = scene.flown_mm, scene.leg_steps_mm
    begun = vertices[leg_starts(scene.n_pieces, scene.forks)]
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    along = (length_mm - scene.leg_starts_mm[leg])[:, np.newaxis]
    points: Floats = begun[leg] + along * directions[leg]
    return points


def expected_light(scene: Scene, segments: Segments, efficiency: Floats) -> ExpectedLight:
    """Mean light per leg and pixel, and its mean arrival time; counts relative (not scaled).

    Parameters
    ----------
    scene : Scene
        Camera, detector and beam.
    segments : Segments
        From `segments_from_scene`.
    efficiency : array of float, shape (rows, cols)
        Relative sensitivity of each pixel.

    Returns
    -------
    ExpectedLight
        Relative counts, and true mean arrival times.

    Raises
    ------
    GeometryError
        Where no pixel catches any light.
    """
    rows, cols = scene.shape
    n_pixels = rows * cols
    size = scene.n_pieces * n_pixels
    counts, moment = np.zeros(size), np.zeros(size)
    catch = scene.detector.catch
    reference = scene.emission_time_ps
    for first, second, weight in _beam_nodes(scene):
        row, col, arrival = _middles(scene, segments, first, second)
        near_row, share_row = catch.neighbours(row, rows)
        near_col, share_col = catch.neighbours(col, cols)
        light = weight * segments.strength * segments.size_mm
        share = light[:, None, None] * share_row[:, :, None] * share_col[:, None, :]
        place = segments.leg[:, None, None] * n_pixels
        place = place + near_row[:, :, None] * cols + near_col[:, None, :]
        counts += np.bincount(place.ravel(), share.ravel(), minlength=size)
        # Times about the emission: sums of products keep their digits.
        share *= (arrival - reference)[:, None, None]
        moment += np.bincount(place.ravel(), share.ravel(), minlength=size)
    lit = counts > 0
    if not lit.any():
        raise GeometryError(
            "no pixel catches light of the path: check the camera's pose and field, the vertices "
            "and the brightness"
        )
    mean = np.full(size, np.nan)
    mean[lit] = reference + moment[lit] / counts[lit]
    shape = (scene.n_pieces, rows, cols)
    return ExpectedLight(counts.reshape(shape) * efficiency, mean.reshape(shape))


# --- drawing ----------------------------------------------------------------------------


def caught_strength(scene: Scene, segments: Segments, catch: Catch) -> Floats:
    """Light of each segment from which photons are drawn, relative.

    Parameters
    ----------
    scene : Scene
        Camera and beam.
    segments : Segments
        From `segments_from_scene`.
    catch : Catch
        Blur and active area of the pixels.

    Returns
    -------
    array of float, shape (n,)
        In the unit of `Segments.strength` times mm.
    """
    light = segments.strength * segments.size_mm
    if beam_std_mm(scene) > 0.0:
        return light * catch.most_caught**2
    row, col, _ = _middles(scene, segments, 0.0, 0.0)
    light *= catch.caught_fraction(row, scene.shape[0])
    light *= catch.caught_fraction(col, scene.shape[1])
    return light
