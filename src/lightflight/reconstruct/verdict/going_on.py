"""Light that goes on from where a path ends in the picture, too dim to be found pixel by pixel.

Six photons are no pulse: a leg behind a dark mirror may be missed as a whole, though all of its
pixels together leave no doubt. A path that ends in the picture tells where and when such a leg
begins, two angles the rest: all directions are tried against the counts of pixels that no leg
lights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc, ndtr, xlogy

from lightflight.camera.model import Camera
from lightflight.camera.stand_in import stand_in_of
from lightflight.errors import GeometryError, NothingFoundError
from lightflight.flight import Medium
from lightflight.path.light_path import LightPath
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from lightflight.reconstruct.fit.joint import JointFit, pulse_std_in_view
from lightflight.reconstruct.fit.membership import mode_columns
from lightflight.reconstruct.model.cells import cells_about
from lightflight.reconstruct.model.counted import dark_pixels
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.other_light.around import Seen, alike, pixels_about_path
from lightflight.reconstruct.verdict.count_evidence import other_light_expected
from lightflight.reconstruct.verdict.evidence import sigma_from_p
from lightflight.reconstruct.verdict.judge import CONTRADICTED_AT
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_N_DIRECTIONS = 4000
"""3 degrees apart: sixteen pixels on, flights next to each other are a pixel apart."""
_STRAIGHT_ON_DEG = 15.0
"""What turns less from the last leg is its own light, which has dimmed."""
_EXTENTS = (8, 16, 10_000)
"""Pixels of a flight that are summed: light may stop or turn again, and directions are coarse."""
_FEWEST_PIXELS = 4
_CELL_STDS, _N_HALF = 0.5, 3
"""Cells of time, and how many to both sides of the expected time hold a pulse's light."""
_REACH_PICTURES = 1.5
"""Longest flight, in diagonals of the picture where the path ends."""
_STEP_PX, _MOST_STEPS = 0.5, 400
_CONES_DEG = (3.0, 1.5, 0.7, 0.35)
"""About the best direction others are tried, nearer and nearer."""
_N_IN_CONE = 60


@dataclass(frozen=True)
class GoingOn:
    """Light along the straight flight from a path's end that shows most of it.

    Attributes
    ----------
    p_value : float
        Chance that any of all flights that were tried shows as much.
    photons, expected : float
        Counted along the flight, and expected without light on it.
    leaves : (int, int)
        The last pixel of these.
    end_mm : array of float, shape (3,)
        Where the flight is then.
    """

    p_value: float
    photons: float
    expected: float
    leaves: tuple[int, int]
    end_mm: Floats


@dataclass(frozen=True, eq=False)
class _Dark:
    """Counts of the pixels that no leg lights, from when the path ends.

    Attributes
    ----------
    camera : Camera
    clock : Sighting
    begins_mm, begins_ps : array of float, shape (3,), and float
        Where and when the path ends.
    medium : Medium
    place : array of int, shape (rows, cols)
        Which pixel it is; -1: none of these.
    arrival_ps : float
        Arrival of light from the path's end, ps on the clock.
    step_ps : float
        Width of cells of time; the first of them begins `lead` cells before that arrival.
    lead : int
    sums : array of float, shape (3, n, g + 1)
        Counts, expected counts and their variance, cumulated over cells.
    """

    camera: Camera
    clock: Sighting
    begins_mm: Floats
    begins_ps: float
    medium: Medium
    place: Indices
    arrival_ps: float
    step_ps: float
    lead: int
    sums: Floats

    def along(self, directions: Floats, ways_mm: Floats) -> tuple[Floats, Indices, Indices]:
        """What flights (k,) see of light by each extent; ways (s,) from the path's end.

        Sums of counts, expected counts and variance (3, k, e); number of pixels (k,); and the step
        at which each extent ends (k, e).
        """
        points = self.begins_mm + ways_mm[:, np.newaxis] * directions[:, np.newaxis]
        shape, points = points.shape[:2], points.reshape(-1, 3)
        at = np.rint(np.stack(self.camera.pixels_from_points(points))).reshape(2, *shape)
        most = np.array(self.place.shape)[:, np.newaxis, np.newaxis]
        shown = (np.isfinite(at) & (at >= 0) & (at < most)).all(axis=0)
        # What has left the picture does not come back.
        shown = np.logical_and.accumulate(shown, axis=1)
        row, col = np.where(shown, at, 0.0).astype(np.int64)
        used = shown & (self.place[row, col] >= 0)
        used[:, 1:] &= (row[:, 1:] != row[:, :-1]) | (col[:, 1:] != col[:, :-1])
        flight, step = np.nonzero(used)
        pixel = self.place[row[used], col[used]]
        flown = ways_mm[step] * self.medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS
        way_back = self.camera.return_times_ps(
            points[used.ravel()], return_group_index=self.medium.return_group_index
        )
        due = self.clock.as_counted(row[used], col[used], self.begins_ps + flown + way_back)
        cell = self.lead + np.rint((due - self.arrival_ps) / self.step_ps).astype(np.int64)
        told = (cell >= _N_HALF) & (cell < self.sums.shape[2] - _N_HALF)
        flight, step, pixel, cell = flight[told], step[told], pixel[told], cell[told]
        light = np.zeros((3, cell.size + 1))
        both = self.sums[:, pixel, cell + _N_HALF] - self.sums[:, pixel, cell - _N_HALF]
        np.cumsum(both, axis=1, out=light[:, 1:])
        n_pixels = np.bincount(flight, minlength=len(directions))
        begins = (np.cumsum(n_pixels) - n_pixels)[:, np.newaxis]
        ends = begins + np.minimum(_EXTENTS, n_pixels[:, np.newaxis])
        last = np.append(0, step)[np.where(ends > begins, ends, 0)]
        return light[:, ends] - light[:, begins], np.asarray(n_pixels, dtype=np.int64), last


def light_going_on(path: LightPath, fit: JointFit, *, nominal: bool) -> GoingOn | None:
    """The flight from the end of a path that shows most light, if it ends in the picture.

    Parameters
    ----------
    path : LightPath
        A chain of legs.
    fit : JointFit
        Of the pulses, which tells what pixels its legs light.
    nominal : bool
        Whether the widths of the codes were never measured.

    Returns
    -------
    GoingOn or None
        None where the path ends outside, no pixels tell, or chance brings as much.
    """
    sightings = list(fit.sightings)
    if path.forks or not all(one.histograms.poisson for one in sightings):
        return None
    found: list[GoingOn] = []
    for whole, own in alike(sightings):
        try:
            dark = _dark_pixels_after(path, fit, whole, own[0], nominal=nominal)
        except (GeometryError, NothingFoundError):
            continue
        one = None if dark is None else _brightest_flight(dark, path)
        if one is not None:
            found.append(one)
    if not found:
        return None
    best = min(found, key=lambda one: one.p_value)
    best = replace(best, p_value=min(1.0, len(found) * best.p_value))
    return best if best.p_value < CONTRADICTED_AT else None


def _dark_pixels_after(
    path: LightPath, fit: JointFit, whole: Sighting, number: int, *, nominal: bool
) -> _Dark | None:
    """The pixels that no leg lights; None where the path's end or its pulses are not in view."""
    camera, medium = fit.solution.cameras[whole.view], fit.solution.medium
    # A million places: a stand-in sees them, a climb that follows sees through windows.
    camera, more_mm = stand_in_of(camera, medium.return_group_index)
    end, shape = path.vertices_mm[-1], whole.blind.shape
    at = np.concatenate(camera.pixels_from_points(end[np.newaxis]))
    if not (np.isfinite(at).all() and (at > -0.5).all() and (at < np.array(shape) - 0.5).all()):
        return None
    # Of several cameras one may show no pulse, whose width would tell when light is due.
    if not len(whole.usable_pulses):
        return None
    clock = replace(whole, found=fit.solution.modes[mode_columns(list(fit.sightings))[whole.view]])
    index = medium.return_group_index
    begins = float(path.vertex_times_ps[-1]) + more_mm / SPEED_OF_LIGHT_MM_PER_PS
    back = camera.return_times_ps(end[np.newaxis], return_group_index=index)
    row, col = np.rint(at).astype(np.int64)[:, np.newaxis]
    arrival = float(clock.as_counted(row, col, begins + back)[0])
    std_ps = pulse_std_in_view(list(fit.sightings), whole.view)
    step, lead = _CELL_STDS * std_ps, 2 * _N_HALF
    longest = 2.0 * _longest_mm(camera, end) * index / SPEED_OF_LIGHT_MM_PER_PS
    n_cells = int(np.ceil(longest / step)) + 2 * lead
    if (period := whole.histograms.laser_period_ps) is not None:
        n_cells = min(n_cells, int(period / step) - 1)
    seen = pixels_about_path(whole, fit, number, std_ps)
    seen = seen.of(np.flatnonzero(seen.leg[:, 0] == -1))
    if not len(seen.rows) or n_cells <= 2 * lead:
        return None
    lags: Floats = np.float64(step) * (np.arange(n_cells + 1) - lead)
    place = np.full(shape, -1)
    place[seen.rows, seen.cols] = np.arange(len(seen.rows))
    sums = _summed(whole, seen, arrival, lags, nominal=nominal)
    return _Dark(camera, clock, end, begins, medium, place, arrival, step, lead, sums)


def _summed(
    whole: Sighting, seen: Seen, arrival_ps: float, lags_ps: Floats, *, nominal: bool
) -> Floats:
    """(3, n, g + 1), counts of pixels (n,), expected ones and variance before each lag (g + 1,)."""
    reference = np.full(len(seen.rows), arrival_ps)
    cells = cells_about(whole, seen.rows, seen.cols, reference, lags_ps, nominal=nominal)
    points = np.column_stack((seen.rows, seen.cols))
    other, beyond = other_light_expected(whole, cells, points, reference)
    pixels = dark_pixels(cells, other=other, beyond=beyond)
    told = pixels.weight > 0.0
    variance = np.divide(1.0, pixels.weight, out=np.zeros_like(pixels.mean), where=told)
    sums = np.zeros((3, len(seen.rows), len(lags_ps)))
    for own, each in zip(sums, (cells.counts * told, pixels.mean * told, variance), strict=True):
        np.cumsum(each, axis=1, out=own[:, 1:])
    return sums


def _longest_mm(camera: Camera, at_mm: Floats) -> float:
    """The longest flight that is followed from a place, mm."""
    rows, cols = camera.shape
    rays = camera.rays_from_pixels(np.array([0.0, rows - 1.0]), np.array([0.0, cols - 1.0]))
    away = float(np.linalg.norm(at_mm - camera.center_mm))
    return _REACH_PICTURES * away * float(np.linalg.norm(rays[1] - rays[0]))


def _brightest_flight(dark: _Dark, path: LightPath) -> GoingOn | None:
    """Of all flights from the path's end that whose counts chance explains worst."""
    longest, diagonal = _longest_mm(dark.camera, dark.begins_mm), np.hypot(*dark.camera.shape)
    n_steps = int(min(_REACH_PICTURES * diagonal / _STEP_PX, _MOST_STEPS))
    ways: Floats = np.float64(longest / n_steps) * (np.arange(n_steps) + 0.5)
    last = path.vertices_mm[-1] - path.vertices_mm[-2]
    directions = _all_directions()
    turned = directions @ (last / np.linalg.norm(last)) < np.cos(np.deg2rad(_STRAIGHT_ON_DEG))
    directions = directions[turned]
    (counts, mean, variance), n_pixels, _ = dark.along(directions, ways)
    asked = n_pixels >= _FEWEST_PIXELS
    if not asked.any():
        return None
    clear = np.where(asked[:, np.newaxis], _clearness(counts, mean), 0.0)
    at = np.unravel_index(int(np.argmax(clear)), clear.shape)
    p_value = gammainc(max(counts[at], 1e-9), max(mean[at], 1e-9))
    if variance[at] > 1.1 * mean[at]:
        p_value = max(p_value, ndtr(-(counts[at] - mean[at]) / np.sqrt(variance[at])))
    n_tried = len(_EXTENTS) * int(np.count_nonzero(asked))
    best, rng = directions[at[0]], np.random.default_rng(4)
    for cone in _CONES_DEG:
        near = best + np.deg2rad(cone) * rng.normal(size=(_N_IN_CONE, 3))
        near[0] = best
        near /= np.linalg.norm(near, axis=1, keepdims=True)
        (counts, mean, _), _, ends = dark.along(near, ways)
        clear = _clearness(counts, mean)
        at = np.unravel_index(int(np.argmax(clear)), clear.shape)
        best = near[at[0]]
    end_mm = dark.begins_mm + ways[ends[at]] * best
    row, col = np.rint(np.concatenate(dark.camera.pixels_from_points(end_mm[np.newaxis])))
    return GoingOn(
        min(1.0, n_tried * float(p_value)), float(counts[at]), float(mean[at]),
        (int(row), int(col)), end_mm,
    )  # fmt: skip


def _clearness(counts: Floats, mean: Floats) -> Floats:
    """By how much the log-likelihood gains where there is as much light as was counted."""
    gain: Floats = xlogy(counts, counts / np.maximum(mean, 1e-9)) - (counts - mean)
    return np.where(counts > mean, gain, 0.0)


def _all_directions() -> Floats:
    """(k, 3), unit vectors as evenly spread as a golden spiral spreads them."""
    step = np.arange(_N_DIRECTIONS) + 0.5
    height, turn = 1.0 - 2.0 * step / _N_DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * step
    radius = np.sqrt(1.0 - height**2)
    return np.column_stack((radius * np.cos(turn), radius * np.sin(turn), height))


def path_going_on(
    path: LightPath, fit: JointFit, setting: Setting, *, nominal: bool
) -> LightPath | None:
    """The path with the leg that all counts show behind its end, by all counts.

    Parameters
    ----------
    path : LightPath
        As it was found, to an end in the picture.
    fit : JointFit
        Of its pulses.
    setting : Setting
        Camera, source, medium and waypoints.
    nominal : bool
        Whether the widths of the codes were never measured.

    Returns
    -------
    LightPath or None
        None where no light goes on, or the counts lead nowhere.
    """
    light = light_going_on(path, fit, nominal=nominal)
    if light is None:
        return None
    # A third of a kernel's compilation, and few paths end in view.
    from lightflight.reconstruct.all_counts.photon import path_of_all_counts

    way = float(np.linalg.norm(light.end_mm - path.vertices_mm[-1]))
    flown = way * fit.solution.medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS
    n, b = 4 * (len(path.vertices_mm) + 1), sum(bend.size for bend in path.bends)
    rough = replace(
        path,
        vertices_mm=np.vstack((path.vertices_mm, light.end_mm)),
        vertex_times_ps=np.append(path.vertex_times_ps, path.vertex_times_ps[-1] + flown),
        covariance=np.zeros((n, n)),
        covariance_parts={},
        bend_covariance=np.zeros((n + b, b)),
    )
    try:
        longer = path_of_all_counts(fit, rough, setting, tips=(fit.tips[0], None))
    except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
        return None
    if not longer.goodness.converged:
        return None
    said = (
        f"Leg {path.n_legs + 1} is too dim for pulses, and was found by all counts: "
        f"{light.photons:.0f} photons where {light.expected:.0f} are expected without it."
    )
    return replace(longer, method=path.method, statements=(said, *longer.statements))


def verdict_with_light_going_on(
    verdict: Verdict, path: LightPath, fit: JointFit, *, nominal: bool
) -> Verdict:
    """The verdict, contradicted where light goes on from the path's end in the picture.

    Parameters
    ----------
    verdict : Verdict
        On the path; only one of "trust" can change: other light that tests have found, a flash
        or an image in a curved mirror, may lie along a flight as well.
    path : LightPath
    fit : JointFit
        Of its pulses.
    nominal : bool
        Whether the widths of the codes were never measured.

    Returns
    -------
    Verdict
    """
    if verdict.level is not Level.TRUST:
        return verdict
    light = light_going_on(path, fit, nominal=nominal)
    if light is None:
        return verdict
    finding = Finding(
        FindingName.LEG_COUNT,
        f"light goes on from where the path ends: {light.photons:.0f} photons come along a "
        f"straight flight to pixel {light.leaves}, {light.expected:.0f} are expected",
        sigma_from_p(light.p_value),
        "try method photon without n_legs, record longer, or look at the mirrors",
        Severity.CONTRADICTED,
    )
    return replace(verdict, level=Level.CONTRADICTED, findings=(finding, *verdict.findings))
