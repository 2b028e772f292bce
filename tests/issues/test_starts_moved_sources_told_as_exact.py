"""A start given by the user put its own first vertex in the place of a source told as exact.

Nothing moved it from there: the result said "source known", and was millimetres off.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.usefixtures("unexamined", "nothing_twice")
@pytest.mark.parametrize("as_path", [pytest.param(False, marks=pytest.mark.long), True])
def test_a_rough_start_ends_where_the_search_ends(as_path):
    world = random_world(0, 3, prior="known", uneven=0.0)
    told, recording = what_the_user_tells(world), record(world, 0)
    found = lf.reconstruct(recording, **told)
    start = world.vertices + np.random.default_rng(1).normal(0.0, 3.0, world.vertices.shape)
    given: Any = start
    if as_path:
        times = found.vertex_times_ps + 7.0
        given = replace(found, vertices_mm=start, vertex_times_ps=times)
    path = lf.reconstruct(recording, start=given, **told)
    assert path.vertices_mm[0] == pytest.approx(world.vertices[0])
    assert path.emission_time_ps == pytest.approx(world.emission_ps)
    gap = np.abs(path.vertices_mm - found.vertices_mm)[1:3].ravel()
    assert np.all(gap < 0.3 * found.vertex_std[1:3, :3].ravel())
