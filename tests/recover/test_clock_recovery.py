"""Draw a camera's true clock, calibrate it, and ask whether arrival times and errors are right.

Arrival error: calibrated pulse time minus truth, of a recording so bright (4e7 photons per
pixel) that its own photons do not matter. Fixed seeds; with 256 pixels the width of pulls is
known to 4.4 %, so that 0.9-1.1 would be left by chance in 2 % of seeds; tests that allow
0.85-1.15 in 1e-3.
"""

from dataclasses import replace

import numpy as np
import pytest

from lightflight import flags
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.pulses.arrivals import find_arrivals
from tests.clock_fakes import fake_clock

FLAT_PS = 2000.0


def _errors(seed, *, distance_ps, photons=4e6, flat_photons=4e5, dead_codes="absorbed", **clock):
    """Arrival errors of all pixels (ps), what is stated of them, and their shared modes."""
    rng = np.random.default_rng(seed)
    fake = fake_clock(rng, **clock)
    timing = calibrate_timing(
        fake.uniform(rng, photons),
        flat=fake.pulse(rng, FLAT_PS, flat_photons),
        flat_arrival_ps=FLAT_PS,
        dead_codes=dead_codes,
    )
    true = FLAT_PS + distance_ps + rng.uniform(-350.0, 350.0, len(fake.width_ps))
    arrivals = find_arrivals(fake.pulse(rng, true, 4e7), timing=timing)
    assert arrivals.usable.all()
    stated = np.hypot(arrivals.pixel_std_ps, arrivals.photon_std_ps)
    return arrivals.arrival_ps - true, stated, arrivals.shared_modes_ps


@pytest.mark.parametrize(
    ("seed", "distance_ps", "most_ps"),
    [(1, 0.0, 0.2), (3, 3000.0, 0.25), (5, 40_000.0, 1.3)],
)
def test_arrival_errors_are_small_and_as_stated(seed, distance_ps, most_ps):
    error, stated, modes = _errors(seed, distance_ps=distance_ps)
    assert error.std() < most_ps
    assert (error / stated).std() == pytest.approx(1.0, abs=0.15)
    assert modes.shape[1] == 0
    # the array's mean gain is measured too: the error of a pixel over the root of their number
    assert abs(error.mean()) < 5.0 * np.sqrt(np.mean(stated**2) / len(error))


@pytest.mark.parametrize(("photons", "most_ps"), [(4e5, 0.55), (4e4, 0.75)])
def test_fewer_calibration_photons(photons, most_ps):
    error, stated, _ = _errors(6, distance_ps=1000.0, photons=photons, flat_photons=4e4)
    assert error.std() < most_ps
    assert (error / stated).std() == pytest.approx(1.0, abs=0.15)


def test_forward_clock():
    error, stated, _ = _errors(7, distance_ps=3000.0, reversed_codes=False)
    assert error.std() < 0.25
    assert (error / stated).std() == pytest.approx(1.0, abs=0.15)


def test_lost_dead_time():
    error, stated, _ = _errors(8, distance_ps=10_000.0, lost=True, dead_codes="lost")
    assert error.std() < 0.4
    assert (error / stated).std() == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("lost", [True, False])
def test_unknown_dead_time_is_one_shared_error_of_one_sigma(lost):
    error, stated, modes = _errors(
        9, distance_ps=10_000.0, lost=lost, dead_codes=None, start_std=0.3
    )
    mode = modes[:, 0]
    size = np.sum(mode * error / stated**2) / np.sum(mode**2 / stated**2)
    assert abs(size) == pytest.approx(1.0, abs=0.05)  # both hypotheses lie one sigma off
    left = error - size * mode
    assert left.std() < 2.5
    assert (left / stated).std() == pytest.approx(1.0, abs=0.2)


def test_codes_that_wander_beside_the_pattern():
    error, stated, _ = _errors(10, distance_ps=1000.0, free_std=0.01)
    assert error.std() > 1.0  # a walk of 18 codes of 1 % each: 2.3 ps
    assert (error / stated).std() == pytest.approx(1.0, abs=0.2)


def test_ringing_near_the_end_of_the_period_does_not_bend_the_clock():
    def ringing(codes):
        return 1.0 - 0.06 * np.exp(-0.5 * ((codes - 40.0) / 6.0) ** 2)

    error, _, _ = _errors(11, distance_ps=1000.0, near_end=ringing)
    # without the ringing's own widths the mean would be off by 0.9 codes, 50 ps
    assert abs(error.mean()) < 1.0
    assert error.std() < 0.6


@pytest.mark.parametrize("dead_codes", ["absorbed", "lost"])
def test_clock_of_the_digital_twin(dead_codes):
    # a third account of the camera; 32 x 32 pixels know the width of pulls to 2.3 %
    import lightflight as lf
    from lightflight.simulate import paper_scene, pf32

    scene = replace(paper_scene(), detector=pf32(seed=3, dead_codes=dead_codes))
    density = lf.simulate(scene, kind="code_density", photons_per_pixel=4e6, seed=1)
    flat = lf.simulate(scene, kind="flat", photons_per_pixel=4e5, seed=2)
    timing = calibrate_timing(
        density, flat=flat, flat_arrival_ps=flat.truth.flat_arrival_ps, dead_codes=dead_codes
    )
    later = flat.truth.flat_arrival_ps + 1000.0
    recording = lf.simulate(
        scene, kind="flat", photons_per_pixel=4e6, seed=4, flat_arrival_ps=later
    )
    arrivals = find_arrivals(recording, timing=timing)
    use = arrivals.usable & (arrivals.flags & flags.UNCALIBRATED == 0)
    assert 940 < np.count_nonzero(use) < 960
    error = (arrivals.arrival_ps - later)[use]
    stated = np.hypot(arrivals.pixel_std_ps, arrivals.photon_std_ps)[use]
    assert error.std() < 0.2
    assert abs(error.mean()) < 0.1
    assert (error / stated).std() == pytest.approx(1.0, abs=0.12)
