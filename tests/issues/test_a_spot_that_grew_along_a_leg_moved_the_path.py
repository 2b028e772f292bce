"""One width of the spot was believed of all legs: a lens out of focus moved paths in silence.

A lens is sharp at one distance and in the middle of its field. Where the spot grows along a leg the
mean time of a pixel is later than the light's brightness says, because light from ahead reaches
farther back; and a line between pixels is told by the width. Paths were two to six stated errors
off, and trusted.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import lightflight as lf
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world

pytestmark = pytest.mark.usefixtures("unexamined", "nothing_twice")


def tilted(world):
    """27 % wider at the right edge than in the middle, as much narrower at the left."""
    return world.but(spot_tilt_ln=0.24)


def out_of_focus(world):
    """A fast lens in focus 40 mm nearer than the middle of the path: half as wide again."""
    depths = (world.vertices - world.view.centre) @ world.view.axes[2]
    return world.but(defocus_px_per_mm=0.007, focus_mm=float(depths.mean()) - 40.0)


@cache
def recorded(blur, seed):
    """One for both estimators: none changes it."""
    world = blur(random_world(seed, 3))
    return world, record(world, seed)


@pytest.mark.parametrize("method", ["joint", pytest.param("photon", marks=pytest.mark.long)])
@pytest.mark.parametrize("blur", [tilted, out_of_focus])
def test_a_spot_that_grew_along_a_leg_moved_the_path(blur, method):
    """One recording of three legs each: the mean square of pulls over two corners (6 numbers),
    below 4.7; by chance less than 1e-4."""
    world, recording = recorded(blur, 71_000)
    path = lf.reconstruct(recording, **what_the_user_tells(world), method=method)
    assert path.n_legs == 3
    off = (path.vertices_mm - world.vertices)[1:3].ravel()
    inner = np.r_[4:7, 8:11]
    values, vectors = np.linalg.eigh(path.covariance[np.ix_(inner, inner)])
    told = values > 1e-9 * values.max()
    assert np.mean((vectors.T @ off)[told] ** 2 / values[told]) < 4.7
