"""Camera: conventions in words, OpenCV as the oracle, exact inverses, analytic derivatives."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from lightflight.camera.lens import Lens
from lightflight.camera.model import Camera
from lightflight.camera.rigid import rotation_from_vector
from lightflight.errors import GeometryError

# One lens per length OpenCV knows, each strong enough to move a corner by pixels.
LENSES: dict[int, tuple[float, ...]] = {
    0: (),
    4: (-0.28, 0.09, 0.004, -0.003),
    5: (-0.31, 0.12, 0.002, -0.001, -0.02),
    8: (0.4, -0.2, 0.001, 0.002, 0.05, 0.65, -0.1, 0.02),
    12: (-0.2, 0.05, 0.001, -0.002, 0.01, 0.03, 0.02, -0.01, 0.004, -0.002, 0.003, 0.001),
}
LENSES[14] = (*LENSES[12], 0.05, -0.03)
MATRIX = np.array([[61.0, 0.0, 15.2], [0.0, 58.0, 16.1], [0.0, 0.0, 1.0]])


def camera_with(
    distortion: Any = (), *, rotation: Any = (2.6, -0.4, 0.3), center: Any = (40.0, 25.0, 600.0)
) -> Camera:
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector(rotation)
    pose[:3, 3] = center
    return Camera(MATRIX, np.array(distortion), pose, (32, 32))


def points_in_front(camera: Camera, n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.27, 0.27, n), rng.uniform(-0.27, 0.27, n)
    depth = rng.uniform(50.0, 2000.0, n)
    local = np.stack([x * depth, y * depth, depth], axis=-1)
    pose = camera.world_from_camera
    return local @ pose[:3, :3].T + pose[:3, 3]


class TestFacingPlane:
    """The paper's camera, described in words."""

    def test_pupil_stands_above_the_centre(self) -> None:
        camera = Camera.facing_plane((32, 48), distance_mm=535.0, center_mm=(187.5, 37.5))
        np.testing.assert_array_equal(camera.center_mm, [187.5, 37.5, 535.0])
        np.testing.assert_array_equal(camera.backward_axis, [0.0, 0.0, 1.0])

    def test_larger_x_is_larger_column_and_larger_y_is_smaller_row(self) -> None:
        camera = Camera.facing_plane()
        row, col = camera.pixels_from_points([[0, 0, 0], [10, 0, 0], [0, 10, 0]])
        assert col[1] > col[0]
        assert row[1] == row[0]
        assert row[2] < row[0]
        assert col[2] == col[0]

    def test_nearer_to_the_camera_is_farther_from_the_centre(self) -> None:
        camera = Camera.facing_plane()
        _, col = camera.pixels_from_points([[50, 0, 0], [50, 0, 50]])
        assert col[1] > col[0] > 15.5

    def test_field_lies_between_outer_pixel_edges_on_z_zero(self) -> None:
        camera = Camera.facing_plane(
            (24, 32), distance_mm=500.0, field_of_view_mm=(320.0, 120.0), center_mm=(5.0, -7.0)
        )
        left_top, right_bottom = [5 - 160, -7 + 60, 0], [5 + 160, -7 - 60, 0]
        row, col = camera.pixels_from_points([left_top, right_bottom])
        np.testing.assert_allclose(row, [-0.5, 23.5], atol=1e-12)
        np.testing.assert_allclose(col, [-0.5, 31.5], atol=1e-12)

    def test_first_pixel_has_its_centre_at_zero(self) -> None:
        camera = Camera.facing_plane((32, 32), field_of_view_mm=(320.0, 320.0))
        pixel = camera.pixels_from_points([-155.0, 155.0, 0.0])
        np.testing.assert_allclose(pixel, (0.0, 0.0), atol=1e-12)

    def test_takes_shape_as_keyword_too(self) -> None:
        assert Camera.facing_plane(shape=(8, 9)).shape == (8, 9)

    @pytest.mark.parametrize("bad", [{"distance_mm": 0.0}, {"field_of_view_mm": (1.0, -2.0)}])
    def test_refuses_nonsense(self, bad: dict[str, Any]) -> None:
        with pytest.raises(GeometryError, match=next(iter(bad))):
            Camera.facing_plane(**bad)


class TestAgainstOpenCV:
    """OpenCV is the definition of the lens model."""

    @pytest.mark.parametrize("size", LENSES)
    def test_projection(self, size: int) -> None:
        cv2 = pytest.importorskip("cv2")
        camera = camera_with(LENSES[size])
        points = points_in_front(camera, 200, seed=size)
        view = np.linalg.inv(camera.world_from_camera)
        turn, _ = cv2.Rodrigues(view[:3, :3])
        expected, _ = cv2.projectPoints(
            points, turn, view[:3, 3], camera.matrix, np.array(LENSES[size] or np.zeros(4))
        )
        row, col = camera.pixels_from_points(points)
        np.testing.assert_allclose(col, expected[:, 0, 0], atol=1e-9)
        np.testing.assert_allclose(row, expected[:, 0, 1], atol=1e-9)

    @pytest.mark.parametrize("size", LENSES)
    def test_undistortion(self, size: int) -> None:
        cv2 = pytest.importorskip("cv2")
        camera = camera_with(LENSES[size])
        row, col = (a.ravel().astype(float) for a in np.mgrid[0:32:5, 0:32:5])
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
        expected = cv2.undistortPoints(
            np.stack([col, row], axis=-1)[:, None],
            camera.matrix,
            np.array(LENSES[size] or np.zeros(4)),
            None,
            None,
            None,
            criteria,
        )
        x, y = camera.normalized_from_pixels(row, col)
        # OpenCV iterates a fixed point: it is the looser of the two.
        np.testing.assert_allclose(x, expected[:, 0, 0], atol=1e-7)
        np.testing.assert_allclose(y, expected[:, 0, 1], atol=1e-7)


class TestRoundTrips:
    @pytest.mark.parametrize("size", LENSES)
    def test_pixel_to_ray_to_pixel(self, size: int) -> None:
        camera = camera_with(LENSES[size])
        row, col = np.mgrid[-0.5:31.6:0.8, -0.5:31.6:0.8]
        rays = camera.rays_from_pixels(row, col)
        np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0, atol=1e-15)
        x, y = camera.normalized_from_pixels(row, col)
        again = camera.normalized_from_pixels(*camera.pixels_from_normalized(x, y))
        np.testing.assert_allclose(again, (x, y), atol=1e-12, rtol=0)
        row_again, col_again = camera.pixels_from_points(camera.center_mm + 700.0 * rays)
        # 1e-12 of a picture 32 pixels wide, through 600 mm of world coordinates.
        np.testing.assert_allclose(row_again, row, atol=1e-11, rtol=0)
        np.testing.assert_allclose(col_again, col, atol=1e-11, rtol=0)

    @settings(max_examples=60, deadline=None)
    @given(
        rotation=st.tuples(*[st.floats(-3.1, 3.1)] * 3),
        center=st.tuples(*[st.floats(-2000.0, 2000.0)] * 3),
        k1=st.floats(-0.35, 0.35),
        p1=st.floats(-0.01, 0.01),
        row=st.floats(-0.5, 31.5),
        col=st.floats(-0.5, 31.5),
        depth=st.floats(10.0, 5000.0),
    )
    def test_any_pose(
        self,
        rotation: tuple[float, float, float],
        center: tuple[float, float, float],
        k1: float,
        p1: float,
        row: float,
        col: float,
        depth: float,
    ) -> None:
        camera = camera_with((k1, 0.05, p1, -p1), rotation=rotation, center=center)
        point = camera.center_mm + depth * camera.rays_from_pixels(row, col)
        assert camera.sees(point) or min(row, col) <= -0.499 or max(row, col) >= 31.499
        # 1e-12 relative to the largest coordinate that had to be subtracted.
        slack = 1e-12 * 61.0 * (1.0 + np.abs(camera.center_mm).max() / depth)
        np.testing.assert_allclose(
            camera.pixels_from_points(point), (row, col), atol=slack, rtol=0.0
        )

    def test_batch_equals_single(self) -> None:
        camera = camera_with(LENSES[5])
        row, col = np.mgrid[0:32:7, 0:32:9].astype(float)
        rays = camera.rays_from_pixels(row, col)
        for index in np.ndindex(row.shape):
            single = camera.rays_from_pixels(row[index], col[index])
            np.testing.assert_allclose(rays[index], single, atol=1e-15)

    def test_nan_pixels_stay_nan(self) -> None:
        camera = camera_with(LENSES[5])
        rays = camera.rays_from_pixels([np.nan, 3.0], [2.0, 3.0])
        assert np.isnan(rays[0]).all()
        assert np.isfinite(rays[1]).all()


class TestJacobian:
    @pytest.mark.parametrize("size", LENSES)
    def test_against_central_differences(self, size: int) -> None:
        camera = camera_with(LENSES[size])
        points = points_in_front(camera, 50, seed=100 + size)
        numeric = np.empty((50, 2, 3))
        for axis in range(3):
            step = np.zeros(3)
            step[axis] = 1e-3
            ahead, behind = (
                camera.pixels_from_points(points + step),
                camera.pixels_from_points(points - step),
            )
            numeric[:, 0, axis] = (ahead[0] - behind[0]) / 2e-3
            numeric[:, 1, axis] = (ahead[1] - behind[1]) / 2e-3
        analytic = camera.pixel_jacobian(points)
        np.testing.assert_allclose(analytic, numeric, atol=3e-9, rtol=1e-8)

    def test_a_radial_lens_is_one_of_all_terms(self) -> None:
        """Terms too small to change a number make it take the way of all twelve."""
        x, y = np.random.default_rng(5).uniform(-0.3, 0.3, (2, 50))
        for terms in ((-0.2, 0.05, 0.0, 0.0), (-0.2, 0.05, 0.0, 0.0, 0.01)):
            all_terms = np.array(terms)
            all_terms[2:4] = 1e-300
            radial, any_lens = Lens(np.array(terms)), Lens(all_terms)
            np.testing.assert_array_equal(radial.distorted(x, y), any_lens.distorted(x, y))
            np.testing.assert_array_equal(radial.jacobian(x, y), any_lens.jacobian(x, y))

    def test_against_mpmath(self) -> None:
        """Thirty digits: pinhole, five coefficients, written out again."""
        k1, k2, p1, p2, k3 = LENSES[5]
        camera = camera_with(LENSES[5])
        rotation, centre = camera.world_from_camera[:3, :3], camera.center_mm

        def pixel(*point: Any) -> tuple[Any, Any]:
            d = [point[i] - mpmath.mpf(centre[i]) for i in range(3)]
            c = [sum(mpmath.mpf(rotation[i, j]) * d[i] for i in range(3)) for j in range(3)]
            x, y = c[0] / c[2], c[1] / c[2]
            q = x**2 + y**2
            g = 1 + k1 * q + k2 * q**2 + k3 * q**3
            u = x * g + 2 * p1 * x * y + p2 * (q + 2 * x**2)
            v = y * g + p1 * (q + 2 * y**2) + 2 * p2 * x * y
            return MATRIX[1, 1] * v + MATRIX[1, 2], MATRIX[0, 0] * u + MATRIX[0, 2]

        point = points_in_front(camera, 1, seed=7)[0]
        with mpmath.workdps(30):
            p = [mpmath.mpf(v) for v in point]
            order = np.eye(3, dtype=int)
            for out in range(2):
                derivative = [
                    float(mpmath.diff(lambda *q, o=out: pixel(*q)[o], tuple(p), tuple(order[a])))
                    for a in range(3)
                ]
                np.testing.assert_allclose(
                    camera.pixel_jacobian(point)[out], derivative, rtol=1e-12
                )
            assert float(pixel(*p)[0]) == pytest.approx(
                float(camera.pixels_from_points(point)[0]), rel=1e-13
            )

    def test_pose_delta_moves_pixels_as_the_jacobian_says(self) -> None:
        """Turning the camera by w about A moves the picture as turning the scene by -w."""
        camera = camera_with(LENSES[5])
        point = points_in_front(camera, 1, seed=8)[0]
        jacobian = camera.pixel_jacobian(point)
        delta = np.array([2e-6, -1e-6, 3e-6, 1e-4, 2e-4, -3e-4])
        moved = np.array(camera.perturbed(delta).pixels_from_points(point))
        still = np.array(camera.pixels_from_points(point))
        apparent = -np.cross(delta[:3], point - camera.center_mm) - delta[3:]
        np.testing.assert_allclose(moved - still, jacobian @ apparent, rtol=1e-4)


class TestOutOfSight:
    def test_behind_is_nan_and_not_seen(self) -> None:
        camera = Camera.facing_plane()
        points = np.array([[0.0, 0.0, 600.0], [0.0, 0.0, 535.0], [0.0, 0.0, 0.0]])
        pixels = np.array(camera.pixels_from_points(points))
        np.testing.assert_array_equal(np.isnan(pixels), [[True, True, False]] * 2)
        np.testing.assert_array_equal(camera.sees(points), [False, False, True])
        assert np.isnan(camera.pixel_jacobian([0.0, 0.0, 600.0])).all()

    def test_edges_of_the_picture(self) -> None:
        camera = Camera.facing_plane(field_of_view_mm=(200.0, 100.0))
        inside = camera.sees([[99.9, 0, 0], [100.1, 0, 0], [0, 49.9, 0], [0, -50.1, 0]])
        np.testing.assert_array_equal(inside, [True, False, True, False])

    def test_folded_rays_do_not_come_back_into_the_picture(self) -> None:
        """k1 = -0.3 alone turns at r = 1.054: a point at r = 1.7 would land inside."""
        camera = Camera(
            np.array([[20.0, 0.0, 15.5], [0.0, 20.0, 15.5], [0.0, 0.0, 1.0]]),
            np.array([-0.3, 0.0, 0.0, 0.0]),
            np.eye(4),
            (32, 32),
        )
        assert 1.7 * (1 - 0.3 * 1.7**2) * 20.0 + 15.5 < 31.5
        assert not camera.sees([1.7, 0.0, 1.0])
        assert np.isnan(camera.pixels_from_points([1.7, 0.0, 1.0])).all()
        assert camera.sees([0.9, 0.0, 1.0])

    def test_a_pixel_beyond_the_fold_is_refused_and_named(self) -> None:
        camera = Camera(
            np.array([[20.0, 0.0, 15.5], [0.0, 20.0, 15.5], [0.0, 0.0, 1.0]]),
            np.array([-0.3, 0.0, 0.0, 0.0]),
            np.eye(4),
            (32, 32),
        )
        with pytest.raises(GeometryError, match=r"cannot be undone at 1 pixels.*\(0, 31\)") as got:
            camera.rays_from_pixels([15.0, 0.0], [15.0, 31.0])
        np.testing.assert_array_equal(got.value.offenders, [False, True])


class TestChecks:
    def test_matrix_transposed(self) -> None:
        with pytest.raises(GeometryError, match="transpose"):
            Camera(MATRIX.T, np.empty(0), np.eye(4), (32, 32))

    def test_negative_focal_length(self) -> None:
        matrix = MATRIX.copy()
        matrix[1, 1] *= -1
        with pytest.raises(GeometryError, match="positive"):
            Camera(matrix, np.empty(0), np.eye(4), (32, 32))

    def test_pose_that_mirrors(self) -> None:
        with pytest.raises(GeometryError, match="mirrors"):
            Camera(MATRIX, np.empty(0), np.diag([1.0, 1.0, -1.0, 1.0]), (32, 32))

    def test_pose_that_scales(self) -> None:
        with pytest.raises(GeometryError, match="not rigid"):
            Camera(MATRIX, np.empty(0), np.diag([1.1, 1.1, 1.1, 1.0]), (32, 32))

    def test_pose_with_rounded_digits_is_made_rigid(self) -> None:
        pose = np.eye(4)
        pose[:3, :3] = np.round(rotation_from_vector((0.3, -0.2, 0.9)), 6)
        rotation = Camera(MATRIX, np.empty(0), pose, (32, 32)).world_from_camera[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)

    def test_distortion_of_odd_length(self) -> None:
        with pytest.raises(ValueError, match="0, 4, 5, 8, 12 or 14"):
            camera_with((0.1, 0.2))

    def test_points_of_wrong_shape(self) -> None:
        with pytest.raises(ValueError, match=r"\(\.\.\., 3\)"):
            camera_with().pixels_from_points([1.0, 2.0])

    @pytest.mark.parametrize(
        ("covariance", "word"),
        [(np.eye(5), "shape"), (-np.eye(6), "negative"), (np.triu(np.ones((6, 6))), "symmetric")],
    )
    def test_pose_covariance(self, covariance: np.ndarray, word: str) -> None:
        with pytest.raises(ValueError, match=word):
            Camera(MATRIX, np.empty(0), np.eye(4), (32, 32), covariance)

    def test_arrays_are_read_only_copies(self) -> None:
        matrix = MATRIX.copy()
        camera = Camera(matrix, np.empty(0), np.eye(4), (32, 32))
        matrix[0, 0] = 1.0
        assert camera.matrix[0, 0] == 61.0
        with pytest.raises(ValueError, match="read-only"):
            camera.matrix[0, 0] = 1.0


class TestStorage:
    @pytest.mark.parametrize("covariance", [None, np.diag([1e-6, 2e-6, 3e-6, 0.1, 0.2, 0.3])])
    def test_arrays_and_back(self, covariance: np.ndarray | None) -> None:
        camera = camera_with(LENSES[8])
        camera = Camera(
            camera.matrix, camera.distortion, camera.world_from_camera, (32, 64), covariance
        )
        again = Camera.from_arrays(camera.to_arrays())
        assert again.shape == (32, 64)
        for name in ("matrix", "distortion", "world_from_camera", "pose_covariance"):
            np.testing.assert_array_equal(getattr(again, name), getattr(camera, name))

    def test_lens_that_follows_the_pose(self) -> None:
        slopes = np.zeros((8, 6))
        slopes[0, 5], slopes[3, 1], slopes[4, 5] = 0.1, 2.0, 0.001
        camera = Camera(MATRIX, np.array([-0.2, 0, 0, 0]), np.eye(4), (32, 32), None, slopes)
        again = Camera.from_arrays(camera.to_arrays()).perturbed((0, 1e-3, 0, 0, 0, 10.0))
        assert again.matrix[0, 0] == pytest.approx(62.0)
        assert again.matrix[1, 1] == 58.0
        assert again.matrix[1, 2] == pytest.approx(16.102)
        assert again.distortion[0] == pytest.approx(-0.19)
        with pytest.raises(ValueError, match=r"\(4, *6\)"):
            Camera(MATRIX, np.empty(0), np.eye(4), (32, 32), None, slopes)

    def test_missing_array_is_named(self) -> None:
        with pytest.raises(ValueError, match="world_from_camera"):
            Camera.from_arrays({"matrix": MATRIX, "distortion": (), "shape": (2, 2)})
