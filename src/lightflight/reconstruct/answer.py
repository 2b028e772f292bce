"""The path that is told of a recording: an estimator's, or another where tests contradict it."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from lightflight.errors import GeometryError, NothingFoundError, SuspectDataWarning
from lightflight.path.glass import refuse_other_crossings
from lightflight.path.light_path import LightPath
from lightflight.path.tables import Explained
from lightflight.path.verdict import (
    NOT_EXAMINED,
    FindingName,
    Level,
    Severity,
    Verdict,
    warning_of,
)
from lightflight.reconstruct.estimators import Estimator, estimator_named
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.result import explained, mirror_of_fit, on_first_lap
from lightflight.reconstruct.fit.short_pieces import without_short_pieces
from lightflight.reconstruct.legs.direction import legs_in_all_pictures
from lightflight.reconstruct.legs.plausible import OtherUnitsError
from lightflight.reconstruct.model.geometry import state_of_path
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.other_light.diffuse import with_diffuse
from lightflight.reconstruct.trials.outcome import NoFit, fit_or_reason
from lightflight.reconstruct.trials.revise import fit_without_dim_legs
from lightflight.reconstruct.verdict.alternatives import Other, others_beside, with_others
from lightflight.reconstruct.verdict.arms import leaves_light, take_up_most, with_arms
from lightflight.reconstruct.verdict.bent import (
    asks_for_bends,
    bent_instead,
    bent_to_lengths,
    costs_less,
)
from lightflight.reconstruct.verdict.detours import (
    detour_instead,
    has_weak_leg,
    without_light_unseen,
)
from lightflight.reconstruct.verdict.examine import examined
from lightflight.reconstruct.verdict.going_on import path_going_on
from lightflight.reconstruct.verdict.judge import leaves_misfit, names_symptom
from lightflight.reconstruct.ways.joint import fit_of_request, fits_begun_by_one_camera
from lightflight.reconstruct.ways.request import Request

if TYPE_CHECKING:
    from lightflight.timing.clock.code_clock import CodeClock

_IN_LINE_DEG = 5.0
"""A corner that turns light by less may be a leg that was parted in two; the one that was, by 1."""


def path_from_sightings(
    sightings: list[Sighting],
    setting: Setting,
    *,
    timing: CodeClock | None,
    method: str = "joint",
    n_legs: int | None = None,
    start: LightPath | ArrayLike | None = None,
    may_bend: bool = False,
) -> LightPath:
    """Path from recordings whose pulses are found; parameters and errors as in `reconstruct`.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    setting : Setting
        Camera, source, medium and waypoints.
    timing : TimingCalibration or None
        Its calibrated clock; None: nominal codes.
    method : str, optional
        An estimator's name.
    n_legs : int, optional
        How many legs there are, where the user knows it; None: as many as the data show.
    start : LightPath or array_like, optional
        A path or its vertices in mm to start from, instead of the search for legs.
    may_bend : bool, optional
        Whether legs may be curves, and all else is as it was told.

    Returns
    -------
    LightPath
        Told in the first lap of the clock, unless the start or the source says which.

    Notes
    -----
    As `reconstruct`, whose errors it raises; for pulses that were found elsewhere.
    """
    request = Request(sightings, setting, timing, n_legs, start, may_bend)
    estimator = estimator_named(method)
    if setting.medium.blocks:
        return _through_blocks(request, estimator)
    if setting.curves:
        return _along_curves(request, estimator)
    if setting.lengths and may_bend and not _starts_bent(request):
        return _of_told_length(request, estimator)
    try:
        found, fit = _found_first(request, estimator)
    except OtherUnitsError:
        raise
    except (GeometryError, NothingFoundError):
        detour, _ = _detour(None, request, estimator)
        if detour is not None:
            return warned(detour[0])
        forked = _forked(None, request, estimator)
        if forked is None:
            raise
        return warned(forked)
    if found.forks and request.start is None:
        return warned(found)
    found = _reconsidered(found, fit, request, estimator)
    found = _begun_by_one_camera(found, request, estimator)
    return warned(_with_a_leg_less(found, request, estimator))


def _found_first(request: Request, estimator: Estimator) -> tuple[LightPath, JointFit | None]:
    """The path and the fit it rests on: with arms that take up most, where tests let them stand."""
    # On a nominal clock all times scatter, which no arm takes up, and each trial takes long.
    measured = request.timing is not None
    if measured and request.n_legs is None and _may_fork(request, estimator):
        path, fit = estimator.fit(replace(request, arms_first=True))
        found = _judged(path, fit, request, estimator)
        if not found.forks or does_stand(found):
            return found, fit
    path, fit = estimator.fit(request)
    return _judged(path, fit, request, estimator), fit


def _begun_by_one_camera(found: LightPath, request: Request, estimator: Estimator) -> LightPath:
    """The path, or where several cameras contradict it one that begins with what one shows."""
    fixed = request.start is not None or estimator.of_fit is None
    if fixed or does_stand(found) or not request.setting.others:
        return found
    for fit in fits_begun_by_one_camera(request):
        path = _judged_fit(fit, request, estimator)
        if path is not None and does_stand(path):
            return path
    return found


def _with_a_leg_less(found: LightPath, request: Request, estimator: Estimator) -> LightPath:
    """The path, or where it is contradicted one with a leg less that explains more, and all.

    A search that parts a leg in two, nearly in line, may lose pulses which the whole leg has.
    """
    told = request.n_legs is not None or request.start is not None or request.may_bend
    chain = not (found.forks or found.unseen_legs or found.bends)
    if told or not chain or does_stand(found):
        return found
    state = state_of_path(found)
    if all(state.turn_deg(corner) >= _IN_LINE_DEG for corner in state.corners_seen):
        return found
    try:
        path, fit = estimator.fit(replace(request, n_legs=found.n_legs - 1))
    except (GeometryError, NothingFoundError):
        return found
    sightings = request.sightings if fit is None else list(fit.sightings)
    if not _explains_more(explained(path, fit, sightings), found.explained):
        return found
    judged = _judged(path, fit, request, estimator)
    return judged if judged.verdict.level is Level.TRUST else found


def _explains_more(one: Explained | None, other: Explained | None) -> bool:
    return one is not None and other is not None and one.n_pulses > other.n_pulses


def _through_blocks(request: Request, estimator: Estimator) -> LightPath:
    """The path where glass stands in the beam: a chain of straight legs, nothing else is tried."""
    path, fit = estimator.fit(request)
    refuse_other_crossings(path.vertices_mm, request.setting.medium.blocks)
    return warned(_judged(path, fit, request, estimator))


def _of_told_length(request: Request, estimator: Estimator) -> LightPath:
    """The path where legs may bend and lengths are told: of a curve they are not its chord's."""
    # Without its length, of a curve not even roughly the index is known.
    medium = replace(request.setting.medium, path_group_index_std=0.0)
    loose = replace(request, setting=replace(request.setting, lengths=(), medium=medium))
    begun = fit_of_request(loose)
    straight = fit_or_reason(partial(fit_of_request, request))
    sightings = request.sightings
    curve = bent_instead(
        begun, sightings, loose.setting, request.n_legs, cut=_as_cut(begun, loose), may_bend=True
    )
    bent = bent_to_lengths(curve or begun, straight, sightings, request.setting)
    told = None if bent is None else _told(bent, request, estimator)
    if told is None and estimator.of_fit is not None and not isinstance(straight, NoFit):
        told = estimator.of_fit(straight, request), straight
    return warned(_judged(*(told or estimator.fit(request)), request, estimator))


def _along_curves(request: Request, estimator: Estimator) -> LightPath:
    """The path where curves are told: which legs there are is known, nothing else is tried."""
    return warned(_judged(*estimator.fit(request), request, estimator))


def _reconsidered(
    found: LightPath,
    fit: JointFit | None,
    request: Request,
    estimator: Estimator,
) -> LightPath:
    """The path, or where its verdict leaves something open one with detours, bends or arms."""
    alone = _without_images(found, request, estimator)
    if alone is not None:
        return _with_arms_not_images(alone, fit, request, estimator)
    longer = _going_on(found, fit, request, estimator)
    if longer is not None:
        return longer
    stands = does_stand(found)
    # Bends may stand in for a way that nobody saw, cut into legs: they are asked about first.
    is_straight = stands and not found.bends
    other = _unseen_as_such(fit, request, estimator) if is_straight else None
    other = other or _detour_or_bend(found, fit, request, estimator)
    is_blamed = _is_blamed(FindingName.UNSEEN_LEG, found)
    if other is None and (is_blamed or (stands and found.bends)):
        other = _unseen_as_such(fit, request, estimator)
    if fit is None:
        return other or found
    if leaves_light(found.verdict):
        forked = _forked(fit, request, estimator)
        # Arms that leave nothing to say are right, whatever else would stand.
        if forked is not None and forked.verdict.level is Level.TRUST:
            return forked
        return other or forked or found
    if other is None and mirror_of_fit(fit) is not None:
        return _with_arms_not_images(found, fit, request, estimator)
    return other or found


def _detour_or_bend(
    found: LightPath, fit: JointFit | None, request: Request, estimator: Estimator
) -> LightPath | None:
    """A path with ways that nobody saw or with bends, or the one found; None: arms may be right.

    Detours come before bends: they are asked about only at the picture's edge, and most
    recordings have none there. A curve is cut into legs as well, between which light seems lost:
    where the pulses leave that open, the one is taken that they ask for. So it is where bends by
    themselves would explain the counts: a way that nobody saw may be cut into legs and bent.
    """
    detour, holds_all = None, False
    is_open = leaves_misfit(found.verdict) or (
        fit is not None and has_weak_leg(fit) and names_symptom(found.verdict)
    )
    if is_open and not _is_repeated(found):
        detour, holds_all = _detour(fit, request, estimator)
        first = detour[0] if detour is not None and holds_all else found
        is_sure = holds_all or detour is None
        if is_sure and does_stand(first) and not request.may_bend:
            return first
    bent = _bent(fit, found.verdict, request, estimator)
    is_curved = bent is not None or _is_blamed(FindingName.CURVED_LEG, found)
    if is_curved and not (is_open or request.may_bend):
        detour = _detour(fit, request, estimator)[0]
        detour = detour if detour is not None and does_stand(detour[0]) else None
    open_to_both = detour is not None and not (holds_all or request.may_bend)
    rival = detour[1] if detour is not None and open_to_both else None
    # The pulses as found decide, and are asked first: the rest of the light takes longest.
    if bent is not None and (
        rival is None or costs_less(bent, rival, request.sightings, request.setting)
    ):
        judged = _judged_fit(bent, request, estimator)
        if judged is not None and (request.may_bend or does_stand(judged)):
            return judged
    if detour is None or (request.may_bend and not holds_all):
        return None
    return detour[0]


def _is_blamed(name: FindingName, path: LightPath) -> bool:
    """Whether that is the likeliest cause of what contradicts a path."""
    return not does_stand(path) and path.verdict.findings[0].name is name


def does_stand(path: LightPath) -> bool:
    """Whether no test contradicts a path."""
    return path.verdict.level is not Level.CONTRADICTED


def _unseen_as_such(
    fit: JointFit | None, request: Request, estimator: Estimator
) -> LightPath | None:
    """The path whose legs without light are ways that nobody saw, where that stands."""
    if fit is None or estimator.of_fit is None:
        return None
    if request.start is not None or request.setting.told_vertices:
        return None
    open_ended = without_light_unseen(fit, request.sightings, request.setting, request.n_legs)
    path = _judged_fit(open_ended, request, estimator)
    return path if path is not None and does_stand(path) else None


def _going_on(
    found: LightPath, fit: JointFit | None, request: Request, estimator: Estimator
) -> LightPath | None:
    """The path with a leg behind its end that only all counts show, where that stands."""
    # In doubt that may be named, too.
    named = {(one.name, one.severity) for one in found.verdict.findings}
    is_named = (FindingName.LEG_COUNT, Severity.CONTRADICTED) in named
    if not is_named or fit is None or estimator.of_fit is None:
        return None
    if request.n_legs is not None or request.start is not None:
        return None
    longer = path_going_on(found, fit, request.setting, nominal=request.timing is None)
    judged = None if longer is None else _judged(longer, None, request, estimator)
    return judged if judged is not None and does_stand(judged) else None


def _is_repeated(found: LightPath) -> bool:
    """Whether a second pulse is what is wrong most of all: it flies as the first did, in legs."""
    names = [one.name for one in found.verdict.findings]
    return FindingName.OTHER_PULSE in (names if does_stand(found) else names[:1])


def _with_arms_not_images(
    found: LightPath, fit: JointFit | None, request: Request, estimator: Estimator
) -> LightPath:
    """A path with a mirror, or with arms instead where those leave nothing to say.

    An arm that goes straight on runs as the image of a leg does.
    """
    forked = None if fit is None else _forked(fit, request, estimator)
    return forked if forked is not None and forked.verdict.level is Level.TRUST else found


def _without_images(found: LightPath, request: Request, estimator: Estimator) -> LightPath | None:
    """The path of the bright legs alone, where a mirror that shows them once more explains all."""
    told = request.n_legs is not None or request.start is not None
    if _passes(found) or told or estimator.of_fit is None:
        return None
    try:
        legs = legs_in_all_pictures(request.sightings, request.setting)
    except NothingFoundError:
        return None
    fit = fit_without_dim_legs(request.sightings, legs, request.setting)
    path = _judged_fit(fit, request, estimator)
    return path if path is not None and _passes(path) else None


def _passes(path: LightPath) -> bool:
    """Whether tests of the counts let a path stand."""
    named = {one.name for one in path.verdict.findings}
    return does_stand(path) and FindingName.NOT_EXAMINED not in named


def warned(path: LightPath) -> LightPath:
    """The path, with a warning unless its verdict is "trust"."""
    if path.verdict.level is not Level.TRUST and path.verdict is not NOT_EXAMINED:
        warnings.warn(warning_of(path.verdict), SuspectDataWarning, stacklevel=4)
    return path


def _detour(
    fit: JointFit | None, request: Request, estimator: Estimator
) -> tuple[tuple[LightPath, JointFit] | None, bool]:
    """A path with legs that nobody saw, where that is right; a start says what legs there are.

    And whether it holds all light by its pulses as they were found: where they leave some (by
    corners, of a camera with a tail), the tests of the counts decide. A told length that is wrong
    looks like a way that nobody saw.
    """
    setting = request.setting
    if estimator.of_fit is None or request.start is not None or setting.lengths:
        return None, False
    found = detour_instead(fit, request.sightings, setting, request.n_legs)
    told = None if found is None else _told(found.fit, request, estimator)
    if found is None or told is None:
        return None, False
    path = _judged(*told, request, estimator)
    stands = found.holds_all or does_stand(path)
    return (path, told[1]) if stands else None, found.holds_all


def _forked(fit: JointFit | None, request: Request, estimator: Estimator) -> LightPath | None:
    """The path with the arms of beam splitters, where that is right; a start says what legs are.

    `fit` is the path without, None where so many legs as were told make none.
    """
    if not _may_fork(request, estimator):
        return None
    if request.n_legs is not None:
        # So many legs in one chain are none: what the recording shows by itself may have arms.
        try:
            fit = fit_of_request(replace(request, n_legs=None))
        except (GeometryError, NothingFoundError):
            return None
    if fit is None:
        return None
    forked = with_arms(fit, request.sightings, request.setting, request.n_legs)
    told = None if forked is None else _told(forked, request, estimator)
    if told is None:
        return None
    # What the tests let stand is right; what they do not may have arms and something else wrong.
    path = _judged(*told, request, estimator)
    return path if does_stand(path) or take_up_most(told[1], fit, request.sightings) else None


def _may_fork(request: Request, estimator: Estimator) -> bool:
    """Whether arms become part of the path; else the verdict names them.

    Waypoints and lengths number what their user knows: an arm would count it anew.
    """
    told = request.start is not None or bool(request.setting.told_vertices)
    return estimator.of_fit is not None and not told


def _told(
    found: JointFit, request: Request, estimator: Estimator
) -> tuple[LightPath, JointFit] | None:
    """The estimator's path from a fit of pulses; None where the counts lead nowhere."""
    assert estimator.of_fit is not None
    found = without_short_pieces(found, request.setting)
    found = with_diffuse(found, request.setting, nominal=request.timing is None)
    try:
        return estimator.of_fit(found, request), found
    except (GeometryError, NothingFoundError):
        return None


def _judged_fit(fit: JointFit | None, request: Request, estimator: Estimator) -> LightPath | None:
    """A fit's path with its verdict; None without a fit, or where its pulses show no path."""
    told = None if fit is None else _told(fit, request, estimator)
    return None if told is None else _judged(*told, request, estimator)


def _bent(
    fit: JointFit | None, verdict: Verdict, request: Request, estimator: Estimator
) -> JointFit | None:
    """A fit with bent legs, where that is right; a start says what legs are."""
    if fit is None or estimator.of_fit is None or request.start is not None:
        return None
    if not request.may_bend and not asks_for_bends(verdict, fit.solution.state):
        return None
    return bent_instead(
        fit, request.sightings, request.setting, request.n_legs,
        cut=_as_cut(fit, request), may_bend=request.may_bend,
        stands=verdict.level is not Level.CONTRADICTED,
    )  # fmt: skip


def _as_cut(fit: JointFit, request: Request) -> JointFit:
    """The fit with as many legs as the data show: a search cuts one curve into several."""
    if request.n_legs is None:
        return fit
    try:
        return fit_of_request(replace(request, n_legs=None))
    except (GeometryError, NothingFoundError):
        return fit


def _starts_bent(request: Request) -> bool:
    """Whether a start says that legs are curves."""
    return isinstance(request.start, LightPath) and bool(request.start.bends)


def _judged(
    path: LightPath, fit: JointFit | None, request: Request, estimator: Estimator
) -> LightPath:
    """The path in its lap of the clock, with what it explains, its verdict and other answers."""
    path = _examined(path, fit, request, estimator)
    others = () if fit is None else _others(path, fit, request, estimator)
    if others and others[0].is_far_likelier:
        likelier = _examined(others[0].answer.path, others[0].fit, request, estimator)
        if does_stand(likelier):
            # Two that each call the other far likelier are both told.
            others = _others(likelier, others[0].fit, request, estimator)
            return with_others(likelier, others)
    return with_others(path, others)


def _examined(
    path: LightPath, fit: JointFit | None, request: Request, estimator: Estimator
) -> LightPath:
    """The path in its lap of the clock, with what it explains and its verdict."""
    # A start given by the user says the lap too: the path stays where it was put.
    path = path if request.start is not None else on_first_lap(path, request.sightings[0])
    sightings = request.sightings if fit is None else list(fit.sightings)
    path = replace(path, explained=explained(path, fit, sightings))
    return examined(
        path,
        fit,
        sightings,
        request.setting,
        nominal_clock=request.timing is None,
        n_legs=request.n_legs,
        may_bend=request.may_bend or _starts_bent(request) or bool(request.setting.curves),
        name_arms=not _may_fork(request, estimator),
    )


def _others(
    path: LightPath, fit: JointFit, request: Request, estimator: Estimator
) -> tuple[Other, ...]:
    """Other answers; none where a start says which is wanted."""
    if estimator.of_fit is None or request.start is not None or request.setting.curves:
        return ()

    def told_of(other: JointFit) -> tuple[LightPath, JointFit] | None:
        told = _told(other, request, estimator)
        return None if told is None else (on_first_lap(told[0], request.sightings[0]), told[1])

    return others_beside(path, fit, request.sightings, request.setting, request.n_legs, told_of)
