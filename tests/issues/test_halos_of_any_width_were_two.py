"""A halo as wide as neither of the two that the fit had contradicted every right path.

Reaches of 3 and 8 px were in the fit, and of 3 and 8 px were the halos that it was tried with.
Between them, and at 2 px, all of 24 recordings of one leg were contradicted but two (`halo`,
`unexplained_light`).
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import LightflightWarning
from lightflight.reconstruct.model import light
from lightflight.reconstruct.other_light import strengths
from tests.oracles.miss import pulls
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.parametrize(
    ("reach_px", "method"),
    [
        pytest.param(2.0, "joint", marks=pytest.mark.long),
        (4.0, "joint"),
        pytest.param(6.0, "photon", marks=pytest.mark.long),
        pytest.param(12.0, "joint", marks=pytest.mark.long),
    ],
)
def test_halos_of_any_width_are_taken_into_the_fit(reach_px, method):
    """The chance that an honest pull is above 4: 6e-5, for each of four."""
    world = random_world(8800, 1).but(halo=0.2, halo_std_px=reach_px)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        path = lf.reconstruct(record(world, 8800), method=method, **what_the_user_tells(world))
    assert path.n_legs == 1
    assert path.verdict.level == "check"
    assert "taken into the fit" in path.verdict.findings[0].sentence
    assert np.abs(pulls(path, world.vertices)).max() < 4.0


@pytest.mark.parametrize(
    ("reach_px", "late_ps"), [(4.0, 300.0), pytest.param(8.0, 1200.0, marks=pytest.mark.long)]
)
def test_halos_of_any_delay_are_taken_into_the_fit(reach_px, late_ps):
    """One was late by 600 ps, over 8 px: fog of other kinds contradicted right paths, or moved
    them by three stated errors."""
    world = random_world(8860, 1).but(
        late_halo=0.1, late_halo_std_px=reach_px, late_halo_ps=late_ps
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        path = lf.reconstruct(record(world, 8860), **what_the_user_tells(world))
    assert path.n_legs == 1
    assert path.verdict.level == "check"
    assert path.verdict.findings[0].name == "halo"
    assert np.abs(pulls(path, world.vertices)).max() < 4.0


def test_no_light_outside_of_the_picture_is_less_than_none():
    """Behind a stop a lens throws none of it about. It came out negative, and crept on and on."""
    left, right = light.OUTSIDE.start, light.OUTSIDE.start + 1
    value = np.zeros(len(light.LABELS))
    value[left] = -1.0
    total = np.eye(len(value))
    total[left, right] = total[right, left] = 0.5
    pull = np.zeros(len(value))
    pull[[left, right]] = -2.0, 1.0
    step = strengths._step(total, pull, value)
    # Held where it is, it takes no part: the other goes all of its own way.
    assert (step[left], step[right]) == (0.0, 1.0)
    pull[left] = 2.0
    assert strengths._step(total, pull, value)[left] > 0.0
