"""Batched fits: their model, its derivatives, windows, and what tells two pulses from one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lightflight.timing.clock.response import Response
from lightflight.timing.pulses import batch, split as splitting
from lightflight.timing.pulses.bins import bins_of, window_at
from tests.pulse_fakes import STD, WIDTH, expected_counts

CODES = np.arange(64) * WIDTH


def bins_of_row(counts):
    counts = np.asarray(counts, float)[None]
    never, none = np.full(1, np.inf), np.zeros((1, 2))
    return bins_of(counts, CODES[None], CODES[None] + WIDTH, math.inf, never, none)


def window_of(bins, first, m):
    return window_at(bins, np.array([first]), np.array([m]), np.zeros(1))


def model_of(kind):
    shape = Response.with_tail(std_ps=60.0, tail_ps=90.0).table() if kind == "tail" else None
    return batch.Model(True, kind == "sampled", True, np.empty((3, 0)) if shape is None else shape)


@pytest.mark.parametrize("kind", ["gaussian", "sampled", "tail"])
def test_slopes_of_the_model_are_its_derivatives(kind):
    theta = np.array([[1490.0, 1600.0, 380.0, 90.0, 75.0, 0.012]])
    window, model = window_of(bins_of_row(np.zeros(64)), 0, 64), model_of(kind)
    _, slope, _ = batch.expected_in(window, theta, model)
    for a in range(6):
        step = np.zeros((1, 6))
        step[0, a] = 1e-5 * theta[0, a]
        high, low = (batch.expected_in(window, theta + d, model)[0] for d in (step, -step))
        by = (high - low) / (2 * step[0, a])
        np.testing.assert_allclose(slope[:, a], by, rtol=1e-5, atol=2e-6 * np.abs(by).max())


def test_window_and_sums_give_the_likelihood_of_the_full_range(rng):
    """Exactly: differences of the objective, gradient and information agree with all bins in."""
    counts = rng.poisson(expected_counts(CODES, CODES + WIDTH, 1500.0, STD, 400.0, 0.01))
    bins, model = bins_of_row(counts), model_of("gaussian")
    whole, part = window_of(bins, 0, 64), window_of(bins, 15, 24)
    assert part.outside[0, 0] > 0
    thetas = np.array([[[1500.0, 380.0, 70.0, 0.01]], [[1480.0, 420.0, 66.0, 0.012]]])
    for theta in thetas:
        one, other = (batch._score(window, bins.dark, theta, model) for window in (whole, part))
        assert one.objective == pytest.approx(other.objective, rel=1e-12)
        np.testing.assert_allclose(one.gradient, other.gradient, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(one.information, other.information, rtol=1e-8, atol=1e-12)


def test_valley_separates_two_bumps_from_a_slope():
    codes = CODES
    two = expected_counts(codes, codes + WIDTH, 1000.0, STD, 3000.0, 0.01)
    two += expected_counts(codes, codes + WIDTH, 1430.0, STD, 100.0, 0.0)
    bins = bins_of_row(two)
    tail = np.where(codes > 1000.0, 600.0 * np.exp(-(codes - 1000.0) / 200.0), 0.0)
    one = expected_counts(codes, codes + WIDTH, 1000.0, STD, 3000.0, 0.01)
    falling = bins_of_row(one + tail)
    gains = [
        splitting.valley_between(
            *splitting.unfolded(some, 0, 1200.0), left=1000.0, right=1430.0, weaker=1430.0,
            std=STD, hollow=1.0,
        )
        for some in (bins, falling)
    ]  # fmt: skip
    assert gains[0] > splitting.VALLEY
    assert gains[1] == 0.0
