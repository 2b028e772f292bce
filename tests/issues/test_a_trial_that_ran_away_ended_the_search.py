"""A ghost of a fourth leg in fog ran 10^15 mm away, and the whole recording was refused for it.

An independent forward model: fog of a quarter of the light, a wall, gaps. With `n_legs=3` the path
was right; without, "the fit runs out of all bounds". Such a trial has failed, and the weakest leg
is left out.
"""

from dataclasses import replace

import pytest

import lightflight as lf
from lightflight.errors import NothingFoundError
from lightflight.reconstruct.fit import joint
from lightflight.reconstruct.fit.robust import solve_robustly
from lightflight.reconstruct.trials import revise
from lightflight.reconstruct.trials.outcome import NoFit
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


def test_a_fit_that_runs_away_is_none(monkeypatch):
    given = []

    def fitted(*args, **kwargs):
        given.append((args, kwargs))
        return joint.fit_joint(*args, **kwargs)

    monkeypatch.setattr(revise, "fit_joint", fitted)
    world = random_world(0, 1)
    path = lf.reconstruct(record(world, 0), **what_the_user_tells(world))
    assert path.n_legs == 1
    (sightings, state, setting), legs = given[0]

    def far_away(*args):
        solution, *rest = solve_robustly(*args)
        gone = replace(solution.state, vertices_mm=1e16 * solution.state.vertices_mm)
        return replace(solution, state=gone), *rest

    monkeypatch.setattr(joint, "solve_robustly", far_away)
    monkeypatch.setattr(joint, "_PASSES", 1)
    with pytest.raises(NothingFoundError, match="runs out of all bounds"):
        joint.fit_joint(sightings, state, setting, **legs)
    assert revise.refitted(sightings, state, setting) is NoFit.NOTHING_FOUND
