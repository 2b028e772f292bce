"""Delays that grow across the picture, codes that run ahead and fall behind: trusted, or called an
index, a pose, a bent leg.

A warm edge of the chip, a flat whose screen stood askew, a code density in too bright a light: no
pixel disagrees with its neighbours then.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


def _off(path, world):
    """Largest error of a corner, mm and in stated errors."""
    off = np.abs(path.vertices_mm - world.vertices)[1:-1]
    return off.max(), (off / path.vertex_std[1:-1, :3]).max()


@pytest.mark.parametrize(
    ("skew_ps", "seed", "prior"),
    [
        ((10.0, 0.0, 0.0), 0, "lab"),
        pytest.param((0.0, 10.0, 0.0), 1, "lab", marks=pytest.mark.long),
        pytest.param((0.0, 0.0, 10.0), 0, "known", marks=pytest.mark.long),
    ],
)
def test_delays_askew_are_named_and_can_be_fitted(skew_ps, seed, prior):
    """Ten picoseconds at the edge put corners 1 to 1.3 mm off, two of the three with "trust"."""
    world = random_world(seed, 3, prior=prior).but(skew_ps=skew_ps)
    hist, told = record(world, seed), what_the_user_tells(world)
    with pytest.warns(SuspectDataWarning, match="picture's edge"):
        path = lf.reconstruct(hist, **told)
    assert path.verdict.findings[0].name == "calibration"
    assert _off(path, world)[1] > 3.0
    with warnings.catch_warnings():
        warnings.simplefilter("error", SuspectDataWarning)
        cured = lf.reconstruct(hist, free=("calibration",), **told)
    off_mm, stds = _off(cured, world)
    assert off_mm < 0.6
    assert stds < 3.0


def test_uneven_codes_are_named():
    """Five picoseconds, up and down over 3 ns: an index, a pose and the source were named."""
    world = random_world(0, 3).but(slow_codes_ps=5.0)
    with pytest.warns(SuspectDataWarning, match="contradicts"):
        path = lf.reconstruct(record(world, 0), **what_the_user_tells(world))
    first = path.verdict.findings[0]
    assert first.name == "calibration"
    assert "codes" in first.sentence


def test_what_looks_like_bent_legs_is_not_bent():
    """The same in another scene: two legs came out bent, 1.2 mm and twelve stated errors off."""
    world = random_world(1, 3).but(slow_codes_ps=5.0)
    with pytest.warns(SuspectDataWarning, match="over the codes"):
        path = lf.reconstruct(record(world, 1), **what_the_user_tells(world))
    assert not path.bends
    assert path.verdict.level == "contradicted"
    assert path.verdict.findings[0].name == "calibration"
