"""A leg was parted where a grain made its times bend, and behind the corner not a pulse was left.

What the corner explained were six pulses that fell out of the path with it. With nothing to hold it
the second leg ended 850 million kilometres away, in a table 0.5 m wide, "check".
"""

import numpy as np

import lightflight as lf
from benchmarks.strangers import farthest, world_of
from tests.oracles.worlds.border import record, what_the_user_tells


def test_legs_without_a_pulse_ended_beyond_jupiter():
    world = world_of("speck", 100_007, 1)
    path = lf.reconstruct(record(world, 100_007), **what_the_user_tells(world))
    assert path.n_legs == 1
    assert path.verdict.level == "trust"
    assert np.abs(path.vertices_mm).max() < 500.0
    assert farthest(path, world)[1] < 3.0
