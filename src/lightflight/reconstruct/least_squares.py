"""The weighted fit under `joint`: times, lines and priors on one path, damped Gauss-Newton.

Shared errors (clock scale, camera pose) are parameters of their own with unit priors, so that
they are solved for where the data know better and otherwise go into the error bars whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.flight import Medium
from lightflight.reconstruct.freedom import Freedom, state_vector
from lightflight.reconstruct.geometry import (
    Indices,
    PathState,
    arrival_jacobian,
    footprints,
    line_offsets,
    overshoots,
)
from lightflight.reconstruct.legs import mean_focal_px

if TYPE_CHECKING:
    from lightflight.camera import Camera

Floats = NDArray[np.float64]

_MOST_STEPS = 80
_OVERSHOOT_PX = 0.7
"""A leg's pulses may lie this far beyond its corner (the spot's width) before they pull it, px."""
_NUDGE = 1e-3
"""Step of a pose for its derivative, in its own standard deviations."""
_TOLERANCE = 5e-3
"""A step below this fraction of a standard error in every direction ends the fit."""
_TINY = 1e-3
"""So does one this short that leads lower, however much it was damped."""
_LEVEL = 1e-4
"""So does one that changes chi-square by less than this."""
_FREE_DAMPING = 1e-2
"""A step that leads nowhere lower tells of the end only where damping did not shorten it."""

OUTLIER = 5.0
"""A pulse this many standard errors from the path takes no part."""


@dataclass(frozen=True, eq=False)
class TimeData:
    """Arrival times of the pulses that take part."""

    leg: Indices
    """(n,), leg each pulse belongs to."""
    row: Floats
    """(n,), pixel row."""
    col: Floats
    """(n,), pixel column."""
    arrival_ps: Floats
    """(n,), measured, unwrapped, ps."""
    footprint_ps: Floats
    """(n,), model correction: mean time over the pixel's footprint minus that at its foot, ps."""
    photon_var: Floats
    """(n,), independent error, ps^2."""
    pixel_var: Floats
    """(n,), calibration error of the pixel, ps^2."""
    modes_ps: Floats
    """(n, k), one-sigma columns of the shared errors, ps."""
    weight: Floats
    """(n,), 1: takes part; 0: outlier."""
    index: Indices
    """(n,), row of the arrivals table."""
    view: Indices | None = None
    """(n,), which camera saw each; None: the only one."""

    def weights(self, floor_var: float) -> Floats:
        """(n,), inverse variance of each time, 1/ps^2."""
        return self.weight / (self.photon_var + self.pixel_var + floor_var)


@dataclass(frozen=True, eq=False)
class LineDataInPicture:
    """Measured lines of the legs: undistorted picture points they run through."""

    leg: Indices
    """(2 L,), leg of each anchor; the two anchors of a leg follow each other."""
    anchors: Floats
    """(2 L, 2), undistorted (u, v), px."""
    whitening: Floats
    """(2 L, 2 L), turns offsets in px into independent unit-variance residuals."""
    view: Indices | None = None
    """(2 L,), in which camera's picture; None: the only one's."""


def rows_of_view(view: Indices | None, wanted: int, n: int) -> Indices:
    """Rows (k,) of n that the camera `wanted` saw."""
    return np.arange(n) if view is None else np.flatnonzero(view == wanted)


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of one fit."""

    state: PathState
    """The path."""
    cameras: tuple[Camera, ...]
    """The cameras, moved within their pose errors."""
    modes: Floats
    """(k,), shared clock errors found, in standard deviations."""
    covariance: Floats
    """(p, p) of (freedom columns, modes, pose)."""
    photon_gain: Floats
    """(p, n): d(parameters) / d(arrival time of each pulse)."""
    line_gain: Floats
    """(p, 2 L): d(parameters) / d(whitened line offsets)."""
    prior_covariance: Floats
    """(p, p), share of the priors in `covariance`."""
    chi2: float
    """Of the times."""
    line_chi2: float
    """Of the lines."""
    dof: int
    """Degrees of freedom of `chi2`."""
    converged: bool
    """Whether the last step was below tolerance."""
    residual_ps: Floats
    """(n,), measured minus model, ps, of all pulses, outliers too."""

    @property
    def camera(self) -> Camera:
        """The first camera, whose picture the path's ends belong to."""
        return self.cameras[0]


@dataclass(frozen=True, eq=False)
class _Linear:
    residual: Floats
    jacobian: Floats
    sqrt_weight: Floats
    n_times: int
    n_lines: int
    n_priors: int


def solve(
    state: PathState,
    times: TimeData,
    lines: LineDataInPicture,
    freedom: Freedom,
    *,
    cameras: tuple[Camera, ...],
    medium: Medium,
    floor_var: float = 0.0,
) -> Solution:
    """Best path for the data, by Levenberg-Marquardt on the freedom given.

    `cameras` are those that `times.view` and `lines.view` count.
    """
    pose_scales = tuple(_pose_scale(camera) for camera in cameras)
    n_modes = times.modes_ps.shape[1]
    modes, pose = np.zeros(n_modes), np.zeros(sum(scale.shape[1] for scale in pose_scales))

    def linear(at: PathState, eta: Floats, delta: Floats) -> _Linear:
        seen = _moved(cameras, pose_scales, delta)
        return _linearised(at, eta, delta, times, lines, freedom, seen, medium, floor_var)

    system = linear(state, modes, pose)
    cost = _cost(system)
    damping, converged = 1e-4, False
    n_free = freedom.basis.shape[1]
    for _ in range(_MOST_STEPS):
        weighted = system.jacobian * system.sqrt_weight[:, np.newaxis]
        normal = weighted.T @ weighted
        score = weighted.T @ (system.sqrt_weight * system.residual)
        diagonal = np.diag(normal) + 1e-30
        step = _damped_step(normal, score, diagonal, damping)
        trial_state = state.moved(freedom.basis @ step[:n_free])
        trial = modes + step[n_free : n_free + n_modes], pose + step[n_free + n_modes :]
        trial_system = linear(trial_state, *trial)
        trial_cost = _cost(trial_system)
        size = float(step @ normal @ step)
        small = size < _TOLERANCE**2 * len(step)
        gained = cost - trial_cost
        lower = bool(np.isfinite(trial_cost) and gained >= -1e-12 * (1.0 + cost))
        if lower:
            state, (modes, pose), system, cost = trial_state, trial, trial_system, trial_cost
        level = damping <= _FREE_DAMPING and (small or abs(gained) < _LEVEL)
        # Along a gauge only short steps go down: a lower cost by a tiny step is an end too.
        if level or (lower and size < _TINY**2 * len(step)):
            converged = True
            break
        damping = max(damping / 10, 1e-12) if lower else damping * 10
        if damping > 1e12:
            break
    seen = _moved(cameras, pose_scales, pose)
    return _solution(state, tuple(camera for camera, _ in seen), modes, system, times, converged)


def _damped_step(normal: Floats, score: Floats, diagonal: Floats, damping: float) -> Floats:
    scale = 1.0 / np.sqrt(diagonal)
    scaled = normal * scale[:, np.newaxis] * scale
    step: Floats = scale * np.linalg.solve(
        scaled + (damping + 1e-14) * np.eye(len(scale)), scale * score
    )
    return step


def _pose_scale(camera: Camera) -> Floats:
    """(6, r): one-sigma moves of the camera; no columns where the pose is exact."""
    if camera.pose_covariance is None:
        return np.zeros((6, 0))
    values, vectors = np.linalg.eigh(np.asarray(camera.pose_covariance, dtype=float))
    keep = values > 1e-24
    scale: Floats = vectors[:, keep] * np.sqrt(values[keep])
    return scale


def _moved(
    cameras: tuple[Camera, ...], pose_scales: tuple[Floats, ...], pose: Floats
) -> list[tuple[Camera, list[tuple[int, Camera]]]]:
    """Each camera within its pose errors, and nudged along each of its own poses (by column)."""
    moved: list[tuple[Camera, list[tuple[int, Camera]]]] = []
    first = 0
    for camera, scale in zip(cameras, pose_scales, strict=True):
        own = slice(first, first + scale.shape[1])
        if scale.shape[1] == 0:
            moved.append((camera, []))
            continue
        nudged = []
        for k in range(scale.shape[1]):
            delta = pose[own].copy()
            delta[k] += _NUDGE
            nudged.append((first + k, camera.perturbed(scale @ delta)))
        moved.append((camera.perturbed(scale @ pose[own]), nudged))
        first += scale.shape[1]
    return moved


@dataclass(frozen=True, eq=False)
class _Model:
    """Expected data and their derivatives, as all cameras see them."""

    arrival_ps: Floats
    arrival_by_state: Floats
    offset_px: Floats
    offset_by_state: Floats
    by_pose: Floats
    over_px: Floats
    over_by_state: Floats


def _modelled(
    state: PathState,
    times: TimeData,
    lines: LineDataInPicture,
    seen: list[tuple[Camera, list[tuple[int, Camera]]]],
    medium: Medium,
) -> _Model:
    """Arrival times and line offsets, camera by camera."""
    n, n_lines, n_state = len(times.leg), len(lines.leg), state.vertices_mm.size + 1
    n_pose = sum(len(nudged) for _, nudged in seen)
    model = _Model(
        np.zeros(n), np.zeros((n, n_state)), np.zeros(n_lines), np.zeros((n_lines, n_state)),
        np.zeros((n + n_lines, n_pose)), np.zeros(n), np.zeros((n, n_state)),
    )  # fmt: skip
    for view, (camera, nudged) in enumerate(seen):
        here, drawn = rows_of_view(times.view, view, n), rows_of_view(lines.view, view, n_lines)
        legs, rows, cols = times.leg[here], times.row[here], times.col[here]
        line_legs, anchors = lines.leg[drawn], lines.anchors[drawn]
        focal = mean_focal_px(camera)
        print_, by_state = arrival_jacobian(
            state, camera=camera, medium=medium, legs=legs, rows=rows, cols=cols
        )
        model.arrival_ps[here], model.arrival_by_state[here] = print_.arrival_ps, by_state
        offset, by_state = line_offsets(
            state, camera=camera, legs=line_legs, anchors=anchors, focal_px=focal
        )
        model.offset_px[drawn], model.offset_by_state[drawn] = offset, by_state
        model.over_px[here], model.over_by_state[here] = overshoots(state, print_, camera=camera)
        for k, other in nudged:
            arrival = footprints(
                state, camera=other, medium=medium, legs=legs, rows=rows, cols=cols
            ).arrival_ps
            line = line_offsets(
                state, camera=other, legs=line_legs, anchors=anchors, focal_px=focal
            )[0]
            model.by_pose[here, k] = (arrival - print_.arrival_ps) / _NUDGE
            model.by_pose[n + drawn, k] = (line - offset) / _NUDGE
    model.by_pose[n:] = lines.whitening @ model.by_pose[n:]
    return model


def _linearised(
    state: PathState,
    modes: Floats,
    pose: Floats,
    times: TimeData,
    lines: LineDataInPicture,
    freedom: Freedom,
    seen: list[tuple[Camera, list[tuple[int, Camera]]]],
    medium: Medium,
    floor_var: float,
) -> _Linear:
    model = _modelled(state, times, lines, seen, medium)
    modelled = model.arrival_ps + times.footprint_ps + times.modes_ps @ modes
    n_free, n_modes = freedom.basis.shape[1], len(modes)
    by_time = np.column_stack((model.arrival_by_state @ freedom.basis, times.modes_ps))
    by_line = np.column_stack(
        (
            lines.whitening @ model.offset_by_state @ freedom.basis,
            np.zeros((len(lines.leg), n_modes)),
        )
    )
    data = np.column_stack((np.vstack((by_time, by_line)), model.by_pose))
    past = np.flatnonzero((np.abs(model.over_px) > _OVERSHOOT_PX) & (times.weight > 0))
    contained = np.zeros((len(past), data.shape[1]))
    contained[:, :n_free] = model.over_by_state[past] @ freedom.basis / _OVERSHOOT_PX
    n_other = n_modes + len(pose)
    prior = np.zeros((len(freedom.prior_values) + n_other, data.shape[1]))
    prior[: len(freedom.prior_values), :n_free] = freedom.prior_rows @ freedom.basis
    prior[len(freedom.prior_values) :, n_free:] = np.eye(n_other)
    residual = np.concatenate(
        (
            times.arrival_ps - modelled,
            -lines.whitening @ model.offset_px,
            freedom.prior_values - freedom.prior_rows @ state_vector(state),
            -modes,
            -pose,
            -model.over_px[past] / _OVERSHOOT_PX,
        )
    )
    sqrt_weight = np.ones(len(residual))
    sqrt_weight[: len(times.leg)] = np.sqrt(times.weights(floor_var))
    return _Linear(
        residual,
        np.vstack((data, prior, contained)),
        sqrt_weight,
        len(times.leg),
        len(lines.leg),
        len(prior),
    )


def _cost(system: _Linear) -> float:
    weighted = system.residual * system.sqrt_weight
    return float(weighted @ weighted)


def _solution(
    state: PathState,
    cameras: tuple[Camera, ...],
    modes: Floats,
    system: _Linear,
    times: TimeData,
    converged: bool,
) -> Solution:
    weighted = system.jacobian * system.sqrt_weight[:, np.newaxis]
    normal = weighted.T @ weighted
    scale = 1.0 / np.sqrt(np.diag(normal) + 1e-30)
    inverse = np.linalg.pinv(normal * scale[:, np.newaxis] * scale, rcond=1e-14, hermitian=True)
    covariance = inverse * scale[:, np.newaxis] * scale
    n, k = system.n_times, system.n_lines
    gain = covariance @ (weighted * system.sqrt_weight[:, np.newaxis]).T
    prior_gain = gain[:, n + k : n + k + system.n_priors]
    residual = system.residual[:n]
    used = times.weight > 0
    chi2 = float(np.sum((residual * system.sqrt_weight[:n])[used] ** 2))
    return Solution(
        state=state,
        cameras=cameras,
        modes=modes,
        covariance=covariance,
        photon_gain=gain[:, :n],
        line_gain=gain[:, n : n + k],
        prior_covariance=prior_gain @ prior_gain.T,
        chi2=chi2,
        line_chi2=float(np.sum(system.residual[n : n + k] ** 2)),
        dof=max(0, int(used.sum()) - system.jacobian.shape[1] + len(modes)),
        converged=converged,
        residual_ps=residual,
    )


def reweighted(times: TimeData, solution: Solution, *, floor_var: float, cut: float) -> TimeData:
    """The same data with pulses farther than `cut` standard errors from the path left out."""
    std = np.sqrt(times.photon_var + times.pixel_var + floor_var)
    inside = np.abs(solution.residual_ps) < cut * std
    return replace(times, weight=inside.astype(float))
