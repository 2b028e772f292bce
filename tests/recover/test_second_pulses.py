"""A second pulse on the same path: its delay and share, the path beside it, and what is said of it.

Worlds of the tests' own forward model (`tests/oracles/worlds`), which adds the second pulse to the
series of each pixel's light and shares no line with the package.
"""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import World

CASES = (
    (501, 1, 0.1, 3_000.0, "joint"),
    (507, 1, 0.5, 30_000.0, "joint"),
    (502, 3, 0.1, 1_000.0, "joint"),
)
"""Seed, legs, share, delay in ps, estimator. The second comes after the laser's next pulse, and
is told as 20 ns before; 20 ns after, its light would lie where the codes end, unseen."""
PERIOD_PS = 50_000.0
CASES_TRIED = pytest.mark.parametrize(
    "case", [CASES[0], *(pytest.param(case, marks=pytest.mark.long) for case in CASES[1:])]
)


@cache
def found(seed: int, n_legs: int, share: float, delay: float, method: str, told: bool = True):
    world = random_world(seed, n_legs).but(second=share, second_ps=delay)
    given = what_the_user_tells(world)
    if not told:
        given["source"] = lf.Source(given["source"].position_mm)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        return world, lf.reconstruct(record(world, seed), method=method, **given)


def inner_pulls(world: World, path: lf.LightPath) -> np.ndarray:
    """Corners of three legs; of one leg, whose end is the picture's edge, its direction."""
    if world.n_legs == 1:
        step = np.diff(world.vertices, axis=0)[0]
        truth = path.vertices_mm[0] + step * np.linalg.norm(
            path.vertices_mm[1] - path.vertices_mm[0]
        ) / np.linalg.norm(step)
        off, std = path.vertices_mm[1] - truth, path.vertex_std[1, :3]
        across = np.abs(step) < 0.9 * np.linalg.norm(step)
        return off[across] / std[across]
    inner = slice(1, -1)
    off = path.vertices_mm - world.vertices
    return (off[inner] / path.vertex_std[inner, :3]).ravel()


@CASES_TRIED
def test_delay_and_share_are_those_put_in(case):
    """Six numbers at fixed seeds: one beyond 4.5 stated errors in 24,000 runs."""
    _, _, share, delay, _ = case
    second = found(*case)[1].second_pulse
    assert abs(second.share - share) < 4.5 * second.share_std
    off = second.delay_ps - delay
    assert abs(off - PERIOD_PS * round(off / PERIOD_PS)) < 4.5 * second.delay_std_ps
    assert second.share_std < 0.01
    assert second.delay_std_ps < 2.0


@CASES_TRIED
def test_the_path_is_right_beside_it(case):
    """Fixed seeds, 12 numbers; 5 stated errors in one of them: 1e-5."""
    world, path = found(*case)
    assert path.n_legs == world.n_legs
    assert (np.abs(inner_pulls(world, path)) < 5.0).all()


@CASES_TRIED
def test_it_is_told_and_no_contradiction(case):
    path = found(*case)[1]
    assert path.verdict.level == "check"
    assert path.verdict.findings[0].name == "other_pulse"
    assert "taken into the fit" in path.verdict.findings[0].sentence
    assert any("second pulse" in one for one in path.statements)


def test_repeats_show_the_same_one():
    """Two repeats, each fitted by itself in the cells of both."""
    world = random_world(501, 1).but(second=0.1, second_ps=3_000.0, repeats=2)
    with pytest.warns(SuspectDataWarning, match="taken into the fit"):
        path = lf.reconstruct(record(world, 501), **what_the_user_tells(world))
    assert abs(path.second_pulse.share - 0.1) < 4.5 * path.second_pulse.share_std
    assert abs(path.second_pulse.delay_ps - 3_000.0) < 4.5 * path.second_pulse.delay_std_ps


def test_without_one_there_is_none():
    path = found(501, 1, 0.0, 0.0, "joint")[1]
    assert path.second_pulse is None
    assert path.verdict.level == "trust"


@pytest.mark.long
def test_which_of_two_alike_is_the_first_stays_open():
    """Shares of one within their error: the other answer is told, as far off as they are apart."""
    world, path = found(501, 1, 1.0, 3_000.0, "joint", told=False)
    (other,) = path.alternatives
    both = sorted([path.emission_time_ps, other.path.emission_time_ps])
    true = world.vertex_times_ps()[0]
    assert np.abs(np.array(both) - [true, true + 3_000.0]).max() < 1.0
    assert abs(other.log_evidence) < np.log(100.0)


@pytest.mark.long
def test_the_brighter_one_is_the_first():
    world, path = found(503, 1, 0.5, -3_000.0, "joint", told=False)
    assert not path.alternatives
    assert abs(path.emission_time_ps - world.vertex_times_ps()[0]) < 1.0
    assert path.second_pulse.delay_ps < 0.0


def test_its_file_holds_it(tmp_path):
    path = found(*CASES[0])[1]
    path.save(tmp_path / "path.h5")
    assert lf.LightPath.load(tmp_path / "path.h5").second_pulse == path.second_pulse


@pytest.mark.long
def test_a_mirror_image_is_no_second_pulse():
    """One fixed seed: a wall 60 mm behind with a tenth of the light, whose image is aside."""
    from tests.oracles.worlds.defects import DEFECTS

    world = DEFECTS["wall_60mm"].applied(random_world(501, 1), 0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        path = lf.reconstruct(record(world, 501), **what_the_user_tells(world))
    assert path.second_pulse is None
