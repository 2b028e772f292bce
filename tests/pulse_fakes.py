"""Histograms of known pulses, and a plain reference fit: slow, full range, no kernel in sight."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr

from lightflight.recording.histograms import Histograms

WIDTH = 55.0
STD = 70.0


def expected_counts(lower, upper, delay, std, photons, background, period=np.inf):
    """Counts due in codes [lower, upper); parameters broadcast against a last axis of codes."""
    counts = np.asarray(background) * (upper - lower)
    images = (-1.0, 0.0, 1.0) if np.isfinite(period) else (0.0,)
    for image in images:
        shift = image * period if image else 0.0
        high, low = (upper - delay - shift) / std, (lower - delay - shift) / std
        counts = counts + photons * (ndtr(high) - ndtr(low))
    return counts


def pulse_cube(
    rng, n_pixels, pulses, background_per_code, *, n_codes=908, std=STD, folds=True, **options
):
    """Histograms (1, n_pixels, codes) of Gaussian pulses; `pulses`: (delays, photons) pairs."""
    lower = np.arange(n_codes) * WIDTH
    period = n_codes * WIDTH if folds else np.inf
    mean = np.full((n_pixels, n_codes), float(background_per_code))
    for delay, photons in pulses:
        delay = np.broadcast_to(delay, (n_pixels,))[:, None]
        photons = np.broadcast_to(photons, (n_pixels,))[:, None]
        mean += expected_counts(lower, lower + WIDTH, delay, std, photons, 0.0, period)
    counts = rng.poisson(mean)[None]
    period_ps = period if folds else None
    return Histograms(counts, bin_width_ps=WIDTH, laser_period_ps=period_ps, **options)


def reference_fit(counts, lower, upper, start, period=np.inf):
    """Poisson maximum likelihood over every code by a general minimiser.

    Returns (delay, std, photons, background) and their covariance from the expected information,
    its derivatives taken by finite differences.
    """
    live = upper > lower
    counts, lower, upper = counts[live], lower[live], upper[live]
    scale = np.array([start[1], start[1], start[2], max(start[3], 1e-3 / np.ptp(upper))])

    def mean(x):
        delay, std, photons, background = x * scale
        return expected_counts(lower, upper, delay, std, photons, background, period)

    def cost(x):
        if x[1] <= 0 or x[2] < 0 or x[3] < 0:
            return np.inf
        expected = np.maximum(mean(x), 1e-300)
        return np.sum(expected - counts * np.log(expected))

    best = np.asarray(start, dtype=float) / scale
    for _ in range(5):
        options: Any = {"maxiter": 4000, "maxfev": 4000, "xatol": 1e-8, "fatol": 1e-11}
        best = minimize(cost, best, method="Nelder-Mead", options=options).x
    step = 1e-5
    slopes = np.array([(mean(best + d) - mean(best - d)) / (2 * step) for d in np.eye(4) * step])
    information = (slopes / np.maximum(mean(best), 1e-300)) @ slopes.T
    return best * scale, np.linalg.inv(information) * np.outer(scale, scale)


def wrapped(difference, period):
    """Differences of times in [-period/2, period/2)."""
    return (np.asarray(difference) + period / 2) % period - period / 2
