"""`n_legs=1` for three: 143 of 222 pulses were left out without a word."""

import pytest

import lightflight as lf
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.parametrize("method", ["joint", pytest.param("photon", marks=pytest.mark.long)])
@pytest.mark.usefixtures("unexamined")
@pytest.mark.long
def test_a_path_says_how_many_pulses_it_explains(method):
    world = random_world(1, 3, 40_000.0, "known")
    hist, told = record(world, 1), what_the_user_tells(world)
    one, whole = (
        lf.reconstruct(hist, **(told | {"n_legs": n, "method": method})).explained for n in (1, 3)
    )
    assert one.n_found == whole.n_found
    assert one.n_pulses < 0.6 * one.n_found
    assert whole.n_pulses > 0.8 * whole.n_found
    assert 0.0 < one.photons < whole.photons <= whole.photons_found
    assert str(one).startswith(f"{one.n_pulses} of {one.n_found} pulses, ")


@pytest.mark.usefixtures("unexamined")
def test_repeats_count_together():
    world = random_world(1, 1, 4_000.0, "known")
    repeats, told = [record(world, seed) for seed in (1, 2)], what_the_user_tells(world)
    each = [lf.reconstruct(hist, **told).explained.n_found for hist in repeats]
    assert lf.reconstruct(repeats, **told).explained.n_found == sum(each)
