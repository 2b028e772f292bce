"""`reconstruct`: recordings in, a `LightPath` out, by the estimator the user names."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags
from lightflight.errors import (
    CalibrationError,
    GeometryError,
    NothingFoundError,
    SuspectDataWarning,
    UncalibratedWarning,
)
from lightflight.flight import Medium, Source
from lightflight.path import RESIDUAL_DTYPE, LightPath
from lightflight.reconstruct.assignment import Tips
from lightflight.reconstruct.code_direction import (
    ask_which_way,
    legs_of_straight_light,
    refuse_if_clearer_backwards,
    warn_of_scatter,
)
from lightflight.reconstruct.freedom import Waypoint, checked_waypoints
from lightflight.reconstruct.geometry import PathState
from lightflight.reconstruct.joint import JointFit, fit_joint, pulse_std_ps
from lightflight.reconstruct.legs import unwrapped_arrivals
from lightflight.reconstruct.observation import Observation, blind_pixels
from lightflight.reconstruct.result import on_first_lap, path_from_fit
from lightflight.reconstruct.revise import fit_from_legs, revised, with_n_legs
from lightflight.reconstruct.setting import Setting, earliest_arrival_ps
from lightflight.reconstruct.statements import statements_from_covariance
from lightflight.reconstruct.unclaimed import from_unclaimed_legs, with_unclaimed_legs
from lightflight.timing.arrivals import find_arrivals
from lightflight.timing.calibration import ASSUMED_GAIN_STD, TimingCalibration

if TYPE_CHECKING:
    from lightflight.camera import Camera
    from lightflight.histogram import Histograms
    from lightflight.timing.arrivals import Arrivals

Floats = NDArray[np.float64]

_POOLING = (2, 4)
"""Pixels pooled along each axis where single ones are too dim."""

_FEW_PULSES = 12
"""A leg that no more pulses than this speak for is looked at again by all its counts."""
_SHORT_PX = 40.0
"""The tips of a leg no longer than this in the picture, px, hold much of what it can tell."""
_WORSE_CHI2 = 10.0
"""The path by all counts must not miss the pulses by more than this."""

_MOST_PERIODS = 2.0
"""Codes that cover more laser periods than this are worth a question."""

METHODS = ("paper", "joint", "photon")
"""Estimators, from the paper's to the limit."""


def reconstruct(
    hist: Histograms | Sequence[Histograms],
    *,
    camera: Camera | Sequence[Camera] | None = None,
    source: Source | None = None,
    medium: Medium | None = None,
    timing: TimingCalibration | Sequence[TimingCalibration] | None = None,
    background: Histograms | None = None,
    method: str = "joint",
    n_legs: int | None = None,
    waypoints: Sequence[Waypoint] = (),
    exclude_mask: ArrayLike | None = None,
    start: LightPath | ArrayLike | None = None,
) -> LightPath:
    """Path of the pulse in space and time from what the camera recorded.

    Parameters
    ----------
    hist : one recording, or repeats of the same scene.
    camera : where every pixel looks; needed for anything beyond (u, v, t_a). One for all
        recordings, or a list of one for each: the same flight seen from several places, fitted
        at once (`joint` only). Legs are looked for in the first camera's picture, and where that
        one's view ends the path ends.
    source : where and when the pulse starts, as far as known; None: nothing is known.
    medium : group indices out and back; None: air.
    timing : calibrated clock; None: nominal codes, with a warning. With several cameras, a list
        of one for each: all clocks count from the same zero (the trigger, or one flat).
    background : recording without the pulse, same clock; enters the likelihood, is not subtracted.
    method : "paper" (literal baseline), "joint" (default) or "photon".
    n_legs : number of straight legs where the user knows it.
    waypoints : (vertex index, position_mm, std_mm) of corners measured otherwise.
    exclude_mask : (rows, cols), True for pixels that take no part.
    start : a LightPath or vertices_mm (m, 3) to start from, instead of the search for legs.

    Raises
    ------
    ValueError
        For an unknown method or arguments of the wrong shape.
    CalibrationError
        Where the time per bin is unknown, the calibration belongs to another camera, or the codes
        run the other way than stated.
    GeometryError
        Where the camera is missing, or camera, source and path are in a degenerate position.
    NothingFoundError
        Where no path stands out, with the reason.
    """
    repeats = [hist] if not isinstance(hist, Sequence) else list(hist)
    source = Source() if source is None else source
    medium = Medium() if medium is None else medium
    several = isinstance(camera, Sequence)
    cameras, clocks = _views(camera, timing, repeats, method)
    of_camera = [[one] for one in repeats] if several else [repeats]
    views = [
        checked_call(own, view, source, method, n_legs, exclude_mask)
        for own, view in zip(of_camera, cameras, strict=True)
    ]
    setting = Setting(
        views[0], source, medium, checked_waypoints(waypoints, n_legs), tuple(views[1:])
    )
    observations = [
        observe(
            h,
            setting.at(k if several else 0),
            timing=clock,
            background=background,
            exclude_mask=exclude_mask,
            least_squares=method == "paper",
            view=k if several else 0,
        )
        for k, (h, clock) in enumerate(zip(repeats, clocks, strict=True))
    ]
    return path_from_observations(
        observations, setting, timing=clocks[0], method=method, n_legs=n_legs, start=start
    )


def path_from_observations(
    observations: list[Observation],
    setting: Setting,
    *,
    timing: TimingCalibration | None,
    method: str = "joint",
    n_legs: int | None = None,
    start: LightPath | ArrayLike | None = None,
) -> LightPath:
    """Path from recordings whose pulses are found; parameters and errors as in `reconstruct`."""
    path = _path_on_some_lap(
        observations, setting, timing=timing, method=method, n_legs=n_legs, start=start
    )
    return path if start is not None else on_first_lap(path, observations[0])


def _path_on_some_lap(
    observations: list[Observation],
    setting: Setting,
    *,
    timing: TimingCalibration | None,
    method: str,
    n_legs: int | None,
    start: LightPath | ArrayLike | None,
) -> LightPath:
    if method == "paper":
        from lightflight.reconstruct.paper import paper_path

        found = legs_of_straight_light(observations[0], setting, n_legs) if start is None else None
        return paper_path(observations, setting, legs=found)
    tips: Tips = (None, None)
    try:
        fit = _joint_fit(observations, setting, timing=timing, n_legs=n_legs, start=start)
        path, tips = _joint_path(fit, observations, setting, timing), fit.tips
        std_ps = pulse_std_ps(observations)
    except NothingFoundError:
        if method != "photon" or start is not None:
            raise
        path, std_ps = _pooled_path(observations, setting, timing=timing, n_legs=n_legs)
    if method == "photon":
        from lightflight.reconstruct.photon import photon_path

        return photon_path(observations, setting, path, std_ps=std_ps, tips=tips)
    return _by_all_counts(observations, fit, setting, path)


def _joint_fit(
    observations: list[Observation],
    setting: Setting,
    *,
    timing: TimingCalibration | None,
    n_legs: int | None,
    start: LightPath | ArrayLike | None,
) -> JointFit:
    """The joint fit, from legs in the picture or from the user's start."""
    if start is not None:
        return fit_joint(observations, _state_from_start(start, setting), setting, legs=None)
    legs = legs_of_straight_light(observations[0], setting, n_legs)
    try:
        fit = fit_from_legs(observations, legs, setting, drop=n_legs is None)
    except (GeometryError, NothingFoundError) as problem:
        refuse_if_clearer_backwards(legs, observations[0], setting, n_legs)
        ask_which_way(legs, observations[0], setting.camera, timing, problem)
        longer = from_unclaimed_legs(observations, legs, setting) if n_legs is None else None
        if longer is None:
            raise
        fit = longer
    if n_legs is None:
        fit = with_unclaimed_legs(observations, legs, revised(observations, fit, setting), setting)
    else:
        fit = with_n_legs(observations, fit, setting, n_legs)
    if timing is None and fit.floor_ps > 0.2 * pulse_std_ps(observations):
        warn_of_scatter(fit.floor_ps, legs, observations[0], setting.camera)
    return fit


def _joint_path(
    fit: JointFit,
    observations: list[Observation],
    setting: Setting,
    timing: TimingCalibration | None,
) -> LightPath:
    return path_from_fit(
        fit,
        observations,
        setting,
        method="joint",
        statements=_statements(fit, timing),
        truth=observations[0].histograms.truth,
    )


def _by_all_counts(
    observations: list[Observation], fit: JointFit, setting: Setting, path: LightPath
) -> LightPath:
    """The path; where pulses alone leave much unsaid, by all counts, if those agree with them.

    A short leg near a corner or the picture's edge may settle on a wrong line: at wrong times
    its light is not seen. Where the light begins or stops in the picture, the pulses there took no
    part. Counts that no single pulse claims speak for both.
    """
    why = _why_all_counts(fit)
    if not why or setting.others or not all(o.histograms.poisson for o in observations):
        return path
    from lightflight.reconstruct.photon import photon_path

    try:
        better = photon_path(
            observations, setting, path, std_ps=pulse_std_ps(observations), tips=fit.tips
        )
    except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
        return path
    worse = better.goodness.chi2 > path.goodness.chi2 + _WORSE_CHI2
    if worse or not better.goodness.converged:
        return path
    said = f"{why}: all counts were fitted."
    return replace(better, method="joint", statements=(said, *path.statements))


def _why_all_counts(fit: JointFit) -> str:
    """What pulses alone do not tell of a path; empty where they tell all."""
    n_legs = fit.solution.state.n_legs
    used = np.bincount(fit.times.leg[fit.times.weight > 0], minlength=n_legs)
    weak = np.flatnonzero(used <= _FEW_PULSES)
    if len(weak):
        return f"Leg {weak[0] + 1} rests on {used[weak[0]]} pulses"
    for leg, tip in zip((0, n_legs - 1), fit.tips, strict=True):
        first, last = fit.pictures[0].legs[leg].span_px
        if tip is not None and last - first < _SHORT_PX:
            return "Light begins or stops within the picture"
    return ""


def _pooled_path(
    observations: list[Observation],
    setting: Setting,
    *,
    timing: TimingCalibration | None,
    n_legs: int | None,
) -> tuple[LightPath, float]:
    """A rough path where no pixel can be fitted alone, and the pulses' std, ps.

    Pixels are pooled two by two, four by four ... until legs appear.

    Raises
    ------
    NothingFoundError
        Where even the coarsest picture shows no path.
    """
    from lightflight.reconstruct.photon import merged
    from lightflight.reconstruct.pooled import pooled_camera, pooled_observation

    whole = merged(observations)
    problem: Exception | None = None
    for factor in _POOLING:
        if min(setting.camera.shape) // factor < 4:
            break
        coarse = replace(setting, camera=pooled_camera(setting.camera, factor))
        try:
            pooled = [unwrapped_observation(pooled_observation(whole, factor), coarse)]
            fit = _joint_fit(pooled, coarse, timing=timing, n_legs=n_legs, start=None)
            path = _joint_path(fit, pooled, coarse, timing)
        except (GeometryError, NothingFoundError, CalibrationError) as found:
            problem = found
            continue
        rough = replace(path, camera=setting.camera, residuals=np.empty(0, RESIDUAL_DTYPE))
        return rough, pulse_std_ps(pooled)
    raise NothingFoundError(
        "too little light: no pixel can be fitted alone and pooled pixels show no path; record "
        "longer, or give a starting path (start=)"
    ) from problem


def unwrapped_observation(observation: Observation, setting: Setting) -> Observation:
    """The observation with arrivals folded to where light can come from."""
    times = unwrapped_arrivals(
        observation.arrivals.arrival_ps,
        period_ps=observation.arrivals.laser_period_ps,
        earliest_ps=earliest_arrival_ps(setting),
    )
    return replace(
        observation, arrivals=replace(observation.arrivals, arrival_ps=times), arrival_ps=times
    )


def _views(
    camera: Camera | Sequence[Camera] | None,
    timing: TimingCalibration | Sequence[TimingCalibration] | None,
    recordings: list[Any],
    method: str,
) -> tuple[list[Camera | None], list[TimingCalibration | None]]:
    """Cameras (one for all, or one for each recording), and a clock for each recording."""
    if not recordings:
        raise ValueError("hist is an empty list: give at least one recording")
    clocks: list[TimingCalibration | None] = (
        list(timing) if isinstance(timing, Sequence) else [timing] * len(recordings)
    )
    cameras: list[Camera | None] = list(camera) if isinstance(camera, Sequence) else [camera]
    if len(clocks) != len(recordings):
        raise ValueError(
            f"{len(clocks)} calibrations for {len(recordings)} recordings: give one for each"
        )
    if isinstance(camera, Sequence) and len(cameras) != len(recordings):
        raise ValueError(
            f"{len(cameras)} cameras for {len(recordings)} recordings: give one for all, or one "
            "for each"
        )
    if len(cameras) > 1 and method != "joint":
        raise ValueError(
            f"method={method!r} takes one camera: fit several at once with method='joint'"
        )
    return cameras, clocks


def checked_call(
    repeats: list[Any],
    camera: Camera | None,
    source: Source,
    method: str,
    n_legs: int | None,
    exclude_mask: ArrayLike | None,
) -> Camera:
    """Everything that can be wrong with a call, before any work."""
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if n_legs is not None and (n_legs != int(n_legs) or n_legs < 1):
        raise ValueError(f"n_legs must be a whole number of at least 1, got {n_legs}")
    for one in repeats:
        if not hasattr(one, "counts"):
            raise TypeError(
                f"hist must be Histograms or a list of them, got {type(one).__name__}: "
                "histogram a recording first (lightflight.histogram)"
            )
        if one.bin_width_ps is None:
            raise CalibrationError(
                "the time per bin of this recording is unknown, so positions have no scale: give "
                "bin_width_ps (the legs in the picture need neither: lightflight.find_legs)"
            )
    if camera is None:
        raise GeometryError(
            "the camera's place is unknown, so arrival times have no geometry: give camera= (for "
            "instance Camera.facing_plane with its distance and field of view)"
        )
    for one in repeats:
        if tuple(one.shape) != tuple(camera.shape):
            raise GeometryError(
                f"the recording has {one.shape[0]} x {one.shape[1]} pixels and the camera "
                f"{camera.shape[0]} x {camera.shape[1]}: give the camera that recorded it"
            )
    if method == "photon" and not all(one.poisson for one in repeats):
        raise ValueError(
            "method='photon' needs photon counts, and this recording holds scaled intensities "
            "(poisson=False): use method='joint'"
        )
    if exclude_mask is not None and np.shape(exclude_mask) != tuple(camera.shape):
        raise ValueError(
            f"exclude_mask must have the camera's shape {camera.shape}, got "
            f"{np.shape(exclude_mask)}"
        )
    if source.position_mm is not None:
        gap = np.linalg.norm(np.asarray(source.position_mm, dtype=float) - camera.center_mm)
        if gap < 1e-6:
            raise GeometryError(
                "the source sits on the camera: every direction then gives the same times; check "
                "position_mm and the camera's pose"
            )
    return camera


def observe(
    hist: Histograms,
    setting: Setting,
    *,
    timing: TimingCalibration | None,
    background: Histograms | None,
    exclude_mask: ArrayLike | None,
    least_squares: bool,
    view: int = 0,
) -> Observation:
    """Pulses of one recording on the clock, unwrapped."""
    clock = clock_or_nominal(hist, timing)
    arrivals = find_arrivals(
        hist,
        timing=clock,
        background=background,
        exclude_mask=None if exclude_mask is None else np.asarray(exclude_mask, dtype=bool),
        # The paper fits one Gaussian per pixel and discards what is too wide for one.
        method="least_squares" if least_squares else "likelihood",
        max_pulses=1 if least_squares else 3,
    )
    _check_period(hist, arrivals)
    return unwrapped_observation(
        Observation(hist, clock, arrivals, arrivals.arrival_ps, blind_pixels(arrivals), view),
        setting,
    )


def _check_period(hist: Histograms, arrivals: Arrivals) -> None:
    """Ask about a laser period that the codes go far beyond.

    One that the pulses fill is refused where they are fitted (`timing._pulse_checks`).
    """
    period_ps = hist.laser_period_ps
    if period_ps is None or hist.bin_width_ps is None:
        return
    covered = hist.n_codes * hist.bin_width_ps / period_ps
    if covered <= _MOST_PERIODS:
        return
    doubt = (
        f"the codes cover {covered:.1f} laser periods of {period_ps:g} ps: check "
        "laser_period_ps and bin_width_ps"
    )
    if not flags.is_usable(arrivals.flags).any():
        raise CalibrationError(f"no pixel shows a pulse, and {doubt}")
    warnings.warn(doubt, SuspectDataWarning, stacklevel=4)


def clock_or_nominal(hist: Histograms, timing: TimingCalibration | None) -> TimingCalibration:
    """The calibration, if it fits the recording; else the nominal clock, with a warning."""
    if timing is not None:
        timing.check_matches(hist)
        return timing
    clock = TimingCalibration.nominal(hist)
    span_ps = clock.laser_period_ps or hist.n_codes * clock.bin_width_ps
    warnings.warn(
        "no timing calibration: nominal codes are used. Unequal codes cost 3-6 ps per pixel, "
        f"unequal gains {100 * ASSUMED_GAIN_STD:.2g} % of the delay (up to "
        f"{ASSUMED_GAIN_STD * span_ps:.0f} ps), and the delays between pixels, often hundreds of "
        "ps, go unseen; give timing=",
        UncalibratedWarning,
        stacklevel=4,
    )
    return clock


def _state_from_start(start: Any, setting: Setting) -> PathState:
    if hasattr(start, "vertices_mm"):
        return PathState(np.array(start.vertices_mm, dtype=float), float(start.vertex_times_ps[0]))
    vertices = np.asarray(start, dtype=float)
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


def _statements(fit: JointFit, timing: TimingCalibration | None) -> tuple[str, ...]:
    """What the result rests on, and what the data leave open."""
    said = []
    if timing is None:
        said.append("The clock is nominal: no timing calibration was given.")
    if fit.floor_ps > 0:
        said.append(
            f"The times scatter about the path by {fit.floor_ps:.2g} ps more than their stated "
            "errors; the error bars include that."
        )
    if not fit.solution.converged:
        said.append("The fit stopped before it converged: do not trust its errors.")
    n_free = len(fit.labels)
    said.extend(statements_from_covariance(fit.solution.covariance[:n_free, :n_free], fit.labels))
    return tuple(said)
