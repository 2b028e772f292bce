"""Pixels beside a corner were told to hold no late light, and `photon` followed it.

How much of a pixel's light is late is expected where a pulse of the path was measured; within 2 px
of a corner none is. With half of the light late by 500 ps, four bright pixels at the picture's edge
led three legs 1.25 mm away, 8 stated errors; `joint` was 1.3 errors off.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import LightflightWarning
from tests.oracles.miss import pulls
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.usefixtures("as_found")
@pytest.mark.long
def test_late_light_beside_corners_was_taken_for_the_path():
    seed = 1292
    world = DEFECTS["haze_500ps"].applied(random_world(seed, 3), 0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        hist = record(world, seed)
        path = lf.reconstruct(hist, method="photon", **what_the_user_tells(world))
    assert path.n_legs == 3
    # Six honest pulls: above 4.5 with a chance of 4e-5.
    assert np.abs(pulls(path, world.vertices)).max() < 4.5
