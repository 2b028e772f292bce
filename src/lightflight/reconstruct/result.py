"""From a fit to a `LightPath`: covariance in three error classes, residuals, and what it means."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight.flight import Source
from lightflight.path import RESIDUAL_DTYPE, Goodness, LightPath
from lightflight.reconstruct.geometry import footprints, vertex_time_jacobian
from lightflight.reconstruct.joint import JointFit
from lightflight.reconstruct.observation import Observation
from lightflight.reconstruct.setting import Setting

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


def covariance_parts(fit: JointFit, setting: Setting) -> dict[str, Floats]:
    """Covariance of (x, y, z, t) of every vertex by error class; each (4m, 4m).

    "photon" is independent from recording to recording; "pixel" (calibration of each pixel, and
    the floor the residuals ask for) averages over pixels but not over repeats; "shared" comes
    from clock scale, emission time, pose and source.
    """
    solution, times = fit.solution, fit.times
    n_free = fit.freedom_basis.shape[1]
    to_vertices = (
        vertex_time_jacobian(solution.state.vertices_mm, setting.medium) @ fit.freedom_basis
    )
    gain = to_vertices @ solution.photon_gain[:n_free]
    line_gain = to_vertices @ solution.line_gain[:n_free]
    photon = (gain * times.photon_var) @ gain.T + line_gain @ line_gain.T
    view = 0.0 if times.view is None else 2.0**32 * times.view
    pixel_id = np.unique(view + times.row * 65536.0 + times.col, return_inverse=True)[1]
    per_pixel = np.zeros((len(gain), pixel_id.max() + 1))
    np.add.at(per_pixel.T, pixel_id, (gain * np.sqrt(times.pixel_var)).T)
    floor = (gain * fit.floor_ps**2) @ gain.T
    shared = to_vertices @ solution.prior_covariance[:n_free, :n_free] @ to_vertices.T
    return {"photon": photon, "pixel": per_pixel @ per_pixel.T + floor, "shared": shared}


def residual_table(fit: JointFit, observations: list[Observation], setting: Setting) -> Any:
    """One row per pulse on the path that the first camera saw; dtype `path.RESIDUAL_DTYPE`."""
    times, state = fit.times, fit.solution.state
    table = np.zeros(len(times.leg), RESIDUAL_DTYPE)
    print_ = footprints(
        state,
        camera=fit.solution.camera,
        medium=setting.medium,
        legs=times.leg,
        rows=times.row,
        cols=times.col,
    )
    at_vertex = state.vertex_times_ps(setting.medium)
    table["row"], table["col"], table["leg"] = times.row, times.col, times.leg
    table["arrival_ps"] = times.arrival_ps
    table["residual_ps"] = fit.solution.residual_ps
    table["model_ps"] = times.arrival_ps - fit.solution.residual_ps
    table["std_ps"] = np.sqrt(times.photon_var + times.pixel_var + fit.floor_ps**2)
    table["event_time_ps"] = at_vertex[times.leg] + print_.fraction * np.diff(at_vertex)[times.leg]
    table["used"] = times.weight > 0
    for number, observation in enumerate(observations):
        here = fit.observation_of == number
        index = times.index[here]
        table["photons"][here] = observation.arrivals.photons[index]
        table["flags"][here] = observation.arrivals.flags[index]
    table["flags"][~table["used"]] |= np.uint32(flags.OUTLIER)
    return table if times.view is None else table[times.view == 0]


def path_from_fit(
    fit: JointFit,
    observations: list[Observation],
    setting: Setting,
    *,
    method: str,
    statements: tuple[str, ...] = (),
    truth: Any = None,
) -> LightPath:
    """The fit as the record users get."""
    solution = fit.solution
    parts = covariance_parts(fit, setting)
    used = fit.times.weight > 0
    residual = solution.residual_ps[used]
    variance = (fit.times.photon_var + fit.times.pixel_var)[used] + fit.floor_ps**2
    goodness = Goodness(
        chi2=float(np.sum(residual**2 / variance)),
        dof=solution.dof,
        n_pulses=int(used.sum()),
        n_rejected=int((~used).sum()),
        residual_rms_ps=float(np.sqrt(np.mean(residual**2))),
        error_floor_ps=fit.floor_ps,
        converged=solution.converged,
    )
    return LightPath(
        solution.state.vertices_mm,
        solution.state.vertex_times_ps(setting.medium),
        parts["photon"] + parts["pixel"] + parts["shared"],
        camera=solution.camera,
        source=setting.source,
        medium=setting.medium,
        method=method,
        goodness=goodness,
        covariance_parts=parts,
        residuals=residual_table(fit, observations, setting),
        prior=prior_in_words(setting.source),
        statements=statements,
        truth=truth,
    )


def on_first_lap(path: LightPath, observation: Observation) -> LightPath:
    """The path told in the lap of the clock in which it starts between zero and one period.

    A clock that starts anew with every laser pulse leaves whole periods open, unless the user
    says when the pulse left. A start just before zero stays there: zero is a likely choice.
    """
    period_ps = observation.arrivals.laser_period_ps
    if period_ps is None or path.source.emission_time_ps is not None:
        return path
    slack_ps = min(_BEFORE_ZERO_PS, 0.05 * period_ps)
    shift_ps = -period_ps * np.floor((path.vertex_times_ps[0] + slack_ps) / period_ps)
    if shift_ps == 0.0:
        return path
    residuals = path.residuals.copy()
    for name in ("arrival_ps", "model_ps", "event_time_ps"):
        residuals[name] += shift_ps
    return replace(path, vertex_times_ps=path.vertex_times_ps + shift_ps, residuals=residuals)
