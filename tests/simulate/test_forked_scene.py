"""The twin draws beam splitters: light that is split, on one clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.simulate import presets

C, AIR = 0.299792458, 1.00027
VERTICES = np.array([(0, 30, 0), (200, 40, 20), (460, 53, 46), (250, 240, 0)], dtype=float)
SHARES = (1.0, 0.7, 0.3)


def scene(**changes):
    given = {
        "camera": lf.Camera.facing_plane(center_mm=(187.5, 60.0)),
        "source": lf.Source((0, 30, 0), emission_time_ps=2000.0),
        "detector": presets.ideal(),
        "forks": ((2, 1),),
        "brightness": SHARES,
    }
    return lf.Scene(VERTICES, **(given | changes))


def test_times_run_from_the_fork():
    times = scene().vertex_times_ps
    steps = [VERTICES[1] - VERTICES[0], VERTICES[2] - VERTICES[1], VERTICES[3] - VERTICES[1]]
    way = np.linalg.norm(steps, axis=1)
    expected = 2000.0 + AIR / C * np.array([0.0, way[0], way[0] + way[1], way[0] + way[2]])
    np.testing.assert_allclose(times, expected, rtol=1e-13)


def test_each_arm_is_the_light_of_a_scene_of_its_own():
    """A leg alone, from where and when the light is split, shows the same in every pixel."""
    whole = scene()
    truth = lf.simulate(whole, photons_per_pixel=1000.0, seed=3).truth
    assert truth.forks == ((2, 1),)
    start = float(whole.vertex_times_ps[1])
    alone = scene(forks=(), brightness=None)
    alone = replace(
        alone,
        vertices_mm=VERTICES[[1, 3]],
        source=lf.Source(VERTICES[1], emission_time_ps=start),
    )
    own = lf.simulate(alone, photons_per_pixel=1000.0, seed=3).truth
    lit = own.expected_counts > 1e-3
    np.testing.assert_allclose(
        truth.mean_arrival_ps[2][lit], own.mean_arrival_ps[0][lit], atol=1e-6
    )
    scale = truth.expected_leg_counts[2][lit] / own.expected_counts[lit]
    np.testing.assert_allclose(scale, scale[0], rtol=1e-9)


def test_light_is_shared():
    """By the pixel's own share of the light where all three legs are equally far and bright."""
    even = lf.simulate(
        scene(brightness=None), photons_per_pixel=1000.0, seed=3
    ).truth.expected_leg_counts
    split = lf.simulate(scene(), photons_per_pixel=1000.0, seed=3).truth.expected_leg_counts
    ratio = split.sum(axis=(1, 2)) / even.sum(axis=(1, 2))
    np.testing.assert_allclose(ratio / ratio[0], SHARES, rtol=1e-9)


@pytest.mark.parametrize("forks", [((2, 2),), ((1, 2),), ((9, 1),), "21"])
def test_what_is_no_fork_is_refused(forks):
    with pytest.raises(ValueError, match="forks must be pairs"):
        scene(forks=forks)


def test_the_field_of_split_light_is_not_modelled():
    with pytest.raises(ValueError, match="polarization cannot be told of a path that forks"):
        scene(scattering="rayleigh", polarization=(0.0, 1.0, 0.0))


def test_a_truth_that_forks_is_kept_with_its_recording(tmp_path):
    hist = lf.simulate(scene(), photons_per_pixel=1000.0, seed=3)
    lf.write(hist, tmp_path / "hist.h5")
    again = lf.read(tmp_path / "hist.h5")
    path = lf.bounds(scene(), photons_per_pixel=1000.0).path
    error = lf.path_error(path, again.truth, scene().camera)
    assert error.position_rms_mm < 1e-6


@pytest.mark.long
def test_a_drawn_splitter_is_found_and_trusted():
    """The position's error is that of the bound, not three times as much: one recording of seven
    numbers and 4,000 photons passes three times by chance far less than once in 1e6."""
    hist = lf.simulate(scene(background=5.0), photons_per_pixel=4000.0, seed=11)
    made = scene()
    path = lf.reconstruct(
        hist, camera=made.camera, source=made.source, timing=lf.TimingCalibration.nominal(hist)
    )
    assert len(path.forks) == 1
    assert path.n_legs == 3
    error = lf.path_error(path, hist.truth, made.camera)
    bound = lf.bounds(scene(background=5.0), photons_per_pixel=4000.0)
    assert error.position_rms_mm < 3.0 * bound.position_rms_mm
