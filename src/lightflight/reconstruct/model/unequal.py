"""Pixels that count more or less than their neighbours in the same light: by how much, from counts.

Takes what pixels counted and what a model expects of them, gives the scatter beyond counting noise:
by a median while a model is rough, or the variance of the efficiencies that makes the scatter
likeliest. A count is then Poisson's of a mean that is itself a gamma's: variance mu + u mu^2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from lightflight.reconstruct.model.kinks import LEAST_TELLING
from lightflight.units import MEDIAN_CHI2

Floats = NDArray[np.float64]

MOST_STDS = 6.0
"""Times the scatter that is there: hot pixels and other light, not the spot's own shape."""

_LOG_UNEQUAL = (-18.0, -3.8)
"""Log of the least and largest variance of the pixels' efficiencies that is looked for, ln^2: from
1e-4, which takes a hundred million photons to see, to 0.15. What scatters more is a bent line."""

_BRIGHT = 30.0
"""Photons from which a pixel's squared residual is a chi-square's, whose median is known."""


def variance_of_counts(counted: Floats, unequal: float) -> Floats:
    """Variance (n,) of counts: their own noise, and what pixels are unequal by.

    Parameters
    ----------
    counted : array of float, shape (n,)
        Expected counts, the empty ones included.
    unequal : float
        Variance of the pixels' efficiencies, ln^2.

    Returns
    -------
    array of float, shape (n,)
    """
    return counted * (1.0 + unequal * counted)


def half_deviance(counts: Floats, mean: Floats, unequal: float) -> Floats:
    """Half the deviance (n,) of Poisson counts whose mean is itself unequal by chance (a gamma).

    Parameters
    ----------
    counts : array of float, shape (n,)
        Counts, none below zero.
    mean : array of float, shape (n,)
        Expected counts.
    unequal : float
        Variance of the pixels' efficiencies, ln^2.

    Returns
    -------
    array of float, shape (n,)
    """
    ratio = np.where(counts > 0, counts / mean, 1.0)
    if not unequal:
        poisson: Floats = counts * np.log(ratio) - (counts - mean)
        return poisson
    of_gamma = (counts + 1.0 / unequal) * np.log1p(
        unequal * (counts - mean) / (1.0 + unequal * mean)
    )
    mixed: Floats = counts * np.log(ratio) - of_gamma
    return mixed


def log_likelihood(residual: Floats, variance: Floats) -> float:
    """Of normal residuals, but for a constant; strangers among them count as they may at most.

    Parameters
    ----------
    residual : array of float, shape (n,)
        Counts beyond those expected.
    variance : array of float, shape (n,)
        Of them.

    Returns
    -------
    float
    """
    squared = np.minimum(residual**2 / variance, MOST_STDS**2)
    return -0.5 * float(np.sum(squared + np.log(variance)))


def price(n_parameters: int, n_data: int) -> float:
    """Log-likelihood that parameters must gain: Schwarz, Ann. Stat. 6, 461 (1978).

    Parameters
    ----------
    n_parameters, n_data : int
        Of the model that is to be believed.

    Returns
    -------
    float
    """
    return 0.5 * n_parameters * float(np.log(n_data))


def median_scatter(residual: Floats, mean: Floats, variance: Floats, weights: Floats) -> float:
    """Std of ln(photons / mean) beyond counting noise, from the pixels bright enough to show it.

    Parameters
    ----------
    residual : array of float, shape (n,)
        Photons beyond those expected.
    mean : array of float, shape (n,)
        Expected photons.
    variance : array of float, shape (n,)
        Of the photons, by counting noise.
    weights : array of float, shape (n,)
        1, or 0 for pixels left out.

    Returns
    -------
    float
        ln; 0 where they scatter as chance allows.
    """
    telling = (weights > 0) & (mean > _BRIGHT)
    if telling.sum() < 6:
        return 0.0
    ratio = (residual[telling] / mean[telling]) ** 2
    expected = variance[telling] / mean[telling] ** 2
    # The median of a chi-square of one degree; chance alone passes 1.5 in few recordings.
    excess = float(np.median(ratio / expected)) / MEDIAN_CHI2
    if excess < 1.0 + 4.0 / np.sqrt(telling.sum()):
        return 0.0
    return float(np.sqrt(max(0.0, np.median(ratio - MEDIAN_CHI2 * expected) / MEDIAN_CHI2)))


def rough_unequal(residual: Floats, counted: Floats) -> float:
    """Variance of the efficiencies that puts the median of bright pixels where chance has it.

    Half of them may be strangers: it says which are.

    Parameters
    ----------
    residual : array of float, shape (n,)
        Counts beyond those expected.
    counted : array of float, shape (n,)
        Expected counts, the empty ones included.

    Returns
    -------
    float
        ln^2; 0 where they scatter as Poisson's do.
    """
    bright = counted > _BRIGHT
    if not bright.any():
        return 0.0
    squared, noise = residual[bright] ** 2, counted[bright]
    low, high = np.exp(_LOG_UNEQUAL)
    # The median falls as the variance grows: bisection of its logarithm.
    for _ in range(30):
        middle = float(np.sqrt(low * high))
        wide = np.median(squared / variance_of_counts(noise, middle)) > MEDIAN_CHI2
        low, high = (middle, high) if wide else (low, middle)
    return float(low) if low > np.exp(_LOG_UNEQUAL[0]) else 0.0


def likeliest_unequal(residual: Floats, counted: Floats, n_fitted: int) -> float:
    """Variance of the efficiencies that makes the scatter of the counts likeliest.

    Parameters
    ----------
    residual : array of float, shape (n,)
        Counts beyond those expected; no strangers among them.
    counted : array of float, shape (n,)
        Expected counts, the empty ones included.
    n_fitted : int
        Parameters that took up some of the scatter.

    Returns
    -------
    float
        ln^2; 0 where it explains less than its price.
    """
    told = counted > LEAST_TELLING
    n, noise = int(told.sum()), counted[told]
    if n <= n_fitted:
        return 0.0
    # What the fit took up of the scatter is put back.
    scatter = residual[told] * np.sqrt(n / (n - n_fitted))

    def unlikely(log_variance: float) -> float:
        return -log_likelihood(scatter, variance_of_counts(noise, float(np.exp(log_variance))))

    found = minimize_scalar(unlikely, bounds=_LOG_UNEQUAL, method="bounded")
    if -found.fun <= log_likelihood(scatter, noise) + price(1, n):
        return 0.0
    return float(np.exp(found.x))
