"""Haze of half of the light, three legs: `joint` was 7 and `photon` 345 stated errors off.

Late light of one leg comes with the next one's, two pixels beside its line: the first fit of that
line believed in light e^24 times as bright where it enters the picture. More light than the
recording holds ended the model of the haze, in silence, and the path was fitted without it.
"""

import warnings

import numpy as np
import pytest
from scipy.interpolate import BSpline

import lightflight as lf
from lightflight.errors import LightflightWarning
from lightflight.reconstruct.model.strength import knots_over, strength_as_seen
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.long
def test_three_legs_in_thick_haze_are_right_within_their_errors():
    """Six numbers of one recording: their rms pull passes 2.2 by chance once in 16,000."""
    haze = DEFECTS["haze_500ps"]
    assert not haze.held_out
    world = haze.applied(random_world(1290, 3), 0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        path = lf.reconstruct(record(world, 1290), **what_the_user_tells(world))
    assert path.n_legs == 3
    corners = np.arange(16).reshape(-1, 4)[1:-1, :3].ravel()
    off = (path.vertices_mm - world.vertices)[1:-1].ravel()
    stated = path.covariance[np.ix_(corners, corners)]
    assert np.sqrt(off @ np.linalg.solve(stated, off) / 6.0) < 2.2


def test_light_brighter_than_any_pixel_is_not_known_however_sure_the_line():
    """e^24 times as bright where the leg enters, its error a hundredth: as bright as farther on."""
    knots = knots_over(0.0, 24.0)
    log_strength = np.full(len(knots) - 4, 8.0)
    log_strength[:2] = 32.0
    spline = BSpline(knots, log_strength, 3)
    along = np.linspace(0.0, 24.0, 97)
    of_coefficients = 1e-4 * np.eye(len(log_strength))
    strength, beyond = strength_as_seen(spline, of_coefficients, np.exp(8.0), along)
    assert strength.max() < np.exp(8.0 + 1.6)
    assert beyond[along < 2.0].all()
    assert not beyond[(along > 8.0) & (along < 22.0)].any()
