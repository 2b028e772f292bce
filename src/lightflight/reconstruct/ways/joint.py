"""`joint`: legs in the picture, one fit of all pulses, second thoughts on the number of legs.

Where pulses alone leave much of the path unsaid, the likelihood of all counts has the last word.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import chdtri

from lightflight.arguments import real_numbers
from lightflight.errors import (
    CalibrationError,
    GeometryError,
    LightflightWarning,
    NothingFoundError,
)
from lightflight.path.light_path import LightPath
from lightflight.reconstruct.fit.along import begun_along, statements_of_curves, with_curves
from lightflight.reconstruct.fit.joint import JointFit, fit_joint, pulse_std_ps
from lightflight.reconstruct.fit.pictures import lit_untold, state_in_view
from lightflight.reconstruct.fit.prices import prices_of_fit
from lightflight.reconstruct.fit.result import path_from_fit
from lightflight.reconstruct.fit.short_pieces import without_short_pieces
from lightflight.reconstruct.fit.slanted_spots import statements_of_slanted_spots
from lightflight.reconstruct.fit.statements import statements_from_covariance
from lightflight.reconstruct.legs.direction import (
    MUCH_SCATTER,
    ask_which_way,
    legs_in_all_pictures,
    refuse_if_clearer_backwards,
    refuse_if_clock_scatters,
    search_legs,
    warn_of_scatter,
)
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.reconstruct.legs.plausible import OtherUnitsError, refuse_other_units
from lightflight.reconstruct.model.geometry import PathState, state_of_path
from lightflight.reconstruct.model.glass import through_blocks
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting, without_pixels
from lightflight.reconstruct.model.told import statements_of_lengths
from lightflight.reconstruct.other_light.diffuse import with_diffuse
from lightflight.reconstruct.sightings import sighting_from_histograms
from lightflight.reconstruct.trials.outcome import NoFit, fit_or_reason
from lightflight.reconstruct.trials.revise import (
    fit_from_brightest,
    fit_from_legs,
    refitted,
    revised,
    with_n_legs,
)
from lightflight.reconstruct.trials.unclaimed import from_unclaimed_legs, with_unclaimed_legs
from lightflight.reconstruct.verdict.arms import with_arms_for_most
from lightflight.reconstruct.ways.request import Request
from lightflight.timing.clock.code_clock import CodeClock

_RECOUNTED_UP_TO_PULSES = 12
"""A leg that no more pulses than this speak for is looked at again by all its counts."""
_ANOTHER_HILL = 1e-4
"""Chance that the path by all counts misses the pulses by so much more than their own best path: of
its p numbers each takes one of their chi-square."""


def path_by_joint(request: Request) -> tuple[LightPath, JointFit]:
    """The path by all pulses in one fit.

    Parameters
    ----------
    request : Request
        What is asked.

    Returns
    -------
    path : LightPath
        On some lap of the clock.
    fit : JointFit
        The fit of the pulses that it rests on.

    Raises
    ------
    GeometryError
        Where camera, source and path are in a degenerate position.
    NothingFoundError
        Where no path stands out.
    """
    fit = fit_of_request(request)
    return path_of_pulses(fit, request), fit


def fit_of_request(request: Request) -> JointFit:
    """The joint fit, from legs in the picture or from the user's start.

    Parameters
    ----------
    request : Request
        What is asked.

    Returns
    -------
    JointFit
        With as many legs as were asked for, or as the data show.

    Raises
    ------
    CalibrationError
        Where the codes run the other way than stated.
    GeometryError, NothingFoundError
        As `path_by_joint`.
    """
    sightings, setting, n_legs = request.sightings, request.setting, request.n_legs
    if request.start is not None:
        period_ps = sightings[0].histograms.laser_period_ps or 0.0
        state = _at_exact_source(_state_from_start(request.start, setting), setting, period_ps)
        state = through_blocks(state, setting.medium.blocks, setting.cameras)
        fit = fit_joint(sightings, with_curves(state, setting), setting, legs=None)
        return _with_other_light(without_short_pieces(fit, setting), request)
    if setting.curves:
        state, shared = begun_along(sightings, setting)
        period_ps = sightings[0].histograms.laser_period_ps or 0.0
        state = _at_exact_source(state, setting, period_ps)
        return _with_other_light(
            fit_joint(sightings, state, setting, legs=None, shared=shared), request
        )
    if request.timing is None and setting.source.position_mm is None:
        refuse_if_clock_scatters(sightings[0], pulse_std_ps(sightings))
    fit, legs = (
        _fit_as_found(request, brightest=True) if n_legs is None else _fit_as_told(request, n_legs)
    )
    fit = without_short_pieces(fit, setting)
    # Light of an arm looks like much else, which takes long to find: halos, mirrors, glare.
    armed = with_arms_for_most(fit, sightings, setting) if request.arms_first else None
    fit = _with_other_light(without_short_pieces(armed, setting) if armed else fit, request)
    if request.timing is None and fit.floor_ps > MUCH_SCATTER * pulse_std_ps(sightings):
        warn_of_scatter(fit.floor_ps, legs, sightings[0], setting.camera)
    return fit


def _with_other_light(fit: JointFit, request: Request) -> JointFit:
    """The fit with light that is not its legs', and without that of legs a picture hardly shows."""
    setting = request.setting
    if setting.others:
        fit = _without_untold(fit, setting)
    return with_diffuse(fit, setting, nominal=request.timing is None)


def fits_begun_by_one_camera(request: Request) -> Iterator[JointFit]:
    """The fits to all cameras' pulses that begin with the path which each of them shows alone.

    Legs of two pictures that are put together wrongly end in a fit that nothing leads out of.

    Parameters
    ----------
    request : Request
        Of several cameras.

    Yields
    ------
    JointFit
        Of all cameras; none for one that shows no path.
    """
    setting = request.setting
    for view in range(len(setting.cameras)):
        own = [replace(one, view=0) for one in request.sightings if one.view == view]
        alone = replace(request, sightings=own, setting=setting.at(view))
        begun = fit_or_reason(partial(fit_of_request, alone))
        if isinstance(begun, NoFit):
            continue
        fit = refitted(request.sightings, begun.solution.state, setting)
        if not isinstance(fit, NoFit):
            yield _without_untold(fit, setting)


def _without_untold(fit: JointFit, setting: Setting) -> JointFit:
    """The fit without pixels of one of several cameras that shows too little of a leg there."""
    state, seen = fit.solution.state, []
    for one, picture in zip(fit.sightings, fit.pictures, strict=True):
        camera = setting.cameras[one.view]
        hidden = lit_untold(state_in_view(state, setting, one.view), camera, picture)
        seen.append(one if hidden is None else without_pixels(one, hidden))
    if all(one is before for one, before in zip(seen, fit.sightings, strict=True)):
        return fit
    trial = refitted(seen, state, setting)
    return fit if isinstance(trial, NoFit) else trial


def _fit_as_found(request: Request, *, brightest: bool) -> tuple[JointFit, tuple[ImageLeg, ...]]:
    """The fit with as many legs as the data show, and the legs in the picture it began with.

    `brightest`: without the dimmer ones where all of them make no path.
    """
    sightings, setting = request.sightings, request.setting
    legs = legs_in_all_pictures(sightings, setting)
    _refuse_other_units(legs, setting)
    try:
        fit = fit_from_legs(sightings, legs, setting, drop=True)
    except (GeometryError, NothingFoundError) as problem:
        _ask_of_the_clock(legs, request, problem)
        longer = from_unclaimed_legs(sightings, legs, setting)
        shorter = fit_from_brightest(sightings, legs, setting) if brightest and not longer else None
        other = longer or shorter
        if other is None:
            raise
        fit = other
    # Revised first: light that a second leg will claim is not left over.
    return with_unclaimed_legs(sightings, legs, revised(sightings, fit, setting), setting), legs


def _fit_as_told(request: Request, n_legs: int) -> tuple[JointFit, tuple[ImageLeg, ...]]:
    """The fit with as many legs as the user says, and the legs in the picture it began with.

    What the data show by themselves comes first: where that is what was told, nothing of it may
    change. Fewer are cut where they bend most; of more, the brightest in the picture are taken.
    """
    sightings, setting = request.sightings, request.setting
    try:
        found, legs = _fit_as_found(request, brightest=False)
        n_shown = found.solution.state.n_told
        if n_shown <= n_legs:
            fit = with_n_legs(sightings, found, setting, n_legs)
            return replace(fit, n_shown=n_shown if n_shown < n_legs else None), legs
    except OtherUnitsError:
        raise
    except (GeometryError, NothingFoundError):
        pass
    legs = legs_in_all_pictures(sightings, setting, n_legs)
    _refuse_other_units(legs, setting)
    try:
        fit = fit_from_legs(sightings, legs, setting, drop=False)
    except (GeometryError, NothingFoundError) as problem:
        # Without dim legs there may be just as many.
        bright = fit_or_reason(partial(_fit_as_found, request, brightest=True))
        if not isinstance(bright, NoFit) and bright[0].solution.state.n_told == n_legs:
            return bright
        _ask_of_the_clock(legs, request, problem)
        raise
    return with_n_legs(sightings, fit, setting, n_legs), legs


def _refuse_other_units(legs: tuple[ImageLeg, ...], setting: Setting) -> None:
    """Refuse a camera or a source told in other units, by the legs of each picture."""
    for view, camera in enumerate(setting.cameras):
        own = tuple(leg for leg in legs if leg.view == view)
        if own:
            refuse_other_units(camera, setting.source, setting.medium, own)


def _ask_of_the_clock(legs: tuple[ImageLeg, ...], request: Request, problem: Exception) -> None:
    """Where no path fits: ask whether the clock runs backwards, if a path fits then."""
    seen, setting = request.sightings[0], request.setting
    refuse_if_clearer_backwards(legs, seen, setting, request.n_legs)
    if request.timing is None and _fits_backwards(seen, setting):
        ask_which_way(legs, seen, setting.camera, request.timing, problem)


def _fits_backwards(sighting: Sighting, setting: Setting) -> bool:
    """Whether a path fits the recording on nominal codes that run the other way."""
    hist = sighting.histograms
    turned = replace(hist, reversed_codes=not hist.reversed_codes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        try:
            backwards = sighting_from_histograms(
                turned, setting, timing=None, background=None, exclude_mask=sighting.blind,
                least_squares=False,
            )  # fmt: skip
            legs = search_legs(backwards.arrivals, backwards, setting, None)
            fit_from_legs([backwards], legs, setting, drop=True)
        except (GeometryError, NothingFoundError, CalibrationError):
            return False
    return True


def path_of_fit(fit: JointFit, request: Request) -> LightPath:
    """The path that a joint fit found, with what it rests on in words.

    Parameters
    ----------
    fit : JointFit
        The fit.
    request : Request
        What it answers.

    Returns
    -------
    LightPath
        Told as `joint`.
    """
    path = path_from_fit(
        fit,
        list(fit.sightings),
        request.setting,
        statements=(
            *_statements_of_path(fit, request.timing),
            *statements_of_curves(fit.solution.state, request.setting.curves),
            *statements_of_lengths(request.setting.lengths),
            *statements_of_slanted_spots(fit),
        ),
        truth=request.sightings[0].histograms.truth,
    )
    return replace(path, prices=prices_of_fit(fit, request.setting))


def path_of_pulses(fit: JointFit, request: Request) -> LightPath:
    """The path of a joint fit; where pulses leave much unsaid, by all counts that agree with them.

    A short leg near a corner or the picture's edge may settle on a wrong line: at wrong times
    its light is not seen. Where the light begins or stops in the picture, the pulses there took no
    part. Counts that no single pulse claims speak for both.

    Parameters
    ----------
    fit : JointFit
        The fit.
    request : Request
        What it answers.

    Returns
    -------
    LightPath
        Told as `joint`.
    """
    path = path_of_fit(fit, request)
    why = _why_all_counts(fit, request.setting)
    if not why or not all(o.histograms.poisson for o in fit.sightings):
        return path
    from lightflight.reconstruct.all_counts.photon import path_of_all_counts

    try:
        better = path_of_all_counts(fit, path, request.setting)
    except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
        return path
    # The likelihood may have climbed another hill, or know too little of uneven light; then the
    # pulses would tell: it need leave no less than their errors, which joint fits may.
    chi2 = [_chi2_of_residuals(one) for one in (path, better)]
    most = max(chi2[0], float(np.count_nonzero(path.residuals["used"])))
    worse = chi2[1] > most + float(chdtri(len(fit.freedom.labels), _ANOTHER_HILL))
    if worse or not better.goodness.converged:
        return path
    said = f"{why}: all counts were fitted."
    return replace(better, method="joint", statements=(said, *better.statements))


def _chi2_of_residuals(path: LightPath) -> float:
    """Chi-square of the pulses that took part, with all errors: those of the first camera."""
    used = path.residuals[path.residuals["used"]]
    return float(np.sum((used["residual_ps"] / used["std_ps"]) ** 2))


def _why_all_counts(fit: JointFit, setting: Setting) -> str:
    """What pulses alone do not tell of a path; empty where they tell all."""
    n_legs = fit.solution.state.n_legs
    used = np.bincount(fit.times.leg[fit.times.weight > 0], minlength=n_legs)
    # Few pulses settle a leg wrongly as easily as rightly: at wrong times its light is not seen.
    weak = np.flatnonzero(used <= _RECOUNTED_UP_TO_PULSES)
    weak = np.intersect1d(weak, fit.solution.state.seen)
    # Of several cameras another may show the leg well.
    if len(weak) and not setting.others:
        return f"Leg {weak[0] + 1} rests on {used[weak[0]]} pulses"
    if any(tip is not None for tip in fit.tips):
        return "Light begins or stops within the picture"
    return ""


def _state_from_start(start: Any, setting: Setting) -> PathState:
    """Vertices and start time to begin from, as the user gave them."""
    if hasattr(start, "vertices_mm"):
        return state_of_path(start)
    must = "be a LightPath or vertices_mm of shape (m, 3)"
    vertices = real_numbers("start", start, must)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < 2:
        raise ValueError(
            f"start must be a LightPath or vertices_mm of shape (m, 3), got {vertices.shape}"
        )
    time = setting.source.emission_time_ps
    if time is None:
        raise ValueError(
            "a start given as vertices needs a time: give emission_time_ps of the source (with an "
            "emission_time_std_ps), or a LightPath as start"
        )
    return PathState(vertices, float(time))


def _at_exact_source(state: PathState, setting: Setting, period_ps: float) -> PathState:
    """The start with what is told as exact of its first vertex, which no fit will move."""
    source = setting.source
    if source.position_mm is None:
        return state
    vertices, time = state.vertices_mm.copy(), state.start_time_ps
    exact = source.position_std_xyz_mm == 0
    vertices[0, exact] = np.asarray(source.position_mm, dtype=float)[exact]
    if source.emission_time_ps is not None and source.emission_time_std_ps == 0:
        # The start says the lap of the clock, the source the time within it.
        laps = round((time - source.emission_time_ps) / period_ps) if period_ps > 0 else 0
        time = source.emission_time_ps + laps * period_ps
    return replace(state, vertices_mm=vertices, start_time_ps=float(time))


def _statements_of_path(fit: JointFit, timing: CodeClock | None) -> tuple[str, ...]:
    """What the result rests on, and what the data leave open."""
    said = []
    if timing is None:
        said.append("The clock is nominal: no timing calibration was given.")
    if fit.floor_ps > 0:
        said.append(
            f"The times scatter about the path by {fit.floor_ps:.2g} ps more than their stated "
            "errors: misfit, which the error bars include and do not explain."
        )
    if not fit.strengths:
        said.append(
            "Haze, halo and glare could not be told from the path's light: their part of the times "
            "is neither taken off nor stated."
        )
    if not fit.solution.converged:
        said.append("The fit stopped before it converged: do not trust its errors.")
    told = _told_columns(fit)
    labels = tuple(fit.freedom.labels[k] for k in told)
    said.extend(statements_from_covariance(fit.solution.covariance[np.ix_(told, told)], labels))
    return tuple(said)


def _told_columns(fit: JointFit) -> list[int]:
    """Freedoms of which something can be said: not those of mirrors that end an unseen leg."""
    ends = fit.solution.state.open_vertices
    rows = [3 * vertex + axis for vertex in ends for axis in range(3)]
    return [k for k in range(len(fit.freedom.labels)) if not fit.freedom.basis[rows, k].any()]
