"""One flight seen by several cameras, fitted at once."""

import numpy as np
import pytest

import lightflight as lf
from lightflight.reconstruct.limits.planning import moved_to
from lightflight.simulate.presets import ideal, paper_scene

PHOTONS = 2_000.0
N_RUNS = 8


def scene_from(camera=None):
    changes = {} if camera is None else {"camera": camera}
    return paper_scene(ideal(psf_std_px=0.3, active_width_px=0.12), **changes)


@pytest.fixture(scope="module")
def scenes():
    front = scene_from()
    side = moved_to(front.camera, (330.0, 37.5, 520.0), (187.5, 37.5, 25.0))
    return front, scene_from(side)


@pytest.fixture(scope="module")
def timing(scenes):
    return lf.TimingCalibration.nominal(
        lf.simulate(scenes[0], photons_per_pixel=10.0, seed=0, threads=1)
    )


def recorded(scenes, seed):
    return [
        lf.simulate(scene, photons_per_pixel=PHOTONS, seed=2 * seed + k, threads=1)
        for k, scene in enumerate(scenes)
    ]


def found(scenes, recordings, timing, **options):
    return lf.reconstruct(
        recordings,
        camera=[scene.camera for scene in scenes],
        source=scenes[0].source,
        timing=timing,
        **options,
    )


@pytest.fixture(scope="module")
def both_and_one(scenes, timing):
    both, one = [], []
    for seed in range(N_RUNS):
        recordings = recorded(scenes, seed)
        both.append(found(scenes, recordings, timing))
        one.append(found(scenes[:1], recordings[:1], timing))
    return both, one


class TestTwoCameras:
    """Emission time fitted; eight recordings at fixed seeds."""

    def test_stated_errors_are_smaller_than_one_cameras(self, both_and_one):
        both, one = ([p.vertex_std[1:3].mean() for p in paths] for paths in both_and_one)
        assert np.mean(both) < 0.85 * np.mean(one)

    def test_corners_come_back_within_the_stated_errors(self, scenes, both_and_one):
        """16 corners of 4 numbers: the rms pull of 64 passes 1.35 by chance once in a million,
        were all independent; those of one corner are not, and 1.6 is allowed.
        """
        pulls = []
        for path in both_and_one[0]:
            assert path.n_legs == 3
            truth = np.column_stack((scenes[0].vertices_mm, scenes[0].vertex_times_ps))
            value = np.column_stack((path.vertices_mm, path.vertex_times_ps))
            pulls.append(((value - truth)[1:3] / path.vertex_std[1:3]).ravel())
        assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.6

    def test_real_errors_are_smaller_too(self, scenes, both_and_one):
        both, one = (
            np.sqrt(np.mean([lf.path_error(p, scenes[0], scenes[0].camera)[0] ** 2 for p in paths]))
            for paths in both_and_one
        )
        assert both < one

    def test_residuals_are_the_first_cameras(self, both_and_one):
        both, one = both_and_one
        assert len(both[0].residuals) == pytest.approx(len(one[0].residuals), abs=12)


def test_a_list_of_one_camera_is_that_camera(scenes, timing):
    recordings = recorded(scenes, 50)[:1]
    listed = found(scenes[:1], recordings, timing)
    plain = lf.reconstruct(
        recordings[0], camera=scenes[0].camera, source=scenes[0].source, timing=timing
    )
    np.testing.assert_array_equal(listed.vertices_mm, plain.vertices_mm)
    np.testing.assert_array_equal(listed.covariance, plain.covariance)


def test_a_pose_that_is_uncertain_counts_for_its_own_camera(scenes, timing):
    """The second camera's pose error costs something, and less than leaving it out."""
    front, side = scenes
    recordings = recorded(scenes, 60)
    loose = lf.Camera(
        side.camera.matrix, side.camera.distortion, side.camera.world_from_camera,
        side.camera.shape, pose_covariance=np.diag([1e-3] * 3 + [1.0] * 3) ** 2,
    )  # fmt: skip
    exact = found(scenes, recordings, timing)
    unsure = lf.reconstruct(
        recordings, camera=[front.camera, loose], source=front.source, timing=timing
    )
    alone = found(scenes[:1], recordings[:1], timing)
    sizes = [p.vertex_std[1:3].mean() for p in (exact, unsure, alone)]
    assert sizes[0] < sizes[1] <= 1.02 * sizes[2]


class TestBadCalls:
    def test_cameras_and_recordings_must_match(self, scenes, timing):
        with pytest.raises(ValueError, match="2 cameras for 1 recordings"):
            found(scenes, recorded(scenes, 1)[:1], timing)

    def test_calibrations_and_recordings_must_match(self, scenes, timing):
        with pytest.raises(ValueError, match="3 calibrations for 2 recordings"):
            found(scenes, recorded(scenes, 1), [timing] * 3)

    @pytest.mark.parametrize("method", ["paper", "photon"])
    def test_only_joint_takes_several(self, scenes, timing, method):
        with pytest.raises(ValueError, match="takes one camera"):
            found(scenes, recorded(scenes, 1), timing, method=method)
