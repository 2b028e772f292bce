"""Photons of pulses at known times against a general minimiser."""

import numpy as np
import pytest
from scipy.optimize import minimize

from lightflight.timing.pulses.amplitudes import amplitudes_at_times
from tests.pulse_fakes import STD, WIDTH, expected_counts


def test_amplitudes_have_the_largest_likelihood_given_times_and_widths(rng):
    """Two pulses that overlap across the fold and a place without one, over a known background."""
    lower, period = np.arange(128) * WIDTH, 128 * WIDTH
    delays, stds = np.array([[30.0, np.nan, period - 90.0]]), np.full((1, 3), STD)
    shapes = [
        expected_counts(lower, lower + WIDTH, delay, STD, 1.0, 0.0, period)
        for delay in delays[0, [0, 2]]
    ]
    counts = rng.poisson(np.array([400.0, 150.0]) @ shapes + 2.0).astype(float)
    photons, empty, background = amplitudes_at_times(
        counts[None], lower[None], lower[None] + WIDTH, period, delays, stds
    )
    away = (np.array(shapes) < 1e-7).all(axis=0)
    assert background[0] == pytest.approx(counts[away].mean() / WIDTH, rel=0.02)

    def minus_log_likelihood(amplitudes):
        mean = amplitudes @ shapes + background[0] * WIDTH
        return np.sum(mean - counts * np.log(mean))

    best = minimize(minus_log_likelihood, (300.0, 200.0), bounds=[(1, None)] * 2).x
    np.testing.assert_allclose(photons[0, [0, 2]], best, atol=0.1 * np.sqrt(best.min()))
    assert np.isnan(photons[0, 1])
    assert np.isnan(empty[0, 1])
    other = best[1] * shapes[1] + background[0] * WIDTH
    assert 1.0 / empty[0, 0] == pytest.approx(np.sum(shapes[0] ** 2 / other), rel=0.05)
