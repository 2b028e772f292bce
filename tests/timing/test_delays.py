"""Flat recordings: delays of pixels, their geometry, and scans of known delays."""

import numpy as np
import pytest

from lightflight import flags
from lightflight.errors import CalibrationError, SuspectDataWarning, UncalibratedWarning
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.calibrate.delay_scan import fit_scan
from lightflight.timing.calibrate.delays import delays_from_flat, skews_near_median
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.pulses.arrivals import find_arrivals
from tests.clock_fakes import PERIOD_PS, fake_clock


def test_delay_is_pulse_time_minus_arrival_of_the_flat(rng):
    clock = fake_clock(rng, (8, 8))
    arrival = 2000.0 + np.arange(64.0).reshape(8, 8)
    timing = calibrate_timing(
        clock.uniform(rng, 4e6), flat=clock.pulse(rng, arrival.ravel(), 4e5),
        flat_arrival_ps=arrival, dead_codes="absorbed",
    )  # fmt: skip
    error = timing.skew_ps.ravel() - clock.skew_ps
    # 70 ps over the root of 400,000 photons: 0.11 ps
    np.testing.assert_allclose(timing.skew_std_ps, 0.115, rtol=0.1)
    # counted from the sync, code widths add 0.6 ps; at the flat's own codes they cancel
    assert error.std() < 1.0
    np.testing.assert_allclose(timing.response_std_ps, 70.0, atol=1.0)
    np.testing.assert_allclose(
        timing.anchor_delay_ps.ravel(), arrival.ravel() + clock.skew_ps, atol=4.0
    )


@pytest.mark.parametrize("arrival_ps", [30.0, PERIOD_PS - 80.0])
def test_flat_on_the_fold_of_the_period(rng, arrival_ps):
    clock = fake_clock(rng, (6, 6))
    timing = calibrate_timing(
        clock.uniform(rng, 4e6), flat=clock.pulse(rng, arrival_ps, 1e5),
        flat_arrival_ps=arrival_ps, dead_codes="absorbed",
    )  # fmt: skip
    # pulses lie on both sides of the fold, delays must not
    assert np.abs(timing.skew_ps.ravel() - clock.skew_ps).max() < 8.0


def test_common_arrival_time_sets_the_zero_of_the_clock(rng):
    clock = fake_clock(rng, (4, 4))
    flat = clock.pulse(rng, 2000.0, 1e5)
    density = clock.uniform(rng, 1e6)
    later = calibrate_timing(density, flat=flat, flat_arrival_ps=5000.0, dead_codes="absorbed")
    zero = calibrate_timing(density, flat=flat, dead_codes="absorbed")
    for timing, arrival in ((later, 5000.0), (zero, 0.0)):
        found = find_arrivals(flat, timing=timing).arrival_ps
        np.testing.assert_allclose(found, arrival, atol=1e-6)


def test_pixels_without_a_pulse_take_the_array_s_delay(rng):
    clock = fake_clock(rng, (6, 6))
    photons = np.full(36, 4e4)
    photons[7] = 0.0
    flat = clock.pulse(rng, 2000.0, photons[:, None])
    timing = calibrate_timing(
        clock.uniform(rng, 1e6), flat=flat, flat_arrival_ps=2000.0, dead_codes="absorbed"
    )
    blind = timing.flags.ravel()[7]
    assert blind & flags.UNCALIBRATED
    assert blind & flags.NO_PHOTONS
    others = np.delete(timing.skew_ps.ravel(), 7)
    assert timing.skew_ps.ravel()[7] == pytest.approx(np.median(others))
    assert timing.skew_std_ps.ravel()[7] == pytest.approx(np.std(others))
    assert np.isnan(timing.anchor_delay_ps.ravel()[7])
    assert np.isfinite(timing.arrival_errors_ps([1], [1], [2000.0])[0]).all()


def test_code_density_given_as_flat_is_refused(rng):
    clock = fake_clock(rng, (6, 6))
    density = clock.uniform(rng, 1e6)
    with pytest.raises(CalibrationError, match="no pixel of the flat recording"):
        calibrate_timing(density, flat=density)


def test_skews_keep_together_across_the_period():
    skew = np.array([[24_990.0, -24_995.0, np.nan]])
    near = skews_near_median(skew, 50_000.0)
    assert abs(near[0, 0] - near[0, 1]) == pytest.approx(15.0)
    assert np.isnan(near[0, 2])
    np.testing.assert_array_equal(skews_near_median(skew, None), skew)


@pytest.mark.parametrize("lost", [True, False])
def test_two_known_delays_tell_where_dead_time_went(rng, lost):
    clock = fake_clock(rng, (8, 8), lost=lost)
    arrivals = [2000.0, 12_000.0]
    timing = calibrate_timing(
        clock.uniform(rng, 1e6), flat=[clock.pulse(rng, a, 1e5) for a in arrivals],
        flat_arrival_ps=arrivals,
    )  # fmt: skip
    assert f"taken as {'lost' if lost else 'absorbed'}" in timing.notes
    assert "the delay scan says so" in timing.notes
    assert timing.scale_std == 0.0
    assert timing.bin_width_ps == pytest.approx(clock.width_ps.mean(), rel=2e-5)
    true = 8000.0 + rng.uniform(-300.0, 300.0, 64)
    found = find_arrivals(clock.pulse(rng, true, 4e7), timing=timing)
    error = found.arrival_ps - true
    assert error.std() < 0.35
    assert (error / found.pixel_std_ps).std() == pytest.approx(1.0, abs=0.35)


def test_scan_measures_gains_that_no_code_density_gave(rng):
    clock = fake_clock(rng, (6, 6), pattern=(1.0,), own_std=0.0, first_live=0, start=())
    arrivals = [2000.0, 22_000.0]
    with pytest.warns(UncalibratedWarning, match="no code-density"):
        timing = calibrate_timing(
            flat=[clock.pulse(rng, a, 1e5) for a in arrivals], flat_arrival_ps=arrivals
        )
    # 0.22 ps each over 20 ns
    width = timing.bin_width_ps * timing.gain.ravel()
    assert (width / clock.width_ps - 1.0).std() < 3e-5
    assert width.mean() == pytest.approx(clock.width_ps.mean(), rel=2e-5)
    assert timing.gain_std.max() < 1e-4
    assert timing.scale_std < 2e-5


def test_scan_that_contradicts_the_code_density_warns(rng):
    clock = fake_clock(rng, (6, 6))
    arrivals = [2000.0, 12_000.0]
    flats = [clock.pulse(rng, a, 1e5) for a in arrivals]
    with pytest.warns(SuspectDataWarning, match="check the delays"):
        calibrate_timing(
            clock.uniform(rng, 1e6), flat=flats, flat_arrival_ps=[2000.0, 12_100.0],
            dead_codes="absorbed",
        )  # fmt: skip


def test_as_many_arrival_times_as_flats(rng):
    clock = fake_clock(rng, (2, 2))
    flats = [clock.pulse(rng, a, 1e4) for a in (2000.0, 3000.0)]
    for wrong in (0.0, [2000.0], []):
        with pytest.raises(ValueError, match="2 flats need as many flat_arrival_ps"):
            calibrate_timing(flat=flats, flat_arrival_ps=wrong)
    with pytest.raises(ValueError, match="empty list"):
        calibrate_timing(flat=[])


def test_scan_slope_equals_a_straight_line_fit(rng):
    delay = np.array([1000.0, 4000.0, 9000.0])[:, None, None] + rng.normal(0, 5, (3, 2, 2))
    std = rng.uniform(0.5, 2.0, (3, 2, 2))
    arrival = delay * 1.003 - 40.0
    scan = fit_scan(delay, arrival, std, np.zeros((2, 2)))
    np.testing.assert_allclose(scan.slope, 0.003, rtol=1e-9)
    assert scan.scale == pytest.approx(0.003)
    for i in np.ndindex(2, 2):
        at = (slice(None), *i)
        design = np.stack([np.ones(3), delay[at]], axis=1) / std[at][:, None]
        covariance = np.linalg.inv(design.T @ design)
        assert scan.lever_ps[i] == pytest.approx(covariance[1, 1] ** -0.5)
    one = fit_scan(delay[:1], arrival[:1], std[:1], np.zeros((2, 2)))
    assert one.scale_std == np.inf
    np.testing.assert_allclose(one.skew_ps, (delay - arrival)[0])


def test_delays_need_a_clock_of_the_same_camera(rng):
    flat = fake_clock(rng, (2, 3)).pulse(rng, 2000.0, 1e4)
    other = TimingCalibration.nominal(fake_clock(rng, (3, 3)).pulse(rng, 2000.0, 1e4))
    with pytest.raises(CalibrationError, match="has shape ="):
        delays_from_flat(flat, timing=other)
