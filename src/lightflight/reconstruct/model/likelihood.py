"""The Poisson likelihood of all counts at one set of parameters, each pixel's own eliminated.

Takes what `forward` expects of every pixel, gives log-likelihood, score and information in the
parameters that pixels share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight._kernels.photon_score import photon_score
from lightflight.reconstruct.model.forward import CodeCounts, Local, Pixels

Floats = NDArray[np.float64]


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
    """

    value: float
    score: Floats
    information: Floats
    nuisance_gain: Floats
    nuisance_step: Floats
    nuisance_std: Floats


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
    if log_photons_shift is None:
        log_photons_shift = np.zeros((n, n_legs))
    scatter = np.broadcast_to(np.asarray(log_scatter, dtype=float), (n, n_legs))
    delays = local.arrival_ps + (pixels.skew_ps + delay_shift_ps)[:, np.newaxis]
    value, score, information = _scored(
        codes,
        local.log_photons + log_photons_shift,
        delays,
        local.std_ps,
        local.third_ps3,
        log_background,
        expected_only=expected_only,
    )
    own = _pixels_own(score, information, pixels, delay_shift_ps, log_photons_shift, scatter)
    outer = local.jacobian
    # Two plain products instead of one einsum over four indices.
    half = own.kept[:, :-1, :-1] @ outer
    follow = own.inverse @ own.crossed[:, :-1].swapaxes(1, 2)
    size = outer.shape[2]
    total = outer.reshape(-1, size).T @ half.reshape(-1, size)
    return Likelihood(
        value=value + own.log_prior[0] + own.log_prior[1],
        score=outer.reshape(-1, size).T @ own.kept_score[:, :-1].ravel(),
        # Rounding leaves it a hair unsymmetric, which eigenvalue routines take ill.
        information=0.5 * (total + total.T),
        nuisance_gain=-follow @ outer,
        nuisance_step=own.step,
        nuisance_std=np.sqrt(np.maximum(np.diagonal(own.inverse, axis1=1, axis2=2), 0.0)),
    )


def _scored(
    codes: CodeCounts,
    log_photons: Floats,
    delays: Floats,
    stds: Floats,
    thirds: Floats,
    log_background: Floats,
    *,
    expected_only: bool,
) -> tuple[float, Floats, Floats]:
    """Log-likelihood, score (n, 3 L + 1) and information of each pixel's local variables."""
    if codes.second is not None:
        # The second pulse of a leg is one leg more, whose variables are those of the first.
        share, later = codes.second
        log_photons = np.hstack((log_photons, log_photons + np.log(share)))
        delays, stds = np.hstack((delays, delays + later)), np.hstack((stds, stds))
        thirds = np.hstack((thirds, thirds))
    n, n_local = len(delays), 3 * delays.shape[1] + 1
    score, information = np.zeros((n, n_local)), np.zeros((n, n_local, n_local))
    value = photon_score(
        codes.counts,
        codes.lower_ps,
        codes.upper_ps,
        np.ones((n, 1)) if codes.open_share is None else codes.open_share,
        codes.other,
        codes.period_ps,
        *codes.shape,
        log_photons,
        delays,
        stds,
        thirds,
        log_background,
        codes.use_outside,
        expected_only,
        score,
        information,
    )
    if codes.second is None:
        return value, score, information
    once = (n_local - 1) // 2
    to_own = np.zeros((n_local, once + 1))
    to_own[np.arange(n_local - 1), np.arange(n_local - 1) % once] = 1.0
    to_own[-1, -1] = 1.0
    return value, score @ to_own, to_own.T @ information @ to_own


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
    step = (inverse @ own_score[..., np.newaxis])[..., 0]
    return _PixelsOwn(
        inverse=inverse,
        crossed=crossed,
        step=step,
        kept=information - crossed @ inverse @ crossed.swapaxes(1, 2),
        kept_score=score - (crossed @ step[..., np.newaxis])[..., 0],
        log_prior=(
            -0.5 * float(np.sum(delay_shift_ps**2 * precision)),
            -0.5 * float(np.sum(log_photons_shift**2 * firm)),
        ),
    )
