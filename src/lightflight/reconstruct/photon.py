"""`photon`: the Poisson likelihood of every count, the limit of what the recording holds.

Takes a path that is roughly right (from `joint`, or from pooled counts where no pixel can be
fitted alone) and climbs the likelihood of `forward` by Fisher scoring with everything unknown at
once: path, emission time, brightness along the legs, spot, pulse width, every pixel's background
and clock error, shared clock errors. No pixel is interpolated and none is too dim.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lightflight import flags
from lightflight.errors import GeometryError, NothingFoundError
from lightflight.path import Goodness, LightPath
from lightflight.reconstruct.assignment import Tips, fraction_at, prints_of_leg
from lightflight.reconstruct.ends import Ends, freedom_at, known_tips, with_ends
from lightflight.reconstruct.forward import (
    CodeCounts,
    Layout,
    Light,
    Likelihood,
    Local,
    Pixels,
    layout_of,
    likelihood,
    local_variables,
    moved_light,
)
from lightflight.reconstruct.freedom import Freedom, state_vector
from lightflight.reconstruct.geometry import PathState, footprints, vertex_time_jacobian
from lightflight.reconstruct.lateral import KNOT_SPACING_PX
from lightflight.reconstruct.legs import undistorted_px
from lightflight.reconstruct.observation import Observation, pixel_counts
from lightflight.reconstruct.picture import Picture, measure_picture
from lightflight.reconstruct.result import prior_in_words
from lightflight.reconstruct.setting import Setting
from lightflight.timing.pile_up import open_share_of

Floats = NDArray[np.float64]

_PASSES = 3
_REACH_PX = 2.5
"""A pixel this near to a leg is on the path, px."""
_DISTURBING = 12.0
"""A strange pulse this many standard deviations from a leg's reaches into its light."""
_UNEVEN = 6.0
"""A pixel whose light departs from its leg's brightness by more standard deviations than this
tells times alone: it is hot, and loses light to its own noise, or it sees less than others."""
_FREE_SCATTER = 3.0
"""How far the brightness of such a pixel may depart, ln."""
_AT_TIP_PX = 2.5
"""Pixels this near to where the light begins or stops are not judged by their times, px."""
_MOST_STEPS = 40
_TOLERANCE = 0.01
"""A step below this many standard errors ends a climb."""
_LEVEL = 0.03
"""So does one that changes the log-likelihood by less than this, a quarter of an error at most."""
_FREE_DAMPING = 1e-2
"""Either tells that the top is near only where damping did not shorten the step."""
_SPOT_PRIOR = (np.log(0.4), 0.8)
_BEND_PRIOR = 0.3
"""How loosely neighbouring strengths are held together where no light tells (ln per knot^2)."""


@dataclass(frozen=True, eq=False)
class Climb:
    """Where a climb ended."""

    state: PathState
    light: Light
    modes: Floats
    freedom: Freedom
    layout: Layout
    pixels: Pixels
    local: Local
    log_background: Floats
    delay_shift_ps: Floats
    result: Likelihood
    departure: Floats
    """(n, L), by how much ln(photons) of each leg in a pixel departs from the leg's."""
    uneven: NDArray[np.bool_]
    """(n, L), True where it may depart freely."""
    prior: Floats
    """(P, P), information of the shared priors (source, emission time, waypoints, modes)."""
    hold: Floats
    """(P, P), information of the weak holds on brightness and spot."""
    converged: bool


def merged(observations: list[Observation]) -> Observation:
    """Repeats as one recording: counts of the same codes add, which loses nothing for one clock."""
    if len(observations) == 1:
        return observations[0]
    first = observations[0]
    counts = np.sum([o.histograms.counts.astype(np.int64) for o in observations], axis=0)
    blind = np.logical_or.reduce([o.blind for o in observations])
    frames = [o.histograms.n_frames for o in observations]
    known = [n for n in frames if n is not None]
    whole = replace(
        first.histograms,
        counts=counts.astype(np.uint64),
        n_frames=sum(known) if len(known) == len(frames) else None,
    )
    return replace(first, histograms=whole, blind=blind)


def without_outliers(
    observation: Observation, rough: LightPath, std_ps: float, tips: Tips
) -> Observation:
    """The recording with the pixels that disagree with the rough path blinded."""
    wrong = rough.residuals[~rough.residuals["used"]]
    blind = observation.blind.copy()
    blind[wrong["row"], wrong["col"]] = True
    if len(rough.residuals):
        blind |= pixels_off_the_path(observation, rough, std_ps, tips)
    return replace(observation, blind=blind)


def pixels_off_the_path(
    observation: Observation, rough: LightPath, std_ps: float, tips: Tips
) -> NDArray[np.bool_]:
    """(rows, cols), True where a pixel on the path has a pulse beside the path's time.

    Such a pixel's clock is wrong, or other light sits under the leg's: the likelihood of its
    counts would pull the path. `joint` leaves such pulses out by the same gate. A pulse between
    the times of two legs is their mixed light and stays.
    """
    arrivals = observation.arrivals
    pulses = np.flatnonzero(flags.is_usable(arrivals.flags) & np.isfinite(observation.arrival_ps))
    state = PathState(np.array(rough.vertices_mm), float(rough.vertex_times_ps[0]))
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
        low = -0.02 if k > 0 else -np.inf
        high = 1.02 if k < state.n_legs - 1 else np.inf
        near = (np.abs(print_.lateral_px) < _REACH_PX) & (print_.fraction > low)
        near &= print_.fraction < high
        gap[near, k] = (observation.arrival_ps[pulses] - print_.arrival_ps)[near]
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
    errors = np.hypot(arrivals.photon_std_ps, arrivals.pixel_std_ps)[pulses]
    gate = np.maximum(6.0 * np.hypot(errors, rough.goodness.error_floor_ps), 0.5 * std_ps)
    mixed = (np.nanmin(gap, axis=1) < 0) & (np.nanmax(gap, axis=1) > 0)
    off = (np.abs(nearest - shared) > gate) & (np.abs(nearest) < _DISTURBING * std_ps) & ~mixed
    wrong = np.zeros(arrivals.shape, dtype=bool)
    wrong[arrivals.row[pulses[off]], arrivals.col[pulses[off]]] = True
    return wrong


def light_from_picture(picture: Picture, std_ps: float) -> Light:
    """Start of the brightness: the picture's splines, re-knotted over all that is in view."""
    knots, coefficients = [], []
    for leg, fit in zip(picture.legs, picture.fits, strict=True):
        low, high = leg.span_px
        inner = np.linspace(low, high, max(2, int(np.ceil((high - low) / KNOT_SPACING_PX)) + 1))
        knot = np.concatenate((np.full(3, low), inner, np.full(3, high)))
        grid = np.linspace(low, high, 12 * len(inner))
        first, last = fit.spline.t[3], fit.spline.t[-4]
        target = fit.spline(np.clip(grid, first, last))
        target = np.maximum(target, target.max() - 12.0)
        design = BSpline.design_matrix(grid, knot, 3).toarray()
        knots.append(knot)
        coefficients.append(np.linalg.lstsq(design, target, rcond=None)[0])
    return Light(
        picture.legs,
        tuple(knots),
        tuple(coefficients),
        float(np.log(picture.spot_std_px)),
        float(np.log(std_ps)),
        tuple(fit.log_scatter for fit in picture.fits),
    )


def pixels_near_path(
    light: Light, setting: Setting, observation: Observation, state: PathState
) -> Pixels:
    """Pixels that a leg's light can reach, with what the calibration says of them."""
    camera = setting.camera
    rows, cols = (index.ravel() for index in np.indices(camera.shape))
    points = undistorted_px(camera, rows, cols)
    reach = max(2.5, 4.0 * np.exp(light.log_spot_px))
    near = np.zeros((len(rows), len(light.lines)), dtype=bool)
    for k, leg in enumerate(light.lines):
        along, across = leg.along_across(points)
        low, high = leg.span_px
        near[:, k] = (along > low - 1.5) & (along < high + 1.5) & (np.abs(across) < reach)
    keep = near.any(axis=1) & ~observation.blind.ravel()
    rows, cols, near, points = rows[keep], cols[keep], near[keep], points[keep]
    timing = observation.timing
    modes = []
    pixel_var = np.zeros(len(rows))
    for k in range(len(light.lines)):
        print_ = footprints(
            state,
            camera=camera,
            medium=setting.medium,
            legs=k,
            rows=rows,
            cols=cols,
        )
        delay = print_.arrival_ps + timing.skew_ps[rows, cols]
        delay = np.where(np.isfinite(delay) & near[:, k], delay, np.nanmedian(delay[near[:, k]]))
        pixel_std, columns, _ = timing.arrival_errors_ps(rows, cols, delay)
        pixel_var = np.where(near[:, k], np.maximum(pixel_var, pixel_std**2), pixel_var)
        modes.append(columns)
    return Pixels(
        rows=rows,
        cols=cols,
        near=near,
        points_px=points,
        skew_ps=timing.skew_ps[rows, cols],
        pixel_var=pixel_var,
        modes_ps=np.stack(modes, axis=1),
    )


def codes_of_pixels(
    pixels: Pixels, observation: Observation, state: PathState, setting: Setting, std_ps: float
) -> CodeCounts:
    """Counts and code intervals; pixels in which something else flashes are marked."""
    found = pixel_counts(observation, pixels.rows, pixels.cols)
    strange = _pixels_with_strangers(observation, state, setting, std_ps)
    response = observation.timing.response
    return CodeCounts(
        counts=found.counts,
        lower_ps=found.lower_ps,
        upper_ps=found.upper_ps,
        period_ps=float(observation.histograms.laser_period_ps or 0.0),
        use_outside=~strange[pixels.rows, pixels.cols],
        open_share=open_share_of(
            observation.histograms, pixels.rows, pixels.cols, (found.lower_ps, found.upper_ps)
        ),
        shape=np.empty((3, 0)) if response is None else response.table(),
    )


def _pixels_with_strangers(
    observation: Observation, state: PathState, setting: Setting, std_ps: float
) -> NDArray[np.bool_]:
    """(rows, cols), True where a pixel holds a pulse that belongs to no leg."""
    arrivals = observation.arrivals
    pulses = np.flatnonzero(np.isfinite(observation.arrival_ps))
    explained = np.zeros(len(pulses), dtype=bool)
    for k in range(state.n_legs):
        print_ = prints_of_leg(observation, state, setting, pulses, k)
        gap = np.abs(observation.arrival_ps[pulses] - print_.arrival_ps)
        explained |= (np.abs(print_.lateral_px) < 4.0) & (gap < 4.0 * std_ps)
    strange = np.zeros(arrivals.shape, dtype=bool)
    strange[arrivals.row[pulses[~explained]], arrivals.col[pulses[~explained]]] = True
    return strange


def _priors(freedom: Freedom, layout: Layout, light: Light) -> tuple[Floats, Floats]:
    """Information of the shared priors, and of the weak holds on brightness and spot; (P, P)."""
    prior, hold = np.zeros((layout.size, layout.size)), np.zeros((layout.size, layout.size))
    rows = freedom.prior_rows @ freedom.basis
    prior[: layout.n_free, : layout.n_free] = rows.T @ rows
    for k in range(layout.n_modes):
        prior[layout.n_free + k, layout.n_free + k] = 1.0
    for start, coefficients in zip(layout.spline_starts, light.coefficients, strict=True):
        n = len(coefficients)
        bend = _BEND_PRIOR * np.diff(np.eye(n), 2, axis=0) if n > 2 else np.zeros((0, n))
        hold[start : start + n, start : start + n] = bend.T @ bend + 1e-9 * np.eye(n)
    hold[-2, -2] = 1.0 / _SPOT_PRIOR[1] ** 2
    return prior, hold


def _prior_score(
    state: PathState,
    light: Light,
    modes: Floats,
    freedom: Freedom,
    layout: Layout,
    hold: Floats,
) -> tuple[Floats, float]:
    """Score and log-density of all priors at a point."""
    misfit = freedom.prior_values - freedom.prior_rows @ state_vector(state)
    score = np.zeros(layout.size)
    score[: layout.n_free] = (freedom.prior_rows @ freedom.basis).T @ misfit
    score[layout.n_free : layout.n_free + layout.n_modes] = -modes
    held = np.zeros(layout.size)
    for start, coefficients in zip(layout.spline_starts, light.coefficients, strict=True):
        held[start : start + len(coefficients)] = coefficients
    held[-2] = light.log_spot_px - _SPOT_PRIOR[0]
    score -= hold @ held
    value = -0.5 * float(misfit @ misfit + modes @ modes + held @ hold @ held)
    return score, value


def climb(
    state: PathState,
    light: Light,
    freedom: Freedom,
    pixels: Pixels,
    codes: CodeCounts,
    setting: Setting,
    uneven: NDArray[np.bool_],
) -> Climb:
    """Fisher scoring with Levenberg damping to the top of the likelihood."""
    scatter = np.where(uneven, _FREE_SCATTER, light.log_scatter)
    layout = layout_of(freedom.basis.shape[1], pixels.modes_ps.shape[2], light)
    prior, hold = _priors(freedom, layout, light)
    modes = np.zeros(layout.n_modes)
    background = np.log(_background_start(codes))
    shift, departure = np.zeros(len(pixels.rows)), np.zeros(pixels.near.shape)

    def evaluate(
        at: PathState, lit: Light, eta: Floats, log_b: Floats, delta: Floats, ln_shift: Floats
    ) -> tuple[Local, Likelihood, Floats, float]:
        local = local_variables(
            at,
            lit,
            pixels,
            layout,
            basis=freedom.basis,
            modes=eta,
            camera=setting.camera,
            medium=setting.medium,
        )
        found = likelihood(
            local,
            pixels,
            codes,
            log_background=log_b,
            delay_shift_ps=delta,
            log_photons_shift=ln_shift,
            log_scatter=scatter,
        )
        score, value = _prior_score(at, lit, eta, freedom, layout, hold)
        return local, found, found.score + score, found.value + value

    local, found, score, value = evaluate(state, light, modes, background, shift, departure)
    damping, converged = 1e-3, False
    for _ in range(_MOST_STEPS):
        total = found.information + prior + hold
        scale = 1.0 / np.sqrt(np.diag(total) + 1e-30)
        scaled = total * scale[:, np.newaxis] * scale + (damping + 1e-13) * np.eye(layout.size)
        step = scale * np.linalg.solve(scaled, scale * score)
        follow = found.nuisance_step + found.nuisance_gain @ step
        trial = (
            state.moved(freedom.basis @ step[: layout.n_free]),
            moved_light(light, step, layout),
            modes + step[layout.n_free : layout.n_free + layout.n_modes],
            background + np.clip(follow[:, 0], -1.5, 1.5),
            shift + follow[:, 1],
            departure + np.clip(follow[:, 2:], -1.0, 1.0),
        )
        # A step too far may leave nothing finite: it is refused below.
        with np.errstate(over="ignore", invalid="ignore"):
            new = evaluate(*trial)
        gained = new[3] - value
        higher = bool(np.isfinite(new[3]) and gained >= 0.0)
        if higher:
            state, light, modes, background, shift, departure = trial
            local, found, score, value = new
        small = float(step @ total @ step) < _TOLERANCE**2 * layout.n_free
        if damping <= _FREE_DAMPING and (small or abs(gained) < _LEVEL):
            converged = True
            break
        damping = max(damping / 10, 1e-9) if higher else damping * 10
        if damping > 1e10:
            break
    return Climb(
        state, light, modes, freedom, layout, pixels, local, background, shift, found,
        departure, uneven, prior, hold, converged,
    )  # fmt: skip


def uneven_pixels(ended: Climb, codes: CodeCounts) -> NDArray[np.bool_]:
    """(n, L), True where a pixel's light departs from its leg's brightness beyond chance."""
    free = likelihood(
        ended.local,
        ended.pixels,
        codes,
        log_background=ended.log_background,
        delay_shift_ps=ended.delay_shift_ps,
        log_photons_shift=ended.departure,
        log_scatter=_FREE_SCATTER,
    )
    departure = ended.departure + free.nuisance_step[:, 2:]
    std = free.nuisance_std[:, 2:]
    usual = np.hypot(std, ended.light.log_scatter)
    telling = ended.pixels.near & (std < 0.3 * _FREE_SCATTER)
    scaled = np.abs(departure) / usual
    spread = max(1.0, 1.4826 * float(np.median(scaled[telling]))) if telling.any() else 1.0
    wrong: NDArray[np.bool_] = telling & (scaled > _UNEVEN * spread)
    return wrong


def _background_start(codes: CodeCounts) -> Floats:
    """Counts per ps of each pixel: the median code, or the mean where that is empty."""
    width = codes.upper_ps - codes.lower_ps
    live = width > 0
    rate = np.where(live, codes.counts / np.where(live, width, 1.0), np.nan)
    low = np.nanquantile(rate, 0.9, axis=1)
    quiet = np.where(rate <= low[:, np.newaxis] + 1e-30, codes.counts, 0.0).sum(axis=1)
    span = np.where(rate <= low[:, np.newaxis] + 1e-30, width, 0.0).sum(axis=1)
    start: Floats = (quiet + 0.5) / np.maximum(span, 1e-9)
    return start


def photon_path(
    observations: list[Observation],
    setting: Setting,
    rough: LightPath,
    *,
    std_ps: float,
    tips: Tips = (None, None),
) -> LightPath:
    """Refine a rough path by the likelihood of all counts.

    `tips` says where the light begins and stops in the picture, where that is known already.

    Raises
    ------
    NothingFoundError
        Where no pixel lies near the path.
    """
    whole = without_outliers(merged(observations), rough, std_ps, tips)
    floor_ps = rough.goodness.error_floor_ps
    state = PathState(np.array(rough.vertices_mm), float(rough.vertex_times_ps[0]))
    light: Light | None = None
    ended: Climb | None = None
    intrinsic = std_ps
    uneven = np.zeros((*setting.camera.shape, state.n_legs), dtype=bool)
    for _ in range(_PASSES):
        previous = state
        state, ends = with_ends(state, observations, setting, std_ps)
        ends = replace(ends, tips=known_tips(ends.tips, tips))
        state = _ending_at_tips(state, ends, setting, None if ended is None else previous)
        try:
            picture = measure_picture(
                state, whole, camera=setting.camera, medium=setting.medium, std_ps=intrinsic
            )
        except GeometryError as lost:
            raise NothingFoundError(
                "too little light: the counts lose the path from the picture; record longer, or "
                "give a starting path (start=)"
            ) from lost
        cut_ends = (ends.tips[0] is not None, ends.tips[1] is not None)
        light = replace(light_from_picture(picture, intrinsic), cut_ends=cut_ends)
        pixels = pixels_near_path(light, setting, whole, state)
        pixels = replace(pixels, pixel_var=pixels.pixel_var + floor_ps**2)
        if len(pixels.rows) < 3:
            raise NothingFoundError("fewer than three usable pixels lie near the path")
        codes = codes_of_pixels(pixels, whole, state, setting, std_ps)
        freedom = freedom_at(state, setting, ends, tips_move=True)
        known = uneven[pixels.rows, pixels.cols]
        ended = climb(state, light, freedom, pixels, codes, setting, known)
        state = ended.state
        intrinsic = float(np.exp(ended.light.log_std_ps))
        found = uneven_pixels(ended, codes)
        uneven[pixels.rows, pixels.cols] |= found
        moved = np.abs(state.vertices_mm - previous.vertices_mm).max()
        if moved < 0.02 and not (found & ~known).any():
            break
    assert ended is not None
    return _path_from_climb(ended, setting, rough)


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


def _path_from_climb(ended: Climb, setting: Setting, rough: LightPath) -> LightPath:
    total = ended.result.information + ended.prior + ended.hold
    scale = 1.0 / np.sqrt(np.diag(total) + 1e-30)
    inverse = np.linalg.pinv(total * scale[:, np.newaxis] * scale, rcond=1e-13, hermitian=True)
    covariance = inverse * scale[:, np.newaxis] * scale
    by_delay = (
        ended.result.nuisance_gain[:, 1]
        / np.sqrt(np.maximum(ended.pixels.pixel_var, 1e-12))[:, np.newaxis]
    )
    to_vertices = (
        vertex_time_jacobian(ended.state.vertices_mm, setting.medium) @ ended.freedom.basis
    )
    n_free = ended.layout.n_free

    def at_vertices(matrix: Floats) -> Floats:
        block = (covariance @ matrix @ covariance)[:n_free, :n_free]
        result: Floats = to_vertices @ block @ to_vertices.T
        return result

    pixel, shared = at_vertices(by_delay.T @ by_delay), at_vertices(ended.prior)
    whole = to_vertices @ covariance[:n_free, :n_free] @ to_vertices.T
    residuals = _updated_residuals(rough, ended, setting)
    used = residuals["used"]
    squared = (residuals["residual_ps"][used] / residuals["std_ps"][used]) ** 2
    return replace(
        rough,
        vertices_mm=ended.state.vertices_mm,
        vertex_times_ps=ended.state.vertex_times_ps(setting.medium),
        covariance=whole,
        method="photon",
        goodness=Goodness(
            chi2=float(np.sum(squared)),
            dof=max(0, int(used.sum()) - n_free),
            n_pulses=len(ended.pixels.rows),
            n_rejected=int((~used).sum()),
            residual_rms_ps=float(np.sqrt(np.mean(residuals["residual_ps"][used] ** 2)))
            if used.any()
            else float("nan"),
            error_floor_ps=rough.goodness.error_floor_ps,
            converged=ended.converged,
        ),
        covariance_parts={"photon": whole - pixel - shared, "pixel": pixel, "shared": shared},
        residuals=residuals,
        prior=prior_in_words(setting.source),
    )


def _updated_residuals(rough: LightPath, ended: Climb, setting: Setting) -> NDArray[np.void]:
    """The pulses' residuals about the refined path."""
    table = rough.residuals.copy()
    legs = table["leg"].astype(np.int64)
    print_ = footprints(
        ended.state,
        camera=setting.camera,
        medium=setting.medium,
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
    times = ended.state.vertex_times_ps(setting.medium)
    table["event_time_ps"] = times[legs] + print_.fraction * np.diff(times)[legs]
    return table
