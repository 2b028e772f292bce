"""`joint`: every pulse, every line, every prior in one fit of the whole path.

Legs found in the picture give a start; then picture and path are refined in turn: the counts say
where each leg's line runs and how its light is weighted within a pixel, the arrival times say
how deep it lies. Wrong pulses are left out, and errors that the stated ones do not cover are
measured from the residuals and stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight.errors import NothingFoundError
from lightflight.reconstruct.assignment import (
    Tips,
    assigned,
    mode_columns,
    stacked,
    stacked_lines,
    time_data,
)
from lightflight.reconstruct.ends import cut_tips, freedom_at, known_tips, with_ends
from lightflight.reconstruct.freedom import Freedom
from lightflight.reconstruct.geometry import Indices, PathState
from lightflight.reconstruct.least_squares import (
    OUTLIER,
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

Floats = NDArray[np.float64]

_PASSES = 4
"""Most rounds of picture and path; the second often agrees with the last to a tenth of an error."""
_STILL = 0.03
"""A round that moves nothing by more than this, in its own errors, was the last."""
_ROUGH_OUTLIER = 8.0
"""The same while the path is rough."""


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
        cut_times = reweighted(times, solution, floor_var=updated_floor, cut=OUTLIER)
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
