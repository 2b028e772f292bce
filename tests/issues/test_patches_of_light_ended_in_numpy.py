"""A patch of halo was taken for a leg, and its bend ended in "zero-size array to reduction"."""

from types import SimpleNamespace

import numpy as np

from lightflight.reconstruct.legs.bend import bend_significance
from tests.oracles.worlds.border import what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


def test_a_patch_as_broad_as_long_tells_no_bend():
    row, col = (index.ravel() + 12 for index in np.indices((4, 4)))
    arrivals = SimpleNamespace(row=row, col=col, independent_std_ps=np.ones(16))
    sighting = SimpleNamespace(arrivals=arrivals, arrival_ps=np.linspace(0.0, 50.0, 16))
    leg = SimpleNamespace(members=np.arange(16), n_pixels=16)
    camera = what_the_user_tells(random_world(0, 1))["camera"]
    assert bend_significance((leg,), sighting, camera) == 0.0
