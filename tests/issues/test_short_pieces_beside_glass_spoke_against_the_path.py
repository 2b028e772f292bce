"""Told glass near a mirror or the picture's edge: a piece of the leg too short to be fitted.

No leg of the fit accounted for its light: right paths were contradicted by it, up to nine stated
errors off by `photon`, or `photon` refused the piece for having no pixels. A block that stood
beyond the picture was refused, and one beside a mirror was put into the wrong one of two legs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.path.verdict import Level
from lightflight.simulate.presets import ideal, paper_scene

GLASS = lf.Material.named("BK7", wavelength_nm=532.0)
IN_VIEW = np.array([[0.0, 0.0, 0.0], [300.0, 20.0, 30.0], [0.0, 90.0, -90.0]])
ONE_LEG = np.array([[0.0, 0.0, 0.0], [375.0, 40.0, 30.0]])
MIRROR = np.array([[0.0, 0.0, 0.0], [345.0, 20.0, 30.0], [0.0, 130.0, 10.0]])


def block_on(leg_mm, share, thickness_mm=20.0, diameter_mm=14.0):
    start, end = leg_mm
    return lf.Block(
        start + share * (end - start), end - start,
        thickness_mm=thickness_mm, diameter_mm=diameter_mm, glass=GLASS,
    )  # fmt: skip


def reconstructed(vertices_mm, block, method="joint"):
    """The path by a recording of the twin, and how far it is off, in view, mm."""
    medium = lf.Medium(blocks=[block])
    scene = paper_scene(ideal(psf_std_px=0.3, active_width_px=0.12))
    scene = replace(scene, vertices_mm=vertices_mm, medium=medium)
    hist = lf.simulate(scene, photons_per_pixel=40_000.0, seed=1)
    path = lf.reconstruct(
        hist, camera=scene.camera, source=lf.Source(tuple(vertices_mm[0]), emission_time_ps=2000.0),
        medium=medium, timing=lf.TimingCalibration.nominal(hist), method=method,
    )  # fmt: skip
    return path, lf.path_error(path, hist.truth, scene.camera).position_rms_mm


@pytest.mark.parametrize("method", ["joint", "photon"])
@pytest.mark.parametrize("share", [0.745, 0.2])
def test_light_of_a_short_piece_says_nothing_against_the_path(method, share):
    """Two pixels of the leg are seen behind the glass, or none before it."""
    path, off_mm = reconstructed(ONE_LEG, block_on(ONE_LEG, share), method)
    assert path.legs_in_glass == (1,)
    assert path.verdict.level is Level.TRUST
    assert off_mm < 0.1


def test_a_block_beyond_the_picture_changes_nothing():
    path, off_mm = reconstructed(ONE_LEG, block_on(ONE_LEG, 0.92))
    assert path.n_legs == 1
    assert path.verdict.level is Level.TRUST
    assert off_mm < 0.1


@pytest.mark.parametrize(
    ("vertices_mm", "share", "thickness_mm"), [(MIRROR, 0.085, 5.0), (IN_VIEW, 0.1, 20.0)]
)
def test_glass_beside_a_mirror_is_put_into_the_leg_that_crosses_it(
    vertices_mm, share, thickness_mm
):
    """Out of view, and where the picture shows it beside the other leg."""
    block = block_on(vertices_mm[1:], share, thickness_mm=thickness_mm)
    path, off_mm = reconstructed(vertices_mm, block)
    assert path.legs_in_glass == (2,)
    assert path.verdict.level is Level.TRUST
    assert off_mm < 0.2
