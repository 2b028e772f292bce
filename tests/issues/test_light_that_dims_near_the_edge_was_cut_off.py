"""Where a leg dims by half within three pixels of the edge its light was taken to stop there.

Light that is uneven by a factor of two (20 % on 10 mm, 3.6 deviations high), along one row, in
a sharp spot: the last three pixels hold half of what those behind hold, each as much as the other.
They were taken for the wing of a spot beyond the leg's end, and a tenth to a sixth of all photons
for no light of the path: the right path was contradicted ("unexplained_light", 32 sigma).
"""

import numpy as np
import pytest

import lightflight as lf
from lightflight.reconstruct.fit.ends import _last_lit
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.parametrize("noise", [65606, 2])
def test_all_of_its_light_is_the_paths(noise):
    """400 photons in the brightest pixel; 82.7 and 88 % of them were the path's."""
    world = random_world(65606, 1, 400.0, "known")
    path = lf.reconstruct(record(world, noise), **what_the_user_tells(world))
    assert path.verdict.level == "trust"
    assert path.explained.photons > 0.99 * path.explained.photons_found


@pytest.mark.parametrize(
    ("beyond", "last"),
    [
        ((0.5, 0.5, 0.5), 11),  # dims by half, and goes on
        ((0.75, 0.55, 0.42), 11),  # dims by degrees
        ((0.31, 0.07, 0.01), 8),  # the wing of a spot of one pixel, half a pixel beyond an end
    ],
)
def test_wings_fall_and_light_goes_on(beyond, last):
    """Twelve pixels of one row, nine of them alike."""
    place = np.arange(12.0)
    strength = np.concatenate((np.ones(9), beyond))
    places = np.column_stack((np.zeros(12), place))
    assert _last_lit(places, place, strength) == last
