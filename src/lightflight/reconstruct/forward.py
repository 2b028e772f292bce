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
handful of parameters: `photon` climbs it, `cramer_rao` reads its curvature.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline

from lightflight._kernels.photon_score import photon_score
from lightflight.flight import Medium
from lightflight.reconstruct._footing import Corners, Moment, corner_distances, footing
from lightflight.reconstruct.geometry import (
    Indices,
    PathState,
    arrival_jacobian,
    line_offsets,
)
from lightflight.reconstruct.legs import mean_focal_px
from lightflight.reconstruct.picture import LegInPicture, arrival_curvature

if TYPE_CHECKING:
    from lightflight.camera import Camera

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Light:
    """Everything about the light that is not the path."""

    lines: tuple[LegInPicture, ...]
    """Where along each leg's image the strength is measured."""
    knots: tuple[Floats, ...]
    """Knots of the cubic log-strength of each leg, px along its line."""
    coefficients: tuple[Floats, ...]
    """Spline coefficients of the log of photons per pixel on the line."""
    log_spot_px: float
    """Log of the spot's standard deviation, px."""
    log_std_ps: float
    """Log of the standard deviation of laser pulse and response, ps."""
    log_scatter: tuple[float, ...]
    """Per leg, scatter of ln(photons) from pixel to pixel that the model does not explain."""
    cut_ends: tuple[bool, bool] = (False, False)
    """Whether the light begins at the path's first vertex, and stops at its last."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """The pixels that take part: (n,) arrays, legs near each in columns (n, L)."""

    rows: Indices
    cols: Indices
    near: NDArray[np.bool_]
    """(n, L), True where the leg's light can reach the pixel."""
    points_px: Floats
    """(n, 2), undistorted (u, v)."""
    skew_ps: Floats
    """(n,), delay of the pixel."""
    pixel_var: Floats
    """(n,), variance of that delay from the calibration, ps^2."""
    modes_ps: Floats
    """(n, L, k), shared clock errors at the leg's arrival, one-sigma columns, ps."""


@dataclass(frozen=True, eq=False)
class CodeCounts:
    """Counts and code intervals of the pixels that take part."""

    counts: Floats
    """(n, codes)."""
    lower_ps: Floats
    """(n, codes)."""
    upper_ps: Floats
    """(n, codes)."""
    period_ps: float
    """Laser period, ps; 0: none."""
    use_outside: NDArray[np.bool_]
    """(n,), False where something else flashes outside the windows."""
    open_share: Floats | None = None
    """(n, codes or 1), counts in a code per photon that came (pile-up); None: all are counted."""
    shape: Floats = field(default_factory=lambda: np.empty((3, 0)))
    """Shape of a pulse (`timing.response.Response.table`); (3, 0): a Gaussian."""


@dataclass(frozen=True, eq=False)
class Local:
    """Local variables of each pixel and leg, and how they follow from the global ones."""

    log_photons: Floats
    """(n, L)."""
    arrival_ps: Floats
    """(n, L), mean over the footprint; NaN where the leg is not near."""
    std_ps: Floats
    """(n, L), of the pulse with its transit."""
    jacobian: Floats
    """(n, 3 L, P), d(ln photons, time, ln std of each leg) / d(parameters)."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Where each kind of parameter sits in the vector of P."""

    n_free: int
    """Freedom of the path."""
    n_modes: int
    """Shared clock errors."""
    spline_starts: tuple[int, ...]
    """First coefficient of each leg's log-strength."""
    size: int
    """P; the last two are log spot and log std."""


def layout_of(n_free: int, n_modes: int, light: Light) -> Layout:
    """Order of the parameters: path, modes, splines leg by leg, log spot, log std."""
    starts, at = [], n_free + n_modes
    for coefficients in light.coefficients:
        starts.append(at)
        at += len(coefficients)
    return Layout(n_free, n_modes, tuple(starts), at + 2)


def moved_light(light: Light, step: Floats, layout: Layout) -> Light:
    """The light after a step of the parameters; widths keep within sane bounds."""
    coefficients = tuple(
        c + step[start : start + len(c)]
        for c, start in zip(light.coefficients, layout.spline_starts, strict=True)
    )
    return replace(
        light,
        coefficients=coefficients,
        log_spot_px=float(np.clip(light.log_spot_px + step[-2], np.log(0.08), np.log(6.0))),
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
    """Photons, time and width of every leg in every pixel, with their derivatives."""
    n, n_legs = pixels.near.shape
    log_photons = np.full((n, n_legs), -60.0)
    arrival, std = np.full((n, n_legs), np.nan), np.ones((n, n_legs))
    jacobian = np.zeros((n, 3 * n_legs, layout.size))
    spot, focal = float(np.exp(light.log_spot_px)), mean_focal_px(camera)
    for k in range(n_legs):
        here = np.flatnonzero(pixels.near[:, k])
        legs = np.full(len(here), k)
        print_, by_state = arrival_jacobian(
            state,
            camera=camera,
            medium=medium,
            legs=legs,
            rows=pixels.rows[here],
            cols=pixels.cols[here],
        )
        points = pixels.points_px[here]
        across, across_by_state = line_offsets(
            state, camera=camera, legs=legs, anchors=points, focal_px=focal
        )
        along = np.clip(
            light.lines[k].along_across(points)[0], light.knots[k][3], light.knots[k][-4]
        )
        design = BSpline.design_matrix(along, light.knots[k], 3).toarray()
        spline = BSpline(light.knots[k], light.coefficients[k], 3)
        curvature = arrival_curvature(print_, state=state, camera=camera, medium=medium)
        corners = corner_distances(state, print_, k, camera=camera, cut_ends=light.cut_ends)
        feet = footing(
            spline.derivative()(along), print_.slope_ps_per_px, curvature, corners, spot_px=spot
        )
        log_photons[here, k] = np.maximum(
            design @ light.coefficients[k] + feet.log_share.value - 0.5 * (across / spot) ** 2,
            -60.0,
        )
        std_here = np.sqrt(np.exp(2 * light.log_std_ps) + feet.variance_ps2.value)
        std[here, k] = std_here
        modes_here = pixels.modes_ps[here, k]
        arrival[here, k] = print_.arrival_ps + feet.offset_ps.value + modes_here @ modes
        at, splines = 3 * k, layout.spline_starts[k]
        to_spline = slice(splines, splines + design.shape[1])
        to_slope = BSpline(light.knots[k], np.eye(design.shape[1]), 3).derivative()(along)
        to_log_std = 0.5 / std_here**2
        for row, moment, scale in (
            (at, feet.log_share, 1.0),
            (at + 1, feet.offset_ps, 1.0),
            (at + 2, feet.variance_ps2, to_log_std),
        ):
            by_corners = (_by_corners(moment, corners) @ basis).T * scale
            jacobian[here, row, : layout.n_free] = by_corners.T
            jacobian[here, row, to_spline] = (scale * moment.by_slope)[:, np.newaxis] * to_slope
            jacobian[here, row, -2] = scale * moment.by_log_spot
        lateral = -(across / spot**2)[:, np.newaxis] * across_by_state
        jacobian[here, at, : layout.n_free] += lateral @ basis
        jacobian[here, at, to_spline] += design
        jacobian[here, at, -2] += (across / spot) ** 2
        jacobian[here, at + 1, : layout.n_free] += by_state @ basis
        jacobian[here, at + 1, layout.n_free : layout.n_free + layout.n_modes] = modes_here
        jacobian[here, at + 2, -1] = np.exp(2 * light.log_std_ps) / std_here**2
    return Local(log_photons, arrival, std, jacobian)


def _by_corners(moment: Moment, corners: Corners) -> Floats:
    """d(moment) / d(state) through the places of the corners; (n, 3m + 1)."""
    return (
        moment.by_before[:, np.newaxis] * corners.before_by_state
        + moment.by_after[:, np.newaxis] * corners.after_by_state
    )


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Log-likelihood of all counts at one set of parameters, pixel nuisances eliminated."""

    value: float
    """Log-likelihood, priors of the pixels' delays included."""
    score: Floats
    """(P,)."""
    information: Floats
    """(P, P), after the pixels' own nuisances (background, delay) are eliminated."""
    nuisance_gain: Floats
    """(n, 2 + L, P): how much the nuisances (ln background, delay, ln photons of each leg)
    follow a step of the parameters."""
    nuisance_step: Floats
    """(n, 2 + L), their own step at fixed parameters."""
    nuisance_std: Floats
    """(n, 2 + L), their standard errors at fixed parameters."""
    fisher: Floats
    """(n, 3 L + 1, 3 L + 1), information of each pixel in its local variables."""


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
    # Nuisances of a pixel: ln background, its delay error (moves all its legs alike), and how
    # far each leg's light in it departs from the smooth brightness along the leg.
    to_nuisance = np.zeros((n_local, 2 + n_legs))
    to_nuisance[-1, 0] = 1.0
    to_nuisance[1:-1:3, 1] = 1.0
    to_nuisance[3 * np.arange(n_legs), 2 + np.arange(n_legs)] = 1.0
    crossed = information @ to_nuisance
    own = to_nuisance.T @ crossed
    own_score = score @ to_nuisance
    precision = 1.0 / np.maximum(pixels.pixel_var, 1e-12)
    own[:, 1, 1] += precision
    own[:, 0, 0] += 1e-9
    own_score[:, 1] -= delay_shift_ps * precision
    value -= 0.5 * float(np.sum(delay_shift_ps**2 * precision))
    firm = 1.0 / np.maximum(scatter, 1e-6) ** 2
    legs = 2 + np.arange(n_legs)
    own[:, legs, legs] += firm
    own_score[:, 2:] -= log_photons_shift * firm
    value -= 0.5 * float(np.sum(log_photons_shift**2 * firm))
    inverse = np.linalg.inv(own)
    step = np.einsum("nij,nj->ni", inverse, own_score)
    kept = information - np.einsum("nai,nij,nbj->nab", crossed, inverse, crossed)
    kept_score = score - np.einsum("nai,ni->na", crossed, step)
    outer = local.jacobian
    half = kept[:, :-1, :-1] @ outer
    size = outer.shape[2]
    total = outer.reshape(-1, size).T @ half.reshape(-1, size)
    return Likelihood(
        value=value,
        score=np.einsum("nap,na->p", outer, kept_score[:, :-1]),
        information=0.5 * (total + total.T),
        nuisance_gain=-np.einsum("nij,naj,nap->nip", inverse, crossed[:, :-1], outer),
        nuisance_step=step,
        nuisance_std=np.sqrt(np.maximum(np.diagonal(inverse, axis1=1, axis2=2), 0.0)),
        fisher=information,
    )
