"""Haze that the fit had taken up was called a contradiction, of paths right to their errors."""

import warnings

import pytest

import lightflight as lf
from lightflight.errors import LightflightWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.parametrize("strength", [pytest.param(1, marks=pytest.mark.long), 2])
def test_haze_is_named_and_contradicts_nothing(strength):
    """A fifth of the light, and half of it, are taken into the fit; one recording each."""
    defect = "haze_500ps"
    assert not DEFECTS[defect].held_out
    world = DEFECTS[defect].applied(random_world(0, 1), DEFECTS[defect].strengths[strength])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        verdict = lf.reconstruct(record(world, 0), **what_the_user_tells(world)).verdict
    first = verdict.findings[0]
    assert (verdict.level, first.name, first.severity) == ("check", "haze", "check")
    assert "taken into the fit" in first.sentence
    assert verdict.p_value > 0.01
    # How clearly haze was seen is still that of the counts against a plain flight.
    assert first.sigma > 30.0
