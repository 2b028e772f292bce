"""Free code widths did not add up to the period that the sweep covers.

A LinoSPAD2 clock, whose 140 codes share the 2.5 ns between two pulses, came out 15 % wrong.
"""

import numpy as np
import pytest

import lightflight as lf


@pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")
def test_the_codes_of_each_pixel_fill_the_period(rng):
    """From nothing to several times the mean, as real tables have them."""
    shares = rng.gamma(0.7, size=(4, 4, 140))
    shares /= shares.sum(axis=-1, keepdims=True)
    hist = lf.Histograms(
        rng.poisson(2e6 * shares), bin_width_ps=2500.0 / 140, laser_period_ps=2500.0
    )
    clock = lf.calibrate_timing(hist)
    lower, upper = clock.code_intervals_ps(*(grid.ravel() for grid in np.indices((4, 4))))
    np.testing.assert_allclose((upper - lower).sum(axis=1), 2500.0, rtol=1e-9)
    # 2e6 counts: the cumulated shares wander by 0.5 / sqrt(2e6), 0.9 ps.
    edges = 2500.0 * np.cumsum(shares.reshape(16, 140), axis=1)
    assert np.abs(upper - lower[:, :1] - edges).max() < 6.0 * 0.9
