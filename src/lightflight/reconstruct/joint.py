"""`joint`: every pulse, every line, every prior in one fit of the whole path.

Legs found in the picture give a start; then picture and path are refined in turn: the counts say
where each leg's line runs and how its light is weighted within a pixel, the arrival times say
how deep it lies. Wrong pulses are left out, and errors that the stated ones do not cover are
measured from the residuals and stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from lightflight import flags
from lightflight.errors import NothingFoundError
from lightflight.reconstruct.assignment import (
    Tips,
    assigned,
    mode_columns,
    prints_of_leg,
    stacked,
    stacked_lines,
    time_data,
)
from lightflight.reconstruct.freedom import (
    Freedom,
    ViewEnd,
    end_in_picture,
    freedom_of_path,
    view_end,
    with_tip,
)
from lightflight.reconstruct.geometry import Indices, PathState, footprints
from lightflight.reconstruct.least_squares import (
    LineDataInPicture,
    Solution,
    TimeData,
    reweighted,
    solve,
)
from lightflight.reconstruct.legs import ImageLeg
from lightflight.reconstruct.observation import Observation
from lightflight.reconstruct.picture import (
    Picture,
    lines_from_picture,
    measure_picture,
)
from lightflight.reconstruct.setting import Setting
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera import Camera

Floats = NDArray[np.float64]

_PASSES = 4
"""Most rounds of picture and path; the second often agrees with the last to a tenth of an error."""
_STILL = 0.03
"""A round that moves nothing by more than this, in its own errors, was the last."""
_DARK_PX = 1.2
"""Light whose last pixel is farther than this from the picture's edge ends in the picture, px."""
_LIT_SHARE = 0.6
"""Where a leg's light falls below this share of what it was, the leg has ended."""
_WING_PX = 3.0
"""The spot's wing beyond a tip is no longer than this, px."""
_USUAL_SPOT_PX = 0.4
"""Std of a usual spot, px, to compare pixels on a leg's line with pixels beside it."""
_OUTER_PX = 1.6
"""Pulses this near to the outermost of an end are judged together, px."""
_FEW_INNER = 6
"""An end is judged only by a path that rests on at least so many other pulses of its leg."""
_FALSE_CUT = 1e-4
"""Chance that an end which is whole is taken for cut."""
_OUTLIER = 5.0
"""A pulse this many standard errors from the path takes no part."""
_ROUGH_OUTLIER = 8.0
"""The same while the path is rough."""


@dataclass(frozen=True, eq=False)
class Ends:
    """Planes in which the visible ends of a path move."""

    start_basis: Floats
    """(3, 2), at the entry into view (used where the source is unknown)."""
    end_basis: Floats
    """(3, 2), at the exit from view."""
    tips: Tips = (None, None)
    """Where the light begins and stops within the picture; None: it crosses the edge."""


@dataclass(frozen=True, eq=False)
class JointFit:
    """Everything the joint fit found."""

    solution: Solution
    """Path, covariance and gains."""
    freedom_basis: Floats
    """(3m + 1, p), what the covariance's first p rows move."""
    labels: tuple[str, ...]
    """(p,), in words."""
    times: TimeData
    """Pulses that took part, and outliers with weight 0."""
    observation_of: Indices
    """(n,), which recording each pulse came from."""
    lines: LineDataInPicture
    """The lines the legs were held to."""
    pictures: tuple[Picture, ...]
    """Lines and brightness, one per recording."""
    floor_ps: float
    """Extra error per pulse that the residuals ask for, ps."""
    tips: Tips
    """Where the light begins and stops within the picture; pulses about these took no part."""


def pulse_std_ps(observations: list[Observation]) -> float:
    """Typical standard deviation of the usable pulses, ps."""
    stds = [o.arrivals.std_ps[flags.is_usable(o.arrivals.flags)] for o in observations]
    return float(np.median(np.concatenate(stds)))


def fit_joint(
    observations: list[Observation],
    state: PathState,
    setting: Setting,
    *,
    legs: tuple[ImageLeg, ...] | None,
) -> JointFit:
    """Refine a path that is roughly right.

    Parameters
    ----------
    state : start, from `start.state_from_legs` or the user.
    legs : legs of the first recording as found in the picture; they say which pulses belong to
        which leg while the start is still rough. None: the start itself says so.

    Raises
    ------
    NothingFoundError
        Where fewer pulses lie on the path than it has unknowns.
    """
    std = pulse_std_ps(observations)
    members = None
    # Shared errors found so far: pulses are told apart on the clock and by the camera as they are.
    seen, clock = setting, observations
    if legs is not None:
        rough = _rough_fit(observations, state, setting, legs)
        state = rough.state
        seen, clock = _as_found(rough, setting, observations)
        members = np.full(len(observations[0].arrivals.row), -1)
        for k, leg in enumerate(legs):
            members[leg.members] = k
    floor, result = 0.0, None
    cut: Tips = (None, None)
    for passed in range(_PASSES):
        state, ends = with_ends(state, clock, seen, std)
        tips = known_tips(cut, ends.tips)
        pictures = tuple(
            measure_picture(
                state, o, camera=seen.cameras[o.view], medium=setting.medium, std_ps=std
            )
            for o in observations
        )
        parts = [
            assigned(
                o,
                state,
                seen.at(o.view),
                picture,
                std,
                floor,
                members if not number else None,
                tips if o.view == 0 else (None, None),
            )
            for number, (o, picture) in enumerate(zip(clock, pictures, strict=True))
        ]
        parts = [
            replace(part, arrival_ps=o.arrival_ps[part.index])
            for part, o in zip(parts, observations, strict=True)
        ]
        times = stacked(parts, mode_columns(observations))
        lines = stacked_lines([lines_from_picture(p) for p in pictures], observations)
        freedom = freedom_at(state, setting, ends)
        _check_enough(times, freedom.basis.shape[1])
        before = state
        solution, times, floor = _solve_robustly(state, times, lines, freedom, setting)
        state = solution.state
        seen, clock = _as_found(solution, setting, observations)
        result = JointFit(
            solution=solution,
            freedom_basis=freedom.basis,
            labels=freedom.labels,
            times=times,
            observation_of=np.repeat(np.arange(len(parts)), [len(p.leg) for p in parts]),
            lines=lines,
            pictures=pictures,
            floor_ps=floor,
            tips=tips,
        )
        told = sum(tip is not None for tip in cut)
        cut = known_tips(cut, cut_tips(solution, times, floor, setting))
        more = sum(tip is not None for tip in cut) > told
        if passed > 0 and not more and _settled(before, solution, freedom):
            break
    assert result is not None
    return result


def known_tips(one: Tips, other: Tips) -> Tips:
    """Tips of `one`, and of `other` where that knows none."""
    first, last = (a if a is not None else b for a, b in zip(one, other, strict=True))
    return first, last


def cut_tips(solution: Solution, times: TimeData, floor_ps: float, setting: Setting) -> Tips:
    """Ends of the path whose outermost pulses disagree with it, as cut footprints do.

    Where light stops within a pixel's footprint, near the picture's edge or in it, the pixel's
    time is that of the lit part: by the leg's slope earlier, or later, than the whole one's.
    """
    if floor_ps > 0.0:  # errors that do not explain the middle of a leg cannot judge its ends
        return None, None
    state = solution.state
    variance = times.photon_var + times.pixel_var
    pulls = np.minimum(solution.residual_ps**2 / variance, _OUTLIER**2)
    found: list[Floats | None] = [None, None]
    for end, leg, sign in ((0, 0, -1.0), (1, state.n_legs - 1, 1.0)):
        if end == 0 and setting.source.position_mm is not None:
            continue
        own = times.leg == leg if times.view is None else (times.leg == leg) & (times.view == 0)
        here = np.flatnonzero(own)
        print_ = footprints(
            state,
            camera=solution.camera,
            medium=setting.medium,
            legs=np.full(len(here), leg),
            rows=times.row[here],
            cols=times.col[here],
        )
        outwards = sign * print_.fraction * print_.px_per_leg
        outer = outwards > outwards.max(initial=-np.inf) - _OUTER_PX
        if not outer.any() or np.count_nonzero(~outer) < _FEW_INNER:
            continue
        if pulls[here][outer].sum() > chdtri(np.count_nonzero(outer), _FALSE_CUT):
            outermost = here[int(np.argmax(outwards))]
            found[end] = np.array([times.row[outermost], times.col[outermost]])
    return found[0], found[1]


def _settled(before: PathState, solution: Solution, freedom: Freedom) -> bool:
    """True where a pass moved the path by a small part of its errors: the next would not."""
    moved = np.append(
        (solution.state.vertices_mm - before.vertices_mm).ravel(),
        solution.state.start_time_ps - before.start_time_ps,
    )
    step = np.linalg.lstsq(freedom.basis, moved, rcond=None)[0]
    own = solution.covariance[: len(step), : len(step)]
    std = np.sqrt(np.maximum(np.diag(own), 1e-300))
    return bool(np.all(np.abs(step) < _STILL * std))


def _as_found(
    solution: Solution, setting: Setting, observations: list[Observation]
) -> tuple[Setting, list[Observation]]:
    """Setting and recordings with the shared errors that a fit found taken off."""
    columns = mode_columns(observations)
    corrected = [
        replace(
            o,
            arrival_ps=o.arrival_ps - o.arrivals.shared_modes_ps @ solution.modes[columns[o.view]],
        )
        for o in observations
    ]
    return replace(setting, camera=solution.camera, others=solution.cameras[1:]), corrected


def freedom_at(
    state: PathState, setting: Setting, ends: Ends | None = None, *, tips_move: bool = False
) -> Freedom:
    """Freedom of a path in a setting; `ends` None: its ends move across their own legs.

    `tips_move`: an end where the light begins or stops in the picture moves along its leg too.
    """
    camera, vertices = setting.camera, state.vertices_mm
    if ends is None:
        ends = Ends(
            _view_plane(camera, vertices[0], vertices[1]),
            _view_plane(camera, vertices[-1], vertices[-2]),
        )
    first, last = ends.tips if tips_move else (None, None)
    start, end = ends.start_basis, ends.end_basis
    if first is not None:
        start = with_tip(start, vertices[0], vertices[1] - vertices[0], camera)
    if last is not None:
        end = with_tip(end, vertices[-1], vertices[-1] - vertices[-2], camera)
    return freedom_of_path(
        state,
        source=setting.source,
        waypoints=setting.waypoints,
        start_basis=start if setting.source.position_mm is None else None,
        end_basis=end,
    )


def _view_plane(camera: Camera, at: Floats, towards: Floats) -> Floats:
    """Plane through the camera in which a visible end moves: its ray, and across the leg."""
    ray = at - camera.center_mm
    ray = ray / np.linalg.norm(ray)
    across = np.cross(ray, towards - at)
    return np.column_stack((ray, across / np.linalg.norm(across)))


def _rough_fit(
    observations: list[Observation],
    state: PathState,
    setting: Setting,
    legs: tuple[ImageLeg, ...],
) -> Solution:
    """One fit with the legs' own pulses and their lines as found, errors kept generous."""
    first = observations[0]
    index = np.concatenate([leg.members for leg in legs])
    leg_of = np.repeat(np.arange(len(legs)), [len(leg.members) for leg in legs])
    times = time_data(first, index, leg_of, np.zeros(len(index)))
    times = stacked([times], mode_columns(observations))
    anchors = np.concatenate([leg.points_px(np.array(leg.extent_px)) for leg in legs])
    lines = LineDataInPicture(
        np.repeat(np.arange(len(legs)), 2), anchors, np.eye(2 * len(legs)) / 0.3
    )
    floor_var = 3.0**2
    for _ in range(3):
        solution = solve(
            state,
            times,
            lines,
            freedom_at(state, setting),
            cameras=setting.cameras,
            medium=setting.medium,
            floor_var=floor_var,
        )
        state = solution.state
        spread = 1.4826 * float(np.median(np.abs(solution.residual_ps)))
        before, floor_before = times, floor_var
        floor_var = max(floor_var, spread**2)
        times = reweighted(times, solution, floor_var=floor_var, cut=_ROUGH_OUTLIER)
        if floor_var == floor_before and np.array_equal(times.weight, before.weight):
            break
    return solution


def _solve_robustly(
    state: PathState,
    times: TimeData,
    lines: LineDataInPicture,
    freedom: Freedom,
    setting: Setting,
) -> tuple[Solution, TimeData, float]:
    """Solve, drop outliers, and raise the floor until the residuals are explained."""
    floor_var = 0.0
    for _ in range(6):
        solution = solve(
            state,
            times,
            lines,
            freedom,
            cameras=setting.cameras,
            medium=setting.medium,
            floor_var=floor_var,
        )
        state = solution.state
        updated_floor = _floor_variance(times, solution)
        cut_times = reweighted(times, solution, floor_var=updated_floor, cut=_OUTLIER)
        same = np.array_equal(cut_times.weight, times.weight)
        settled = abs(updated_floor - floor_var) < 0.02 * (updated_floor + 1e-6)
        times, floor_var = cut_times, updated_floor
        if same and settled:
            break
    return solution, times, float(np.sqrt(floor_var))


def _floor_variance(times: TimeData, solution: Solution) -> float:
    """Extra variance per pulse that makes the residuals as large as stated; 0 where they are.

    Judged by the median, which outliers do not reach, and only where chance is no excuse.
    """
    stated = times.photon_var + times.pixel_var
    squared = solution.residual_ps**2
    n = len(squared)
    loss = max(0.2, 1.0 - (n - solution.dof) / max(n, 1))

    def excess(extra: float) -> float:
        return float(np.median(squared / (stated + extra))) / (0.4549 * loss) - 1.0

    # The median of n chi-squares of one degree scatters by about 2.3 / sqrt(n).
    if excess(0.0) < 3.5 * 2.3 / np.sqrt(n):
        return 0.0
    low, high = 0.0, float(np.max(squared)) + 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high


def _check_enough(times: TimeData, n_unknowns: int) -> None:
    view = 0 if times.view is None else times.view
    pixels = len(np.unique(times.row * 1e6 + times.col + 1e12 * view))
    if pixels < n_unknowns - 1 or pixels < 3:
        raise NothingFoundError(
            f"{pixels} usable pixels lie on the path, fewer than its {n_unknowns} unknowns: record "
            "longer, give the source's place and time, or give a smaller n_legs"
        )


def with_ends(
    state: PathState, observations: list[Observation], setting: Setting, std: float
) -> tuple[PathState, Ends]:
    """The state with its last vertex (unknown source: and its first) where it leaves the view."""
    vertices, start_time = state.vertices_mm.copy(), state.start_time_ps
    end, last_tip = _visible_end(state, state.n_legs - 1, observations, setting, std, outwards=1.0)
    if end is not None:
        vertices[-1] = end.position_mm
    entry = None
    if setting.source.position_mm is None:
        entry, first_tip = _visible_end(state, 0, observations, setting, std, outwards=-1.0)
        if entry is not None:
            direction = vertices[1] - vertices[0]
            length = float(np.linalg.norm(direction))
            moved = float((entry.position_mm - vertices[0]) @ direction) / length
            vertices[0] = entry.position_mm
            start_time += moved * setting.medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS
    else:
        seen = bool(setting.camera.sees(vertices[0]))
        first_tip = np.array(setting.camera.pixels_from_points(vertices[0])) if seen else None
    ends = Ends(
        _view_plane(setting.camera, vertices[0], vertices[1]) if entry is None else entry.basis,
        _view_plane(setting.camera, vertices[-1], vertices[-2]) if end is None else end.basis,
        (first_tip, last_tip),
    )
    return PathState(vertices, float(start_time)), ends


def _visible_end(
    state: PathState,
    leg: int,
    observations: list[Observation],
    setting: Setting,
    std: float,
    *,
    outwards: float,
) -> tuple[ViewEnd | None, Floats | None]:
    """Where a leg leaves the picture, or where its light stops within it; and the light's tip.

    The tip is None where the light reaches the edge, or is too dim to tell.
    """
    camera = setting.camera
    start, stop = state.vertices_mm[leg], state.vertices_mm[leg + 1]
    direction = (stop - start) / np.linalg.norm(stop - start)
    own = [o for o in observations if o.view == 0]
    seen = [_footprints_of_pulses(o, state, setting, leg, std) for o in own]
    fraction, photons, strength = (np.concatenate(column) for column in zip(*seen, strict=True))
    if not len(fraction):
        return None, None
    extreme = _last_lit(start, stop, fraction, strength, outwards, camera)
    inside = start + fraction[extreme] * (stop - start)
    if not bool(camera.sees(inside)):
        inside = start + np.median(fraction) * (stop - start)
    edge = view_end(camera, inside, outwards * direction)
    places = np.column_stack(
        camera.pixels_from_points(start + fraction[:, np.newaxis] * (stop - start))
    )
    tip = places[extreme]
    dark = all(_recorded_beyond(o, state, setting, leg, tip, std, outwards) for o in own)
    away = np.hypot(*(places - tip).T)
    sharp = np.median(photons[away < 4.0]) > 50.0 and len(np.unique(np.rint(away[away < 6.0]))) >= 5
    if edge is not None:
        gap = float(np.hypot(*(np.array(camera.pixels_from_points(edge.position_mm)) - tip)))
        if gap < 4.0 or not sharp:
            return edge, tip if dark and sharp and gap > _DARK_PX else None
    inner = places[np.argmin(outwards * fraction)]
    along = (tip - inner) / max(float(np.hypot(*(tip - inner))), 1e-9)
    return end_in_picture(
        camera, inside, (float(-along[1]), float(along[0]))
    ), tip if dark else None


def _recorded_beyond(
    observation: Observation,
    state: PathState,
    setting: Setting,
    leg: int,
    tip: Floats,
    std: float,
    outwards: float,
) -> bool:
    """True where light beyond a tip would be in the recording; else its codes end there."""
    beyond = footprints(
        state,
        camera=setting.camera,
        medium=setting.medium,
        legs=np.array([leg]),
        rows=tip[:1],
        cols=tip[1:],
    )
    row, col = np.clip(np.rint(tip).astype(int), 0, np.array(setting.camera.shape) - 1).tolist()
    lower, upper = observation.timing.code_intervals_ps([row], [col])
    period_ps = observation.histograms.laser_period_ps
    if period_ps is not None and (upper - lower).sum() > 0.98 * period_ps:
        return True
    first, last = float(lower.min()), float(upper.max())
    delay = float(beyond.arrival_ps[0] + outwards * _WING_PX * beyond.slope_ps_per_px[0])
    delay += float(observation.timing.skew_ps[row, col])
    if period_ps is not None:
        delay = first + (delay - first) % period_ps
    return first + 3.0 * std < delay < last - 3.0 * std


def _last_lit(
    start: Floats,
    stop: Floats,
    fraction: Floats,
    strength: Floats,
    outwards: float,
    camera: Camera,
) -> int:
    """The outermost pulse where the leg is as bright as before; beyond is the spot's wing alone."""
    places = np.column_stack(
        camera.pixels_from_points(start + fraction[:, np.newaxis] * (stop - start))
    )
    order = np.argsort(-outwards * fraction)
    away = np.hypot(*(places - places[order[0]]).T)
    for this in order:
        near = np.abs(away - away[this]) < 0.5
        inner = (away > away[this] + 1.0) & (away < away[this] + 5.0)
        if away[this] > _WING_PX or np.count_nonzero(inner) < 3:
            break
        if strength[near].max() > _LIT_SHARE * np.median(strength[inner]):
            return int(this)
    return int(order[0])


def _footprints_of_pulses(
    observation: Observation, state: PathState, setting: Setting, leg: int, std: float
) -> tuple[Floats, Floats, Floats]:
    """(fraction along the leg, photons, those there would be on its line) of the leg's pulses.

    Pulses that agree with the leg in place and time; the spot is taken for a usual one.
    """
    usable = np.flatnonzero(
        flags.is_usable(observation.arrivals.flags) & np.isfinite(observation.arrival_ps)
    )
    print_ = prints_of_leg(observation, state, setting, usable, leg)
    gap = np.abs(observation.arrival_ps[usable] - print_.arrival_ps)
    lit = (np.abs(print_.lateral_px) < 1.5) & (gap < std)
    low = -0.02 if leg > 0 else -np.inf
    high = 1.02 if leg < state.n_legs - 1 else np.inf
    lit &= (print_.fraction > low) & (print_.fraction < high)
    photons = observation.arrivals.photons[usable][lit]
    on_line = photons * np.exp(0.5 * (print_.lateral_px[lit] / _USUAL_SPOT_PX) ** 2)
    return print_.fraction[lit], photons, on_line
