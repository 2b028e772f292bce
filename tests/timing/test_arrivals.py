"""Arrivals: pulse times on the clock, with the calibration's delays, errors and flags."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from lightflight import flags as fl
from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.pulses.arrivals import arrivals_from_pulses, find_arrivals
from lightflight.timing.pulses.pulses import fit_pulses
from tests.pulse_fakes import WIDTH, pulse_cube

SKEW = np.array([[0.0, 120.0, -80.0, 40.0]])


@pytest.fixture
def hist(rng):
    return pulse_cube(rng, 4, [(20_000.0 + SKEW[0], 3000)], 0.1)


@pytest.fixture
def timing(hist):
    flags = np.zeros((1, 4), dtype=np.uint32)
    flags[0, 3] = fl.SCREAMING
    return dataclasses.replace(
        TimingCalibration.nominal(hist),
        skew_ps=SKEW,
        skew_std_ps=np.full((1, 4), 0.7),
        scale_std=0.004,
        anchor_delay_ps=np.full((1, 4), 19_000.0),
        flags=flags,
    )


def test_arrival_is_delay_minus_the_skew_of_the_pixel(hist, timing):
    pulses = fit_pulses(hist, timing=timing)
    arrivals = arrivals_from_pulses(pulses, timing=timing)
    assert arrivals.arrival_ps == pytest.approx(pulses.delay_ps - SKEW[0], abs=1e-12)
    assert arrivals.arrival_ps == pytest.approx(20_000.0, abs=5 * 70 / np.sqrt(3000))
    assert arrivals.photon_std_ps == pytest.approx(np.sqrt(pulses.covariance[:, 0, 0]))
    assert arrivals.photons_std == pytest.approx(np.sqrt(pulses.covariance[:, 2, 2]))
    assert arrivals.std_error_ps == pytest.approx(np.sqrt(pulses.covariance[:, 1, 1]))


def test_errors_of_the_calibration_come_in_their_classes(hist, timing):
    arrivals = find_arrivals(hist, timing=timing)
    pixel, modes, names = timing.arrival_errors_ps(
        arrivals.row, arrivals.col, fit_pulses(hist, timing=timing).delay_ps
    )
    np.testing.assert_array_equal(arrivals.pixel_std_ps, pixel)
    np.testing.assert_array_equal(arrivals.shared_modes_ps, modes)
    assert arrivals.shared_names == names == ("clock scale",)
    assert arrivals.independent_std_ps == pytest.approx(np.hypot(arrivals.photon_std_ps, pixel))
    assert (arrivals.flags[3] & fl.SCREAMING) != 0
    assert arrivals.usable.tolist() == [True, True, True, False]


def test_without_calibration_delays_stand_for_arrivals_and_say_so(hist):
    arrivals = find_arrivals(hist)
    pulses = fit_pulses(hist)
    np.testing.assert_array_equal(arrivals.arrival_ps, pulses.delay_ps)
    assert (arrivals.flags & fl.UNCALIBRATED).all()
    assert arrivals.pixel_std_ps.tolist() == [0.0] * 4
    assert arrivals.shared_modes_ps.shape == (4, 0)
    assert arrivals.usable.all()
    assert arrivals.image("arrival_ps") == pytest.approx(pulses.delay_ps[None])


def test_pixels_without_pulse_stay_nan_with_their_reason(rng):
    counts = rng.poisson(1.0, (1, 3, 908))
    arrivals = find_arrivals(Histograms(counts, bin_width_ps=WIDTH))
    for name in ("arrival_ps", "photon_std_ps", "pixel_std_ps", "photons"):
        assert np.isnan(getattr(arrivals, name)).all(), name
    assert (arrivals.flags & fl.NO_PULSE).all()


def test_a_calibration_of_another_camera_is_refused(hist, timing):
    pulses = dataclasses.replace(fit_pulses(hist), shape=(2, 2))
    with pytest.raises(ValueError, match="same camera"):
        arrivals_from_pulses(pulses, timing=timing)
