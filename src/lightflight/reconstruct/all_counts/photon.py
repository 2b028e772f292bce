"""`photon`: the Poisson likelihood of every count, the limit of what the recording holds.

Takes a path that is roughly right (from `joint`, or from pooled counts where no pixel can be
fitted alone) and the counts of all cameras, and climbs the likelihood of `forward` by Fisher
scoring with everything unknown at once: path, emission time, brightness along the legs, spot, pulse
width, every pixel's background and clock error, shared clock errors. No pixel is interpolated and
none is too dim.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import NothingFoundError
from lightflight.path.light_path import LightPath
from lightflight.path.tables import Goodness
from lightflight.reconstruct.all_counts.climb import GAUGE, Climb, View, climb, led_by
from lightflight.reconstruct.all_counts.corners import statements_of_corners
from lightflight.reconstruct.all_counts.counts import (
    Counts,
    clean_counts,
    other_light_otherwise,
    view_of_counts,
    with_uneven,
)
from lightflight.reconstruct.fit.active_area import areas_found
from lightflight.reconstruct.fit.ends import Ends, freedom_at, known_tips, with_ends
from lightflight.reconstruct.fit.fine import rests_of_light
from lightflight.reconstruct.fit.joint import JointFit, pulse_std_ps, refuse_run_away
from lightflight.reconstruct.fit.membership import (
    Tips,
    fraction_at,
    tip_of_leg,
)
from lightflight.reconstruct.fit.result import prior_in_words
from lightflight.reconstruct.fit.uneven import RestAlong
from lightflight.reconstruct.model.geometry import (
    PathState,
    footprints,
    state_of_path,
)
from lightflight.reconstruct.model.glass import with_dark_pieces
from lightflight.reconstruct.model.information import covariance_from_information
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import (
    group_index_std,
    moved,
    shared_errors,
    vertices_by_parameters,
)
from lightflight.reconstruct.model.sighting import Sighting

Floats = NDArray[np.float64]

_PASSES = 3
"""Most rounds of picture and climb: a climb changes a little which pixels lie near the path."""


def photon_path(
    sightings: list[Sighting],
    setting: Setting,
    rough: LightPath,
    *,
    std_ps: float,
    tips: Tips = (None, None),
    shared: Floats | None = None,
    areas: Mapping[int, tuple[float, float]] | None = None,
    rests: Mapping[int, tuple[RestAlong, ...]] | None = None,
    slanted: bool = False,
) -> LightPath:
    """Refine a rough path by the likelihood of all counts.

    `tips` says where the light begins and stops in the picture, where that is known already.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    setting : Setting
        Camera, source, medium and waypoints.
    rough : LightPath
        A path that is roughly right, with the residuals of its pulses.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    tips : Tips, optional
        (row, col, camera) where the light begins and stops in the picture; None: it does not.
    shared : array of float, shape (j,), optional
        Shared errors of the setting that the rough path was found with; None: none.
    areas : mapping of int to (float, float), optional
        Active areas of cameras that are not small: side, pitches, and standard deviation of its
        fourth power, for which the path is climbed to without it, too.
    rests : mapping of int to tuple of RestAlong, optional
        How uneven light is along legs beyond splines, by camera.
    slanted : bool, optional
        Whether spots may be no circles.

    Returns
    -------
    LightPath
        Refined path; its residuals are those of the same pulses.

    Raises
    ------
    NothingFoundError
        Where no pixel lies near the path, or the counts lead it out of all bounds.
    """
    told = {view: side for view, (side, _) in (areas or {}).items()}
    climbed = partial(
        _climbed, sightings, setting, rough, std_ps, tips, shared, rests or {}, slanted
    )
    path = climbed(told)
    for view, (side, fourth_std) in (areas or {}).items():
        if side > 0.0:
            # What an area of next to nothing does is how far two climbs to one top end apart.
            wide = max(side, fourth_std**0.25)
            larger = path if wide == side else climbed({**told, view: wide})
            without = climbed({**told, view: 0.0})
            path = _with_error_of_area(path, larger, without, fourth_std / wide**4)
    return path


def path_of_all_counts(
    fit: JointFit, rough: LightPath, setting: Setting, *, tips: Tips | None = None
) -> LightPath:
    """The path by all counts, from a fit of single pulses.

    Parameters
    ----------
    fit : JointFit
        The fit.
    rough : LightPath
        Its path.
    setting : Setting
        Camera, source, medium and waypoints.
    tips : Tips, optional
        Where light begins and stops in view; None: as the fit has it.

    Returns
    -------
    LightPath
        On some lap of the clock.

    Raises
    ------
    NothingFoundError
        Where the counts lead it out of all bounds.
    """
    sightings = list(fit.sightings)
    return photon_path(
        sightings,
        setting,
        rough,
        std_ps=pulse_std_ps(sightings),
        tips=fit.tips if tips is None else tips,
        shared=fit.solution.shared,
        areas=areas_found(fit),
        rests=rests_of_light(fit, setting),
        slanted=fit.slanted,
    )


def _with_error_of_area(
    path: LightPath, larger: LightPath, without: LightPath, share: float
) -> LightPath:
    """The path with the error of an area: a share of what a larger one does to it."""
    moved_by = np.column_stack(
        (larger.vertices_mm - without.vertices_mm, larger.vertex_times_ps - without.vertex_times_ps)
    )
    error = share * moved_by.ravel()
    error = np.outer(error, error)
    parts = {**path.covariance_parts, "shared": path.covariance_parts["shared"] + error}
    return replace(path, covariance=path.covariance + error, covariance_parts=parts)


def _climbed(
    sightings: list[Sighting],
    setting: Setting,
    rough: LightPath,
    std_ps: float,
    tips: Tips,
    shared: Floats | None,
    rests: Mapping[int, tuple[RestAlong, ...]],
    slanted: bool,
    active_px: Mapping[int, float],
) -> LightPath:
    """The path at the top of the likelihood, with active areas as told; of no other camera."""
    # The path is seen by camera and medium as they were found, told by those of the user.
    errors = shared_errors(setting)
    shared = np.zeros(len(errors)) if shared is None else shared
    wholes = clean_counts(sightings, rough, std_ps, tips, moved(setting, errors, shared))
    state = with_dark_pieces(state_of_path(rough), setting.cameras)
    counts = [
        Counts(
            whole,
            std_ps,
            np.zeros((*whole.blind.shape, state.n_legs), bool),
            active_px.get(whole.view, 0.0),
            rests=rests.get(whole.view, ()),
            slanted=slanted,
        )
        for whole in wholes
    ]
    ended: Climb | None = None
    for _ in range(_PASSES):
        previous, seen = state, moved(setting, errors, shared)
        state, ends = with_ends(state, sightings, seen, std_ps)
        # Seen in the picture now, or told by the pulses before.
        ends = replace(ends, tips=known_tips(ends.tips, tips))
        state = _ending_at_tips(state, ends, seen, None if ended is None else previous)
        cut_ends = tuple(tip is not None for tip in ends.tips)
        counts, views = _views(counts, state, seen, cut_ends, std_ps, rough)
        freedom = freedom_at(state, seen, ends)
        # A picture led astray has light without bounds, whose score is no number.
        with np.errstate(invalid="ignore", over="ignore"):
            ended = climb(state, views, freedom, setting, shared=shared)
        if not np.isfinite(ended.information).all():
            raise NothingFoundError(
                "the counts lead the path to where they tell nothing of it: check start, source "
                "and camera (lightflight check)"
            )
        state, shared = ended.state, ended.shared
        climbed, (counts, new) = counts, with_uneven(counts, ended)
        step = np.abs(state.vertices_mm - previous.vertices_mm).max()
        if step < 0.02 and not new:
            break
    assert ended is not None
    refuse_run_away(state)
    return _path_from_climb(ended, rough, climbed)


def _views(
    counts: list[Counts],
    state: PathState,
    seen: Setting,
    cut_ends: tuple[bool, ...],
    std_ps: float,
    rough: LightPath,
) -> tuple[list[Counts], list[View]]:
    """The recordings whose pictures tell of some leg, and what each brings to a climb."""
    floor_ps = rough.goodness.error_floor_ps
    both = [
        (own, view)
        for own in counts
        if (view := view_of_counts(own, state, seen, cut_ends, std_ps, floor_ps)) is not None
    ]
    if not both:
        raise NothingFoundError("too little light: no picture tells where a leg of the path runs")
    return [own for own, _ in both], [view for _, view in both]


def _ending_at_tips(
    state: PathState, ends: Ends, setting: Setting, climbed: PathState | None
) -> PathState:
    """The path with its ends where light begins and stops in view: as seen, or as last climbed."""
    tips = [(leg, tip_of_leg(ends.tips, leg, state), True) for leg in state.last_legs]
    if setting.source.position_mm is None:
        tips.insert(0, (0, ends.tips[0], False))
    for leg, tip, at_end in tips:
        if tip is None:
            continue
        if climbed is None:
            where = fraction_at(tip, leg, state, setting.at(int(tip[2])))
            state = state.prolonged(leg, where, setting.medium, at_end=at_end)
        else:
            state = _ending_as(climbed, state, leg, at_end=at_end)
    return state


def _ending_as(climbed: PathState, state: PathState, leg: int, *, at_end: bool) -> PathState:
    """The path with a leg's end, or its start, and the leg's curve from another state of it."""
    vertices = state.vertices_mm.copy()
    vertex = leg + 1 if at_end else 0
    vertices[vertex] = climbed.vertices_mm[vertex]
    own = {bend.leg: bend for bend in climbed.bends}
    return replace(
        state,
        vertices_mm=vertices,
        start_time_ps=state.start_time_ps if at_end else climbed.start_time_ps,
        bends=tuple(own[bend.leg] if bend.leg == leg else bend for bend in state.bends),
    )


def _path_from_climb(ended: Climb, rough: LightPath, counts: list[Counts]) -> LightPath:
    total = ended.information + ended.prior + ended.hold
    covariance = covariance_from_information(total, rcond=GAUGE)
    by_delay = np.zeros_like(total)
    for view, told, places in zip(ended.views, ended.told, ended.order.places, strict=True):
        own = told.result.nuisance_gain[:, 1]
        own = own / np.sqrt(np.maximum(view.pixels.pixel_var, 1e-12))[:, np.newaxis]
        by_delay[np.ix_(places, places)] += own.T @ own
    seen, n_free, shared_at = ended.seen, ended.order.n_free, ended.order.shared
    rows, to_vertices = vertices_by_parameters(
        ended.state,
        seen.medium,
        ended.freedom.basis,
        ended.errors,
        first=ended.order.shared.start,
    )

    def at_vertices(matrix: Floats) -> Floats:
        block = (covariance @ matrix @ covariance)[np.ix_(rows, rows)]
        result: Floats = to_vertices @ block @ to_vertices.T
        return result

    n = 4 * len(ended.state.vertices_mm)
    pixel, shared = (at_vertices(part)[:n, :n] for part in (by_delay, ended.prior))
    led = to_vertices @ (covariance @ _led_by_other_light(ended, counts))[rows]
    shared = shared + (led @ led.T)[:n, :n]
    with_bends = to_vertices @ covariance[np.ix_(rows, rows)] @ to_vertices.T + led @ led.T
    whole = with_bends[:n, :n]
    residuals = _updated_residuals(rough, ended)
    used = residuals["used"]
    squared, variance = residuals["residual_ps"][used] ** 2, residuals["std_ps"][used] ** 2
    # Errors of the table include the floor; what is left of them is what was stated.
    stated = np.maximum(variance - rough.goodness.error_floor_ps**2, 1e-12 * variance)
    return replace(
        rough,
        vertices_mm=ended.state.vertices_mm,
        vertex_times_ps=ended.state.vertex_times_ps(seen.medium),
        covariance=whole,
        camera=seen.camera,
        medium=seen.medium,
        method="photon",
        goodness=Goodness(
            chi2=float(np.sum(squared / stated)),
            dof=max(0, int(used.sum()) - n_free),
            n_pulses=sum(len(view.pixels.rows) for view in ended.views),
            n_rejected=int((~used).sum()),
            residual_rms_ps=float(np.sqrt(np.mean(residuals["residual_ps"][used] ** 2)))
            if used.any()
            else float("nan"),
            error_floor_ps=rough.goodness.error_floor_ps,
            converged=ended.converged,
            chi2_with_floor=float(np.sum(squared / variance)),
        ),
        covariance_parts={"photon": whole - pixel - shared, "pixel": pixel, "shared": shared},
        residuals=residuals,
        prior=prior_in_words(seen.source),
        statements=(*rough.statements, *statements_of_corners(ended, counts, covariance)),
        bends=ended.state.bends,
        bend_covariance=with_bends[:, n:],
        group_index_std=group_index_std(ended.errors, covariance[shared_at, shared_at]),
    )


def _led_by_other_light(ended: Climb, counts: list[Counts]) -> Floats:
    """(P, k), how the score follows k errors of light that is no leg's, which was taken as told.

    Where a leg runs between two rows its spot, and with it the line, is told by the few photons of
    the next ones: there a halo known to 2 % leaves more open than all counts do.
    """
    columns = [np.zeros((ended.order.size, 0))]
    for own, view, at, told, places in zip(
        counts, ended.views, ended.points, ended.told, ended.order.places, strict=True
    ):
        otherwise = other_light_otherwise(own.whole, view.pixels, view.codes)
        columns.append(np.zeros((ended.order.size, len(otherwise))))
        columns[-1][places] = led_by(view, at, told, otherwise)
    return np.hstack(columns)


def _updated_residuals(rough: LightPath, ended: Climb) -> NDArray[np.void]:
    """The pulses' residuals about the refined path: those of the first camera."""
    seen, near, local = ended.seen, ended.views[0].pixels, ended.told[0].local
    table = rough.residuals.copy()
    legs = table["leg"].astype(np.int64)
    print_ = footprints(
        ended.state,
        camera=seen.camera,
        medium=seen.medium,
        legs=legs,
        rows=table["row"],
        cols=table["col"],
    )
    pixels = zip(near.rows, near.cols, strict=True)
    at_pixel = {(int(row), int(col)): i for i, (row, col) in enumerate(pixels)}
    model = print_.arrival_ps.copy()
    for i, (row, col, leg) in enumerate(zip(table["row"], table["col"], legs, strict=True)):
        place = at_pixel.get((int(row), int(col)))
        if place is not None and np.isfinite(local.arrival_ps[place, leg]):
            model[i] = local.arrival_ps[place, leg]
    table["model_ps"] = model
    table["residual_ps"] = table["arrival_ps"] - model
    table["event_time_ps"] = ended.state.event_times_ps(legs, print_.fraction, seen.medium)
    return table
