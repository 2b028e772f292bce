"""Drift of a clock: what moved is measured, what did not raises no alarm."""

from dataclasses import replace

import numpy as np
import pytest

from lightflight.errors import CalibrationError, SuspectDataWarning, UncalibratedWarning
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.drift import drift_from_flat, drift_in_slices
from tests.clock_fakes import fake_clock


@pytest.fixture(scope="module")
def camera():
    rng = np.random.default_rng(4)
    clock = fake_clock(rng, (10, 10))
    timing = calibrate_timing(
        clock.uniform(rng, 1e6), flat=clock.pulse(rng, 2000.0, 4e4), flat_arrival_ps=2000.0,
        dead_codes="absorbed",
    )  # fmt: skip
    return clock, timing


def test_nothing_moved(camera, rng):
    clock, timing = camera
    drift = drift_from_flat(timing, clock.pulse(rng, 2000.0, 4e4), flat_arrival_ps=2000.0)
    assert not drift.moved.any()
    assert abs(drift.offset_ps[0]) < 5 * drift.offset_std_ps[0]
    assert drift.offset_std_ps[0] == pytest.approx(0.36 * np.sqrt(2) / 10, rel=0.15)
    assert drift.chi2[0] == pytest.approx(98, abs=5 * np.sqrt(196))


def test_shift_since_the_calibration(camera, rng):
    clock, timing = camera
    later = replace(clock, skew_ps=clock.skew_ps + 4.0)
    flat = later.pulse(rng, 2000.0, 4e4)
    with pytest.warns(SuspectDataWarning, match=r"drifted since .* moved by \+[34]\.\d\d \+- 0.0"):
        drift = drift_from_flat(timing, flat, flat_arrival_ps=2000.0)
    assert drift.offset_ps[0] == pytest.approx(4.0, abs=5 * drift.offset_std_ps[0])


def test_slices_of_a_steady_recording(camera, rng):
    clock, timing = camera
    slices = [clock.pulse(rng, 3000.0, 4e3) for _ in range(4)]
    drift = drift_in_slices(slices, timing=timing)
    assert not drift.moved.any()
    assert drift.offset_ps.shape == (4,)


def test_slices_of_a_camera_that_warms_up(camera, rng):
    clock, timing = camera
    slices = [
        replace(clock, skew_ps=clock.skew_ps + shift).pulse(rng, 3000.0, 1e4)
        for shift in (0.0, 2.0, 4.0)
    ]
    with pytest.warns(SuspectDataWarning, match="pulses move within the recording: in slice [13]"):
        drift = drift_in_slices(slices, timing=timing)
    # against the mean of the others: -3, 0, +3
    np.testing.assert_allclose(drift.offset_ps, [-3.0, 0.0, 3.0], atol=5 * drift.offset_std_ps[0])


def test_scale_of_a_clock_that_warms_up(camera, rng):
    clock, timing = camera
    arrival = 3000.0 + np.linspace(-2000.0, 2000.0, 100)
    slices = [clock.pulse(rng, arrival * (1.0 + stretch), 4e4) for stretch in (0.0, 1e-3)]
    with pytest.warns(SuspectDataWarning, match="the scale by"):
        drift = drift_in_slices(slices, timing=timing)
    np.testing.assert_allclose(drift.scale, [-1e-3, 1e-3], atol=5 * drift.scale_std[0])


def test_without_delays_there_is_nothing_to_compare(camera, rng):
    clock, _ = camera
    with pytest.warns(UncalibratedWarning):
        timing = calibrate_timing(clock.uniform(rng, 1e5), dead_codes="absorbed")
    with pytest.raises(CalibrationError, match="no delays to compare with"):
        drift_from_flat(timing, clock.pulse(rng, 2000.0, 1e4))
    with pytest.raises(ValueError, match="at least two slices"):
        drift_in_slices([clock.pulse(rng, 2000.0, 1e4)], timing=timing)
