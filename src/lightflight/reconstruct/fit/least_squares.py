"""The weighted fit under `joint`: times, lines and priors on one path, damped Gauss-Newton.

Shared errors (of clock, pose, lens and medium) are parameters of their own with unit priors, so
that they are solved for where the data know better and otherwise go into the error bars whole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import NothingFoundError
from lightflight.flight import Medium
from lightflight.reconstruct.model.freedom import Freedom
from lightflight.reconstruct.model.geometry import (
    Indices,
    PathState,
    footprints_and_slopes,
    overshoots,
)
from lightflight.reconstruct.model.information import ascend, covariance_from_information
from lightflight.reconstruct.model.nudges import NUDGE
from lightflight.reconstruct.model.offsets import offsets_and_slopes
from lightflight.reconstruct.model.picture import LineDataInPicture
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import (
    SharedErrors,
    moved,
    nudges_of_views,
    shared_errors,
    undistorted_as_moved,
)

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_MOST_PATH_STEPS = 80
"""A fit that took more steps than this is said not to have converged."""
_OVERSHOOT_PX = 0.7
"""A leg's pulses may lie this far beyond its corner (the spot's width) before they pull it, px."""
_GAUGE = 1e-14
"""Share of the largest scaled information below which a direction is a gauge, fixed by nothing."""

OUTLIER = 5.0
"""A pulse this many standard errors from the path takes no part."""


@dataclass(frozen=True, eq=False)
class TimeData:
    """Arrival times of the pulses that take part.

    Attributes
    ----------
    leg : array of int, shape (n,)
        Leg each pulse belongs to.
    row : array of float, shape (n,)
        Pixel row.
    col : array of float, shape (n,)
        Pixel column.
    arrival_ps : array of float, shape (n,)
        Measured, unwrapped, ps.
    footprint_ps : array of float, shape (n,)
        Model correction: mean time over the pixel's footprint minus that at its foot, ps.
    photon_var : array of float, shape (n,)
        Independent error, ps^2.
    pixel_var : array of float, shape (n,)
        Calibration error of the pixel, ps^2.
    modes_ps : array of float, shape (n, k)
        One-sigma columns of the shared errors, ps.
    weight : array of float, shape (n,)
        1: takes part; 0: outlier.
    index : array of int, shape (n,)
        Row of the arrivals table.
    view : array of int, shape (n,)
        Which camera saw each.
    """

    leg: Indices
    row: Floats
    col: Floats
    arrival_ps: Floats
    footprint_ps: Floats
    photon_var: Floats
    pixel_var: Floats
    modes_ps: Floats
    weight: Floats
    index: Indices
    view: Indices

    def of(self, kept: NDArray[np.bool_]) -> TimeData:
        """Some of them."""
        return TimeData(**{each.name: getattr(self, each.name)[kept] for each in fields(self)})

    def weights(self, floor_var: float) -> Floats:
        """(n,), inverse variance of each time, 1/ps^2."""
        return self.weight / (self.photon_var + self.pixel_var + floor_var)


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of one fit.

    Attributes
    ----------
    state : PathState
        The path.
    cameras : tuple of Camera
        The cameras, moved within their errors of pose and lens.
    medium : Medium
        The medium, moved within its errors.
    modes : array of float, shape (k,)
        Shared clock errors found, in standard deviations.
    shared : array of float, shape (j,)
        Shared errors of cameras and medium found, in standard deviations.
    errors : SharedErrors
        What those are.
    covariance : array of float, shape (p, p)
        Of (freedom columns, modes, shared).
    photon_gain : array of float, shape (p, n)
        d(parameters) / d(arrival time of each pulse).
    line_gain : array of float, shape (p, 2 L)
        d(parameters) / d(whitened line offsets).
    prior_covariance : array of float, shape (p, p)
        Share of the priors in `covariance`.
    chi2 : float
        Of the times.
    line_chi2 : float
        Of the lines.
    dof : int
        Degrees of freedom of `chi2`.
    converged : bool
        Whether the last step was below tolerance.
    residual_ps : array of float
        (n,), measured minus model, ps, of all pulses, outliers too.
    rows : array of float
        (N,), whitened residuals of times, lines, priors, and of pulses beyond their corners.
    columns : array of float
        (N, p), derivatives of the whitened model.
    """

    state: PathState
    cameras: tuple[Camera, ...]
    medium: Medium
    modes: Floats
    shared: Floats
    errors: SharedErrors
    covariance: Floats
    photon_gain: Floats
    line_gain: Floats
    prior_covariance: Floats
    chi2: float
    line_chi2: float
    dof: int
    converged: bool
    residual_ps: Floats
    rows: Floats
    columns: Floats


_Point = tuple[PathState, Floats, Floats]
"""Path, shared clock errors, and shared errors of camera and medium in standard deviations."""


@dataclass(frozen=True, eq=False)
class _Linear:
    residual: Floats
    sqrt_weight: Floats
    derived: Callable[[], Floats]
    n_times: int
    n_lines: int
    n_priors: int

    @cached_property
    def jacobian(self) -> Floats:
        """Made when it is asked for: of a step that is refused it never is."""
        return self.derived()

    @cached_property
    def columns(self) -> Floats:
        """The Jacobian in standard errors."""
        return self.jacobian * self.sqrt_weight[:, np.newaxis]

    @cached_property
    def rows(self) -> Floats:
        """The residuals in standard errors."""
        return self.residual * self.sqrt_weight

    @property
    def value(self) -> float:
        return -0.5 * float(self.rows @ self.rows)

    @cached_property
    def score(self) -> Floats:
        return self.columns.T @ self.rows

    @cached_property
    def information(self) -> Floats:
        return self.columns.T @ self.columns


def fit_path(
    state: PathState,
    times: TimeData,
    lines: LineDataInPicture,
    freedom: Freedom,
    setting: Setting,
    *,
    floor_var: float = 0.0,
    shared: Floats | None = None,
) -> Solution:
    """Best path for the data on the freedom given.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    times : TimeData
        Arrival times with their errors.
    lines : LineDataInPicture
        Lines in the picture that the legs are held to.
    freedom : Freedom
        What may move, and the priors on it.
    setting : Setting
        The cameras that `times.view` and `lines.view` count, and the medium; no more is read of it.
    floor_var : float, optional
        Variance per pulse beyond the stated errors, ps^2.
    shared : array of float, shape (k,), optional
        Where the shared errors of cameras and medium start, in standard deviations: those that the
        path was found with. None: at zero.

    Returns
    -------
    Solution
        Path, covariance, gains and residuals.

    Raises
    ------
    NothingFoundError
        Where the start is none: what it expects of the data is no number.

    Notes
    -----
    Minimised is the chi-square of times, whitened line offsets, priors, and a pull on pulses that
    lie beyond their own leg's corner (method.md, The weighted fit).
    """
    rays = Rays()
    errors = shared_errors(setting)
    n_modes = times.modes_ps.shape[1]
    n_free = freedom.basis.shape[1]

    def linear(at: _Point) -> _Linear:
        model = modelled(at[0], times, lines, setting, errors, at[2], rays)
        return _linearised(*at, times, lines, freedom, model, floor_var)

    def stepped(at: _Point, _: _Linear, step: Floats) -> _Point:
        free, of_modes, of_shared = np.split(step, (n_free, n_free + n_modes))
        return at[0].moved(freedom.basis @ free), at[1] + of_modes, at[2] + of_shared

    (state, modes, shared), system, converged = ascend(
        (state, np.zeros(n_modes), np.zeros(len(errors)) if shared is None else shared),
        linear,
        stepped,
        most_steps=_MOST_PATH_STEPS,
        gauge=_GAUGE,
        # A ridge is a cause that another makes up for, and its prior says where on it the top is.
        winds=len(errors) > 0,
    )
    if not np.isfinite(system.score).all():
        raise NothingFoundError(
            "from this start no path can be computed (a leg without length, or along a line of "
            "sight): give another start"
        )
    seen = moved(setting, errors, shared)
    return _solution(state, seen, modes, shared, errors, system, times, converged)


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of expected data; n pulses, 2 L anchors.

    Attributes
    ----------
    arrival_by_state : array of float, shape (n, size)
        ps per mm and ps per ps.
    offset_by_state : array of float, shape (2 L, size)
        px per mm.
    by_shared : array of float, shape (n + 2 L, k)
        Times (ps) and whitened offsets per standard deviation of each shared error.
    over_by_state : array of float, shape (n, size)
        px per mm.
    """

    arrival_by_state: Floats
    offset_by_state: Floats
    by_shared: Floats
    over_by_state: Floats


@dataclass(frozen=True, eq=False)
class Modelled:
    """Expected data as all cameras see them; n pulses, 2 L anchors.

    Attributes
    ----------
    arrival_ps : array of float, shape (n,)
        Arrival times of the pulses' feet, ps.
    offset_px : array of float, shape (2 L,)
        Of the anchors from the images of their legs, px.
    over_px : array of float, shape (n,)
        How far pulses lie beyond the corners of their leg, px.
    slopes : callable
        Gives their derivatives, most of the work.
    """

    arrival_ps: Floats
    offset_px: Floats
    over_px: Floats
    slopes: Callable[[], Slopes]


class Rays:
    """Rays of the pulses' pixels, kept while a fit moves its cameras but not their lenses."""

    def __init__(self) -> None:
        self._kept: dict[int, tuple[Floats, Floats, Floats]] = {}

    def of_view(self, view: int, camera: Camera, rows: Floats, cols: Floats) -> Floats:
        """`Camera.own_rays` of a view's pixels (n,), of which there is one table; (n, 3)."""
        kept = self._kept.get(view)
        if kept is None or kept[0] is not camera.matrix or kept[1] is not camera.distortion:
            kept = camera.matrix, camera.distortion, camera.own_rays(rows, cols)
            self._kept[view] = kept
        return kept[2]


def modelled(
    state: PathState,
    times: TimeData,
    lines: LineDataInPicture,
    told: Setting,
    errors: SharedErrors,
    delta: Floats,
    rays: Rays,
) -> Modelled:
    """Arrival times and line offsets, camera by camera, and how they follow path and shared errors.

    Parameters
    ----------
    state : PathState
        The path.
    times : TimeData
        Arrival times with their errors.
    lines : LineDataInPicture
        Anchors in the pictures of the cameras as told.
    told : Setting
        Cameras and medium.
    errors : SharedErrors
        k of them.
    delta : array of float, shape (k,)
        Where they stand, in standard deviations.
    rays : Rays
        Of these pulses.

    Returns
    -------
    Modelled
        With what gives all derivatives.
    """
    n, n_lines, n_state = len(times.leg), len(lines.leg), state.size
    arrival, offset, over = np.zeros(n), np.zeros(n_lines), np.zeros(n)
    seen, parts = moved(told, errors, delta), []
    for view, camera in enumerate(seen.cameras):
        here, drawn = np.flatnonzero(times.view == view), np.flatnonzero(lines.view == view)
        rows, cols = times.row[here], times.col[here]
        own_rays = rays.of_view(view, camera, rows, cols)
        print_, by_state = footprints_and_slopes(
            state, camera, seen.medium, times.leg[here], rows, cols, own_rays
        )
        arrival[here] = print_.arrival_ps
        offset[drawn], by_line = _offsets(state, lines, drawn, told.cameras[view], camera)
        over[here], over_by_state = overshoots(state, print_, camera=camera)
        parts.append((here, drawn, print_, by_state, by_line, over_by_state))

    def slopes() -> Slopes:
        found = Slopes(
            np.zeros((n, n_state)), np.zeros((n_lines, n_state)),
            np.zeros((n + n_lines, len(errors))), np.zeros((n, n_state)),
        )  # fmt: skip
        for here, drawn, _, by_state, by_line, over_by_state in parts:
            found.arrival_by_state[here], found.over_by_state[here] = by_state(), over_by_state()
            found.offset_by_state[drawn] = by_line()
        for view, nudges in enumerate(nudges_of_views(told, errors, delta, seen)):
            here, drawn, print_, *_ = parts[view]
            found.by_shared[here] = nudges.arrivals(
                state, print_, found.arrival_by_state[here], seen.medium
            )
            found.by_shared[n + drawn] = found.offset_by_state[drawn] @ nudges.as_moves(state)
            for k, lens in nudges.lenses.items():
                line = _offsets(state, lines, drawn, told.cameras[view], lens)[0]
                found.by_shared[n + drawn, k] += (line - offset[drawn]) / NUDGE
        # Whitened like the offsets themselves: one weight for both.
        found.by_shared[n:] = lines.whitening @ found.by_shared[n:]
        return found

    return Modelled(arrival, offset, over, slopes)


def _offsets(
    state: PathState, lines: LineDataInPicture, rows: Indices, told: Camera, seen: Camera
) -> tuple[Floats, Callable[[], Floats]]:
    """Line offsets of some anchors, which a moved lens puts elsewhere in the undistorted plane."""
    return offsets_and_slopes(
        state,
        camera=seen,
        legs=lines.leg[rows],
        anchors=undistorted_as_moved(lines.anchors[rows], told, seen),
    )


def _linearised(
    state: PathState,
    modes: Floats,
    shared: Floats,
    times: TimeData,
    lines: LineDataInPicture,
    freedom: Freedom,
    model: Modelled,
    floor_var: float,
) -> _Linear:
    modelled = model.arrival_ps + times.footprint_ps + times.modes_ps @ modes
    n_free, n_modes = freedom.basis.shape[1], len(modes)
    line_modes = np.zeros((len(lines.leg), n_modes))
    if lines.modes is not None:
        line_modes[:, n_modes - lines.modes.shape[1] :] = lines.modes
    # Only pulses well past the corner pull: those within the spot's width are no surprise.
    past = np.flatnonzero((np.abs(model.over_px) > _OVERSHOOT_PX) & (times.weight > 0))
    # Shared errors are counted in their own standard deviations: unit priors about zero.
    n_other = n_modes + len(shared)

    def derived() -> Floats:
        slopes = model.slopes()
        by_time = np.column_stack((slopes.arrival_by_state @ freedom.basis, times.modes_ps))
        offsets = lines.whitening @ slopes.offset_by_state @ freedom.basis
        by_line = np.column_stack((offsets, line_modes))
        data = np.column_stack((np.vstack((by_time, by_line)), slopes.by_shared))
        contained = np.zeros((len(past), data.shape[1]))
        contained[:, :n_free] = slopes.over_by_state[past] @ freedom.basis / _OVERSHOOT_PX
        prior = np.zeros((len(freedom.prior_values) + n_other, data.shape[1]))
        prior[: len(freedom.prior_values), :n_free] = freedom.prior_rows @ freedom.basis
        prior[len(freedom.prior_values) :, n_free:] = np.eye(n_other)
        return np.vstack((data, prior, contained))

    residual = np.concatenate(
        (
            times.arrival_ps - modelled,
            -lines.whitening @ model.offset_px - line_modes @ modes,
            freedom.prior_values - freedom.prior_rows @ state.vector,
            -modes,
            -shared,
            -model.over_px[past] / _OVERSHOOT_PX,
        )
    )
    sqrt_weight = np.ones(len(residual))
    sqrt_weight[: len(times.leg)] = np.sqrt(times.weights(floor_var))
    n_priors = len(freedom.prior_values) + n_other
    return _Linear(residual, sqrt_weight, derived, len(times.leg), len(lines.leg), n_priors)


def _solution(
    state: PathState,
    seen: Setting,
    modes: Floats,
    shared: Floats,
    errors: SharedErrors,
    system: _Linear,
    times: TimeData,
    converged: bool,
) -> Solution:
    covariance = covariance_from_information(system.information, rcond=_GAUGE)
    n, k = system.n_times, system.n_lines
    gain = covariance @ (system.columns * system.sqrt_weight[:, np.newaxis]).T
    # The priors' share of the covariance: what they would move the path if they erred.
    prior_gain = gain[:, n + k : n + k + system.n_priors]
    residual = system.residual[:n]
    used = times.weight > 0
    chi2 = float(np.sum(system.rows[:n][used] ** 2))
    return Solution(
        state=state,
        cameras=seen.cameras,
        medium=seen.medium,
        modes=modes,
        shared=shared,
        errors=errors,
        covariance=covariance,
        photon_gain=gain[:, :n],
        line_gain=gain[:, n : n + k],
        prior_covariance=prior_gain @ prior_gain.T,
        chi2=chi2,
        line_chi2=float(np.sum(system.residual[n : n + k] ** 2)),
        # Modes are held by priors of their own and take no degree of freedom.
        dof=max(0, int(used.sum()) - system.jacobian.shape[1] + len(modes)),
        converged=converged,
        residual_ps=residual,
        rows=system.rows,
        columns=system.columns,
    )


def reweighted(times: TimeData, solution: Solution, *, floor_var: float, cut: float) -> TimeData:
    """The same data with pulses farther than `cut` standard errors from the path left out.

    Parameters
    ----------
    times : TimeData
        The data it was fitted to.
    solution : Solution
        The fit.
    floor_var : float
        Variance per pulse beyond the stated errors, ps^2.
    cut : float
        Standard errors beyond which a pulse takes no part.

    Returns
    -------
    TimeData
        The data with weights of 0 and 1.
    """
    std = np.sqrt(times.photon_var + times.pixel_var + floor_var)
    inside = np.abs(solution.residual_ps) < cut * std
    return replace(times, weight=inside.astype(float))
