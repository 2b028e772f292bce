"""Half of the time in which further pulses were looked for went to fits that led nowhere.

Two pulses that trade light sway about the top of their likelihood, and what will never be worth a
pulse was followed to its end. Both are left where they are seen to: the pulses stay the same.
"""

import numpy as np
import pytest

import lightflight as lf
from lightflight.timing.pulses import batch
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


@pytest.fixture
def steps(monkeypatch):
    """Steps of the fits of two pulses and more, times pixels."""
    taken = []
    fitted_in = batch._fit_in

    def counted(window, bins, theta, *given):
        found, escaped = fitted_in(window, bins, theta, *given)
        if theta.shape[1] > 4:
            taken.append(int(found.steps.max()))
        return found, escaped

    monkeypatch.setattr(batch, "_fit_in", counted)
    return taken


def test_fits_that_lead_nowhere_are_left(steps, monkeypatch):
    world = random_world(31013, 3)
    hist, timing = record(world, 31013), what_the_user_tells(world)["timing"]
    found = lf.find_arrivals(hist, timing=timing, max_pulses=4)
    short = sum(steps)
    steps.clear()
    monkeypatch.setattr(batch, "_STALLED_BY", 1e300)
    monkeypatch.setattr(batch, "_HOPES", 1e300)
    whole = lf.find_arrivals(hist, timing=timing, max_pulses=4)
    assert short < 0.6 * sum(steps)
    np.testing.assert_array_equal(found.row, whole.row)
    np.testing.assert_array_equal(found.flags, whole.flags)
    late = found.arrival_ps - whole.arrival_ps
    assert np.nanmax(np.abs(late) / whole.photon_std_ps) < 0.03
