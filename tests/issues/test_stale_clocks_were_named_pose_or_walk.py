"""Delays and gains of another day: contradicted, and blamed on the camera's place or on walk."""

import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.usefixtures("as_found")
@pytest.mark.parametrize(
    ("defect", "strength", "seed", "n_legs"),
    [("stale_delays", 0, 0, 3), pytest.param("stale_gains", 1, 300, 1, marks=pytest.mark.long)],
)
def test_the_calibration_is_named(defect, strength, seed, n_legs):
    """Delays off by 5 ps rms, gains a twentieth of another camera's. Of one leg the source was
    named: freed, it left nine of ten pulses out, and gained all that they had been off by."""
    assert not DEFECTS[defect].held_out
    world = DEFECTS[defect].applied(random_world(seed, n_legs), DEFECTS[defect].strengths[strength])
    with pytest.warns(SuspectDataWarning, match="neighbouring pixels disagree"):
        path = lf.reconstruct(record(world, seed), **what_the_user_tells(world))
    assert path.verdict.level == "contradicted"
    assert path.verdict.findings[0].name == "calibration"
