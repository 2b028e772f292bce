"""Results of `fit_pulses` were held by a circle of references until the next garbage collection."""

import gc
import weakref

from lightflight.timing.pulses.pulses import fit_pulses
from tests.pulse_fakes import pulse_cube


def test_pulses_that_nobody_holds_give_back_their_memory_at_once(rng):
    """Not at the next garbage collection: a loop of fits would get fresh memory every time."""
    hist = pulse_cube(rng, 6, [(1500.0, 500)], 1.0, n_codes=64)
    collecting = gc.isenabled()
    gc.disable()
    try:
        pulses = fit_pulses(hist, max_pulses=1)
        results = weakref.ref(pulses.covariance.base)
        assert results() is not None
        del pulses
        assert results() is None
    finally:
        if collecting:
            gc.enable()
