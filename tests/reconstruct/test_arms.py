"""Where light that a path leaves is the other arm of a beam splitter, the verdict says where from.

Scenes of an oracle that shares no line with the package (`tests/oracles/splitter.py`). The full
table is `benchmarks/splitters.py`.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.splitters import arm_named, path_of
from lightflight.path.verdict import Level
from tests.oracles.splitter import splitter_world

CASES = [(seed, share) for share in (0.5, 0.1) for seed in (300, 301, 302)]
"""Fixed before looking."""
WITHIN_MM = 5.0
"""Many errors; the arm's light starts a pixel, 7.7 mm, long."""


@pytest.mark.parametrize(("seed", "share"), CASES)
def test_the_arm_is_named_where_it_leaves(seed, share):
    world = splitter_world(seed, share=share)
    path = path_of(world, seed)
    assert path.verdict.level is Level.CONTRADICTED
    place = arm_named(path)
    assert place is not None
    assert np.linalg.norm(place[:3] - world.splitter_mm) < WITHIN_MM
    # When the light was at the splitter.
    assert place[3] == pytest.approx(world.arms[1].emission_time_ps, abs=20.0)


def test_light_that_is_no_arm_is_not_called_one():
    """Where none of the light turns off there is one leg, and nothing to name."""
    world = splitter_world(300, share=0.0)
    path = path_of(world, 300)
    assert path.n_legs == 1
    assert path.verdict.level is Level.TRUST
    assert arm_named(path) is None
