"""Without the laser's sync there is nothing to fit, and that is said."""

import numpy as np
import pytest

from lightflight.errors import CalibrationError
from lightflight.recording.histograms import Histograms
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.pulses.pulses import fit_pulses
from lightflight.timing.pulses.sync import coarse_step
from tests.pulse_fakes import WIDTH, pulse_cube


def coarse(rng, step=8, stray=0.0):
    """PF32-like histograms (8, 8, 1024) of which only every `step`-th code counts."""
    counts = rng.poisson(stray, (8, 8, 1024))
    counts[..., step:915:step] += rng.poisson(50.0, (8, 8, len(range(step, 915, step))))
    return Histograms(
        counts, bin_width_ps=55.0, laser_period_ps=50_000.0, reversed_codes=True,
        no_photon_code=0, n_frames=50_000,
    )  # fmt: skip


@pytest.mark.parametrize("step", [2, 8, 16])
def test_coarse_codes_alone_are_refused(rng, step):
    hist = coarse(rng, step, stray=0.02)
    assert coarse_step(hist) % step == 0
    for fit in (
        lambda: fit_pulses(hist),
        lambda: fit_pulses(hist, method="least_squares"),
        lambda: calibrate_timing(hist),
        lambda: calibrate_timing(flat=hist),
    ):
        with pytest.raises(CalibrationError, match="without sync"):
            fit()


def test_light_and_pulses_are_not_mistaken_for_it(rng, data_dir):
    assert coarse_step(Histograms(rng.poisson(3.0, (8, 8, 1024)))) is None
    pulse = pulse_cube(rng, 30, [(rng.uniform(3000, 40_000, 30), 500)], 0.0, std=WIDTH / 4)
    assert coarse_step(pulse) is None
    counts = np.zeros((4, 4, 256), int)
    counts[..., 100] = 400  # a pulse within one code, in all pixels
    assert coarse_step(Histograms(counts)) is None
    with np.load(data_dir / "pf32-codedensity-20mhz" / "pf32_codedensity_20mhz.npz") as file:
        real = Histograms(file["hist"], no_photon_code=0)
    assert coarse_step(real) is None
