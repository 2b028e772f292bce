"""`reconstruct`: recordings in, a `LightPath` out, by the estimator the user names."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from lightflight.arguments import check_kinds
from lightflight.camera.refraction import scene_medium
from lightflight.curves import DrawnCurve, checked_curves
from lightflight.errors import GeometryError, NothingFoundError, SuspectDataWarning
from lightflight.flight import Medium, Source
from lightflight.path.light_path import LightPath
from lightflight.reconstruct.answer import does_stand, path_from_sightings, warned
from lightflight.reconstruct.calls import (
    cameras_and_clocks,
    checked_call,
    checked_media,
    refuse_copies,
)
from lightflight.reconstruct.estimators import estimator_named
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import freed, freed_names
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.told import Waypoint, checked_lengths, checked_waypoints
from lightflight.reconstruct.sightings import sighting_from_histograms
from lightflight.reconstruct.trials.outcome import NoFit, fit_or_reason
from lightflight.reconstruct.verdict.asked import shares_asked_for
from lightflight.reconstruct.ways.joint import fit_of_request
from lightflight.reconstruct.ways.request import Request

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.code_clock import CodeClock


def reconstruct(
    hist: Histograms | Sequence[Histograms],
    *,
    camera: Camera | Sequence[Camera] | None = None,
    source: Source | None = None,
    medium: Medium | None = None,
    timing: CodeClock | Sequence[CodeClock] | None = None,
    background: Histograms | None = None,
    method: str = "joint",
    n_legs: int | None = None,
    waypoints: Sequence[Waypoint] = (),
    exclude_mask: ArrayLike | None = None,
    start: LightPath | ArrayLike | None = None,
    free: Iterable[str] = (),
    curves: Sequence[DrawnCurve] = (),
    lengths: Sequence[tuple[int, float, float]] = (),
) -> LightPath:
    """Path of the pulse in space and time from what the camera recorded.

    Parameters
    ----------
    hist : Histograms or sequence of Histograms
        One recording, or repeats of the same scene.
    camera : Camera or sequence of Camera, optional
        Where every pixel looks; needed for anything beyond (u, v, t_a). One for all recordings, or
        a list of one for each: the same flight seen from several places, fitted at once (`joint`
        and `photon`). Legs are looked for in all pictures, and the path ends where the camera that
        follows it farthest sees it leave.
    source : Source, optional
        Where and when the pulse starts, as far as known; None: nothing is known.
    medium : Medium, optional
        Group indices out and back; None: air, or what fills the scene behind the camera's window.
    timing : TimingCalibration or sequence of TimingCalibration, optional
        Calibrated clock; None: nominal codes, with a warning. With several cameras, a list of one
        for each: all clocks count from the same zero (the trigger, or one flat) but for what each
        camera says of its own (`clock_offset_ps`, `clock_offset_std_ps`).
    background : Histograms, optional
        Recording of the same scene without the flight, same clock; enters the likelihood, is not
        subtracted. Codes where it holds pulses itself (a leak, reflections) take no part.
    method : str, optional
        An estimator's name (`reconstruct.estimators.ESTIMATORS`): "paper" (literal baseline),
        "joint" (default), "photon" ...
    n_legs : int, optional
        Number of straight legs where the user knows it; legs that nobody saw may be counted or not,
        those of all branches are counted together.
    waypoints : sequence of (int, array_like, float), optional
        (vertex index, position_mm, std_mm) of corners measured otherwise.
    exclude_mask : array_like, shape (rows, cols), optional
        True for pixels that take no part.
    start : LightPath or array_like, optional
        A LightPath or vertices_mm (m, 3) to start from, instead of the search for legs.
    free : iterable of str, optional
        What to fit although it was told as exact, or nearly so; it may be off as far as the misfit
        of the path as told asks for, by its plausible size where there is none: "source",
        "emission_time", "pose", "focal_length", "aspect" (height against width), "axis" (where
        the optical axis meets the picture), "distortion", "decentering", "index", "window" (its
        distance), "clock_offset", "clock_scale", "clock_drift", "calibration" (delays that grow
        across the picture), "bend" (legs may be curves).
    curves : sequence of DrawnCurve, optional
        Curves that legs are known to run along (a fibre, a circle, a parabola). Without a `start`
        one for each leg: none is looked for in the picture.
    lengths : sequence of (int, float, float), optional
        (leg, length_mm, std_mm) of legs, from 0, whose way is known: a fibre, two mirrors measured
        with a ruler. Both ends must be corners, ends of the light in view, or the source.

    Raises
    ------
    ValueError
        For an unknown method, arguments of the wrong shape, or a recording that is given twice.
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
    check_kinds(source=source, medium=medium, background=background)
    check_kinds(lists=True, camera=camera, timing=timing)
    several = isinstance(camera, Sequence)
    cameras, clocks = cameras_and_clocks(camera, timing, repeats, method)
    of_camera = [[one] for one in repeats] if several else [repeats]
    # Everything is checked before any pulse is fitted: a wrong call must not cost minutes.
    views = [
        checked_call(own, view, source, method, n_legs, exclude_mask)
        for own, view in zip(of_camera, cameras, strict=True)
    ]
    medium = scene_medium(views[0]) if medium is None else medium
    setting = Setting(
        views[0], source, medium, checked_waypoints(waypoints, n_legs), tuple(views[1:]),
        checked_curves(curves, n_legs, begun=start is not None), checked_lengths(lengths, n_legs),
    )  # fmt: skip
    checked_media(setting, method)
    refuse_copies(repeats)
    told, wanted = clocks[0], freed_names(free)

    def seen_with(setting: Setting, clocks: Sequence[CodeClock | None]) -> list[Sighting]:
        return [
            sighting_from_histograms(
                h,
                setting.at(k if several else 0),
                timing=clock,
                background=background,
                exclude_mask=exclude_mask,
                least_squares=estimator_named(method).least_squares,
                view=k if several else 0,
            )
            for k, (h, clock) in enumerate(zip(repeats, clocks, strict=True))
        ]

    sightings, may_bend = seen_with(setting, clocks), "bend" in wanted

    def path_with(sightings: list[Sighting], setting: Setting) -> LightPath:
        return path_from_sightings(
            sightings, setting, timing=told, method=method, n_legs=n_legs, start=start,
            may_bend=may_bend,
        )  # fmt: skip

    if not any(name != "bend" for name in wanted):
        return path_with(sightings, setting)
    as_told = Request(sightings, setting, told, n_legs, start, may_bend)
    shares = _shares(as_told, wanted)
    if shares:
        # Where legs were lost as all was told, what is left of the misfit asks for too little.
        there, seen_by = freed(setting, clocks, repeats, wanted, shares)
        path = _unless_contradicted(lambda: path_with(seen_with(there, seen_by), there))
        if path is not None:
            return warned(path)
    setting, clocks = freed(setting, clocks, repeats, wanted)
    return path_with(seen_with(setting, clocks), setting)


def _unless_contradicted(attempt: Callable[[], LightPath]) -> LightPath | None:
    """A path, and no word of warning; None where there is none that its recording bears out."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        try:
            path = attempt()
        except (GeometryError, NothingFoundError):
            return None
    return path if does_stand(path) else None


def _shares(request: Request, wanted: Sequence[str]) -> dict[str, float]:
    """How far what is freed may be off, where the path as all was told says so."""
    fit = fit_or_reason(partial(fit_of_request, request))
    if isinstance(fit, NoFit):
        return {}
    return shares_asked_for(
        fit, list(fit.sightings), request.setting, wanted, n_legs=request.n_legs
    )
