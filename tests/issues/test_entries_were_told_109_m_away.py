"""An unknown source on an uncalibrated clock: the entry lay 109 m away, told as good to 1 mm."""

import pytest

import lightflight as lf
from lightflight.errors import CalibrationError, SuspectDataWarning, UncalibratedWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.clock import PERFECT, pf32_clock
from tests.oracles.worlds.random_worlds import random_world


def told_nothing(seed, clock):
    world = random_world(seed, 3, clock=clock)
    blind = {"timing": None, "source": None}
    return record(world, seed), what_the_user_tells(world.told_but(clock=PERFECT)) | blind


@pytest.mark.parametrize("seed", range(3))
def test_it_is_refused_in_one_sentence(seed):
    hist, told = told_nothing(seed, pf32_clock(seed, random_world(seed, 3).view.shape))
    with (
        pytest.warns(UncalibratedWarning),
        pytest.raises(CalibrationError, match="neither the source nor the clock is known"),
    ):
        lf.reconstruct(hist, **told)


@pytest.mark.parametrize("photons", [40_000.0, pytest.param(100.0, marks=pytest.mark.long)])
def test_codes_that_are_even_are_no_reason(photons):
    world = random_world(1, 3, photons)
    told = what_the_user_tells(world) | {"timing": None, "source": None}
    with pytest.warns((UncalibratedWarning, SuspectDataWarning)):
        path = lf.reconstruct(record(world, 1), **told)
    assert path.verdict.level == "check"
