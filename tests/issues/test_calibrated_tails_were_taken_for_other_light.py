"""A clock whose flat showed a tail was told of it, and its recordings were called contradicted.

The tests of counts took every pulse for a Gaussian: "a second pulse of some 0.05 of the light".
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.timing.clock.response import Response
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world

SHARE, WAIT_PS = 0.3, 200.0


@pytest.mark.usefixtures("as_found")
@pytest.mark.parametrize("told", [True, False])
def test_the_shape_of_the_flat_is_that_of_the_pulses(told):
    """Pulses are placed by their mean, as the flat places them: the tail moves no time.

    A false alarm comes once in 10,000 recordings.
    """
    world = random_world(2, 1, 4_000.0).but(tail=SHARE, tail_ps=WAIT_PS, offset_ps=-SHARE * WAIT_PS)
    given = what_the_user_tells(world)
    if told:
        shape = Response.with_tail(std_ps=world.std_ps, tail_ps=WAIT_PS, tail_share=SHARE)
        curve = np.array([shape.time_ps, shape.density])
        given["timing"] = replace(given["timing"], response_curve=curve)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        verdict = lf.reconstruct(record(world, 2), **given).verdict
    assert (verdict.level == "contradicted") != told, verdict
