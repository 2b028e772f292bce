"""Light that leaves the beam two or three rows before the picture's edge is too short to be a leg.

It comes when that of the leg beside it does, so the pixels' own brightness, which no test held to
anything, took it up: half of a beam turned aside by a splitter, in rows that the beam itself lights
by less than a thousandth, and the path of one leg was trusted. So was one that went straight on
where a mirror in such a place turned all of the light.
"""

from __future__ import annotations

from math import log

import numpy as np
import pytest

import lightflight as lf
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.light import scaled_to
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import Arm, C


def world_along_the_edge(share, row=2.1):
    """A beam along the upper edge; a share leaves upwards in the middle of the picture."""
    world = random_world(76_002, 1, uneven=0.0)
    view = world.view

    def at(row, col, depth=500.0):
        sight = np.array([(col - 15.5) / view.focal_px[1], (row - 15.5) / view.focal_px[0], 1.0])
        return view.centre + depth * sight @ view.axes

    start, split, end = at(row + 1.0, -6.0), at(row, 16.0), at(row - 1.0, 38.0)
    world = world.told_but(source_mm=start).but(vertices=np.array([start, end]))
    if share:
        when = world.emission_ps + world.path_index * np.linalg.norm(split - start) / C
        arm = Arm(np.array([split, at(-30.0, 19.0, 520.0)]), share, float(when))
        left = log(1.0 - share) if share < 1.0 else -30.0
        world = world.but(
            vertices=np.array([start, split, end]), arms=(arm,), leg_log_flux=(0.0, left)
        )
    return scaled_to(world, 10_000.0)


@pytest.mark.filterwarnings("ignore::lightflight.errors.SuspectDataWarning")
@pytest.mark.parametrize(
    "share",
    [pytest.param(0.1, marks=pytest.mark.long), 0.5, pytest.param(1.0, marks=pytest.mark.long)],
)
def test_arms_that_leave_at_once_were_silent(share):
    """Three pixels of an arm: a path without it is never trusted. Two recordings of each."""
    world = world_along_the_edge(share)
    for seed in (1, 2):
        path = lf.reconstruct(record(world, seed), **what_the_user_tells(world))
        assert path.forks or path.n_legs == 2 or path.verdict.level != "trust"


@pytest.mark.filterwarnings("ignore::lightflight.errors.SuspectDataWarning")
def test_the_same_beam_alone_is_trusted():
    """Two recordings; each is not trusted by a chance of 0.01, both by 1e-4."""
    world = world_along_the_edge(0.0)
    levels = [
        lf.reconstruct(record(world, seed), **what_the_user_tells(world)).verdict.level
        for seed in (1, 2)
    ]
    assert "trust" in levels
