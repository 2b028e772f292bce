"""Tails of the detector, stretched as if flight through a pixel drew them out: contradicted.

Light that takes half of the response to cross a pixel widens pulses as a Gaussian does. Those
of a shape that the flat showed were stretched whole, and `pile_up`, or "counts are too low where
other pulse would add to them", was said of right paths.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.timing.clock.response import Response
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.clock import Clock
from tests.oracles.worlds.random_worlds import random_world

FINE = Clock(n_codes=2000, width_ps=25.0)


@pytest.mark.parametrize(
    ("std_ps", "wait_ps", "seed"),
    [pytest.param(14.0, 20.0, 2, marks=pytest.mark.long), (16.0, 24.0, 3)],
)
def test_flight_through_a_pixel_leaves_the_tail_as_long(std_ps, wait_ps, seed):
    """A false alarm comes once in 10,000 recordings of each."""
    world = random_world(seed, 1, clock=FINE)
    world = world.but(std_ps=std_ps, tail=1.0, tail_ps=wait_ps, offset_ps=-wait_ps)
    told = what_the_user_tells(world)
    shape = Response.with_tail(std_ps=std_ps, tail_ps=wait_ps)
    curve = np.array([shape.time_ps, shape.density])
    told["timing"] = replace(told["timing"], response_curve=curve)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        verdict = lf.reconstruct(record(world, seed), **told).verdict
    assert verdict.level != "contradicted", verdict
