"""Light that begins or stops within the picture: cut footprints must not bend the path."""

from functools import cache, lru_cache

import numpy as np
import pytest

import lightflight as lf
from lightflight.simulate import Scene
from lightflight.simulate.presets import ideal

# The verdict only says that its tests do not hold where light begins or stops in the picture.
pytestmark = pytest.mark.usefixtures("unexamined", "nothing_twice")
N_RUNS = 3
CAMERA = lf.Camera.facing_plane()


def scene_of(angle_deg, half_mm=150.0):
    """One leg about the middle of the field; steep ones end in the picture."""
    direction = np.array([np.cos(np.radians(angle_deg)), 0.0, np.sin(np.radians(angle_deg))])
    return Scene(
        np.array([-half_mm * direction, half_mm * direction]),
        camera=CAMERA,
        source=lf.Source(-half_mm * direction, emission_time_ps=2000.0, pulse_fwhm_ps=68.0),
        detector=ideal(psf_std_px=0.3, active_width_px=0.12),
    )


@lru_cache(maxsize=48)
def recording_of(angle_deg, seed):
    return lf.simulate(scene_of(angle_deg), photons_per_pixel=4000.0, seed=seed, threads=1)


@cache
def steep_path(angle_deg, method, seed):
    """One for all tests that ask for it: none changes it."""
    hist = recording_of(angle_deg, seed)
    return lf.reconstruct(
        hist, camera=CAMERA, source=scene_of(angle_deg).source,
        timing=lf.TimingCalibration.nominal(hist), method=method, n_legs=1,
    )  # fmt: skip


def steep_paths(angle_deg, method, seeds):
    return [steep_path(angle_deg, method, seed) for seed in seeds]


@pytest.mark.parametrize(
    ("angle_deg", "method"),
    [
        (-80.0, "joint"),
        pytest.param(-60.0, "joint", marks=pytest.mark.long),
        pytest.param(60.0, "joint", marks=pytest.mark.long),
        (80.0, "joint"),
        pytest.param(-80.0, "photon", marks=pytest.mark.long),
        pytest.param(-60.0, "photon", marks=pytest.mark.long),
        pytest.param(60.0, "photon", marks=pytest.mark.long),
        (80.0, "photon"),
    ],
)
def test_steep_legs_that_end_in_the_picture(angle_deg, method):
    """The rms pull of 3 angles passes 2.8 by chance in fewer than one case of 10,000 (4e-5)."""
    pulls = [
        (path.legs[0].angle_deg - angle_deg) / path.legs[0].angle_std_deg
        for path in steep_paths(angle_deg, method, range(N_RUNS))
    ]
    assert np.sqrt(np.mean(np.square(pulls))) < 2.8


@pytest.mark.parametrize("angle_deg", [-60.0, 60.0])
def test_where_light_stops_is_found(angle_deg):
    """To 0.08 px in the picture. The stated error is 0.026 px: a spot that may be wider at the tip
    than elsewhere leaves that much; it was 0.01 px with one spot of all."""
    seen = np.array(CAMERA.pixels_from_points(scene_of(angle_deg).vertices_mm[-1]))
    for path in steep_paths(angle_deg, "photon", range(N_RUNS)):
        found = np.array(CAMERA.pixels_from_points(path.vertices_mm[-1]))
        np.testing.assert_allclose(found, seen, atol=0.08)


def test_pixels_at_the_tips_count():
    """Errors at the bound, tips included: 6 ratios pass 2.2 by chance in 1 of 10,000 (7e-5)."""
    ratios = []
    for angle_deg in (-80.0, -60.0):
        bound = lf.bounds(scene_of(angle_deg), photons_per_pixel=4000.0).angle_std_deg[0]
        found = [path.legs[0].angle_deg for path in steep_paths(angle_deg, "photon", range(N_RUNS))]
        ratios.extend((np.array(found) - angle_deg) / bound)
    assert np.sqrt(np.mean(np.square(ratios))) < 2.2


def test_joint_asks_all_counts_where_light_stops_in_view():
    (path,) = steep_paths(-60.0, "joint", [1])
    assert path.method == "joint"
    assert "all counts" in path.statements[0]


def test_light_beyond_the_codes_is_not_dark():
    """A window of codes that ends before the light does cuts the recording, not the leg."""
    scene = scene_of(5.0, half_mm=190.0)
    hist = lf.simulate(scene, photons_per_pixel=4000.0, seed=3, threads=1)
    whole = lf.reconstruct(
        hist, camera=CAMERA, source=scene.source, timing=lf.TimingCalibration.nominal(hist)
    )
    last = int(np.quantile(whole.residuals["arrival_ps"], 0.7) / hist.bin_width_ps)
    cut = lf.Histograms(
        hist.counts[:, :, :last], bin_width_ps=hist.bin_width_ps, laser_period_ps=None
    )
    part = lf.reconstruct(
        cut, camera=CAMERA, source=scene.source, timing=lf.TimingCalibration.nominal(cut),
        method="photon",
    )  # fmt: skip
    assert part.goodness.converged
    assert abs(part.legs[0].angle_deg - 5.0) < 4.0 * part.legs[0].angle_std_deg


def test_a_leg_that_crosses_the_picture_keeps_its_ends():
    """Nothing is taken for cut where nothing is: all pulses at the edges take part."""
    scene = scene_of(5.0, half_mm=190.0)
    for seed in range(2):
        hist = lf.simulate(scene, photons_per_pixel=4000.0, seed=seed, threads=1)
        path = lf.reconstruct(
            hist, camera=CAMERA, source=scene.source, timing=lf.TimingCalibration.nominal(hist)
        )
        used = path.residuals[path.residuals["used"]]
        assert used["col"].min() == 0
        assert used["col"].max() == 31
