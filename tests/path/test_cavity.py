"""path.round_trip: two mirrors from a path's corners, in closed form, and its errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.oracles.cavity import cavity
from tests.path_fakes import PAPER_VERTICES, make_path, random_covariance

C = 0.299792458
LEVEL_MM = np.array(
    [(20.0, 0, 0), (300.0, 10, 0), (0.0, 20, 5), (300.0, 30, 10), (0.0, 40, 15), (200.0, 45, 20)]
)
"""Corners at x = 300 and x = 0 by turns; source and exit lie between the mirrors."""


def test_mirrors_that_face_each_other_are_as_far_apart_as_they_stand():
    trip = make_path(LEVEL_MM).round_trip
    # 11.2 mm of walk per pass: the way is that much longer than the mirrors are apart. The law of
    # reflection is not quite kept by the first pass (10 mm) and the last: 0.2 mm.
    assert trip.distance_mm == pytest.approx(300.0, abs=0.3)
    np.testing.assert_allclose(trip.axis, [-1.0, 0.0, 0.0], atol=0.02)
    way = 2.0 * np.linalg.norm([300.0, 10.0, 5.0])
    np.testing.assert_allclose(trip.times_ps, 1.00027 * way / C, rtol=1e-12)
    assert trip.time_ps == pytest.approx(float(trip.times_ps.mean()), rel=1e-15)


@pytest.mark.parametrize("seed", range(6))
def test_tilted_mirrors_of_the_oracle_are_found_exactly(seed):
    """Light thrown back by planes (the oracle), mirrors from corners alone (the record)."""
    world = cavity(seed, passes=9 + seed)
    trip = make_path(world.scene.vertices_mm).round_trip
    assert trip.distance_mm == pytest.approx(world.distance_mm, abs=2e-5)
    # The path of this test counts time by itself.
    np.testing.assert_allclose(trip.times_ps, world.round_trips_ps, rtol=1e-12)


def test_errors_are_those_of_drawn_paths():
    """1,000 paths drawn from the covariance: their scatter errs by 2.2 %, and 10 % are allowed.

    False alarm: 4.5 deviations, 7e-6 for each of the two.
    """
    rng = np.random.default_rng(7)
    path = make_path(LEVEL_MM, random_covariance(rng, len(LEVEL_MM), scale=0.3))
    value = np.column_stack((path.vertices_mm, path.vertex_times_ps)).ravel()
    times, distances = [], []
    for one in rng.multivariate_normal(value, path.covariance, size=1000):
        moved = one.reshape(-1, 4)
        trip = replace(path, vertices_mm=moved[:, :3], vertex_times_ps=moved[:, 3]).round_trip
        times.append(trip.time_ps)
        distances.append(trip.distance_mm)
    trip = path.round_trip
    assert np.std(times) / trip.time_std_ps == pytest.approx(1.0, abs=0.1)
    assert np.std(distances) / trip.distance_std_mm == pytest.approx(1.0, abs=0.1)
    assert trip.times_std_ps.shape == trip.times_ps.shape == (2,)


def test_the_share_of_each_class_of_error_adds_up():
    rng = np.random.default_rng(8)
    parts = {
        name: random_covariance(rng, len(LEVEL_MM), scale=scale)
        for name, scale in (("photon", 0.1), ("pixel", 0.2), ("shared", 0.6))
    }
    trip = make_path(LEVEL_MM, sum(parts.values()), covariance_parts=parts).round_trip
    assert set(trip.time_std_parts_ps) == set(parts)
    assert np.hypot.reduce(list(trip.time_std_parts_ps.values())) == pytest.approx(
        trip.time_std_ps, rel=1e-12
    )


@pytest.mark.parametrize(
    ("vertices", "unseen"),
    [
        (PAPER_VERTICES, ()),
        (LEVEL_MM, (2,)),
        ([(0, 0, 0), (300, 0, 0), (400, 200, 0), (0, 20, 0), (300, 30, 0)], ()),
    ],
    ids=["two corners", "a way unseen", "a corner that leads on"],
)
def test_light_that_does_not_go_to_and_fro_has_no_round_trip(vertices, unseen):
    assert make_path(vertices, unseen_legs=unseen).round_trip is None
