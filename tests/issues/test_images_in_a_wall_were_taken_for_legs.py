"""A wall far behind shows the flight once more, and its images were taken for legs of the path.

Three legs came out as five to seven in 5 of 20 recordings with mirrors 15 to 400 mm behind: far
images stand apart in place and time, and six lines can be joined. The bright legs alone, with a
mirror, explain all counts, and are asked for where the path of all is contradicted.
"""

from types import SimpleNamespace

import numpy as np
import pytest

import lightflight as lf
from lightflight.path.verdict import NOT_EXAMINED, Level, Verdict
from lightflight.reconstruct import answer, chain
from lightflight.reconstruct.legs.direction import legs_in_all_pictures
from lightflight.reconstruct.trials.revise import fit_without_dim_legs
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


class SeenError(Exception):
    """What a reconstruction begins with."""


def seen_by_chain(world, seed, monkeypatch):
    """Recordings and setting of a call, at their clock and with their pulses found."""

    def stop(sightings, setting, **_):
        raise SeenError(sightings, setting)

    monkeypatch.setattr(chain, "path_from_sightings", stop)
    with pytest.raises(SeenError) as seen:
        lf.reconstruct(record(world, seed), **what_the_user_tells(world))
    return seen.value.args


def test_three_legs_before_a_far_wall_are_three(monkeypatch):
    plain = random_world(95004, 3)
    depth = (plain.vertices - plain.view.centre) @ plain.view.axes[2]
    world = plain.but(wall=0.053, wall_depth_mm=float(depth.max()) + 208.6)
    sightings, setting = seen_by_chain(world, 95004, monkeypatch)
    legs = legs_in_all_pictures(sightings, setting)
    assert len(legs) > 3
    state = fit_without_dim_legs(sightings, legs, setting).solution.state
    assert state.n_legs == 3
    # Images are no part of this fit: they pull it by some tenths of a mm.
    np.testing.assert_allclose(state.vertices_mm[1:-1], world.vertices[1:-1], atol=1.0)


@pytest.mark.parametrize(
    ("verdict", "asked"),
    [
        (Verdict(Level.CONTRADICTED, ()), True),
        (NOT_EXAMINED, True),
        (Verdict(Level.CHECK, ()), False),
        (Verdict(Level.TRUST, ()), False),
    ],
)
def test_bright_legs_alone_are_asked_for_where_all_do_not_pass(monkeypatch, verdict, asked):
    tried = []

    def tries(*given):
        tried.append(given)
        return given

    def judged(*_):
        return SimpleNamespace(verdict=Verdict(Level.CHECK, ()))

    monkeypatch.setattr(answer, "legs_in_all_pictures", lambda *_: ())
    monkeypatch.setattr(answer, "fit_without_dim_legs", tries)
    monkeypatch.setattr(answer, "_told", lambda *_: (None, None))
    monkeypatch.setattr(answer, "_judged", judged)
    request = SimpleNamespace(n_legs=None, start=None, sightings=(), setting=None)
    found = SimpleNamespace(verdict=verdict)
    alone = answer._without_images(found, request, SimpleNamespace(of_fit=True))
    assert bool(tried) == asked
    assert (alone is not None) == asked
