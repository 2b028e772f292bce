"""In fog a thousand pixels hold only scattered light, and some thirty see the beam.

The typical width of pulses was that of all pixels: the beam's were "too narrow" and left out, and
legs were looked for in the fog. Where legs were found, the fog's long pulses "filled the laser
period". Now the brightest pixels tell the width if they share a narrower one: light is widened on
its way, never narrowed.
"""

from __future__ import annotations

import numpy as np
import pytest

import lightflight as lf
from lightflight import flags as fl
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import World

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")

FARTHEST_STDS = 5.0
"""Of three coordinates of two corners, by chance once in 300,000 recordings."""


def fog(seed: int, n_legs: int, photons: float) -> World:
    """Three fifths of the light are scattered: 8 px wide, 600 ps late."""
    return random_world(seed, n_legs, photons=photons).but(
        late_halo=0.6, late_halo_std_px=8.0, late_halo_ps=600.0
    )


@pytest.mark.long
def test_the_beams_pulses_are_those_that_are_used() -> None:
    world = fog(5100, 1, 40_000.0)
    found = lf.find_arrivals(record(world, 5100), timing=what_the_user_tells(world)["timing"])
    beam = found.photons > 0.5 * np.sort(found.photons)[-8]
    assert fl.is_usable(found.flags[beam]).all()
    assert np.median(found.std_ps[~beam]) > 4.0 * np.median(found.std_ps[beam])


@pytest.mark.usefixtures("as_found")
@pytest.mark.parametrize(
    ("seed", "n_legs", "photons"),
    [(5101, 1, 40_000.0), pytest.param(5110, 3, 4_000.0, marks=pytest.mark.long)],
)
def test_paths_in_fog_are_those_of_the_beam(seed: int, n_legs: int, photons: float) -> None:
    world = fog(seed, n_legs, photons)
    path = lf.reconstruct(record(world, seed), **what_the_user_tells(world))
    assert path.n_legs == n_legs
    assert path.verdict.level != "trust"
    if n_legs == 1:
        slope = np.diff(world.vertices, axis=0)[0] @ path.camera.backward_axis
        truth = np.degrees(np.arcsin(slope / np.linalg.norm(np.diff(world.vertices, axis=0))))
        assert abs(path.legs[0].angle_deg - truth) < FARTHEST_STDS * path.legs[0].angle_std_deg
    else:
        off = np.abs(path.vertices_mm - world.vertices)[1:-1]
        assert (off < FARTHEST_STDS * path.vertex_std[1:-1, :3]).all()
