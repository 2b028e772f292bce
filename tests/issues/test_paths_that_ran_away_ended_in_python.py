"""About light that is mostly another's a fit ran 10^16 mm away: "not enough values to unpack".

Half of the light is a late halo. Places of the path in the picture, from which mirrors are looked
for, were none; and where a path ends so far away, that is told in a sentence.
"""

import importlib
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import NothingFoundError, SuspectDataWarning
from lightflight.reconstruct.fit.joint import refuse_run_away
from lightflight.reconstruct.model.geometry import PathState
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.long
def test_a_late_halo_of_half_the_light_leaves_the_path():
    """Refused in a sentence at first; found since the beam's pulses are told from the halo's."""
    world = DEFECTS["late_halo"].applied(random_world(9016, 1), 0.5)
    with pytest.warns(SuspectDataWarning):
        path = lf.reconstruct(record(world, 9016), **what_the_user_tells(world))
    assert path.n_legs == 1
    assert path.verdict.level != "trust"
    step = np.diff(world.vertices, axis=0)[0]
    truth = np.degrees(np.arcsin(step @ path.camera.backward_axis / np.linalg.norm(step)))
    assert abs(path.legs[0].angle_deg - truth) < 4.0 * path.legs[0].angle_std_deg


@pytest.mark.parametrize("far", [4e16, np.nan])
def test_a_path_that_no_bench_holds_is_refused(far):
    with pytest.raises(NothingFoundError, match="out of all bounds"):
        refuse_run_away(PathState(np.array([[0.0, 0.0, 0.0], [1.0, 2.0, far]]), 0.0))


def test_light_behind_the_camera_leaves_the_verdict_numbers(monkeypatch):
    """In fog of 95 % of the light: "SVD did not converge", for such a leg has no picture."""
    asked = []
    tests = importlib.import_module("lightflight.reconstruct.verdict.geometry_tests")
    candidates = tests.geometry_candidates

    def overheard(rows, **named):
        asked.append(rows)
        return candidates(rows, **named)

    monkeypatch.setattr(tests, "geometry_candidates", overheard)
    world = random_world(9017, 1)
    path = lf.reconstruct(record(world, 9017), **what_the_user_tells(world))
    eye, rows = path.camera, asked[0]
    away = rows.state.vertices_mm + 2.0 * (eye.center_mm - rows.state.vertices_mm)
    behind = replace(rows, state=replace(rows.state, vertices_mm=away))
    by_time, by_line = behind.seen_by(0, eye)
    assert np.isfinite(by_time).all()
    assert np.isfinite(by_line).all()
