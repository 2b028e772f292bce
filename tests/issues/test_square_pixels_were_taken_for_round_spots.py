"""The spot of a pixel was taken for a Gaussian: pixels sensitive over their pitch bent right paths.

Such a pixel looks before or behind its foot, and shares the light of a line otherwise than a
Gaussian would. Right single legs were 30 stated errors off and contradicted (`curved_leg`,
`source`); one path of three legs got a fourth that ran away, and was refused.
"""

from __future__ import annotations

import numpy as np
import pytest

import lightflight as lf
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.light import scaled_to
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import World

PHOTONS = 40_000.0


def with_square_pixels(seed: int, n_legs: int) -> World:
    """Sensitive over the whole pitch, behind a lens of 0.26 px."""
    world = random_world(seed, n_legs, PHOTONS, "known")
    return scaled_to(world.but(active_side_px=1.0, spot_std_px=0.26), PHOTONS)


def mean_square(path: lf.LightPath, world: World) -> float:
    """Of the errors, whitened: corners, and what is square to the last leg at its end."""
    n = world.n_legs
    ahead = world.vertices[-1] - world.vertices[-2]
    aside = np.linalg.svd(ahead[np.newaxis])[2][1:]
    told = np.zeros((3 * (n - 1) + 2, 4 * (n + 1)))
    for row, place in enumerate(4 * k + axis for k in range(1, n) for axis in range(3)):
        told[row, place] = 1.0
    told[-2:, 4 * n : 4 * n + 3] = aside
    off = np.zeros((n + 1, 4))
    off[:, :3] = path.vertices_mm - world.vertices
    values, vectors = np.linalg.eigh(told @ path.covariance @ told.T)
    kept = values > 1e-9 * values.max()
    return float(np.mean((vectors.T @ told @ off.ravel())[kept] ** 2 / values[kept]))


@pytest.mark.parametrize(
    ("method", "seed", "n_legs"),
    [
        # Along rows: the area comes from times and line together.
        ("joint", 501, 1),
        # A lens that distorts: the light stops in the picture.
        ("joint", 505, 1),
        # The one that was refused.
        pytest.param("joint", 503, 3, marks=pytest.mark.long),
        pytest.param("photon", 503, 3, marks=pytest.mark.long),
        ("photon", 505, 1),
    ],
)
def test_square_pixels_were_taken_for_round_spots(method, seed, n_legs):
    """Two numbers of one leg, eight of three: mean squares beyond 9.3 and 4.0 by chance in 1e-4."""
    world = with_square_pixels(seed, n_legs)
    path = lf.reconstruct(record(world, seed), **what_the_user_tells(world), method=method)
    assert path.verdict.level == "trust"
    assert path.n_legs == n_legs
    assert mean_square(path, world) < (9.3 if n_legs == 1 else 4.0)


@pytest.mark.usefixtures("unexamined")
def test_the_line_of_a_square_spot_is_not_lost_to_unequal_pixels():
    """What a Gaussian left unexplained was called unequal pixels: corners three times as unsure."""
    world = with_square_pixels(502, 3)
    path = lf.reconstruct(record(world, 502), **what_the_user_tells(world))
    small = random_world(502, 3, PHOTONS, "known")
    usual = lf.reconstruct(record(small, 502), **what_the_user_tells(small))
    errors = [np.sqrt(np.diag(one.covariance)[4:7]).max() for one in (path, usual)]
    assert errors[0] < 1.5 * errors[1]
