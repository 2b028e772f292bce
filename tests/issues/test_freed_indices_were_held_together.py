"""`free=("index",)` held the index of the way and of the way back to one number.

Light in air that is seen out of water was named `index`, and no index could be found: 3 mm off with
1.01 up to the camera, 60 to 90 mm with 1.33.
"""

from __future__ import annotations

import numpy as np
import pytest

import lightflight as lf
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world

FALSE_ALARM_STDS = 5.0
"""Of six numbers, chance leaves five errors once in 300,000."""


@pytest.mark.usefixtures("nothing_twice")
@pytest.mark.parametrize("more", [0.01, pytest.param(0.33, marks=pytest.mark.long)])
def test_freed_indices_were_held_together(more):
    seed = 60_000
    world = DEFECTS["index_to_the_camera"].applied(random_world(seed, 3), more)
    path = lf.reconstruct(record(world, seed), free=("index",), **what_the_user_tells(world))
    assert path.verdict.level == "trust"
    off = (path.vertices_mm - world.vertices)[1:-1]
    assert np.abs(off / path.vertex_std[1:-1, :3]).max() < FALSE_ALARM_STDS
    assert abs(path.medium.return_group_index - path.medium.path_group_index - more) < 0.01
