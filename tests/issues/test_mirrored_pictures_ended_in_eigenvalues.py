"""A mirrored picture led `photon` astray, and it ended with "Eigenvalues did not converge"."""

import warnings

import pytest

import lightflight as lf
from lightflight.errors import LightflightWarning, NothingFoundError
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


def test_a_mirrored_leg_is_refused_in_a_sentence():
    assert not DEFECTS["mirrored_picture"].held_out
    world = DEFECTS["mirrored_picture"].applied(random_world(0, 1), 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        with pytest.raises(
            NothingFoundError, match=r"lightflight check|too few to say where it runs"
        ):
            lf.reconstruct(record(world, 0), method="photon", **what_the_user_tells(world))
