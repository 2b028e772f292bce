"""Four billion counts in one pixel overflowed the integers that their sum was kept in."""

import numpy as np
import pytest

from lightflight.recording.histograms import Histograms
from lightflight.timing.pulses.pulses import fit_pulses
from tests.pulse_fakes import WIDTH, pulse_cube


def test_counts_that_sum_beyond_their_integers_are_fitted_all_the_same(rng):
    """None of the codes is too large, their sum is."""
    small = pulse_cube(rng, 2, [(900.0, 4000)], 0.5).counts
    huge = small.astype(np.uint64)
    huge[0, 1] *= 2_000_000
    assert huge.max() < 2**32 < huge[0, 1].sum()
    one, other = (
        fit_pulses(
            Histograms(counts, bin_width_ps=WIDTH, laser_period_ps=908 * WIDTH), max_pulses=1
        )
        for counts in (small, huge.astype(np.uint32))
    )
    assert other.delay_ps == pytest.approx(one.delay_ps, abs=0.05)
    assert other.photons / one.photons == pytest.approx([1.0, 2e6], rel=1e-3)
