"""Counts on a comb of codes (a camera without sync), stray light between: pulses for minutes."""

import time

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import CalibrationError
from lightflight.recording.histograms import Histograms


@pytest.mark.parametrize("stray", [0.0, 2.0, 10.0])
def test_a_comb_is_refused_at_once(stray):
    rng = np.random.default_rng(5)
    counts = rng.poisson(stray, (32, 32, 1024))
    counts[..., 8:915:8] += rng.poisson(50.0, counts[..., 8:915:8].shape)
    comb = Histograms(counts, bin_width_ps=55.0, laser_period_ps=50_000.0, reversed_codes=True)
    started = time.perf_counter()
    with pytest.raises(CalibrationError, match=r"without sync.*every 8th code"):
        lf.find_arrivals(comb)
    assert time.perf_counter() - started < 20.0
