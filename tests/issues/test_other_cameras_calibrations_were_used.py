"""A calibration of another camera of the same kind: five legs, and 440 ps of scatter "stated"."""

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight import flags
from lightflight.errors import CalibrationError
from lightflight.simulate.presets import paper_scene, pf32
from lightflight.timing.pulses.same_camera import scatter_of_neighbours
from tests.labs import one_leg


def calibration_of(camera_number):
    scene = paper_scene(pf32(camera_number))
    bright, flat = (
        lf.simulate(scene, photons_per_pixel=photons, seed=seed, kind=kind)
        for photons, seed, kind in ((4e6, 1, "code_density"), (4e5, 2, "flat"))
    )
    return lf.calibrate_timing(bright, flat=flat)


@pytest.fixture(scope="module")
def calibrations():
    return [calibration_of(number) for number in (0, 99)]


def test_it_is_refused_with_exit_code_4(calibrations):
    own, other = calibrations
    scene = paper_scene(pf32(0))
    hist = lf.simulate(scene, photons_per_pixel=40_000, seed=3)
    scatter = scatter_of_neighbours(lf.find_arrivals(hist, timing=own), own)
    assert scatter is not None
    calibrated, equal, _ = scatter
    assert calibrated < 0.05 * equal
    with pytest.raises(CalibrationError, match="of another camera") as refused:
        lf.reconstruct(
            hist,
            camera=scene.camera,
            source=lf.Source((0, 0, 0)),
            timing=other,
        )
    assert refused.value.exit_code == 4


def test_a_clock_without_defects_is_never_taken_for_another():
    """Its times scatter by as much with and without it; errors of a dim recording scatter more."""
    lab = one_leg()
    for photons in (300.0, 40_000.0):
        hist = lab.recording(2, photons)
        arrivals = lf.find_arrivals(hist, timing=lab.timing)
        scatter = scatter_of_neighbours(arrivals, lab.timing)
        assert scatter is not None
        calibrated, equal, _ = scatter
        assert calibrated == pytest.approx(equal, abs=1e-6)


def test_an_array_without_neighbours_is_not_judged():
    lab = one_leg()
    arrivals = lf.find_arrivals(lab.recording(2, 4_000.0), timing=lab.timing)
    masked = np.full(len(arrivals.row), flags.MASKED, dtype=np.uint32)
    assert scatter_of_neighbours(replace(arrivals, flags=masked), lab.timing) is None
