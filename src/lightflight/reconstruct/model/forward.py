"""The forward model of all counts: what every pixel near the path should have recorded.

Expected counts of pixel p in code k are

    lambda_pk = o_pk (sum_legs N_p [F(e_(k+1)) - F(e_k)] + b_p w_pk),

F the pulse (laser, response, transit over the footprint; a Gaussian, or the shape the flat was
fitted with) about the footprint's mean arrival time plus the pixel's delay, e the true code edges
modulo the period, o_pk the share of laser periods that no earlier photon had closed. N_p is the
strength of the light along the leg under the spot. The integral along the leg is collapsed into
its zeroth, first and second moment (photons, mean time, variance), which is exact for a Gaussian
spot and a curve that bends little within it; corners cut the footprint.

Takes a path and the brightness along it, gives log-likelihood, score and information in a
handful of parameters: `photon` climbs it, `limits.bounds` reads its curvature.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline

from lightflight._kernels.photon_score import photon_score
from lightflight.flight import Medium
from lightflight.reconstruct.model.footing import (
    Corners,
    Footing,
    Moment,
    corner_distances,
    footing,
)
from lightflight.reconstruct.model.geometry import (
    Indices,
    PathState,
    arrival_jacobian,
    line_offsets,
)
from lightflight.reconstruct.model.image_plane import mean_focal_px
from lightflight.reconstruct.model.picture import LegInPicture, arrival_curvature
from lightflight.reconstruct.model.strength import LOG_SPOT_RANGE, span_of_knots

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_DARK_LOG = -60.0
"""ln(photons) of a pixel that a leg does not light: far below any, and exp() of it is no zero."""


@dataclass(frozen=True, eq=False)
class Light:
    """Everything about the light that is not the path.

    Attributes
    ----------
    lines : tuple of LegInPicture
        Where along each leg's image the strength is measured.
    knots : tuple of arrays
        Knots of the cubic log-strength of each leg, px along its line.
    coefficients : tuple of arrays
        Spline coefficients of the log of photons per pixel on the line.
    log_spot_px : float
        Log of the spot's standard deviation, px.
    log_std_ps : float
        Log of the standard deviation of laser pulse and response, ps.
    log_scatter : tuple of float
        Per leg, scatter of ln(photons) from pixel to pixel that the model does not explain.
    cut_ends : (bool, bool)
        Whether the light begins at the path's first vertex, and stops at its last.
    """

    lines: tuple[LegInPicture, ...]
    knots: tuple[Floats, ...]
    coefficients: tuple[Floats, ...]
    log_spot_px: float
    log_std_ps: float
    log_scatter: tuple[float, ...]
    cut_ends: tuple[bool, bool] = (False, False)


@dataclass(frozen=True, eq=False)
class Pixels:
    """The pixels that take part: (n,) arrays, legs near each in columns (n, L).

    Attributes
    ----------
    near : array of bool, shape (n, L)
        True where the leg's light can reach the pixel.
    points_px : array of float, shape (n, 2)
        Undistorted (u, v).
    skew_ps : array of float, shape (n,)
        Delay of the pixel.
    pixel_var : array of float, shape (n,)
        Variance of that delay from the calibration, ps^2.
    modes_ps : array of float, shape (n, L, k)
        Shared clock errors at the leg's arrival, one-sigma columns, ps.
    """

    rows: Indices
    cols: Indices
    near: NDArray[np.bool_]
    points_px: Floats
    skew_ps: Floats
    pixel_var: Floats
    modes_ps: Floats


@dataclass(frozen=True, eq=False)
class CodeCounts:
    """Counts and code intervals of the pixels that take part.

    Attributes
    ----------
    counts : array of float, shape (n, codes)
    lower_ps : array of float, shape (n, codes)
    upper_ps : array of float, shape (n, codes)
    period_ps : float
        Laser period, ps; 0: none.
    use_outside : array of bool, shape (n,)
        False where something else flashes outside the windows.
    open_share : array of float, shape (n, codes or 1) or None
        Counts in a code per photon that came (pile-up); None: all are counted.
    shape : array of float
        Shape of a pulse (`timing.response.Response.table`); (3, 0): a Gaussian.
    """

    counts: Floats
    lower_ps: Floats
    upper_ps: Floats
    period_ps: float
    use_outside: NDArray[np.bool_]
    open_share: Floats | None = None
    shape: Floats = field(default_factory=lambda: np.empty((3, 0)))


@dataclass(frozen=True, eq=False)
class Local:
    """Local variables of each pixel and leg, and how they follow from the global ones.

    Attributes
    ----------
    log_photons : array of float, shape (n, L)
    arrival_ps : array of float, shape (n, L)
        Mean over the footprint; NaN where the leg is not near.
    std_ps : array of float, shape (n, L)
        Of the pulse with its transit.
    jacobian : array of float, shape (n, 3 L, P)
        d(ln photons, time, ln std of each leg) / d(parameters).
    """

    log_photons: Floats
    arrival_ps: Floats
    std_ps: Floats
    jacobian: Floats


@dataclass(frozen=True, eq=False)
class Layout:
    """Where each kind of parameter sits in the vector of P.

    Attributes
    ----------
    n_free : int
        Freedom of the path.
    n_modes : int
        Shared clock errors.
    spline_starts : tuple of int
        First coefficient of each leg's log-strength.
    size : int
        P; the last two are log spot and log std.
    n_shared : int
        Shared errors of camera and medium.
    """

    n_free: int
    n_modes: int
    spline_starts: tuple[int, ...]
    size: int
    n_shared: int = 0

    @property
    def unit_priors(self) -> slice:
        """Parameters counted in their own standard deviations: modes, then shared errors."""
        return slice(self.n_free, self.n_free + self.n_modes + self.n_shared)


def layout_of(n_free: int, n_modes: int, light: Light, n_shared: int = 0) -> Layout:
    """Order of the parameters: path, modes, shared errors, splines leg by leg, log spot, log std.

    Parameters
    ----------
    n_free : int
        Columns of the path's freedom.
    n_modes : int
        Shared clock errors.
    light : Light
        Brightness, spot and pulse width.
    n_shared : int, optional
        Shared errors of camera and medium.

    Returns
    -------
    Layout
        And the number of parameters.
    """
    starts, at = [], n_free + n_modes + n_shared
    for coefficients in light.coefficients:
        starts.append(at)
        at += len(coefficients)
    return Layout(n_free, n_modes, tuple(starts), at + 2, n_shared)


def moved_light(light: Light, step: Floats, layout: Layout) -> Light:
    """The light after a step of the parameters; widths keep within sane bounds.

    Parameters
    ----------
    light : Light
        Brightness, spot and pulse width.
    step : array of float, shape (P,)
    layout : Layout
        Where each kind of parameter sits.

    Returns
    -------
    Light
        Lines and knots stay.
    """
    coefficients = tuple(
        c + step[start : start + len(c)]
        for c, start in zip(light.coefficients, layout.spline_starts, strict=True)
    )
    return replace(
        light,
        coefficients=coefficients,
        log_spot_px=float(np.clip(light.log_spot_px + step[-2], *LOG_SPOT_RANGE)),
        log_std_ps=float(light.log_std_ps + np.clip(step[-1], -0.5, 0.5)),
    )


def local_variables(
    state: PathState,
    light: Light,
    pixels: Pixels,
    layout: Layout,
    *,
    basis: Floats,
    modes: Floats,
    camera: Camera,
    medium: Medium,
) -> Local:
    """Photons, time and width of every leg in every pixel, with their derivatives.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    light : Light
        Brightness, spot and pulse width.
    pixels : Pixels
        The pixels that take part.
    layout : Layout
        Where each kind of parameter sits.
    basis : array of float, shape (3m + 1, p)
        Columns are unit moves of (vertices in mm, start time in ps).
    modes : array of float, shape (k,)
        Shared clock errors, in standard deviations.
    camera : Camera
        The camera that sees it.
    medium : Medium
        Group indices out and back.

    Returns
    -------
    Local
        (n, L) each, and how they follow the parameters.
    """
    n, n_legs = pixels.near.shape
    local = Local(
        log_photons=np.full((n, n_legs), _DARK_LOG),
        arrival_ps=np.full((n, n_legs), np.nan),
        std_ps=np.ones((n, n_legs)),
        jacobian=np.zeros((n, 3 * n_legs, layout.size)),
    )
    for k in range(n_legs):
        here = np.flatnonzero(pixels.near[:, k])
        seen = _seen_leg(state, light, pixels, k, here, camera, medium)
        _fill_leg(local, seen, light, pixels.modes_ps[here, k], modes, layout, basis, here)
    return local


@dataclass(frozen=True, eq=False)
class _SeenLeg:
    """One leg as the n pixels near it see it.

    Attributes
    ----------
    leg : int
        Which.
    arrival_ps : array of float, shape (n,)
        Arrival time from the foot, ps.
    arrival_by_state : array of float, shape (n, 3m + 1)
        Its derivative, ps per mm.
    across_px : array of float, shape (n,)
        Distance of the pixel from the leg's image, px.
    across_by_state : array of float, shape (n, 3m + 1)
        Its derivative, px per mm.
    along_px : array of float, shape (n,)
        Place along the leg's image, within its knots, px.
    corners : Corners
        Where the footprint is cut.
    feet : Footing
        Moments of the footprint.
    """

    leg: int
    arrival_ps: Floats
    arrival_by_state: Floats
    across_px: Floats
    across_by_state: Floats
    along_px: Floats
    corners: Corners
    feet: Footing


def _seen_leg(
    state: PathState,
    light: Light,
    pixels: Pixels,
    k: int,
    here: Indices,
    camera: Camera,
    medium: Medium,
) -> _SeenLeg:
    """Geometry and footprint moments of leg `k` in the pixels `here` (n,)."""
    legs, points = np.full(len(here), k), pixels.points_px[here]
    print_, by_state = arrival_jacobian(
        state,
        camera=camera,
        medium=medium,
        legs=legs,
        rows=pixels.rows[here],
        cols=pixels.cols[here],
    )
    across, across_by_state = line_offsets(
        state, camera=camera, legs=legs, anchors=points, focal_px=mean_focal_px(camera)
    )
    along = np.clip(light.lines[k].along_across(points)[0], *span_of_knots(light.knots[k]))
    corners = corner_distances(state, print_, k, camera=camera, cut_ends=light.cut_ends)
    feet = footing(
        BSpline(light.knots[k], light.coefficients[k], 3).derivative()(along),
        print_.slope_ps_per_px,
        arrival_curvature(print_, state=state, camera=camera, medium=medium),
        corners,
        spot_px=float(np.exp(light.log_spot_px)),
    )
    return _SeenLeg(k, print_.arrival_ps, by_state, across, across_by_state, along, corners, feet)


def _fill_leg(
    local: Local,
    seen: _SeenLeg,
    light: Light,
    modes_ps: Floats,
    modes: Floats,
    layout: Layout,
    basis: Floats,
    here: Indices,
) -> None:
    """Write one leg's columns of `local`, and its rows of the jacobian, in the pixels `here`."""
    k, feet, across = seen.leg, seen.feet, seen.across_px
    spot, pulse_var = float(np.exp(light.log_spot_px)), np.exp(2 * light.log_std_ps)
    design = BSpline.design_matrix(seen.along_px, light.knots[k], 3).toarray()
    local.log_photons[here, k] = np.maximum(
        design @ light.coefficients[k] + feet.log_share.value - 0.5 * (across / spot) ** 2,
        _DARK_LOG,
    )
    std = np.sqrt(pulse_var + feet.variance_ps2.value)
    local.std_ps[here, k] = std
    local.arrival_ps[here, k] = seen.arrival_ps + feet.offset_ps.value + modes_ps @ modes
    jacobian, at, splines = local.jacobian, 3 * k, layout.spline_starts[k]
    to_spline = slice(splines, splines + design.shape[1])
    to_slope = BSpline(light.knots[k], np.eye(design.shape[1]), 3).derivative()(seen.along_px)
    # d ln(std) = d(variance) / (2 variance).
    to_log_std = 0.5 / std**2
    for row, moment, scale in (
        (at, feet.log_share, 1.0),
        (at + 1, feet.offset_ps, 1.0),
        (at + 2, feet.variance_ps2, to_log_std),
    ):
        by_corners = (_by_corners(moment, seen.corners) @ basis).T * scale
        jacobian[here, row, : layout.n_free] = by_corners.T
        jacobian[here, row, to_spline] = (scale * moment.by_slope)[:, np.newaxis] * to_slope
        jacobian[here, row, -2] = scale * moment.by_log_spot
    lateral = -(across / spot**2)[:, np.newaxis] * seen.across_by_state
    jacobian[here, at, : layout.n_free] += lateral @ basis
    jacobian[here, at, to_spline] += design
    # d/d ln(spot) of -across^2 / 2 spot^2.
    jacobian[here, at, -2] += (across / spot) ** 2
    jacobian[here, at + 1, : layout.n_free] += seen.arrival_by_state @ basis
    jacobian[here, at + 1, layout.n_free : layout.n_free + layout.n_modes] = modes_ps
    jacobian[here, at + 2, -1] = pulse_var / std**2


def _by_corners(moment: Moment, corners: Corners) -> Floats:
    """d(moment) / d(state) through the places of the corners; (n, 3m + 1)."""
    return (
        moment.by_before[:, np.newaxis] * corners.before_by_state
        + moment.by_after[:, np.newaxis] * corners.after_by_state
    )


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Log-likelihood of all counts at one set of parameters, pixel nuisances eliminated.

    Attributes
    ----------
    value : float
        Log-likelihood, priors of the pixels' delays included.
    score : array of float, shape (P,)
    information : array of float, shape (P, P)
        After the pixels' own nuisances (background, delay) are eliminated.
    nuisance_gain : array of float, shape (n, 2 + L, P)
        How much the nuisances (ln background, delay, ln photons of each leg) follow a step of the
        parameters.
    nuisance_step : array of float, shape (n, 2 + L)
        Their own step at fixed parameters.
    nuisance_std : array of float, shape (n, 2 + L)
        Their standard errors at fixed parameters.
    fisher : array of float, shape (n, 3 L + 1, 3 L + 1)
        Information of each pixel in its local variables.
    """

    value: float
    score: Floats
    information: Floats
    nuisance_gain: Floats
    nuisance_step: Floats
    nuisance_std: Floats
    fisher: Floats


def likelihood(
    local: Local,
    pixels: Pixels,
    codes: CodeCounts,
    *,
    log_background: Floats,
    delay_shift_ps: Floats,
    log_photons_shift: Floats | None = None,
    log_scatter: ArrayLike = 0.0,
    expected_only: bool = False,
) -> Likelihood:
    """Evaluate the likelihood and eliminate each pixel's background, delay and brightness errors.

    `log_photons_shift` (n, L) is by how much each pixel departs from the brightness of its leg;
    `log_scatter`, (L,) or (n, L), how much it may.

    Parameters
    ----------
    local : Local
        Photons, time and width of every leg in every pixel.
    pixels : Pixels
        The pixels that take part.
    codes : CodeCounts
        Counts and code intervals of those pixels.
    log_background : array of float, shape (n,)
        ln(background counts per ps).
    delay_shift_ps : array of float, shape (n,)
        Clock error of each pixel, ps.
    log_photons_shift : array of float, shape (n, L), optional
        By how much each pixel departs from the brightness of its leg; None: not at all.
    log_scatter : array_like, optional
        (L,) or (n, L), how much it may, ln.
    expected_only : bool, optional
        Expected information; the counts are not read.

    Returns
    -------
    Likelihood
        Value, score and information.

    Notes
    -----
    With the pixels' own unknowns in block B, the parameters in A and C what both share, the
    information left is A - C B^-1 C^T (method.md, What the counts say).
    """
    n, n_legs = pixels.near.shape
    n_local = 3 * n_legs + 1
    score, information = np.zeros((n, n_local)), np.zeros((n, n_local, n_local))
    if log_photons_shift is None:
        log_photons_shift = np.zeros((n, n_legs))
    scatter = np.broadcast_to(np.asarray(log_scatter, dtype=float), (n, n_legs))
    delays = local.arrival_ps + (pixels.skew_ps + delay_shift_ps)[:, np.newaxis]
    value = photon_score(
        codes.counts,
        codes.lower_ps,
        codes.upper_ps,
        np.ones((n, 1)) if codes.open_share is None else codes.open_share,
        codes.period_ps,
        codes.shape,
        local.log_photons + log_photons_shift,
        delays,
        local.std_ps,
        log_background,
        codes.use_outside,
        expected_only,
        score,
        information,
    )
    own = _pixels_own(score, information, pixels, delay_shift_ps, log_photons_shift, scatter)
    outer = local.jacobian
    # Two plain products instead of one einsum over four indices.
    half = own.kept[:, :-1, :-1] @ outer
    size = outer.shape[2]
    total = outer.reshape(-1, size).T @ half.reshape(-1, size)
    return Likelihood(
        value=value + own.log_prior[0] + own.log_prior[1],
        score=np.einsum("nap,na->p", outer, own.kept_score[:, :-1]),
        # Rounding leaves it a hair unsymmetric, which eigenvalue routines take ill.
        information=0.5 * (total + total.T),
        nuisance_gain=-np.einsum("nij,naj,nap->nip", own.inverse, own.crossed[:, :-1], outer),
        nuisance_step=own.step,
        nuisance_std=np.sqrt(np.maximum(np.diagonal(own.inverse, axis1=1, axis2=2), 0.0)),
        fisher=information,
    )


@dataclass(frozen=True, eq=False)
class _PixelsOwn:
    """The nuisances of each pixel (2 + L of them), and what is left without them.

    Attributes
    ----------
    inverse : array of float, shape (n, 2 + L, 2 + L)
        Covariance of the nuisances at fixed parameters.
    crossed : array of float, shape (n, 3 L + 1, 2 + L)
        Information that local variables and nuisances share.
    step : array of float, shape (n, 2 + L)
        Best step of the nuisances at fixed parameters.
    kept : array of float, shape (n, 3 L + 1, 3 L + 1)
        Information left in the local variables.
    kept_score : array of float, shape (n, 3 L + 1)
        Score left in them.
    log_prior : (float, float)
        Log-density of the delays' and of the brightness errors' priors.
    """

    inverse: Floats
    crossed: Floats
    step: Floats
    kept: Floats
    kept_score: Floats
    log_prior: tuple[float, float]


def _pixels_own(
    score: Floats,
    information: Floats,
    pixels: Pixels,
    delay_shift_ps: Floats,
    log_photons_shift: Floats,
    scatter: Floats,
) -> _PixelsOwn:
    """Eliminate what each pixel has of its own: A - C B^-1 C^T, the Schur complement."""
    n_legs, n_local = scatter.shape[1], score.shape[1]
    # Nuisances of a pixel: ln background, its delay error (moves all its legs alike), and how
    # far each leg's light in it departs from the smooth brightness along the leg.
    to_nuisance = np.zeros((n_local, 2 + n_legs))
    to_nuisance[-1, 0] = 1.0
    to_nuisance[1:-1:3, 1] = 1.0
    to_nuisance[3 * np.arange(n_legs), 2 + np.arange(n_legs)] = 1.0
    crossed = information @ to_nuisance
    own = to_nuisance.T @ crossed
    own_score = score @ to_nuisance
    # A calibration error of zero is exact: held by a wall, not by a division by zero.
    precision = 1.0 / np.maximum(pixels.pixel_var, 1e-12)
    own[:, 1, 1] += precision
    # A pixel without any background in reach still needs a matrix that can be inverted.
    own[:, 0, 0] += 1e-9
    own_score[:, 1] -= delay_shift_ps * precision
    firm = 1.0 / np.maximum(scatter, 1e-6) ** 2
    legs = 2 + np.arange(n_legs)
    own[:, legs, legs] += firm
    own_score[:, 2:] -= log_photons_shift * firm
    inverse = np.linalg.inv(own).astype(np.float64, copy=False)
    step = np.einsum("nij,nj->ni", inverse, own_score)
    return _PixelsOwn(
        inverse=inverse,
        crossed=crossed,
        step=step,
        kept=information - np.einsum("nai,nij,nbj->nab", crossed, inverse, crossed),
        kept_score=score - np.einsum("nai,ni->na", crossed, step),
        log_prior=(
            -0.5 * float(np.sum(delay_shift_ps**2 * precision)),
            -0.5 * float(np.sum(log_photons_shift**2 * firm)),
        ),
    )
