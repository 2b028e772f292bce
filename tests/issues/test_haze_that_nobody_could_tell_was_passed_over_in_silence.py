"""Where the strengths of diffuse light do not settle a fit goes on without them: nobody said so."""

import pytest

import lightflight as lf
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")
@pytest.mark.parametrize("method", ["joint", "photon"])
def test_dim_light_does_not_tell_haze_and_the_path_says_so(method):
    bright, dim = (
        lf.reconstruct(record(world, 0), method=method, **what_the_user_tells(world))
        for world in (random_world(71_000, 1, photons) for photons in (40_000.0, 40.0))
    )
    assert not any("Haze" in said for said in bright.statements)
    (said,) = (said for said in dim.statements if "Haze" in said)
    assert "could not be told" in said
