"""`joint`: every pulse, every line, every prior in one fit of the whole path.

Legs found in the picture give a start; then picture and path are refined in turn: the counts say
where each leg's line runs and how its light is weighted within a pixel, the arrival times say
how deep it lies. Wrong pulses are left out, and errors that the stated ones do not cover are
measured from the residuals and stated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import NothingFoundError
from lightflight.reconstruct.fit.clocks import (
    clocks_as_shown,
    shared_as_stated,
    with_doubtful_clocks,
)
from lightflight.reconstruct.fit.ends import cut_tips, freedom_at, known_tips, with_ends
from lightflight.reconstruct.fit.least_squares import Solution, TimeData, fit_path, reweighted
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
from lightflight.reconstruct.fit.robust import check_enough, solve_robustly
from lightflight.reconstruct.legs.find import Images
from lightflight.reconstruct.model.freedom import Freedom
from lightflight.reconstruct.model.geometry import Indices, PathState
from lightflight.reconstruct.model.light import Strengths
from lightflight.reconstruct.model.picture import (
    LineDataInPicture,
    Picture,
    lines_from_picture,
)
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import moved, shared_errors, undistorted_as_moved
from lightflight.reconstruct.model.sighting import Sighting, first_of_each_view
from lightflight.units import std_from_mad

Floats = NDArray[np.float64]

_FARTHEST_MM = 1e7
"""Ten kilometres: a flight so long is none that a picture shows, but a leg that runs off."""
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
        What the last fit could move (the covariance's first rows), and the priors on it.
    sightings : tuple of Sighting
        The recordings whose pulses these are.
    strengths : tuple of Strengths
        Of diffuse light, by camera and clock; empty: the pulses are as they were found.
    active_px : mapping of int to float
        Side of the active area of cameras whose counts or path show one.
    broad : tuple of (int, int)
        Camera and leg of which the last shared errors of `times` but those that lean and the
        areas' say what of their spot is the beam's.
    slanted : bool
        Whether spots may be no circles: how much times lean to the sides of legs is fitted.
    leaning : tuple of (int, int)
        Camera and leg of which the last shared errors of `times` but the areas' are that.
    n_shown : int or None
        Legs that the recording shows by itself, where the user told of more; None: as many.
    """

    solution: Solution
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
    broad: tuple[tuple[int, int], ...] = ()
    slanted: bool = False
    leaning: tuple[tuple[int, int], ...] = ()
    n_shown: int | None = None

    @property
    def leaning_modes(self) -> slice:
        """Which of the shared errors of the times are leaning times: those before the areas'."""
        last = self.times.modes_ps.shape[1] - len(self.active_px)
        return slice(last - len(self.leaning), last)

    @property
    def broad_modes(self) -> slice:
        """Which of them say what of the spots is the beams': those before the leaning times."""
        last = self.leaning_modes.start
        return slice(last - len(self.broad), last)

    @property
    def kinks_chi2(self) -> float:
        """What the counts say against the shape of each leg's image, chi-square."""
        return sum(line.bend_chi2 for picture in self.pictures for line in picture.fits)

    def late_ps(self, modes: slice) -> Floats:
        """(n,), by how much some of the shared errors make each pulse late, as solved, ps."""
        late: Floats = self.times.modes_ps[:, modes] @ self.solution.modes[modes]
        return late


def score_of_unfitted(
    fit: JointFit, by_time: Floats, by_line: Floats | None = None
) -> tuple[Floats, Floats]:
    """Score of errors that a fit has not, and its information: what it could move answers first.

    Parameters
    ----------
    fit : JointFit
        As solved.
    by_time : array of float, shape (n, k)
        One-sigma columns of its times, ps.
    by_line : array of float, shape (a, k), optional
        The same of its lines, px; None: these do not move.

    Returns
    -------
    score : array of float, shape (k,)
        Of each error, in its own standard deviations.
    information : array of float, shape (k, k)
        With their priors of one.
    """
    solution, n = fit.solution, len(by_time)
    columns = np.zeros((len(solution.rows), by_time.shape[1]))
    columns[:n] = by_time * np.sqrt(fit.times.weights(fit.floor_ps**2))[:, np.newaxis]
    if by_line is not None:
        columns[n : n + len(by_line)] = fit.lines.whitening @ by_line
    shared = solution.columns.T @ columns
    own = columns.T @ columns - shared.T @ solution.covariance @ shared
    return columns.T @ solution.rows, own + np.eye(len(own))


def pulses_of_legs(fit: JointFit) -> NDArray[np.intp]:
    """How many pulses speak for each leg.

    Parameters
    ----------
    fit : JointFit
        The joint fit.

    Returns
    -------
    array of int, shape (k,)
        Of each leg of the path that a picture may show.
    """
    held = fit.times.leg[fit.times.weight > 0]
    state = fit.solution.state
    return np.bincount(held, minlength=state.n_legs)[list(state.seen)]


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
        Where fewer pulses lie on the path than it has unknowns, or it runs out of all bounds.
    """
    std = pulse_std_ps(sightings)
    members = None
    # Shared errors found so far: pulses are told apart on the clock and by the camera as they are.
    seen = setting if shared is None else moved(setting, shared_errors(setting), shared)
    clock = sightings
    if legs is not None:
        rough = _rough_fit(sightings, state, with_doubtful_clocks(setting), legs)
        state, shared = rough.state, shared_as_stated(rough, setting)
        seen, clock = as_found(rough, setting, sightings)
        members = _members_of_legs(legs, state, sightings)
    floor, result = 0.0, None
    cut: Tips = (None, None)
    for passed in range(_PASSES):
        seen = clocks_as_shown(state, clock, seen, std)
        state, ends = with_ends(state, clock, seen, std)
        tips = known_tips(cut, ends.tips)
        pictures = pictures_of(state, clock, seen, std_ps=std)
        parts = _pulses_on_legs(sightings, clock, state, seen, pictures, std, floor, members, tips)
        times = stacked(parts, mode_columns(sightings))
        lines = told_lines(pictures, sightings, setting, seen)
        freedom = freedom_at(state, setting, ends)
        check_enough(times, freedom.n_unknown)
        before = state
        solution, times, floor = solve_robustly(state, times, lines, freedom, setting, shared)
        state, shared = solution.state, solution.shared
        seen, clock = as_found(solution, setting, sightings)
        result = JointFit(
            solution=solution,
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
    refuse_run_away(result.solution.state, result.solution.rows)
    return result


def refuse_run_away(state: PathState, rows: Floats | None = None) -> None:
    """Refuse a path that no bench holds, or of which a camera sees nothing where it should.

    Parameters
    ----------
    state : PathState
        As a fit ended.
    rows : array of float, optional
        Its residuals: NaN where a place that shows light has no picture, behind the camera.

    Raises
    ------
    NothingFoundError
        Where the counts held it by nothing.
    """
    if not np.ptp(state.vertices_mm, axis=0).max() <= _FARTHEST_MM:
        raise NothingFoundError(
            "the fit runs out of all bounds, so these pulses are no light of one straight flight: "
            "look at the picture (lightflight check) or give a starting path (start=)"
        )
    if rows is not None and not np.isfinite(rows).all():
        raise NothingFoundError(
            "the fit runs behind the camera, where none of this light can be: look at the picture "
            "(lightflight check) or give a starting path (start=)"
        )


def told_lines(
    pictures: tuple[Picture, ...], sightings: list[Sighting], setting: Setting, seen: Setting
) -> LineDataInPicture:
    """Lines of all recordings in the pictures of the cameras as told.

    Parameters
    ----------
    pictures : tuple of Picture
        One per recording.
    sightings : list of Sighting
        The recordings.
    setting, seen : Setting
        As told, and as it was when the pictures were measured.

    Returns
    -------
    LineDataInPicture
    """
    parts = []
    for picture, sighting in zip(pictures, sightings, strict=True):
        told, there = (one.cameras[sighting.view] for one in (setting, seen))
        lines = lines_from_picture(picture, sighting.view)
        parts.append(replace(lines, anchors=undistorted_as_moved(lines.anchors, there, told)))
    return stacked_lines(parts)


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


def _pulses_on_legs(
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
    moved = solution.state.vector - before.vector
    # What moved outside the freedom (an end put back to the edge) is not counted.
    step = np.linalg.lstsq(freedom.basis, moved, rcond=None)[0]
    own = solution.covariance[: len(step), : len(step)]
    std = np.sqrt(np.maximum(np.diag(own), 1e-300))
    stds: Floats = np.abs(step) / std
    return stds


def as_found(
    solution: Solution, setting: Setting, sightings: list[Sighting]
) -> tuple[Setting, list[Sighting]]:
    """Setting and recordings with the shared errors that a fit found taken off.

    Parameters
    ----------
    solution : Solution
        What the fit found.
    setting : Setting
        As told.
    sightings : list of Sighting
        On the clock as told.

    Returns
    -------
    setting : Setting
    sightings : list of Sighting
    """
    columns = mode_columns(sightings)
    modes = [solution.modes[columns[o.view]] for o in sightings]
    corrected = [
        replace(o, arrival_ps=o.arrival_ps - o.arrivals.shared_modes_ps @ own, found=own)
        for o, own in zip(sightings, modes, strict=True)
    ]
    found = replace(
        setting, camera=solution.cameras[0], others=solution.cameras[1:], medium=solution.medium
    )
    return found, corrected


def _rough_fit(
    sightings: list[Sighting],
    state: PathState,
    setting: Setting,
    legs: Sequence[Images],
) -> Solution:
    """One fit with the legs' own pulses and their lines as found, errors kept generous."""
    times_of, lines_of = [], []
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
        times_of.append(time_data(first, index, leg_of, np.zeros(len(index))))
        anchors = np.concatenate([image.points_px(np.array(image.extent_px)) for _, image in own])
        # Lines as found in the picture hold to about a third of a pixel.
        stiff = np.eye(2 * len(own)) / 0.3
        ends_of, views = np.repeat([k for k, _ in own], 2), np.full(2 * len(own), first.view)
        lines_of.append(LineDataInPicture(ends_of, anchors, stiff, views))
    times = stacked(times_of, mode_columns(sightings))
    lines = stacked_lines(lines_of)
    # 3 ps: the start's own errors exceed those of bright pulses by far.
    floor_var, shared = 3.0**2, None
    for _ in range(3):
        solution = fit_path(
            state,
            times,
            lines,
            freedom_at(state, setting),
            setting,
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
