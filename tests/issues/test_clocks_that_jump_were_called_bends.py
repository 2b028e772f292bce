"""Delays that jump in the middle of the array, a code that is longer than all others: contradicted,
and called slow waves of all codes, glass in the beam, a bent or an unseen leg.

Halves that are read out by themselves, a stage of a delay line: no slow change across the picture
or over the codes makes a step.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world

CODE = 499
"""In the middle of those that the light of seed 0 fills."""


def _halves_apart(clock, shape, ps, *, by_row):
    """The later half of the rows or columns is late."""
    rows, cols = shape
    row, col = np.mgrid[:rows, :cols]
    later = row >= rows // 2 if by_row else col >= cols // 2
    return replace(clock, skew_ps=ps * later.ravel().astype(float))


def _one_longer(clock, shape, code, ps):
    """One code is longer: all after it start late."""
    edges = clock.width_ps * np.arange(clock.n_codes + 1.0)
    edges[code + 1 :] += ps
    return replace(clock, edges_ps=np.tile(edges, (shape[0] * shape[1], 1)))


def _first_finding(world, clock, seed):
    """Of a recording on that clock, told as the world's: its name, and the numbers it says."""
    hist = record(world.but(clock=clock), seed)
    with pytest.warns(SuspectDataWarning, match="contradicts"):
        path = lf.reconstruct(hist, **what_the_user_tells(world))
    first = path.verdict.findings[0]
    assert "jump" in first.sentence
    return first.name, [float(x) for x in re.findall(r"-?\d+(?:\.\d+)?", first.sentence)], path


@pytest.mark.parametrize(
    ("by_row", "seed", "prior"),
    [
        pytest.param(True, 2, "known", marks=pytest.mark.long),
        (False, 0, "known"),
        (False, 0, "lab"),
    ],
)
def test_halves_apart_are_named(by_row, seed, prior):
    """Three picoseconds, and from which row or column on; corners are 0.6 to 1 mm off."""
    world = random_world(seed, 3, prior=prior)
    shape = world.view.shape
    clock = _halves_apart(world.clock, shape, 3.0, by_row=by_row)
    name, (jump_ps, first_late), path = _first_finding(world, clock, seed)
    assert name == "calibration"
    assert jump_ps == pytest.approx(3.0, abs=0.5)
    assert first_late == shape[0 if by_row else 1] // 2
    assert np.abs(path.vertices_mm - world.vertices)[1:-1].max() > 0.5


def test_a_code_that_is_longer_is_named():
    """By 10 ps, and after how many: corners were 3.6 mm and 35 stated errors off, a leg "bent"."""
    world = random_world(0, 3)
    clock = _one_longer(world.clock, world.view.shape, CODE, 10.0)
    name, (jump_ps, counted_ps), _ = _first_finding(world, clock, 0)
    assert name == "calibration"
    assert jump_ps == pytest.approx(-10.0, abs=1.0)
    assert counted_ps == pytest.approx((CODE + 1) * world.clock.width_ps, abs=60.0)
