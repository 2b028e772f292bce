"""A second pulse, a tenth as strong and 3 ns later, made eight legs of three, in half a minute.

Legs of its light, joined to the first by mirrors that nobody saw, explained all of the recording.
"""

from __future__ import annotations

import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


def test_a_second_pulse_is_no_detour():
    world = random_world(300, 3).but(second=0.1, second_ps=3000.0)
    with pytest.warns(SuspectDataWarning, match="second pulse"):
        path = lf.reconstruct(record(world, 300), **what_the_user_tells(world))
    assert path.n_legs == 3
    assert not path.gaps
    assert path.verdict.findings[0].name == "other_pulse"
