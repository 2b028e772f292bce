"""Legs about a way that nobody saw were cut otherwise and bent: by 18 and 35 mm, and stood.

Detours were asked about where a path left misfit that nothing named takes up. Where a curve did, or
the path with one was another answer and far likelier, they were not: 154 of 161 pulses lay on a
bent path, all of them on the one with a detour. Scenes 26126, 26242 and 26256 of
`benchmarks/unseen_legs.py`.
"""

import pytest

from benchmarks.unseen_legs import result_of

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


@pytest.mark.parametrize(
    "seed", [26256, *(pytest.param(n, marks=pytest.mark.long) for n in (26126, 26242))]
)
def test_they_are_ways_that_nobody_saw(seed):
    """The delay within four stated errors (false alarm 6e-5 a scene)."""
    found = result_of(4_000.0, "joint", seed)
    assert found["found"]
    assert found["level"] == "check"
    assert abs(found["pull"]) < 4.0
