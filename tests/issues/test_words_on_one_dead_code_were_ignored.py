"""With one dead code, that of no photon, `dead_codes` was ignored: its time was lost for sure."""

import pytest

from lightflight.timing.calibrate.chain import calibrate_timing
from tests.clock_fakes import fake_clock


@pytest.mark.parametrize(
    ("dead_codes", "width"), [(None, 1.0), ("lost", 1.0), ("absorbed", 1.0011)]
)
def test_one_code_without_photons_is_time_that_is_lost(rng, dead_codes, width):
    clock = fake_clock(rng, (5, 5), first_live=1, start=(), lost=True)
    flat = clock.pulse(rng, 2000.0, 1e4)
    timing = calibrate_timing(clock.uniform(rng, 1e6), flat=flat, dead_codes=dead_codes)
    assert timing.bin_width_ps == pytest.approx(width * clock.width_ps.mean(), rel=1e-4)
    assert timing.scale_std == (pytest.approx(0.0011, abs=1e-4) if dead_codes is None else 0.0)
