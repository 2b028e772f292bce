"""One flight seen by several cameras, fitted at once."""

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.reconstruct.all_counts.climb import order_of
from lightflight.reconstruct.limits.planning import moved_to
from lightflight.reconstruct.model.unknowns import Layout
from lightflight.simulate.presets import ideal, paper_scene
from tests.labs import without_second_light, without_verdict
from tests.oracles import several_views
from tests.oracles.refracted_bound import bound, emission_freedom


@pytest.fixture(scope="module", autouse=True)
def nothing_but_paths():
    """Neither verdicts nor second light: not for the fixtures of the module either."""
    with pytest.MonkeyPatch.context() as patch:
        without_verdict(patch)
        without_second_light(patch)
        yield


PHOTONS = 2_000.0
N_RUNS = 3


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
    """Emission time fitted; three recordings at fixed seeds."""

    def test_stated_errors_are_smaller_than_one_cameras(self, both_and_one):
        both, one = ([p.vertex_std[1:3].mean() for p in paths] for paths in both_and_one)
        assert np.mean(both) < 0.85 * np.mean(one)

    def test_corners_come_back_within_the_stated_errors(self, scenes, both_and_one):
        """6 corners of 4 numbers: the rms pull of 24 passes 1.57 by chance once in 10,000, were all
        independent; those of one corner are not, and 1.7 is allowed.
        """
        pulls = []
        for path in both_and_one[0]:
            assert path.n_legs == 3
            truth = np.column_stack((scenes[0].vertices_mm, scenes[0].vertex_times_ps))
            value = np.column_stack((path.vertices_mm, path.vertex_times_ps))
            pulls.append(((value - truth)[1:3] / path.vertex_std[1:3]).ravel())
        assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.7

    def test_real_errors_are_smaller_too(self, scenes, both_and_one):
        both, one = (
            np.sqrt(np.mean([lf.path_error(p, scenes[0], scenes[0].camera)[0] ** 2 for p in paths]))
            for paths in both_and_one
        )
        assert both < one

    def test_residuals_are_the_first_cameras(self, both_and_one):
        both, one = both_and_one
        assert len(both[0].residuals) == pytest.approx(len(one[0].residuals), abs=12)


def test_a_list_of_one_camera_is_that_camera(scenes, timing, both_and_one):
    listed = both_and_one[1][0]
    plain = lf.reconstruct(
        recorded(scenes, 0)[0], camera=scenes[0].camera, source=scenes[0].source, timing=timing
    )
    np.testing.assert_array_equal(listed.vertices_mm, plain.vertices_mm)
    np.testing.assert_array_equal(listed.covariance, plain.covariance)


def test_a_pose_that_is_uncertain_counts_for_its_own_camera(scenes, timing, both_and_one):
    """The second camera's pose error costs something, and less than leaving it out."""
    front, side = scenes
    recordings = recorded(scenes, 0)
    loose = lf.Camera(
        side.camera.matrix, side.camera.distortion, side.camera.world_from_camera,
        side.camera.shape, pose_covariance=np.diag([1e-3] * 3 + [1.0] * 3) ** 2,
    )  # fmt: skip
    exact, alone = (paths[0] for paths in both_and_one)
    unsure = lf.reconstruct(
        recordings, camera=[front.camera, loose], source=front.source, timing=timing
    )
    sizes = [p.vertex_std[1:3].mean() for p in (exact, unsure, alone)]
    assert sizes[0] < sizes[1] <= 1.02 * sizes[2]


@pytest.fixture(scope="module")
def alone_by_photon(scenes, timing):
    """The first camera's path by all its counts, seed 62."""
    return found(scenes[:1], recorded(scenes, 62)[:1], timing, method="photon")


class TestEveryCount:
    """`photon` before two and three cameras; recordings of an oracle that shoots its own rays.

    Full tables: benchmarks/several_cameras.py.
    """

    RUNS = 1

    @pytest.mark.long
    @pytest.mark.parametrize(("cameras", "photons"), [(2, 40.0), (3, 40_000.0)])
    def test_errors_are_those_stated(self, cameras, photons):
        """Squared distance of both corners from the truth by the stated covariance: chi-square of
        6 per recording; either side is passed by chance 1e-5, 4e-5 over both cells.
        """
        scenes = several_views.views(cameras, photons=photons)
        total, stated2 = 0.0, []
        least = bound(
            scenes[0], others=scenes[1:], also=(emission_freedom(),), vertices=(1, 2, 3)
        ).block(["x1", "y1", "z1", "x2", "y2", "z2"])
        for seed in range(61, 61 + self.RUNS):
            recordings = several_views.recorded(scenes, seed)
            call = several_views.told(scenes, recordings, emission_known=False)
            path = lf.reconstruct(recordings, method="photon", **call)
            assert path.n_legs == 3
            off = (path.vertices_mm - scenes[0].vertices_mm)[1:3].ravel()
            inner = np.r_[4:7, 8:11]
            stated = path.covariance[np.ix_(inner, inner)]
            total += float(off @ np.linalg.solve(stated, off))
            stated2.append(np.trace(stated))
        degrees = 6 * self.RUNS
        assert chi2.ppf(1e-5, degrees) < total < chi2.ppf(1.0 - 1e-5, degrees)
        # What is stated is what such counts can tell at best, not less and hardly more.
        assert 0.9 < np.sqrt(np.mean(stated2) / np.trace(least)) < 1.15

    def test_one_camera_of_a_list_is_that_camera(self, scenes, timing, alone_by_photon):
        plain = lf.reconstruct(
            recorded(scenes, 62)[0], camera=scenes[0].camera, source=scenes[0].source,
            timing=timing, method="photon",
        )  # fmt: skip
        np.testing.assert_array_equal(alone_by_photon.vertices_mm, plain.vertices_mm)
        np.testing.assert_array_equal(alone_by_photon.covariance, plain.covariance)

    def test_a_second_camera_that_sees_nothing_changes_little(
        self, scenes, timing, alone_by_photon, as_found
    ):
        """Twelve photons in its brightest pixel: the first camera's path, and its errors."""
        recordings = [
            recorded(scenes, 62)[0],
            lf.simulate(scenes[1], photons_per_pixel=12.0, seed=72, threads=1),
        ]
        both, alone = found(scenes, recordings, timing, method="photon"), alone_by_photon
        off = (both.vertices_mm - alone.vertices_mm)[1:3]
        assert np.all(np.abs(off) < 1.5 * alone.vertex_std[1:3, :3])
        assert np.all(both.vertex_std[1:3] < 1.01 * alone.vertex_std[1:3])

    @pytest.mark.long
    def test_a_pose_that_is_uncertain_counts_for_its_own_camera(
        self, scenes, timing, alone_by_photon
    ):
        front, side = scenes
        recordings = recorded(scenes, 62)
        loose = lf.Camera(
            side.camera.matrix, side.camera.distortion, side.camera.world_from_camera,
            side.camera.shape, pose_covariance=np.diag([1e-3] * 3 + [1.0] * 3) ** 2,
        )  # fmt: skip
        exact = found(scenes, recordings, timing, method="photon")
        unsure = lf.reconstruct(
            recordings, camera=[front.camera, loose], source=front.source, timing=timing,
            method="photon",
        )  # fmt: skip
        sizes = [p.vertex_std[1:3].mean() for p in (exact, unsure, alone_by_photon)]
        assert sizes[0] < sizes[1] <= 1.02 * sizes[2]

    def test_parameters_of_all_views_have_places_of_their_own(self):
        first = Layout(n_free=5, n_modes=2, spline_starts=(8, 12), size=18, n_shared=1)
        other = Layout(n_free=5, n_modes=1, spline_starts=(7,), size=14, n_shared=1)
        order = order_of([first, other])
        np.testing.assert_array_equal(order.places[0], np.arange(18))
        # Path and shared errors stand where the first camera has them; all else is new.
        np.testing.assert_array_equal(order.places[1], [0, 1, 2, 3, 4, 18, 7, *range(19, 26)])
        assert order.size == 26
        assert order.shared == slice(7, 8)


class TestBadCalls:
    def test_cameras_and_recordings_must_match(self, scenes, timing):
        with pytest.raises(ValueError, match="2 cameras for 1 recordings"):
            found(scenes, recorded(scenes, 1)[:1], timing)

    def test_calibrations_and_recordings_must_match(self, scenes, timing):
        with pytest.raises(ValueError, match="3 calibrations for 2 recordings"):
            found(scenes, recorded(scenes, 1), [timing] * 3)

    def test_the_papers_estimator_takes_one(self, scenes, timing):
        with pytest.raises(ValueError, match="takes one camera"):
            found(scenes, recorded(scenes, 1), timing, method="paper")
