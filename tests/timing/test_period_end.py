"""Where the period ends: the search beside a plain scan of its likelihood."""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.timing.calibrate import period_end


@pytest.mark.parametrize("blur", [0.01, 0.05, 0.3, 1.0, 3.0])
@pytest.mark.parametrize(
    "level",
    [
        5.0,
        pytest.param(50.0, marks=pytest.mark.long),
        pytest.param(2e3, marks=pytest.mark.long),
        1e5,
    ],
)
def test_ends_are_the_most_likely_ones(level, blur):
    """Per pixel no end of 8,000 is likelier by 0.01, which is a seventh of an error."""
    rng = np.random.default_rng(3)
    n, edges = 40, np.arange(100.0, 141.0)
    truth = 115.0 + rng.uniform(0.0, 6.0, n)
    counts = level * rng.uniform(0.8, 1.2, (n, 40))
    share = period_end.live_fraction(truth, edges, blur) + 1e-3
    tail = period_end._Tail(rng.poisson(counts * share).astype(float), counts, edges, 1e-3)
    found, likelihood = period_end._scan_end(tail, blur)
    plain = [
        period_end._end_likelihood(tail, np.full(n, end), blur)
        for end in np.linspace(108.0, 130.0, 8000)
    ]
    assert (np.max(plain, axis=0) - likelihood).max() < 0.01
    assert np.allclose(period_end._end_likelihood(tail, found, blur), likelihood, atol=1e-6)
