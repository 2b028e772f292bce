"""`photon`: the Poisson likelihood of every count, the limit of what the recording holds.

Takes a path that is roughly right (from `joint`, or from pooled counts where no pixel can be
fitted alone) and climbs the likelihood of `forward` by Fisher scoring with everything unknown at
once: path, emission time, brightness along the legs, spot, pulse width, every pixel's background
and clock error, shared clock errors. No pixel is interpolated and none is too dim.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.path.light_path import LightPath
from lightflight.path.tables import Goodness
from lightflight.reconstruct.fit.climb import GAUGE, Climb, climb, uneven_pixels
from lightflight.reconstruct.fit.ends import Ends, freedom_at, known_tips, with_ends
from lightflight.reconstruct.fit.membership import (
    Tips,
    fraction_at,
    roughly_on_leg,
)
from lightflight.reconstruct.fit.result import prior_in_words, refuse_run_away
from lightflight.reconstruct.fit.strangers import (
    counts_of_pulses,
    further_pulses,
    pulses_of_no_leg,
    strange_pulses,
    whole_pulses,
)
from lightflight.reconstruct.model.forward import (
    CodeCounts,
    Light,
    Pixels,
)
from lightflight.reconstruct.model.geometry import (
    PathState,
    footprints,
    state_of_path,
)
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.information import covariance_from_information
from lightflight.reconstruct.model.picture import Picture, lit_by_legs, measure_picture
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import moved, shared_errors, vertices_by_parameters
from lightflight.reconstruct.model.sighting import Sighting, clock_errors, pixel_counts
from lightflight.reconstruct.model.strength import span_of_knots, strength_spline
from lightflight.timing.pulses.pile_up import open_share_of

Floats = NDArray[np.float64]

_PASSES = 3
"""Most rounds of picture and climb: a climb changes a little which pixels lie near the path."""
LIKELIHOOD_REACH_PX = 2.5
"""A pixel this near to a leg's line takes part in the likelihood, px, and its pulse must agree."""
_DISTURBING = 12.0
"""A strange pulse this many standard deviations from a leg's reaches into its light."""
_AT_TIP_PX = 2.5
"""Pixels this near to where the light begins or stops are not judged by their times, px."""


def merged(sightings: list[Sighting]) -> Sighting:
    """Repeats as one recording: counts of the same codes add, which loses nothing for one clock.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.

    Returns
    -------
    Sighting
        The first, with the counts of all, its pulses as bright as in all, and the pixels blind that
        are blind in any.
    """
    if len(sightings) == 1:
        return sightings[0]
    first = sightings[0]
    counts = np.sum([o.histograms.counts.astype(np.int64) for o in sightings], axis=0)
    blind = np.logical_or.reduce([o.blind for o in sightings])
    frames = [o.histograms.n_frames for o in sightings]
    # One unknown number of frames leaves the sum unknown.
    known = [n for n in frames if n is not None]
    whole = replace(
        first.histograms,
        counts=counts.astype(np.uint64),
        n_frames=sum(known) if len(known) == len(frames) else None,
    )
    # What was found in the first is so much brighter in all of them.
    factor = float(counts.sum()) / max(float(first.histograms.photons.sum()), 1.0)
    arrivals = replace(first.arrivals, photons=factor * first.arrivals.photons)
    diffuse = None if first.diffuse is None else first.diffuse.times(factor)
    return replace(first, histograms=whole, arrivals=arrivals, blind=blind, diffuse=diffuse)


def without_outliers(
    sighting: Sighting, rough: LightPath, std_ps: float, tips: Tips, setting: Setting
) -> Sighting:
    """The recording with the pixels that disagree with the rough path blinded.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    rough : LightPath
        A path that is roughly right, with the residuals of its pulses.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    tips : Tips
        (row, col) where the light begins and stops in the picture; None: it does not.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    Sighting
        The same counts, `blind` extended.
    """
    # What the joint fit left out as an outlier is no light of the path at that time.
    wrong = rough.residuals[~rough.residuals["used"]]
    blind = sighting.blind.copy()
    blind[wrong["row"], wrong["col"]] = True
    if len(rough.residuals):
        blind |= pixels_off_the_path(sighting, rough, std_ps, tips, setting)
    return replace(sighting, blind=blind)


def pixels_off_the_path(
    sighting: Sighting, rough: LightPath, std_ps: float, tips: Tips, setting: Setting
) -> NDArray[np.bool_]:
    """(rows, cols), True where a pixel on the path has a pulse beside the path's time.

    Such a pixel's clock is wrong, or other light sits under the leg's: the likelihood of its
    counts would pull the path. `joint` leaves such pulses out by the same gate. A pulse between
    the times of two legs is their mixed light and stays.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    rough : LightPath
        A path that is roughly right, with the residuals of its pulses.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    tips : Tips
        (row, col) where the light begins and stops in the picture; None: it does not.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    array of bool, shape (rows, cols)
    """
    arrivals = sighting.arrivals
    pulses = sighting.usable_pulses
    state = state_of_path(rough)
    gap = np.full((len(pulses), state.n_legs), np.nan)
    for k in range(state.n_legs):
        print_ = footprints(
            state,
            camera=rough.camera,
            medium=rough.medium,
            legs=k,
            rows=arrivals.row[pulses],
            cols=arrivals.col[pulses],
        )
        near = np.abs(print_.lateral_px) < LIKELIHOOD_REACH_PX
        near &= roughly_on_leg(print_, k, state)
        gap[near, k] = (sighting.arrival_ps[pulses] - print_.arrival_ps)[near]
    # Where the light begins or stops, a pixel's time is that of the lit part of its footprint.
    for tip in (tip for tip in tips if tip is not None):
        away = np.hypot(arrivals.row[pulses] - tip[0], arrivals.col[pulses] - tip[1])
        gap[away < _AT_TIP_PX] = np.nan
    on_path = np.isfinite(gap).any(axis=1)
    pulses, gap = pulses[on_path], gap[on_path]
    if not len(pulses):
        return np.zeros(arrivals.shape, dtype=bool)
    nearest = gap[np.arange(len(gap)), np.nanargmin(np.abs(gap), axis=1)]
    close = np.abs(nearest) < 2.0 * std_ps
    # Errors that all pulses share (clock scale, pose) are no fault of a pixel.
    shared = float(np.median(nearest[close])) if close.any() else 0.0
    errors = arrivals.independent_std_ps[pulses]
    gate = np.maximum(6.0 * np.hypot(errors, rough.goodness.error_floor_ps), 0.5 * std_ps)
    mixed = (np.nanmin(gap, axis=1) < 0) & (np.nanmax(gap, axis=1) > 0)
    off = (np.abs(nearest - shared) > gate) & (np.abs(nearest) < _DISTURBING * std_ps) & ~mixed
    # Beside a pulse that is the leg's, one that was fitted apart is a light of its own.
    drawn = np.isin(pulses, pulses_of_no_leg(sighting, state, setting, std_ps), invert=True)
    off &= drawn | ~further_pulses(sighting, pulses, np.abs(nearest - shared) <= gate)
    wrong = np.zeros(arrivals.shape, dtype=bool)
    wrong[arrivals.row[pulses[off]], arrivals.col[pulses[off]]] = True
    return wrong


def light_from_picture(picture: Picture, std_ps: float) -> Light:
    """Start of the brightness: the picture's splines, re-knotted over all that is in view.

    Parameters
    ----------
    picture : Picture
        Lines, brightness and spot of the legs, as the counts showed them.
    std_ps : float
        Typical standard deviation of a pulse, ps.

    Returns
    -------
    Light
        Strength per leg, spot and width.
    """
    knots, coefficients = [], []
    for leg, fit in zip(picture.legs, picture.fits, strict=True):

        def measured(along: Floats, spline: BSpline = fit.spline) -> Floats:
            seen = spline(np.clip(along, *span_of_knots(spline.t)))
            # Where nothing lit the leg the spline may fall without end: e^-12 is dark enough.
            lit: Floats = np.maximum(seen, seen.max() - 12.0)
            return lit

        knot, coefficient = strength_spline(*leg.span_px, measured, spacing_px=fit.knot_spacing_px)
        knots.append(knot)
        coefficients.append(coefficient)
    return Light(
        picture.legs,
        tuple(knots),
        tuple(coefficients),
        float(np.log(picture.spot_std_px)),
        float(np.log(std_ps)),
        tuple(fit.log_scatter for fit in picture.fits),
    )


def pixels_near_path(
    light: Light, setting: Setting, sighting: Sighting, state: PathState
) -> Pixels:
    """Pixels that a leg's light can reach, with what the calibration says of them.

    Parameters
    ----------
    light : Light
        Brightness, spot and pulse width.
    setting : Setting
        Camera, source, medium and waypoints.
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    state : PathState
        The path as it is now.

    Returns
    -------
    Pixels
        Blind pixels left out.
    """
    camera = setting.camera
    rows, cols = (index.ravel() for index in np.indices(camera.shape))
    points = undistorted_px(camera, rows, cols)
    # Pixels beyond reach would only add background, which tells nothing of the path.
    near = lit_by_legs(light.lines, points, spot_px=float(np.exp(light.log_spot_px)))
    keep = near.any(axis=1) & ~sighting.blind.ravel()
    rows, cols, near, points = rows[keep], cols[keep], near[keep], points[keep]
    timing = sighting.timing
    pixel_var, modes_ps = clock_errors(timing, rows, cols, near, state, camera, setting.medium)
    if sighting.diffuse is not None:
        more = sighting.diffuse.modes_of_legs(rows, cols, camera.shape, near.shape[1])
        modes_ps = np.concatenate((modes_ps, more), axis=2)
    return Pixels(
        rows=rows,
        cols=cols,
        near=near,
        points_px=points,
        skew_ps=timing.skew_ps[rows, cols],
        pixel_var=pixel_var,
        modes_ps=modes_ps,
    )


def codes_of_pixels(
    pixels: Pixels, sighting: Sighting, state: PathState, setting: Setting, std_ps: float
) -> CodeCounts:
    """Counts and code intervals, with what is expected of light that is no leg's.

    Parameters
    ----------
    pixels : Pixels
        The pixels that take part.
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    state : PathState
        The path as it is now.
    setting : Setting
        Camera, source, medium and waypoints.
    std_ps : float
        Typical standard deviation of a pulse, ps.

    Returns
    -------
    CodeCounts
        (n, codes) each.
    """
    found = pixel_counts(sighting, pixels.rows, pixels.cols)
    response, other = sighting.timing.response, np.empty((0, 0))
    skew = found.skew_ps[:, np.newaxis]
    intervals = found.lower_ps - skew, found.upper_ps - skew
    open_share = open_share_of(
        sighting.histograms, pixels.rows, pixels.cols, (found.lower_ps, found.upper_ps)
    )
    if sighting.diffuse is not None:
        other = sighting.diffuse.counts(
            pixels.rows, pixels.cols, intervals,
            float(sighting.histograms.laser_period_ps or 0.0), setting.camera.shape,
        )  # fmt: skip
        # As in its cells: of photons of which those that came first are counted.
        other *= open_share / open_share.max(axis=1, keepdims=True)
    pulses = strange_pulses(sighting, state, setting, std_ps)
    whole = whole_pulses(sighting, pulses)
    if whole.any():
        more = counts_of_pulses(sighting, pulses[whole], pixels.rows, pixels.cols, intervals)
        more *= open_share
        other = more if not other.size else other + more
    # What is not known well enough to be expected would be fitted as background.
    strange = np.zeros(setting.camera.shape, dtype=bool)
    strange[sighting.arrivals.row[pulses[~whole]], sighting.arrivals.col[pulses[~whole]]] = True
    return CodeCounts(
        counts=found.counts,
        lower_ps=found.lower_ps,
        upper_ps=found.upper_ps,
        period_ps=float(sighting.histograms.laser_period_ps or 0.0),
        use_outside=~strange[pixels.rows, pixels.cols],
        open_share=open_share,
        shape=np.empty((3, 0)) if response is None else response.table(),
        other=other,
    )


def photon_path(
    sightings: list[Sighting],
    setting: Setting,
    rough: LightPath,
    *,
    std_ps: float,
    tips: Tips = (None, None),
    shared: Floats | None = None,
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
        (row, col) where the light begins and stops in the picture; None: it does not.
    shared : array of float, shape (j,), optional
        Shared errors of the setting that the rough path was found with; None: none.

    Returns
    -------
    LightPath
        Refined path; its residuals are those of the same pulses.

    Raises
    ------
    NothingFoundError
        Where no pixel lies near the path, or the counts lead it out of all bounds.
    """
    whole = without_outliers(merged(sightings), rough, std_ps, tips, setting)
    # The path is seen by camera and medium as they were found, told by those of the user.
    errors = shared_errors(setting)
    shared = np.zeros(len(errors)) if shared is None else shared
    floor_ps = rough.goodness.error_floor_ps
    state = state_of_path(rough)
    light: Light | None = None
    ended: Climb | None = None
    intrinsic = std_ps
    uneven = np.zeros((*setting.camera.shape, state.n_legs), dtype=bool)
    for _ in range(_PASSES):
        previous, seen = state, moved(setting, errors, shared)
        state, ends = with_ends(state, sightings, seen, std_ps)
        # Seen in the picture now, or told by the pulses before.
        ends = replace(ends, tips=known_tips(ends.tips, tips))
        state = _ending_at_tips(state, ends, seen, None if ended is None else previous)
        try:
            picture = measure_picture(
                state, whole, camera=seen.camera, medium=seen.medium, std_ps=intrinsic
            )
        except GeometryError as lost:
            raise NothingFoundError(
                "too little light: the counts lose the path from the picture; record longer, or "
                "give a starting path (start=)"
            ) from lost
        cut_ends = (ends.tips[0] is not None, ends.tips[1] is not None)
        light = replace(light_from_picture(picture, intrinsic), cut_ends=cut_ends)
        pixels = pixels_near_path(light, seen, whole, state)
        # The floor that the pulses asked for is a clock error of each pixel.
        pixels = replace(pixels, pixel_var=pixels.pixel_var + floor_ps**2)
        if len(pixels.rows) < 3:
            raise NothingFoundError("fewer than three usable pixels lie near the path")
        codes = codes_of_pixels(pixels, whole, state, seen, std_ps)
        freedom = freedom_at(state, seen, ends, tips_move=True)
        known = uneven[pixels.rows, pixels.cols]
        # A picture led astray has light without bounds, whose score is no number.
        with np.errstate(invalid="ignore", over="ignore"):
            ended = climb(state, light, freedom, pixels, codes, setting, known, shared=shared)
        if not np.isfinite(ended.result.information).all():
            raise NothingFoundError(
                "the counts lead the path to where they tell nothing of it: check start, source "
                "and camera (lightflight check)"
            )
        state, shared = ended.state, ended.shared
        intrinsic = float(np.exp(ended.light.log_std_ps))
        found = uneven_pixels(ended, codes)
        uneven[pixels.rows, pixels.cols] |= found
        step = np.abs(state.vertices_mm - previous.vertices_mm).max()
        if step < 0.02 and not (found & ~known).any():
            break
    assert ended is not None
    refuse_run_away(state)
    return _path_from_climb(ended, rough)


def _ending_at_tips(
    state: PathState, ends: Ends, setting: Setting, climbed: PathState | None
) -> PathState:
    """The path with its ends where light begins and stops in view: as seen, or as last climbed."""
    first, last = ends.tips
    vertices, start_time = state.vertices_mm.copy(), state.start_time_ps
    if first is not None and setting.source.position_mm is None:
        if climbed is not None:
            vertices[0], start_time = climbed.vertices_mm[0], climbed.start_time_ps
        else:
            where = fraction_at(first, 0, state, setting)
            vertices[0] += where * (vertices[1] - vertices[0])
            start_time += where * float(np.diff(state.vertex_times_ps(setting.medium))[0])
    if last is not None:
        if climbed is not None:
            vertices[-1] = climbed.vertices_mm[-1]
        else:
            where = fraction_at(last, state.n_legs - 1, state, setting)
            vertices[-1] = vertices[-2] + where * (vertices[-1] - vertices[-2])
    return PathState(vertices, start_time)


def _path_from_climb(ended: Climb, rough: LightPath) -> LightPath:
    total = ended.result.information + ended.prior + ended.hold
    covariance = covariance_from_information(total, rcond=GAUGE)
    by_delay = (
        ended.result.nuisance_gain[:, 1]
        / np.sqrt(np.maximum(ended.pixels.pixel_var, 1e-12))[:, np.newaxis]
    )
    seen, n_free = ended.seen, ended.layout.n_free
    rows, to_vertices = vertices_by_parameters(
        ended.state,
        seen.medium,
        ended.freedom.basis,
        ended.errors,
        first=n_free + ended.layout.n_modes,
    )

    def at_vertices(matrix: Floats) -> Floats:
        block = (covariance @ matrix @ covariance)[np.ix_(rows, rows)]
        result: Floats = to_vertices @ block @ to_vertices.T
        return result

    pixel, shared = at_vertices(by_delay.T @ by_delay), at_vertices(ended.prior)
    whole = to_vertices @ covariance[np.ix_(rows, rows)] @ to_vertices.T
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
            n_pulses=len(ended.pixels.rows),
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
    )


def _updated_residuals(rough: LightPath, ended: Climb) -> NDArray[np.void]:
    """The pulses' residuals about the refined path."""
    seen = ended.seen
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
    pixels = zip(ended.pixels.rows, ended.pixels.cols, strict=True)
    at_pixel = {(int(row), int(col)): i for i, (row, col) in enumerate(pixels)}
    model = print_.arrival_ps.copy()
    for i, (row, col, leg) in enumerate(zip(table["row"], table["col"], legs, strict=True)):
        place = at_pixel.get((int(row), int(col)))
        if place is not None and np.isfinite(ended.local.arrival_ps[place, leg]):
            model[i] = ended.local.arrival_ps[place, leg]
    table["model_ps"] = model
    table["residual_ps"] = table["arrival_ps"] - model
    times = ended.state.vertex_times_ps(seen.medium)
    table["event_time_ps"] = times[legs] + print_.fraction * np.diff(times)[legs]
    return table
