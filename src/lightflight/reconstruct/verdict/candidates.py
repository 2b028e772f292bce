"""What the times and lines of a path would be if something held fixed were a little off.

Each `Candidate` is a cause with a column for each of its parameters: the change of the whitened
rows of the joint fit (`least_squares.Solution.rows`) by that parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from lightflight.camera.model import Camera
from lightflight.camera.refraction import interface_moved, phase_index_moved
from lightflight.flight import Medium
from lightflight.path.verdict import FindingName
from lightflight.reconstruct import FREE_NAMES
from lightflight.reconstruct.fit.least_squares import TimeData
from lightflight.reconstruct.model.geometry import (
    PathState,
    arrival_jacobian,
    footprints,
)
from lightflight.reconstruct.model.image_plane import (
    decentering_of_corner,
    pixels_of_undistorted,
    radial_of_corner,
    undistorted_px,
)
from lightflight.reconstruct.model.offsets import line_offsets
from lightflight.reconstruct.model.picture import LineDataInPicture
from lightflight.reconstruct.model.sizes import PLAUSIBLE, Plausible
from lightflight.reconstruct.model.told import ToldRow
from lightflight.timing.clock.shared_modes import skewed_delays
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]

LEAST_SIGNAL = 1.0
"""A parameter whose plausible size makes no more than this, sigma, is not asked for."""
_STEP = 1e-3
"""Steps of numerical derivatives, in plausible sizes."""
_AHEAD = 1e-4
"""Share of a leg by which the direction of its picture is told."""
_CODE_WAVES = 4
"""Shapes of uneven codes beside zero and scale: with two, 5 ps over 3 ns were called a pose."""
_TREND_WAVES = 3
"""Waves along each leg that a trend is looked for in, beside the slopes that the path takes up."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause, and what it would do to the whitened rows.

    Attributes
    ----------
    name : FindingName
        The cause.
    columns : array of float
        (N, k), change of the rows by each parameter of plausible size.
    plausible : tuple of Plausible
        (k), the sizes.
    symptom : bool
        True for what several causes bring.
    says : callable, optional
        What is said of sizes (k,) in plausible ones; None: by how much it is off.
    looked_for : float
        Chi-square that looking for its place costs.
    frees : str
        What `free=` calls it; "": nothing.
    """

    name: FindingName
    columns: Floats
    plausible: tuple[Plausible, ...]
    symptom: bool = False
    says: Callable[[Floats], str] | None = None
    looked_for: float = 0.0
    frees: str = ""


@dataclass(frozen=True, eq=False)
class Rows:
    """The model of the whitened rows of times and lines, to be asked with something else off.

    Attributes
    ----------
    state : PathState
        The path.
    cameras : tuple of Camera
        The cameras.
    medium : Medium
        The medium.
    times : TimeData
        Pulses.
    lines : LineDataInPicture
        Lines of the legs.
    sqrt_weight : array of float
        (n,), inverse errors of the pulses, 1/ps.
    size : int
        Number of all rows, priors and others included.
    """

    state: PathState
    cameras: tuple[Camera, ...]
    medium: Medium
    times: TimeData
    lines: LineDataInPicture
    sqrt_weight: Floats
    size: int

    def whole(self, by_time: Floats, by_line: Floats) -> Floats:
        """(N,) row by row: of times (n,), ps; of lines (2 L,), px; nothing for all others."""
        column = np.zeros(self.size)
        n = len(by_time)
        column[:n] = self.sqrt_weight * by_time
        column[n : n + len(by_line)] = self.lines.whitening @ by_line
        return column

    def seen_by(self, view: int, other: Camera) -> tuple[Floats, Floats]:
        """By how much times (n,), ps, and lines (2 L,), px, are off if a view has another camera.

        To first order: light that the other camera sees farther along a leg comes from before.
        """
        camera, state = self.cameras[view], self.state
        by_time, by_line = np.zeros(len(self.times.leg)), np.zeros(len(self.lines.leg))
        here = np.flatnonzero(self.times.view == view)
        drawn = np.flatnonzero(self.lines.view == view)
        leg, legs = self.times.leg[here], self.lines.leg[drawn]
        step = state.tangents_mm(leg, self.traced.fraction[here])
        points = state.points_mm(leg, self.traced.fraction[here])
        seen = np.array(camera.pixels_from_points(points))
        ahead = np.array(camera.pixels_from_points(points + _AHEAD * step)) - seen
        away = np.array(other.pixels_from_points(points)) - seen
        along = np.sum(away * ahead, axis=0) / np.maximum(np.hypot(*ahead), 1e-12)
        # A runaway leg's pulses may lie behind the camera, where no picture tells of its lens.
        by_time[here] = -self.traced.slope_ps_per_px[here] * np.nan_to_num(along)
        if camera.interfaces:
            index = self.medium.return_group_index
            late = other.return_times_ps(points, return_group_index=index)
            late -= camera.return_times_ps(points, return_group_index=index)
            by_time[here] += np.nan_to_num(late)
        anchors = self.lines.anchors[drawn]
        there = undistorted_px(other, *pixels_of_undistorted(camera, anchors))
        off, as_it_is = (
            line_offsets(state, camera=eye, legs=legs, anchors=points_px)[0]
            for eye, points_px in ((other, there), (camera, anchors))
        )
        # So may the place of a bent leg that the other camera sees at the same point.
        by_line[drawn] = np.nan_to_num(off - as_it_is)
        return by_time, by_line

    def moved(self, moves_mm: Floats) -> tuple[Floats, Floats]:
        """The same where each vertex (m, 3) moves, mm; (3,): all alike."""
        moves_mm = np.broadcast_to(moves_mm, self.state.vertices_mm.shape)
        whole = self.traced.by_vertices @ moves_mm.ravel()
        n = len(self.times.leg)
        return whole[:n], whole[n:]

    @cached_property
    def traced(self) -> Traced:
        """What follows from where each pulse's light comes from."""
        state = self.state
        n, n_lines = len(self.times.leg), len(self.lines.leg)
        by_vertices = np.zeros((n + n_lines, state.vertices_mm.size))
        fraction, distance, slope = np.zeros((3, n))
        for view, camera in enumerate(self.cameras):
            here = np.flatnonzero(self.times.view == view)
            drawn = np.flatnonzero(self.lines.view == view)
            print_, by_time = arrival_jacobian(
                state,
                camera=camera,
                medium=self.medium,
                legs=self.times.leg[here],
                rows=self.times.row[here],
                cols=self.times.col[here],
            )
            by_vertices[here] = by_time[:, : state.vertices_mm.size]
            by_vertices[n + drawn] = line_offsets(
                state,
                camera=camera,
                legs=self.lines.leg[drawn],
                anchors=self.lines.anchors[drawn],
            )[1][:, : state.vertices_mm.size]
            fraction[here], distance[here] = print_.fraction, print_.distance_mm
            slope[here] = print_.slope_ps_per_px
        before = state.in_medium_mm[state.leg_starts[self.times.leg]]
        out_mm = before + state.ways_mm(self.times.leg, fraction)
        return Traced(by_vertices, fraction, slope, out_mm, distance)

    def line_fractions(self) -> Floats:
        """(2 L,), where along its leg each anchor of a line is."""
        lines = self.lines
        out = np.zeros(len(lines.leg))
        for view, camera in enumerate(self.cameras):
            drawn = np.flatnonzero(lines.view == view)
            row, col = pixels_of_undistorted(camera, lines.anchors[drawn])
            out[drawn] = footprints(
                self.state,
                camera=camera,
                medium=self.medium,
                legs=lines.leg[drawn],
                rows=row,
                cols=col,
            ).fraction
        return out


@dataclass(frozen=True, eq=False)
class Traced:
    """Times and lines of `Rows` as the path has them.

    Attributes
    ----------
    by_vertices : array of float, shape (n + 2 L, 3 m)
        Derivatives of arrival times, ps, and distances of lines, px, per mm.
    fraction : array of float, shape (n,)
        Where along its leg the light of each pulse comes from.
    slope_ps_per_px : array of float, shape (n,)
        How times grow along the leg's picture.
    out_mm, back_mm : array of float, shape (n,)
        How far it flew out, and back to the camera, mm.
    """

    by_vertices: Floats
    fraction: Floats
    slope_ps_per_px: Floats
    out_mm: Floats
    back_mm: Floats


def geometry_candidates(
    rows: Rows, *, counted_ps: Floats, repeat: Floats, photons: Floats
) -> list[Candidate]:
    """All causes that times and lines can tell of.

    Parameters
    ----------
    rows : the model.
    counted_ps : (n,), what the clock of each pulse's pixel counted, signed as arrival times are.
    repeat : (n,), which of the repeats each pulse is of.
    photons : (n,), of each pulse.
    """
    nothing = np.zeros(len(rows.lines.leg))

    def of_times(name: FindingName, *by_time: Floats, symptom: bool = False) -> Candidate:
        sizes = (PLAUSIBLE[name],) * len(by_time)
        columns = [s.size * rows.whole(t, nothing) for s, t in zip(sizes, by_time, strict=True)]
        return Candidate(name, np.column_stack(columns), sizes, symptom, frees=_freed_by(name))

    found = [
        _late_clocks(rows),
        of_times(FindingName.CLOCK_SCALE, counted_ps),
        of_times(FindingName.WALK, *_brightness(photons)),
        _index(rows),
        _of_lenses(rows, FindingName.FOCAL_LENGTH, ("focal_length", _zoomed)),
        _of_lenses(rows, FindingName.FOCAL_LENGTH, ("aspect", _taller)),
        _of_lenses(rows, FindingName.DISTORTION, ("distortion", _stretched)),
        _of_lenses(rows, FindingName.DISTORTION, *_each_way("decentering", _decentred)),
        _pose(rows),
        _of_lenses(rows, FindingName.POSE, *_each_way("axis", _off_axis)),
        _source(rows),
        _curved(rows),
        _skewed(rows),
        _candidate(
            rows,
            FindingName.CALIBRATION,
            [("codes", (wave, nothing)) for wave in _uneven_codes(counted_ps).T],
        ),
    ]
    if any(camera.interfaces for camera in rows.cameras):
        found.append(_window(rows))
    if rows.state.corners_seen:
        found.append(_unseen(rows))
    # Of what a clock drifts over one recording, its mean time is half late.
    passed = (repeat + 0.5) / (repeat.max(initial=0.0) + 1.0)
    found.append(of_times(FindingName.CLOCK_DRIFT, passed))
    found.append(of_times(FindingName.TREND, *_waves(rows), symptom=True))
    return found


def drawn_curve_candidate(rows: Rows, curve_moves: Floats) -> Candidate | None:
    """Curves that were told and stand elsewhere: a shift and a turn of each, beyond their errors.

    Parameters
    ----------
    rows : Rows
        The model.
    curve_moves : array of float, shape (q, 6 k)
        Of the freedom's q priors, which follow the times and lines (`Freedom.curve_moves`).

    Returns
    -------
    Candidate or None
        None where no curve is told.
    """
    if not curve_moves.shape[1]:
        return None
    first = len(rows.times.leg) + len(rows.lines.leg)
    columns = np.zeros((rows.size, curve_moves.shape[1]))
    columns[first : first + len(curve_moves)] = curve_moves
    one = (PLAUSIBLE["drawn_curve"],) * 3 + (PLAUSIBLE["pose turn"],) * 3
    return Candidate(FindingName.DRAWN_CURVE, columns, one * (curve_moves.shape[1] // 6))


def told_candidate(rows: Rows, told: Sequence[ToldRow]) -> Candidate | None:
    """Waypoints and lengths that were told and are elsewhere, beyond their errors.

    Parameters
    ----------
    rows : Rows
        The model.
    told : sequence of ToldRow
        Which of the freedom's priors they are; these follow the times and lines.

    Returns
    -------
    Candidate or None
        None where nothing of the kind is told.
    """
    if not told:
        return None
    first, plausible = len(rows.times.leg) + len(rows.lines.leg), PLAUSIBLE["prior"]
    columns = np.zeros((rows.size, len(told)))
    for k, one in enumerate(told):
        columns[first + one.row, k] = plausible.size / one.std_mm

    def worst(sizes: Floats) -> str:
        """Which of them is farthest off."""
        k = int(np.argmax(np.abs(sizes)))
        return f"the told {told[k].words} is off by {sizes[k] * plausible.size:.2g} mm"

    return Candidate(FindingName.PRIOR, columns, (plausible,) * len(told), says=worst)


def _late_clocks(rows: Rows) -> Candidate:
    """The zero of all clocks, and of several cameras that of each further one against the first."""
    n, still = len(rows.times.leg), np.zeros(len(rows.lines.leg))
    parts = [("clock_offset", (np.ones(n), still))]
    for view in range(1, len(rows.cameras)):
        late = (rows.times.view == view).astype(float)
        parts.append(("clock_offset", (late, still)))
    candidate = _candidate(rows, FindingName.CLOCK_OFFSET, parts)
    return candidate if len(parts) == 1 else replace(candidate, says=_which_clock)


def _which_clock(sizes: Floats) -> str:
    """Of several cameras, whose clock is farthest off."""
    view, unit = int(np.argmax(np.abs(sizes))), PLAUSIBLE["clock_offset"]
    whose = f"clock of camera {view + 1}, against the first," if view else "clock offset"
    return f"{whose} off by {sizes[view] * unit.size:.2g} {unit.unit}"


def _brightness(photons: Floats) -> tuple[Floats, Floats]:
    """Share of the brightest pulse's light, and its log per decade: both ways delays may go."""
    share = np.maximum(photons, 1.0) / max(float(photons.max(initial=1.0)), 1.0)
    return share, np.log10(share)


def _candidate(
    rows: Rows, name: FindingName, parts: list[tuple[str, tuple[Floats, Floats]]]
) -> Candidate:
    sizes = tuple(PLAUSIBLE[kind] for kind, _ in parts)
    columns = [s.size * rows.whole(*change) for s, (_, change) in zip(sizes, parts, strict=True)]
    frees = _freed_by(parts[0][0].split()[0])
    return Candidate(name, np.column_stack(columns), sizes, frees=frees)


def _freed_by(kind: str) -> str:
    return kind if kind in FREE_NAMES else ""


def _index(rows: Rows) -> Candidate:
    """Group indices out and back; where a window bends the light, the scene's phase index too."""
    still = np.zeros(len(rows.lines.leg))
    ways = (rows.traced.out_mm, rows.traced.back_mm)
    parts = [("index", (way / SPEED_OF_LIGHT_MM_PER_PS, still)) for way in ways]
    for view, camera in enumerate(rows.cameras):
        if camera.interfaces:
            denser = phase_index_moved(camera, len(camera.interfaces) - 1, _STEP)
            by_time, by_line = rows.seen_by(view, denser)
            parts.append(("index", (by_time / _STEP, by_line / _STEP)))
    return _candidate(rows, FindingName.INDEX, parts)


_Lens = tuple[str, Callable[[Camera, float], Camera]]
"""A number of a lens by its plausible size's name, and the camera with it off by so much."""


def _of_lenses(rows: Rows, name: FindingName, *numbers: _Lens) -> Candidate:
    """A cause within the lenses, each by itself."""
    parts = []
    for view, camera in enumerate(rows.cameras):
        for kind, moved in numbers:
            step = _STEP * PLAUSIBLE[kind].size
            by_time, by_line = rows.seen_by(view, moved(camera, step))
            parts.append((kind, (by_time / step, by_line / step)))
    return _candidate(rows, name, parts)


def _each_way(kind: str, moved: Callable[[int, Camera, float], Camera]) -> list[_Lens]:
    """Both numbers of a lens that is off along the rows or along the columns."""
    return [(kind, partial(moved, way)) for way in (0, 1)]


def _window(rows: Rows) -> Candidate:
    """Each camera's first interface, with all behind it, farther away than told."""
    parts = []
    for view, camera in enumerate(rows.cameras):
        if camera.interfaces:
            step = _STEP * PLAUSIBLE["window"].size
            by_time, by_line = rows.seen_by(view, interface_moved(camera, 0, step))
            parts.append(("window", (by_time / step, by_line / step)))
    return _candidate(rows, FindingName.WINDOW, parts)


def _pose(rows: Rows) -> Candidate:
    """Each camera turned about its centre, and shifted: the path moves the other way for it."""
    parts = []
    for view, camera in enumerate(rows.cameras):
        own = rows.times.view == view, rows.lines.view == view
        away = rows.state.vertices_mm - camera.center_mm
        turns = [("pose turn", np.cross(away, axis)) for axis in np.eye(3)]
        for kind, moves in (*turns, *(("pose shift", -axis) for axis in np.eye(3))):
            by_time, by_line = rows.moved(moves)
            parts.append((kind, (own[0] * by_time, own[1] * by_line)))
    return _candidate(rows, FindingName.POSE, parts)


def _zoomed(camera: Camera, share: float) -> Camera:
    return camera.with_lens_moved(focal_share=share)


def _taller(camera: Camera, share: float) -> Camera:
    return camera.with_lens_moved(aspect=share)


def _off_axis(way: int, camera: Camera, px: float) -> Camera:
    return camera.with_lens_moved(axis_px=(px, 0.0) if way else (0.0, px))


def _stretched(camera: Camera, corner_px: float) -> Camera:
    return camera.with_lens_moved(radial=radial_of_corner(camera, corner_px))


def _decentred(way: int, camera: Camera, corner_px: float) -> Camera:
    by = decentering_of_corner(camera, corner_px)
    return camera.with_lens_moved(decentering=(0.0, by) if way else (by, 0.0))


def _source(rows: Rows) -> Candidate:
    m = len(rows.state.vertices_mm)
    parts = [("source", rows.moved(np.eye(m, 1) * axis)) for axis in np.eye(3)]
    return _candidate(rows, FindingName.SOURCE, parts)


def _skewed(rows: Rows) -> Candidate:
    """Delays that grow across each camera's picture, each of its own clock."""
    times, nothing = rows.times, np.zeros(len(rows.lines.leg))
    parts = []
    for view, camera in enumerate(rows.cameras):
        here = np.flatnonzero(times.view == view)
        row, col = times.row[here].astype(np.int64), times.col[here].astype(np.int64)
        for late in skewed_delays(camera.shape)[row, col].T:
            by_time = np.zeros(len(times.leg))
            by_time[here] = late
            parts.append(("calibration", (by_time, nothing)))
    return _candidate(rows, FindingName.CALIBRATION, parts)


def _uneven_codes(counted_ps: Floats) -> Floats:
    """Codes whose lengths change slowly over those that were counted (n,): waves (n, 4)."""
    told = counted_ps[np.isfinite(counted_ps)]
    low, high = told.min(initial=np.inf), told.max(initial=-np.inf)
    place = 2.0 * (counted_ps - low) / max(high - low, 1e-9) - 1.0
    waves = [legendre.Legendre.basis(k)(place) for k in range(2, 2 + _CODE_WAVES)]
    return np.column_stack(waves)


def _curved(rows: Rows) -> Candidate:
    """Each leg bowed in the picture and in depth: half a sine, with so large a sagitta."""
    f_time, f_line = rows.traced.fraction, rows.line_fractions()
    parts = []
    for leg in rows.state.seen:
        start, end = rows.state.starts_mm[leg], rows.state.vertices_mm[leg + 1]
        along = (end - start) / np.linalg.norm(end - start)
        away = rows.cameras[0].sight_directions(0.5 * (start + end))
        depth = away - (away @ along) * along
        depth = depth / max(float(np.linalg.norm(depth)), 1e-12)
        for direction in (np.cross(along, depth), depth):
            by_time, by_line = rows.moved(direction)
            parts.append(
                (
                    "curved_leg",
                    (
                        np.where(rows.times.leg == leg, np.sin(np.pi * f_time) * by_time, 0.0),
                        np.where(rows.lines.leg == leg, np.sin(np.pi * f_line) * by_line, 0.0),
                    ),
                )
            )
    return _candidate(rows, FindingName.CURVED_LEG, parts)


def _unseen(rows: Rows) -> Candidate:
    """At each corner, what follows starts elsewhere or later than the leg before ends."""
    by_shift = [rows.moved(np.eye(3)[axis]) for axis in range(3)]
    parts = []
    for corner in rows.state.corners_seen:
        late, drawn = rows.times.leg >= corner, rows.lines.leg >= corner
        for by_time, by_line in by_shift:
            parts.append(("unseen_leg", (by_time * late, by_line * drawn)))
        parts.append(("unseen_leg time", (late.astype(float), np.zeros(len(drawn)))))
    return _candidate(rows, FindingName.UNSEEN_LEG, parts)


def _waves(rows: Rows) -> list[Floats]:
    """Cosines along the seen part of each leg, of one period and more."""
    fraction = rows.traced.fraction
    found = []
    for leg in range(rows.state.n_legs):
        here = rows.times.leg == leg
        if np.count_nonzero(here) < 4 * _TREND_WAVES:
            continue
        low, high = fraction[here].min(), fraction[here].max()
        place = (fraction - low) / max(high - low, 1e-12)
        found += [np.where(here, np.cos(np.pi * (k + 2) * place), 0.0) for k in range(_TREND_WAVES)]
    return found or [np.zeros(len(fraction))]
