"""A mirrored second path, or a second pulse, was taken for legs; then no path was found at all."""

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.parametrize(
    ("defect", "n_legs", "seed", "method", "level"),
    [
        pytest.param("pulse_before_2ns", 3, 2, "joint", "check", marks=pytest.mark.long),
        ("wall_60mm", 1, 0, "joint", "check"),
        ("pulse_before_2ns", 1, 0, "paper", "contradicted"),
    ],
)
def test_the_flight_is_found_and_the_other_light_named(defect, n_legs, seed, method, level):
    """A tenth of the light along a second path, the number of legs untold.

    A second pulse on the same path and a mirror have a place in the fit of `joint`, and all counts
    bear them out.
    """
    assert not DEFECTS[defect].held_out
    world = DEFECTS[defect].applied(random_world(seed, n_legs), DEFECTS[defect].strengths[1])
    with pytest.warns(SuspectDataWarning, match="contradicts this path|taken into the fit"):
        path = lf.reconstruct(record(world, seed), method=method, **what_the_user_tells(world))
    assert path.n_legs == n_legs
    if method == "joint":
        np.testing.assert_allclose(path.vertices_mm[:-1], world.vertices[:-1], atol=0.3)
    assert path.verdict.level == level
    assert path.verdict.findings[0].name in {"other_pulse", "unexplained_light"}
