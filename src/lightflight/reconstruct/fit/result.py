"""From a fit to a `LightPath`: covariance in three error classes, residuals, and what it means."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight.flight import Source
from lightflight.path.light_path import LightPath
from lightflight.path.second_pulse import SecondPulse
from lightflight.path.tables import RESIDUAL_DTYPE, Explained, Goodness
from lightflight.reconstruct.fit.joint import JointFit, refuse_run_away
from lightflight.reconstruct.model.geometry import footprints
from lightflight.reconstruct.model.second_path import SecondPath
from lightflight.reconstruct.model.second_pulse import Echo
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import group_index_std, vertices_by_parameters
from lightflight.reconstruct.model.sighting import Sighting

Floats = NDArray[np.float64]

_BEFORE_ZERO_PS = 1000.0
"""A path may start this long before the clock's zero and still be told there, ps."""


def prior_in_words(source: Source) -> str:
    """What was taken as known of source and emission time, for tables and titles."""
    if source.position_mm is None:
        return "source unknown"
    std = np.asarray(source.position_std_mm)
    place = "source known" if not std.any() else f"source ± {float(std.max()):g} mm"
    if source.emission_time_ps is None:
        return f"{place}, emission time fitted"
    if source.emission_time_std_ps > 0:
        return f"{place}, emission time ± {source.emission_time_std_ps:g} ps"
    return f"{place}, emission time known"


def covariance_parts(fit: JointFit) -> dict[str, Floats]:
    """Covariance of (x, y, z, t) of every vertex, then of bends, by error class.

    Each (4m + b, 4m + b), b coefficients of bends.

    "photon" is independent from recording to recording; "pixel" (calibration of each pixel, and
    the floor the residuals ask for) averages over pixels but not over repeats; "shared" comes
    from clock scale, emission time, pose and source.

    Parameters
    ----------
    fit : JointFit
        The joint fit.

    Returns
    -------
    dict of str to array of float
        "photon", "pixel" and "shared"; together the whole.
    """
    solution, times = fit.solution, fit.times
    rows, to_vertices = vertices_by_parameters(
        solution.state,
        solution.medium,
        fit.freedom.basis,
        solution.errors,
        first=len(solution.covariance) - len(solution.shared),
    )
    gain = to_vertices @ solution.photon_gain[rows]
    line_gain = to_vertices @ solution.line_gain[rows]
    photon = (gain * times.photon_var) @ gain.T + line_gain @ line_gain.T
    view = 2.0**32 * times.view
    # A pixel of each camera its own: pulses of one pixel share its calibration error.
    pixel_id = np.unique(view + times.row * 65536.0 + times.col, return_inverse=True)[1]
    per_pixel = np.zeros((len(gain), pixel_id.max() + 1))
    # Summed before squaring: the same error moves all pulses of a pixel alike.
    np.add.at(per_pixel.T, pixel_id, (gain * np.sqrt(times.pixel_var)).T)
    floor = (gain * fit.floor_ps**2) @ gain.T
    shared = to_vertices @ solution.prior_covariance[np.ix_(rows, rows)] @ to_vertices.T
    return {"photon": photon, "pixel": per_pixel @ per_pixel.T + floor, "shared": shared}


def residual_table(fit: JointFit, sightings: list[Sighting]) -> NDArray[np.void]:
    """One row per pulse on the path that the first camera saw; dtype `path.RESIDUAL_DTYPE`.

    Parameters
    ----------
    fit : JointFit
        The joint fit.
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.

    Returns
    -------
    structured array, shape (n,)
        Of dtype `path.RESIDUAL_DTYPE`; outliers are flagged.
    """
    times, solution = fit.times, fit.solution
    state = solution.state
    table = np.zeros(len(times.leg), RESIDUAL_DTYPE)
    print_ = footprints(
        state,
        camera=solution.cameras[0],
        medium=solution.medium,
        legs=times.leg,
        rows=times.row,
        cols=times.col,
    )
    table["row"], table["col"], table["leg"] = times.row, times.col, times.leg
    table["arrival_ps"] = times.arrival_ps
    table["residual_ps"] = fit.solution.residual_ps
    table["model_ps"] = times.arrival_ps - fit.solution.residual_ps
    table["std_ps"] = np.sqrt(times.photon_var + times.pixel_var + fit.floor_ps**2)
    table["event_time_ps"] = state.event_times_ps(times.leg, print_.fraction, solution.medium)
    table["used"] = times.weight > 0
    for number, sighting in enumerate(sightings):
        here = fit.sighting_of == number
        index = times.index[here]
        table["photons"][here] = sighting.arrivals.photons[index]
        table["flags"][here] = sighting.arrivals.flags[index]
    table["flags"][~table["used"]] |= np.uint32(flags.OUTLIER)
    of_first: NDArray[np.void] = table[times.view == 0]
    return of_first


def path_from_fit(
    fit: JointFit,
    sightings: list[Sighting],
    setting: Setting,
    *,
    statements: tuple[str, ...] = (),
    truth: Any = None,
) -> LightPath:
    """The fit as the record users get.

    Parameters
    ----------
    fit : JointFit
        The joint fit.
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    setting : Setting
        Camera, source, medium and waypoints.
    statements : tuple of str, optional
        What it rests on and leaves open, one sentence each.
    truth : object, optional
        What made the recording, where a simulator knows it.

    Returns
    -------
    LightPath
        Covariance in three classes, residuals, goodness and prior.
    """
    solution = fit.solution
    refuse_run_away(solution.state, solution.rows)
    parts = covariance_parts(fit)
    used = fit.times.weight > 0
    residual = solution.residual_ps[used]
    stated = (fit.times.photon_var + fit.times.pixel_var)[used]
    goodness = Goodness(
        chi2=float(np.sum(residual**2 / stated)),
        dof=solution.dof,
        n_pulses=int(used.sum()),
        n_rejected=int((~used).sum()),
        residual_rms_ps=float(np.sqrt(np.mean(residual**2))),
        error_floor_ps=fit.floor_ps,
        converged=solution.converged,
        chi2_with_floor=float(np.sum(residual**2 / (stated + fit.floor_ps**2))),
    )
    whole = parts["photon"] + parts["pixel"] + parts["shared"]
    n = 4 * len(solution.state.vertices_mm)
    second = second_pulse_of_fit(fit)
    if second is not None:
        statements = (*statements, f"A second pulse flew the same path: {second}.")
    first = len(solution.covariance) - len(solution.shared)
    return LightPath(
        solution.state.vertices_mm,
        solution.state.vertex_times_ps(solution.medium),
        whole[:n, :n],
        camera=solution.cameras[0],
        source=setting.source,
        medium=solution.medium,
        method="joint",
        goodness=goodness,
        covariance_parts={name: part[:n, :n] for name, part in parts.items()},
        residuals=residual_table(fit, sightings),
        prior=prior_in_words(setting.source),
        statements=statements,
        truth=truth,
        unseen_legs=solution.state.unseen,
        forks=solution.state.forks,
        bends=solution.state.bends,
        bend_covariance=whole[:, n:],
        second_pulse=second,
        group_index_std=group_index_std(solution.errors, solution.covariance[first:, first:]),
    )


def explained(path: LightPath, fit: JointFit | None, sightings: list[Sighting]) -> Explained | None:
    """How much of what was found in the recordings a path explains.

    Parameters
    ----------
    path : LightPath
        The path; its residuals tell of it where there is no fit of single pulses.
    fit : JointFit or None
        The fit of single pulses that it rests on.
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.

    Returns
    -------
    Explained or None
        None where the path rests on no single pulse.
    """
    if fit is not None:
        return explained_by_fit(fit, sightings)
    table = path.residuals[path.residuals["used"]]
    if not len(table):
        return None
    n_found, photons_found = _found_in(sightings)
    return Explained(len(table), n_found, float(table["photons"].sum()), photons_found)


def explained_by_fit(fit: JointFit, sightings: list[Sighting]) -> Explained:
    """How much of what was found in the recordings a fit of single pulses explains.

    Parameters
    ----------
    fit : JointFit
        The fit.
    sightings : list of Sighting
        Those it was made of.

    Returns
    -------
    Explained
        Of all recordings together.
    """
    on_path = []
    for number, sighting in enumerate(sightings):
        # A pulse where two legs meet may stand in both.
        own = np.unique(fit.times.index[(fit.sighting_of == number) & (fit.times.weight > 0)])
        on_path.append(sighting.arrivals.photons[own])
    n_found, photons_found = _found_in(sightings)
    photons = float(sum(np.nansum(one) for one in on_path))
    return Explained(sum(map(len, on_path)), n_found, photons, photons_found)


def _found_in(sightings: list[Sighting]) -> tuple[int, float]:
    """Number of usable pulses, and of their photons."""
    n, photons = 0, 0.0
    for sighting in sightings:
        # Those that hold too little of a leg's light to have its time were found, too.
        arrivals = sighting.arrivals
        found = np.flatnonzero(flags.is_usable(arrivals.flags) & np.isfinite(arrivals.arrival_ps))
        n += len(found)
        photons += float(np.nansum(sighting.arrivals.photons[found]))
    return n, photons


def mirror_of_fit(fit: JointFit) -> SecondPath | None:
    """The mirror that shows the flight once more, as a fit has found it; None: there is none."""
    seen = (one.diffuse.second for one in fit.sightings if one.diffuse is not None)
    return next((one for one in seen if isinstance(one, SecondPath)), None)


def second_pulse_of_fit(fit: JointFit) -> SecondPulse | None:
    """The second pulse that a fit has found; where several clocks saw it, their mean.

    Parameters
    ----------
    fit : JointFit
        With the light beside the path at its place.

    Returns
    -------
    SecondPulse or None
        None: there is none.
    """
    seen: dict[tuple[int, int], tuple[Echo, float]] = {}
    for number, sighting in enumerate(fit.sightings):
        echo = None if sighting.diffuse is None else sighting.diffuse.second
        key = sighting.view, id(sighting.timing)
        if isinstance(echo, Echo) and key not in seen:
            seen[key] = echo, _clock_std_ps(fit, number, echo.delay_ps)
    if not seen:
        return None
    values = np.array([(echo.delay_ps, echo.share) for echo, _ in seen.values()])
    variances = np.array(
        [
            (echo.covariance[1, 1] + clock_ps**2, echo.covariance[0, 0])
            for echo, clock_ps in seen.values()
        ]
    )
    weights = 1.0 / np.maximum(variances, 1e-300)
    mean = np.sum(weights * values, axis=0) / weights.sum(axis=0)
    std = 1.0 / np.sqrt(weights.sum(axis=0))
    return SecondPulse(float(mean[0]), float(std[0]), float(mean[1]), float(std[1]))


def _clock_std_ps(fit: JointFit, number: int, delay_ps: float) -> float:
    """By how much the clock's shared errors may stretch a delay, ps."""
    sighting, own = fit.sightings[number], np.flatnonzero(fit.sighting_of == number)
    if not len(own):
        return 0.0
    rows, cols = (each[own].astype(np.int64) for each in (fit.times.row, fit.times.col))
    first = fit.times.arrival_ps[own] + sighting.timing.skew_ps[rows, cols]
    columns = [
        sighting.timing.shared_errors_ps(rows, cols, when)[0] for when in (first, first + delay_ps)
    ]
    return float(np.linalg.norm(np.median(columns[1] - columns[0], axis=0)))


def on_first_lap(path: LightPath, sighting: Sighting) -> LightPath:
    """The path told in the lap of the clock in which it starts between zero and one period.

    A clock that starts anew with every laser pulse leaves whole periods open, unless the user
    says when the pulse left. A start just before zero stays there: zero is a likely choice.

    Parameters
    ----------
    path : LightPath
        A path in any lap.
    sighting : Sighting
        The recording, on the clock and with its pulses found.

    Returns
    -------
    LightPath
        The same path, all its times shifted by whole periods.
    """
    period_ps = sighting.arrivals.laser_period_ps
    if period_ps is None or path.source.emission_time_ps is not None:
        return path
    slack_ps = min(_BEFORE_ZERO_PS, 0.05 * period_ps)
    shift_ps = -period_ps * np.floor((path.vertex_times_ps[0] + slack_ps) / period_ps)
    if shift_ps == 0.0:
        return path
    # The path that was given stays as it is.
    residuals = path.residuals.copy()
    for name in ("arrival_ps", "model_ps", "event_time_ps"):
        residuals[name] += shift_ps
    return replace(path, vertex_times_ps=path.vertex_times_ps + shift_ps, residuals=residuals)
