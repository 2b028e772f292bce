"""Codes 0.1 % longer, source told as exact: four legs instead of three, every test passed, "trust".

The corner that was found turns by 14 degrees where the light is straight. A clock, an index or a
source that is off explains the same recording without it, which is now said. Light that does turn
by 12 degrees is explained by no such error and stays trusted.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.path.verdict import Level
from lightflight.reconstruct.trials.outcome import NoFit
from lightflight.reconstruct.trials.revise import refitted
from lightflight.reconstruct.verdict import doubtful, examine
from lightflight.reconstruct.verdict.doubtful import verdict_with_doubtful_corners
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.fixture
def asked(monkeypatch):
    """What is said of corners where, as once, all tests pass."""
    said = []

    def passed(verdict, *given):
        trusting = replace(verdict, level=Level.TRUST, findings=())
        said.append(verdict_with_doubtful_corners(trusting, *given))
        return verdict

    monkeypatch.setattr(examine, "verdict_with_doubtful_corners", passed)
    return said


@pytest.mark.usefixtures("as_found")
@pytest.mark.long
def test_a_corner_that_a_clock_explains_is_in_doubt(asked):
    """Named by its tests; by its corner where, as once, all tests pass."""
    world = random_world(9263, 3).but(scale=1e-3)
    with pytest.warns(lf.errors.SuspectDataWarning):
        path = lf.reconstruct(record(world, 9263), **what_the_user_tells(world))
    names = [finding.name for finding in path.verdict.findings]
    assert path.n_legs == 4
    assert path.verdict.level != "trust"
    assert "clock_scale" in names
    # A path with a leg less was asked about as well, and is no better.
    doubted = asked[0]
    assert doubted.level == "check"
    assert "turns by 8.1° at corner 1" in doubted.findings[0].sentence
    assert "--n-legs" in doubted.findings[0].remedy


@pytest.mark.usefixtures("as_found")
@pytest.mark.long
def test_a_corner_is_asked_about_where_the_path_without_loses_pulses():
    """A source told 3 mm off made four legs of three, trusted: without the corner ten pulses lay on
    no leg, and each counted against the source, with which they all come back."""
    world = DEFECTS["source_off_x"].applied(random_world(33508, 3), 3.0)
    with pytest.warns(lf.errors.SuspectDataWarning):
        path = lf.reconstruct(record(world, 33508), **what_the_user_tells(world))
    assert path.n_legs == 4
    assert path.verdict.level == "check"
    assert path.verdict.findings[0].name == "source"


@pytest.mark.long
def test_a_corner_is_asked_about_where_even_light_fits_no_path(asked, monkeypatch):
    """Two legs for one, trusted: the path as found had too few pixels of its first leg in even
    light, and was not asked about."""
    n_asked = []

    def none_of_the_found(*given):
        n_asked.append(given)
        return NoFit.NOTHING_FOUND if len(n_asked) == 1 else refitted(*given)

    monkeypatch.setattr(doubtful, "refitted", none_of_the_found)
    world = random_world(24124, 1).but(scale=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lf.errors.SuspectDataWarning)
        path = lf.reconstruct(record(world, 24124), **what_the_user_tells(world))
    assert path.n_legs == 2
    # Then a path with a leg less was tried, too.
    doubted = asked[0]
    assert doubted.level == "check"
    assert "clock_scale" in {finding.name for finding in doubted.findings}


@pytest.mark.parametrize("seed", [700, pytest.param(702, marks=pytest.mark.long)])
def test_light_that_turns_by_twelve_degrees_is_not(seed):
    world = random_world(seed, 2)
    start, end = world.vertices[:2]
    step = end - start
    aside = np.cross(step, [0.3, 0.4, 0.5])
    aside *= np.tan(np.radians(6.0)) * np.linalg.norm(step) / 2 / np.linalg.norm(aside)
    world = world.but(vertices=np.array([start, (start + end) / 2 + aside, end]))
    path = lf.reconstruct(record(world, seed), **what_the_user_tells(world))
    assert path.n_legs == 2
    assert path.verdict.level == "trust"
