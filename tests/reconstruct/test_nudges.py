"""How the picture follows errors of camera and medium, against a second look as they moved it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.camera.refraction import window
from lightflight.materials import Material
from lightflight.reconstruct.model.forward import local_variables
from lightflight.reconstruct.model.geometry import arrival_jacobian, footprints
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import (
    local_with_shared,
    moved,
    nudges_of_views,
    shared_errors,
)
from lightflight.reconstruct.model.unknowns import layout_of
from tests.reconstruct.test_forward import ASIDE, CAMERA, CORNER, scene_of

MEDIUM = lf.Medium(path_group_index_std=1e-3, return_group_index_std=2e-3, index_correlation=0.4)
UNSURE = replace(
    CAMERA,
    distortion=np.array([-0.2, 0.05, 1e-3, -1e-3, 0.0]),
    pose_covariance=np.diag([1e-6, 2e-6, 3e-6, 0.1, 0.2, 0.3]),
    focal_std_fraction=2e-3,
    distortion_std=5e-3,
)
ALONG = np.random.default_rng(5).normal(size=(9, 6)) * np.array([0.3] * 3 + [1e-3] * 3)
FITTED = replace(UNSURE, intrinsics_per_pose=ALONG)
"""A camera whose lens terms were fitted together with its pose."""
PANE = window(
    (0.0, 0.0, 300.0), (0.1, -0.05, 1.0), thickness_mm=10.0, glass=Material(1.52, 1.55),
    beyond=Material(1.334, 1.36), distance_std_mm=0.5,
)  # fmt: skip
TANK = replace(UNSURE, interfaces=(PANE[0], replace(PANE[1], phase_index_std=2e-3)))
"""It looks through a tilted window of uncertain place into water of uncertain index."""
WATER = replace(MEDIUM, path_group_index=1.36, return_group_index=1.36)
SEEN = [(UNSURE, MEDIUM), (FITTED, MEDIUM), (TANK, WATER)]
SEEN_IDS = ["told", "fitted with its pose", "through a window"]
STEP = 0.01


@pytest.mark.parametrize(("camera", "medium"), SEEN, ids=SEEN_IDS)
@pytest.mark.parametrize("state", [CORNER, ASIDE], ids=["corner", "corner aside"])
def test_arrival_times_follow_as_a_second_look_says(camera, medium, state):
    told = Setting(camera, lf.Source(), medium)
    errors = shared_errors(told)
    delta = np.linspace(-2.0, 2.0, len(errors))
    _, pixels = scene_of(state)
    near = np.flatnonzero(pixels.near[:, 0])

    def arrivals(at):
        there = moved(told, errors, at)
        return footprints(
            state, camera=there.camera, medium=there.medium, legs=0, rows=pixels.rows[near],
            cols=pixels.cols[near],
        ).arrival_ps  # fmt: skip

    seen = moved(told, errors, delta)
    print_, by_state = arrival_jacobian(
        state, camera=seen.camera, medium=seen.medium, legs=0, rows=pixels.rows[near],
        cols=pixels.cols[near],
    )  # fmt: skip
    nudges = nudges_of_views(told, errors, delta, seen)[0]
    own = nudges.arrivals(state, print_, by_state, seen.medium)
    # Feet of pixels beside the leg turn with it, which is left out.
    on = np.abs(print_.lateral_px) < 0.15
    assert on.sum() >= 2
    assert own.shape[1] == len(nudges) == len(errors) == 10 + len(camera.interfaces)
    for k, unit in enumerate(np.eye(len(errors)) * STEP):
        change = (arrivals(delta + unit) - arrivals(delta - unit)) / (2 * STEP)
        np.testing.assert_allclose(own[on, k], change[on], rtol=0.02, atol=0.02)
    assert np.abs(own[on]).max() > 1.0


@pytest.mark.parametrize(("camera", "medium"), SEEN, ids=SEEN_IDS)
@pytest.mark.parametrize(("state", "off"), [(ASIDE, 1e-6), (CORNER, 0.01)], ids=["legs", "corner"])
def test_brightness_follows_as_a_second_look_says(camera, medium, state, off):
    """A leg's image moves across its pixels, and a corner, whose feet turn, along it."""
    told = Setting(camera, lf.Source(), medium)
    errors = shared_errors(told)
    delta = np.linspace(-1.0, 1.0, len(errors))
    light, pixels = scene_of(state, slope=0.1)
    basis, modes = np.eye(state.vertices_mm.size + 1), np.zeros(0)

    def seen(at):
        there = moved(told, errors, at)
        points = undistorted_px(there.camera, pixels.rows, pixels.cols)
        return local_variables(
            state, light, pixels, layout_of(len(basis), 0, light), seen_px=points,
            basis=basis, modes=modes, camera=there.camera, medium=there.medium,
        ).log_photons  # fmt: skip

    local = local_with_shared(
        state, light, pixels, layout_of(len(basis), 0, light, len(errors)), basis=basis,
        modes=modes, setting=told, errors=errors, delta=delta,
    )  # fmt: skip
    lit = pixels.near & (local.log_photons > 0.0)
    for k, unit in enumerate(np.eye(len(errors)) * STEP):
        change = (seen(delta + unit) - seen(delta - unit)) / (2 * STEP)
        own = local.jacobian[:, ::3, len(basis) + k]
        np.testing.assert_allclose(own[lit], change[lit], rtol=1e-4, atol=off)
