"""`joint`: every pulse, every line, every prior in one fit of the whole path.

Legs found in the picture give a start; then picture and path are refined in turn: the counts say
where each leg's line runs and how its light is weighted within a pixel, the arrival times say
how deep it lies. Wrong pulses are left out, and errors that the stated ones do not cover are
measured from the residuals and stated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.reconstruct.fit.active_area import areas_of_path, with_area_errors
from lightflight.reconstruct.fit.clocks import (
    clocks_as_shown,
    shared_as_stated,
    with_doubtful_clocks,
)
from lightflight.reconstruct.fit.ends import cut_tips, freedom_at, known_tips, with_ends
from lightflight.reconstruct.fit.least_squares import (
    OUTLIER,
    Solution,
    TimeData,
    fit_path,
    reweighted,
)
from lightflight.reconstruct.fit.membership import (
    Tips,
    assigned,
    mode_columns,
    stacked,
    stacked_lines,
    time_data,
    tips_in_view,
)
from lightflight.reconstruct.fit.pictures import as_shown, pictures_of
from lightflight.reconstruct.fit.uneven import uneven_light
from lightflight.reconstruct.legs.find import Images
from lightflight.reconstruct.model.freedom import Freedom, state_vector
from lightflight.reconstruct.model.geometry import Indices, PathState, footprints
from lightflight.reconstruct.model.light import Strengths
from lightflight.reconstruct.model.picture import (
    LineDataInPicture,
    Picture,
    footprint_corrections,
    lines_from_picture,
)
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import moved, shared_errors, undistorted_as_moved
from lightflight.reconstruct.model.sighting import Sighting, first_of_each_view
from lightflight.units import MEDIAN_CHI2, std_from_mad

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_PASSES = 4
"""Most rounds of picture and path; the second often agrees with the last to a tenth of an error."""
_STILL = 0.03
"""A round that moves nothing by more than this, in its own errors, was the last."""
_ROUGH_OUTLIER = 8.0
"""The same while the path is rough."""


@dataclass(frozen=True, eq=False)
class JointFit:
    """Everything the joint fit found.

    Attributes
    ----------
    solution : Solution
        Path, covariance and gains.
    freedom_basis : array of float, shape (3m + 1, p)
        What the covariance's first p rows move.
    labels : tuple of str
        (p,), in words.
    times : TimeData
        Pulses that took part, and outliers with weight 0.
    sighting_of : array of int, shape (n,)
        Which recording each pulse came from.
    lines : LineDataInPicture
        The lines the legs were held to.
    pictures : tuple of Picture
        Lines and brightness, one per recording.
    floor_ps : float
        Extra error per pulse that the residuals ask for, ps.
    tips : Tips
        Where the light begins and stops within the picture; pulses about these took no part.
    freedom : Freedom
        What the last fit could move, and the priors on it.
    sightings : tuple of Sighting
        The recordings whose pulses these are.
    strengths : tuple of Strengths
        Of diffuse light, by camera and clock; empty: the pulses are as they were found.
    active_px : mapping of int to float
        Side of the active area of cameras whose counts or path show one.
    """

    solution: Solution
    freedom_basis: Floats
    labels: tuple[str, ...]
    times: TimeData
    sighting_of: Indices
    lines: LineDataInPicture
    pictures: tuple[Picture, ...]
    floor_ps: float
    tips: Tips
    freedom: Freedom
    sightings: tuple[Sighting, ...]
    strengths: tuple[Strengths, ...] = ()
    active_px: Mapping[int, float] = field(default_factory=dict)


def pulse_std_ps(sightings: list[Sighting]) -> float:
    """Typical standard deviation of the usable pulses, ps.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.

    Returns
    -------
    float
        Median over the light of all usable pulses, ps: of a halo many dim pixels show wide ones.
    """
    usable = [o.arrivals.usable for o in sightings]
    pairs = list(zip(sightings, usable, strict=True))
    stds = np.concatenate([o.arrivals.std_ps[own] for o, own in pairs])
    photons = np.concatenate([o.arrivals.photons[own] for o, own in pairs])
    order = np.argsort(stds)
    if not len(order):
        return float("nan")
    light = np.cumsum(photons[order])
    return float(stds[order][np.searchsorted(light, 0.5 * light[-1])])


def pulse_std_in_view(sightings: list[Sighting], view: int) -> float:
    """The same of one camera's pulses, ps: light crosses another's pixels in another time."""
    return pulse_std_ps([one for one in sightings if one.view == view])


def fit_joint(
    sightings: list[Sighting],
    state: PathState,
    setting: Setting,
    *,
    legs: Sequence[Images] | None,
    shared: Floats | None = None,
) -> JointFit:
    """Refine a path that is roughly right.

    Parameters
    ----------
    state : PathState
        Start, from `start.state_from_legs` or the user.
    legs : sequence of tuple of ImageLeg, or None
        Of each leg that is seen, as found in the picture of each camera that shows it: they say
        which pulses belong to which leg while the start is still rough. None: the start itself says
        so.
    shared : array of float, shape (j,), optional
        Shared errors of cameras and medium that the start was found with, in standard deviations.

    Raises
    ------
    NothingFoundError
        Where fewer pulses lie on the path than it has unknowns.
    """
    std = pulse_std_ps(sightings)
    members = None
    # Shared errors found so far: pulses are told apart on the clock and by the camera as they are.
    seen = setting if shared is None else moved(setting, shared_errors(setting), shared)
    clock = sightings
    if legs is not None:
        rough = _rough_fit(sightings, state, with_doubtful_clocks(setting), legs)
        state, shared = rough.state, shared_as_stated(rough, setting)
        seen, clock = _as_found(rough, setting, sightings)
        members = _members_of_legs(legs, state, sightings)
    floor, result = 0.0, None
    cut: Tips = (None, None)
    for passed in range(_PASSES):
        seen = clocks_as_shown(state, clock, seen, std)
        state, ends = with_ends(state, clock, seen, std)
        tips = known_tips(cut, ends.tips)
        pictures = pictures_of(state, clock, seen, std_ps=std)
        parts = _pulses_of_legs(sightings, clock, state, seen, pictures, std, floor, members, tips)
        times = stacked(parts, mode_columns(sightings))
        lines = _told_lines(pictures, sightings, setting, seen)
        freedom = freedom_at(state, setting, ends)
        _check_enough(times, freedom.basis.shape[1])
        before = state
        solution, times, floor = _solve_robustly(state, times, lines, freedom, setting, shared)
        state, shared = solution.state, solution.shared
        seen, clock = _as_found(solution, setting, sightings)
        result = JointFit(
            solution=solution,
            freedom_basis=freedom.basis,
            labels=freedom.labels,
            times=times,
            sighting_of=np.repeat(np.arange(len(parts)), [len(p.leg) for p in parts]),
            lines=lines,
            pictures=pictures,
            floor_ps=floor,
            tips=tips,
            freedom=freedom,
            sightings=tuple(sightings),
        )
        told = sum(tip is not None for tip in cut)
        cut = known_tips(cut, cut_tips(solution, times, floor, setting))
        more = sum(tip is not None for tip in cut) > told
        # The first pass sorted the pulses by a rough path: it never is the last.
        if passed > 0 and not more and _settled(before, solution, freedom):
            break
    assert result is not None
    return result


def with_fine_light(fit: JointFit, setting: Setting) -> JointFit:
    """The fit with lines and times as the light is: spots that vary, unequal pixels, uneven light.

    Parameters
    ----------
    fit : JointFit
        Whose legs are to stay: which there are needs no such care, and could be hidden by it.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    JointFit
        Of the same pulses.
    """
    settled = fit
    while True:
        try:
            settled = _finely_solved(fit, setting)
        except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
            # The last step led a leg to the edge of what its pixels tell: as it was found, then.
            return settled
        areas = areas_of_path(settled, setting)
        if areas is None:
            return settled
        fit = replace(settled, active_px=areas)


def _finely_solved(fit: JointFit, setting: Setting) -> JointFit:
    shown = finely_lit(fit, list(fit.sightings), setting)
    times = replace(shown.times, weight=np.ones_like(shown.times.weight))
    solution, times, floor = _solve_robustly(
        fit.solution.state, times, shown.lines, fit.freedom, setting, fit.solution.shared
    )
    return replace(shown, solution=solution, times=times, floor_ps=floor)


def finely_lit(fit: JointFit, sightings: list[Sighting], setting: Setting) -> JointFit:
    """The fit with lines, and what light does to the times, measured finely; no path moves.

    Parameters
    ----------
    fit : JointFit
        Of the recordings as they were.
    sightings : list of Sighting
        Perhaps with light found that is no leg's.
    setting : Setting
        As told.

    Returns
    -------
    JointFit
        Of the same pulses, with other pictures and lines.

    Raises
    ------
    GeometryError, NothingFoundError
        Where a leg does not cross the picture, or has too few pixels.
    """
    seen, clock = _as_found(fit.solution, setting, list(fit.sightings))
    std = pulse_std_ps(sightings)
    as_found = [replace(o, found=same.found) for o, same in zip(sightings, clock, strict=True)]
    pictures = pictures_of(
        fit.solution.state, as_found, seen, std_ps=std, fine=True, active_px=fit.active_px
    )
    shown = replace(fit, pictures=pictures, lines=_told_lines(pictures, sightings, setting, seen))
    uneven = uneven_light(shown, sightings, setting)
    # What was known of uneven light before stands behind the errors of the clock.
    of_clock = fit.times.modes_ps[:, : _n_of_clock(fit)]
    times = replace(
        fit.times,
        footprint_ps=_feet(shown, seen) + uneven.late_ps,
        modes_ps=np.hstack((of_clock, uneven.columns_ps)),
    )
    return with_area_errors(replace(shown, times=times), setting)


def _n_of_clock(fit: JointFit) -> int:
    """How many of the pulses' shared errors are the clock's: the first."""
    return max((own.stop for own in mode_columns(list(fit.sightings)).values()), default=0)


def _feet(fit: JointFit, seen: Setting) -> Floats:
    """(n,), mean time over each pulse's footprint minus that at its foot as pictures say, ps."""
    feet, state = np.zeros(len(fit.times.leg)), fit.solution.state
    for number, (picture, sighting) in enumerate(zip(fit.pictures, fit.sightings, strict=True)):
        here = np.flatnonzero(fit.sighting_of == number)
        rows, cols = fit.times.row[here], fit.times.col[here]
        camera = seen.cameras[sighting.view]
        print_ = footprints(
            state, camera=camera, medium=seen.medium, legs=fit.times.leg[here], rows=rows, cols=cols
        )
        feet[here] = footprint_corrections(
            picture, print_, rows=rows, cols=cols, camera=camera, state=state, medium=seen.medium
        )
    return feet


def _told_lines(
    pictures: tuple[Picture, ...], sightings: list[Sighting], setting: Setting, seen: Setting
) -> LineDataInPicture:
    """Lines of all recordings in the pictures of the cameras as told."""
    return stacked_lines(
        [
            _as_told(lines_from_picture(p), setting.cameras[o.view], seen.cameras[o.view])
            for p, o in zip(pictures, sightings, strict=True)
        ],
        sightings,
    )


def fitted_again(fit: JointFit, sightings: list[Sighting], setting: Setting) -> JointFit:
    """The same pulses with other times, errors and modes: of these recordings, row by row.

    Parameters
    ----------
    fit : JointFit
        Of the recordings as they were.
    sightings : list of Sighting
        With rows of arrivals as before; those without a time take no part.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    JointFit
        With the same lines, and feet as before.

    Raises
    ------
    NothingFoundError
        Where too few pulses are left.
    """
    parts, kept = [], []
    for number, sighting in enumerate(sightings):
        here = np.flatnonzero(fit.sighting_of == number)
        here = here[np.isfinite(sighting.arrival_ps[fit.times.index[here]])]
        leg, feet = fit.times.leg[here], fit.times.footprint_ps[here]
        parts.append(time_data(sighting, fit.times.index[here], leg, feet))
        kept.append(here)
    times = stacked(parts, mode_columns(sightings))
    # Errors of uneven light stand behind those of the clock, and stay.
    uneven = fit.times.modes_ps[np.concatenate(kept), _n_of_clock(fit) :]
    times = replace(times, modes_ps=np.hstack((times.modes_ps, uneven)))
    _check_enough(times, fit.freedom.basis.shape[1])
    solution, times, floor = _solve_robustly(
        fit.solution.state, times, fit.lines, fit.freedom, setting, fit.solution.shared
    )
    return replace(
        fit,
        solution=solution,
        times=times,
        sighting_of=np.repeat(np.arange(len(parts)), [len(part.leg) for part in parts]),
        floor_ps=floor,
        sightings=tuple(sightings),
    )


def moved_stds(before: JointFit, after: JointFit) -> float:
    """Largest step from one path to another of the same freedom, in the second's errors."""
    return float(np.max(_step_stds(before.solution.state, after.solution, after.freedom)))


def _members_of_legs(
    legs: Sequence[Images], state: PathState, sightings: list[Sighting]
) -> dict[int, Indices]:
    """Leg of the path that each row of the arrivals belongs to, -1: none, by number of recording.

    Of the recordings that were searched: of repeats the first.
    """
    first = {o.view: number for number, o in reversed(list(enumerate(sightings)))}
    members: dict[int, Indices] = {}
    for k, images in zip(state.seen, legs, strict=True):
        for image in images:
            number = first[image.view]
            nobodys = np.full(len(sightings[number].arrivals.row), -1)
            members.setdefault(number, nobodys)[image.members] = k
    return members


def _pulses_of_legs(
    sightings: list[Sighting],
    clock: list[Sighting],
    state: PathState,
    seen: Setting,
    pictures: tuple[Picture, ...],
    std: float,
    floor: float,
    members: dict[int, Indices] | None,
    tips: Tips,
) -> list[TimeData]:
    """Pulses that belong to the path, one table per recording, on the clock as recorded.

    `seen` and `clock` are setting and recordings with the shared errors found so far taken off.
    """
    parts = [
        assigned(
            o,
            as_shown(state, picture),
            seen.at(o.view),
            picture,
            std,
            floor,
            None if members is None else members.get(number),
            tips_in_view(tips, state, seen, o.view),
        )
        for number, (o, picture) in enumerate(zip(clock, pictures, strict=True))
    ]
    # Told apart on the corrected clock, fitted on the recorded one: the fit finds the errors anew.
    return [
        replace(part, arrival_ps=o.arrival_ps[part.index])
        for part, o in zip(parts, sightings, strict=True)
    ]


def _settled(before: PathState, solution: Solution, freedom: Freedom) -> bool:
    """True where a pass moved the path by a small part of its errors: the next would not."""
    return bool(np.all(_step_stds(before, solution, freedom) < _STILL))


def _step_stds(before: PathState, solution: Solution, freedom: Freedom) -> Floats:
    """(p,), how far each freedom of the path moved, in its errors."""
    moved = state_vector(solution.state) - state_vector(before)
    # What moved outside the freedom (an end put back to the edge) is not counted.
    step = np.linalg.lstsq(freedom.basis, moved, rcond=None)[0]
    own = solution.covariance[: len(step), : len(step)]
    std = np.sqrt(np.maximum(np.diag(own), 1e-300))
    stds: Floats = np.abs(step) / std
    return stds


def _as_found(
    solution: Solution, setting: Setting, sightings: list[Sighting]
) -> tuple[Setting, list[Sighting]]:
    """Setting and recordings with the shared errors that a fit found taken off."""
    columns = mode_columns(sightings)
    modes = [solution.modes[columns[o.view]] for o in sightings]
    corrected = [
        replace(o, arrival_ps=o.arrival_ps - o.arrivals.shared_modes_ps @ own, found=own)
        for o, own in zip(sightings, modes, strict=True)
    ]
    found = replace(
        setting, camera=solution.camera, others=solution.cameras[1:], medium=solution.medium
    )
    return found, corrected


def _as_told(lines: LineDataInPicture, told: Camera, seen: Camera) -> LineDataInPicture:
    """Lines measured with the lens as found, in the picture of the lens as told."""
    return replace(lines, anchors=undistorted_as_moved(lines.anchors, seen, told))


def _rough_fit(
    sightings: list[Sighting],
    state: PathState,
    setting: Setting,
    legs: Sequence[Images],
) -> Solution:
    """One fit with the legs' own pulses and their lines as found, errors kept generous."""
    told, times_of, lines_of = [], [], []
    for first in first_of_each_view(sightings):
        own = [
            (k, image)
            for k, images in zip(state.seen, legs, strict=True)
            for image in images
            if image.view == first.view
        ]
        if not own:
            continue
        index = np.concatenate([image.members for _, image in own])
        leg_of = np.repeat([k for k, _ in own], [len(image.members) for _, image in own])
        told.append(first)
        times_of.append(time_data(first, index, leg_of, np.zeros(len(index))))
        anchors = np.concatenate([image.points_px(np.array(image.extent_px)) for _, image in own])
        # Lines as found in the picture hold to about a third of a pixel.
        stiff = np.eye(2 * len(own)) / 0.3
        lines_of.append(LineDataInPicture(np.repeat([k for k, _ in own], 2), anchors, stiff))
    times = stacked(times_of, mode_columns(sightings))
    lines = stacked_lines(lines_of, told)
    # 3 ps: the start's own errors exceed those of bright pulses by far.
    floor_var, shared = 3.0**2, None
    for _ in range(3):
        solution = fit_path(
            state,
            times,
            lines,
            freedom_at(state, setting),
            cameras=setting.cameras,
            medium=setting.medium,
            floor_var=floor_var,
            shared=shared,
        )
        state, shared = solution.state, solution.shared
        spread = std_from_mad(float(np.median(np.abs(solution.residual_ps))))
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
    shared: Floats | None,
) -> tuple[Solution, TimeData, float]:
    """Solve, drop outliers, and raise the floor until the residuals are explained.

    `shared` (k,) are the shared errors that the path was found with, in standard deviations.
    """
    floor_var = 0.0
    for _ in range(6):
        solution = fit_path(
            state,
            times,
            lines,
            freedom,
            cameras=setting.cameras,
            medium=setting.medium,
            floor_var=floor_var,
            shared=shared,
        )
        state, shared = solution.state, solution.shared
        updated_floor = floor_variance(times, solution, solution.residual_ps)
        cut_times = reweighted(times, solution, floor_var=updated_floor, cut=OUTLIER)
        same = np.array_equal(cut_times.weight, times.weight)
        # Two percent of a floor are nothing beside the error of the floor itself.
        settled = abs(updated_floor - floor_var) < 0.02 * (updated_floor + 1e-6)
        times, floor_var = cut_times, updated_floor
        if same and settled:
            break
    return solution, times, float(np.sqrt(floor_var))


def floor_variance(times: TimeData, solution: Solution, residual_ps: Floats) -> float:
    """Extra variance per pulse that makes the residuals as large as stated; 0 where they are.

    Judged by the median, which outliers do not reach, and only where chance is no excuse.

    Parameters
    ----------
    times : TimeData
        n pulses with their stated errors.
    solution : Solution
        The fit: how many numbers were fitted.
    residual_ps : array of float, shape (n,)
        What it left, ps.

    Returns
    -------
    float
        ps^2.
    """
    stated = times.photon_var + times.pixel_var
    squared = residual_ps**2
    n = len(squared)
    # Fitted numbers take their share of the residuals: the median falls by the same part.
    loss = max(0.2, 1.0 - (n - solution.dof) / max(n, 1))

    def excess(extra: float) -> float:
        return float(np.median(squared / (stated + extra))) / (MEDIAN_CHI2 * loss) - 1.0

    # The median of n chi-squares of one degree scatters by about 2.3 / sqrt(n).
    if excess(0.0) < 3.5 * 2.3 / np.sqrt(n):
        return 0.0
    low, high = 0.0, float(np.max(squared)) + 1.0
    # Bisection: excess falls steadily as the extra variance grows.
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high


def _check_enough(times: TimeData, n_unknowns: int) -> None:
    view = 0 if times.view is None else times.view
    # Pixels, not pulses: repeats of one pixel do not tell another direction.
    pixels = len(np.unique(times.row * 1e6 + times.col + 1e12 * view))
    if pixels < n_unknowns - 1 or pixels < 3:
        raise NothingFoundError(
            f"{pixels} usable pixels lie on the path, fewer than its {n_unknowns} unknowns: record "
            "longer, give the source's place and time, or give a smaller n_legs"
        )
