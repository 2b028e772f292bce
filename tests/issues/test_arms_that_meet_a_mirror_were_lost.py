"""An arm of a beam splitter that a mirror in view turns again.

Arms were single legs: each leg among the light that the path leaves had to meet the path. The first
leg of such an arm was fitted as if it ran on to the picture's edge, with the light of the second
against it, so neither was taken, and the path without them was contradicted.
"""

from __future__ import annotations

from math import log
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.reconstruct.trials import arms
from lightflight.reconstruct.trials.arms import _Start
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.light import scaled_to
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import Arm, C

# Splitter, mirror and end of the arm: (row, column, depth in mm).
SHORT = (18.0, 13.0, 505.0), (10.0, 16.0, 500.0), (-12.0, 60.0, 480.0)
LONG = (18.0, 13.0, 505.0), (28.0, 27.0, 520.0), (-30.0, 20.0, 540.0)


def world_with_arm(places):
    world = random_world(77_002, 1, uneven=0.0)
    view = world.view

    def at(row, col, depth):
        sight = np.array([(col - 15.5) / view.focal_px[1], (row - 15.5) / view.focal_px[0], 1.0])
        return view.centre + depth * sight @ view.axes

    start, split = at(20.0, -8.0, 515.0), at(*places[0])
    end = split + 3.0 * (split - start)
    when = world.emission_ps + world.path_index * float(np.linalg.norm(split - start)) / C
    arm = Arm(np.array([at(*place) for place in places]), 0.5, when)
    world = world.told_but(source_mm=start).but(
        vertices=np.array([start, split, end]), arms=(arm,), leg_log_flux=(0.0, log(0.5))
    )
    return scaled_to(world, 10_000.0)


def test_each_leg_is_tried_alone_and_turned_into_the_others(monkeypatch):
    """Of two among the light that a path leaves: alone its light is held against the other's."""
    monkeypatch.setattr(arms, "unclaimed_by_path", lambda *_: None)
    monkeypatch.setattr(arms, "legs_among", lambda *_: ["first", "second"])
    monkeypatch.setattr(arms, "_straight_on", lambda *_: [])
    monkeypatch.setattr(
        arms,
        "_starts",
        lambda state, leg, setting, _: [_Start(SimpleNamespace(n_legs=2, way=(leg,)), setting, 1)],
    )

    def turned(longer, leg, into, setting, _):
        assert leg == longer.n_legs - 1
        if into not in longer.way:
            yield _Start(SimpleNamespace(way=(*longer.way, into)), setting)

    def refitted(_, state, setting):
        return SimpleNamespace(solution=SimpleNamespace(covariance=np.eye(3)), way=state.way)

    monkeypatch.setattr(arms, "_turned", turned)
    monkeypatch.setattr(arms, "refitted", refitted)
    setting: Any = SimpleNamespace(cameras=("one",), at=lambda _: None)
    fit: Any = SimpleNamespace(solution=SimpleNamespace(state=None))
    sightings: list[Any] = [SimpleNamespace(view=0)]
    found: Any = arms.fits_with_arm(sightings, fit, setting)
    ways = {one.fit.way for one in found}
    assert ways == {("first",), ("second",), ("first", "second"), ("second", "first")}
    assert all(one.parted == 1 for one in found)


@pytest.mark.long
@pytest.mark.parametrize(
    ("places", "method"), [(SHORT, "joint"), (LONG, "joint"), (LONG, "photon")]
)
def test_arms_that_meet_a_mirror_were_lost(places, method):
    """Splitter and mirror at their stated errors: chance below 1e-4 for six numbers."""
    world = world_with_arm(places)
    path = lf.reconstruct(record(world, 4), method=method, **what_the_user_tells(world))
    assert path.n_legs == 4
    assert path.forks == ((2, 1),)
    assert path.verdict.level == "trust"
    true = np.vstack((world.vertices[1], world.arms[0].vertices[1]))
    off = path.vertices_mm[[1, 3]] - true
    assert np.abs(off / path.vertex_std[[1, 3], :3]).max() < 4.3
