"""Water told as air: a leg lost all its pulses, and what was left spoke of bends, or of nothing."""

import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.parametrize(
    ("defect", "seed", "photons", "told"),
    [
        pytest.param("index", 5, 40_000.0, None, marks=pytest.mark.long),
        pytest.param("index_to_the_camera", 2, 400.0, 3, marks=pytest.mark.long),
    ],
)
def test_the_index_is_named(defect, seed, photons, told):
    """Once "trust" with two of three legs' pulses on the path."""
    assert not DEFECTS[defect].held_out
    world = DEFECTS[defect].applied(random_world(seed, 3, photons), DEFECTS[defect].strengths[2])
    with pytest.warns(SuspectDataWarning, match="contradicts this path"):
        path = lf.reconstruct(record(world, seed), **what_the_user_tells(world) | {"n_legs": told})
    assert path.verdict.level == "contradicted"
    assert path.verdict.findings[0].name == "index"
    assert "more pulses lie on the path" in path.verdict.findings[0].sentence
