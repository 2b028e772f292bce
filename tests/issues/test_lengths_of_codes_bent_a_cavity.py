"""Fault: with codes 1 % longer than told, and told so, the passes of a cavity were called curved.

Lines were measured where the clock as told counts the light, 200 ps beside it, so that neighbouring
passes pulled them by up to 3 mm; and the column of the clock's scale held the noise of the times,
which explained itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.timing.clock.shared_modes import with_shared_errors
from tests.oracles.cavity import cavity
from tests.oracles.refracted_border import camera_told

LONGER, STATED = 0.05, 0.03
"""So that six passes show what twenty did with dead codes that nobody knows."""


@pytest.fixture(scope="module")
def told():
    world = cavity(3, passes=6)
    clock = world.scene.clock
    longer = replace(world.scene, clock=replace(clock, width=clock.width * (1.0 + LONGER)))
    hist = lf.Histograms(
        replace(world, scene=longer).recording(3),
        bin_width_ps=clock.width,
        laser_period_ps=clock.period,
    )
    source = lf.Source(
        tuple(world.scene.vertices_mm[0]), emission_time_ps=world.scene.emission_time_ps
    )
    timing = with_shared_errors(lf.TimingCalibration.nominal(hist), scale_std=STATED)
    return world, lf.reconstruct(
        hist, camera=camera_told(world.scene), source=source, timing=timing
    )


def test_the_path_is_right(told):
    """One fixed seed; five stated errors or more in one of 15 coordinates: 1e-5."""
    world, path = told
    assert path.n_legs == world.n_passes
    inner = slice(1, -1)
    off = np.abs(path.vertices_mm - world.scene.vertices_mm)[inner]
    assert (off < 5.0 * path.vertex_std[inner, :3]).all()


def test_it_is_not_called_bent(told):
    """One fixed seed: 1 % of recordings would not be trusted."""
    assert told[1].verdict.level == "trust", told[1].verdict
