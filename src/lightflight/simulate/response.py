"""The shape of a pulse as a detector sees it, in closed form: for recordings of one pulse."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erfcx, ndtr

from lightflight.simulate.clock import TrueClock
from lightflight.simulate.detector import Detector
from lightflight.units import std_from_fwhm

Floats = NDArray[np.float64]

_DRIFT_NODES = 9
_REACH_STD = 9.0
_SMALLEST_STD_PS = 1e-3


def exponentially_modified_cdf(time_ps: ArrayLike, std_ps: float, tail_ps: float) -> Floats:
    """Distribution function of a Gaussian (mean 0) plus an exponential (mean `tail_ps`).

    F(x) = Phi(x/s) - exp(s^2 / (2 T^2) - x/T) Phi(x/s - s/T), the second term written with the
    scaled complementary error function so that it never overflows.

    Parameters
    ----------
    time_ps : array-like, shape (...)
        x, ps.
    std_ps : float
        s of the Gaussian, ps.
    tail_ps : float
        T, mean of the exponential, ps.

    Returns
    -------
    array of float, shape (...)
        0 to 1.
    """
    x = np.asarray(time_ps, dtype=float)
    z = (std_ps / tail_ps - x / std_ps) / math.sqrt(2.0)
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        # Both are worked out everywhere, and each overflows only where the other is taken.
        near = 0.5 * np.exp(-0.5 * (x / std_ps) ** 2) * erfcx(z)
        far = np.exp(0.5 * (std_ps / tail_ps) ** 2 - x / tail_ps) * ndtr(-math.sqrt(2.0) * z)
    return np.asarray(ndtr(x / std_ps) - np.where(z > 0, near, far))


def pulse_cdf(time_ps: Floats, pulse_fwhm_ps: float, detector: Detector) -> Floats:
    """Distribution of a photon's lateness: pulse, trigger, response and its tail.

    Parameters
    ----------
    time_ps : array of float, shape (...)
        Lateness, ps.
    pulse_fwhm_ps : float
        Full width at half maximum of the laser pulse, ps.
    detector : Detector
        Trigger jitter, response and its tail.

    Returns
    -------
    array of float, shape (...)
        Chance of being no later, 0 to 1.
    """
    widths = (pulse_fwhm_ps, detector.trigger_jitter_fwhm_ps, detector.response_fwhm_ps)
    std = max(std_from_fwhm(math.hypot(*widths)), _SMALLEST_STD_PS)
    share: Floats = np.asarray(ndtr(time_ps / std))
    if detector.response_mean_ps > 0:
        late = exponentially_modified_cdf(time_ps, std, detector.response_tail_ps)
        share = share + detector.response_tail_fraction * (late - share)
    return share


def flat_shares(
    clock: TrueClock, delay_ps: Floats, pulse_fwhm_ps: float, detector: Detector
) -> Floats:
    """Share of a pulse in each code of each pixel.

    Parameters
    ----------
    clock : TrueClock
        The true clock.
    delay_ps : array of float, shape (pixels,)
        Delay of the pulse's Gaussian part, ps; the drift runs about it.
    pulse_fwhm_ps : float
        Full width at half maximum of the laser pulse, ps.
    detector : Detector
        Trigger jitter, response, its tail, and the drift.

    Returns
    -------
    array of float, shape (pixels, codes + 1)
        Rows sum to 1; the last column gets no code.
    """
    lower, upper = clock.intervals_ps(np.arange(len(delay_ps)))
    shares = np.zeros((len(delay_ps), clock.n_codes + 1))
    # Delays drift linearly: a recording is an even mean over moments in [-1, 1].
    moments, weights = np.polynomial.legendre.leggauss(_DRIFT_NODES if detector.drift_ps else 1)
    for moment, weight in zip(moments, weights / weights.sum(), strict=True):
        shift = delay_ps + 0.5 * detector.drift_ps * moment
        for fold in _folds(lower, upper, shift, pulse_fwhm_ps, detector, clock.laser_period_ps):
            late = pulse_cdf(upper - shift[:, None] - fold, pulse_fwhm_ps, detector)
            late -= pulse_cdf(lower - shift[:, None] - fold, pulse_fwhm_ps, detector)
            shares[:, :-1] += weight * late
    np.clip(shares, 0.0, 1.0, out=shares)
    shares[:, -1] = np.maximum(1.0 - shares[:, :-1].sum(axis=1), 0.0)
    scaled: Floats = shares / shares.sum(axis=1, keepdims=True)
    return scaled


def _folds(
    lower: Floats,
    upper: Floats,
    delay_ps: Floats,
    pulse_fwhm_ps: float,
    detector: Detector,
    period_ps: float | None,
) -> list[float]:
    """Multiples of the period by which a pulse may reach into the recorded range, ps."""
    if period_ps is None:
        return [0.0]
    reach = _REACH_STD * std_from_fwhm(
        math.hypot(pulse_fwhm_ps, detector.trigger_jitter_fwhm_ps, detector.response_fwhm_ps)
    )
    # exp(-40): no photon of any recording is later.
    tail = 40.0 * detector.response_tail_ps if detector.response_mean_ps > 0 else 0.0
    first = math.floor((lower.min() - delay_ps.max() - reach - tail) / period_ps)
    last = math.ceil((upper.max() - delay_ps.min() + reach) / period_ps)
    return [k * period_ps for k in range(first, last + 1)]
