"""Nominal codes beyond one laser period stood for times that earlier codes stood for already."""

import numpy as np
import pytest

import lightflight as lf
from lightflight.timing.clock.calibration import TimingCalibration


@pytest.mark.parametrize("reversed_codes", [True, False])
def test_nominal_codes_cover_one_period_once(reversed_codes):
    """1,024 codes of 55 ps reach beyond 50 ns: those beyond stand for no second time."""
    hist = lf.Histograms(
        np.zeros((1, 1, 1024), int), bin_width_ps=55.0, laser_period_ps=50_000.0,
        reversed_codes=reversed_codes,
    )  # fmt: skip
    lower, upper = (x[0] for x in TimingCalibration.nominal(hist).code_intervals_ps([0], [0]))
    assert np.sum(upper - lower) == pytest.approx(50_000.0)
    assert lower.min() == pytest.approx(0.0, abs=1e-9)
    assert upper.max() == pytest.approx(50_000.0)
    np.testing.assert_allclose((upper - lower)[:909], 55.0)
    assert (upper - lower)[910:].max() == pytest.approx(0.0, abs=1e-9)
