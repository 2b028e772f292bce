"""A mirrored picture led `photon` astray, and it ended with "Eigenvalues did not converge"."""

import warnings

import pytest

import lightflight as lf
from lightflight.errors import LightflightWarning, NothingFoundError
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.long), 1])
def test_a_mirrored_leg_is_refused_in_a_sentence_or_contradicted(seed):
    assert not DEFECTS["mirrored_picture"].held_out
    world = DEFECTS["mirrored_picture"].applied(random_world(seed, 1), 1.0)
    told = what_the_user_tells(world)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        try:
            level, said = (
                lf.reconstruct(record(world, seed), method="photon", **told).verdict.level,
                "",
            )
        except NothingFoundError as error:
            level, said = None, str(error)
    refused = "lightflight check" in said or "too few to say" in said
    assert level == "contradicted" or refused
