"""Camera calibration: exact recovery, honest errors, degenerate input, a real camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.stats import chi2 as chi2_distribution

from lightflight.camera.boards import calibrate_camera_from_boards
from lightflight.camera.calibration import CameraFit, calibrate_camera, fit_camera
from lightflight.camera.fit import LensModel, View, pose_error_from_step, system
from lightflight.camera.model import Camera
from lightflight.camera.rigid import rotation_from_vector
from lightflight.errors import GeometryError, SuspectDataWarning

LENS = (-0.2, 0.05, 0.001, -0.002, 0.01)


def some_camera(rng: np.random.Generator, *, lens: Any = LENS, fy: float = 61.0) -> Camera:
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector((np.pi, 0, 0)) @ rotation_from_vector(rng.normal(0, 0.3, 3))
    pose[:3, 3] = rng.normal(0.0, 300.0, 3)
    row, col = 15.5 + rng.normal(0.0, 0.5, 2)
    return Camera(
        np.array([[61.0, 0, col], [0, fy, row], [0, 0, 1.0]]), np.array(lens), pose, (32, 32)
    )


def some_points(
    rng: np.random.Generator, camera: Camera, n: int, *, planar: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Points in view 400-800 mm away, and the exact pixels that see them."""
    row, col = rng.uniform(-0.5, 31.5, (2, n))
    rays = camera.rays_from_pixels(row, col)
    if planar:
        # Tilted by 35 degrees: a plane that faces the camera cannot be calibrated from.
        across = camera.world_from_camera[:3, 0]
        normal = rotation_from_vector(0.6 * across) @ camera.backward_axis
        reach = (-600.0 * camera.backward_axis @ normal) / (rays @ normal)
    else:
        reach = rng.uniform(400.0, 800.0, n)
    return camera.center_mm + reach[:, None] * rays, np.stack([row, col], axis=-1)


def pose_error(fitted: Camera, truth: Camera) -> np.ndarray:
    """(6,) pose step that takes the fitted camera to the true one."""
    turn = truth.world_from_camera[:3, :3] @ fitted.world_from_camera[:3, :3].T
    vector = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    return np.append(np.array(vector) / 2.0, truth.center_mm - fitted.center_mm)


class TestExactData:
    # One plane cannot tell oblong pixels from a shifted principal point: not among these.
    @pytest.mark.parametrize(("planar", "fy"), [(False, 61.0), (False, 58.0), (True, 61.0)])
    def test_camera_is_found(self, planar: bool, fy: float) -> None:
        rng = np.random.default_rng(3)
        truth = some_camera(rng, fy=fy)
        points, pixels = some_points(rng, truth, 80, planar=planar)
        fitted = calibrate_camera(points, pixels, (32, 32))
        np.testing.assert_allclose(fitted.center_mm, truth.center_mm, atol=2e-3)
        np.testing.assert_allclose(fitted.backward_axis, truth.backward_axis, atol=1e-5)
        np.testing.assert_allclose(fitted.matrix, truth.matrix, rtol=1e-5, atol=1e-3)
        np.testing.assert_allclose(fitted.pixels_from_points(points), pixels.T, atol=1e-5)

    def test_paper_camera_from_points_in_space(self) -> None:
        truth = Camera.facing_plane(center_mm=(187.5, 37.5))
        points, pixels = some_points(np.random.default_rng(1), truth, 30)
        fitted = calibrate_camera(points, pixels, (32, 32))
        np.testing.assert_allclose(fitted.center_mm, truth.center_mm, atol=1e-3)
        np.testing.assert_allclose(fitted.matrix, truth.matrix, rtol=1e-5)

    def test_telephoto_and_wide_angle_start_alike(self) -> None:
        rng = np.random.default_rng(5)
        for focal in (12.0, 1200.0):
            plain = some_camera(rng, lens=())
            matrix = plain.matrix * [[focal / 61.0, 1, 1], [1, focal / 61.0, 1], [1, 1, 1]]
            truth = Camera(matrix, plain.distortion, plain.world_from_camera, (32, 32))
            points, pixels = some_points(rng, truth, 60)
            fitted = calibrate_camera(points, pixels, (32, 32))
            assert fitted.matrix[0, 0] == pytest.approx(focal, rel=1e-3)

    def test_known_focal_length_frees_a_facing_plane(self) -> None:
        truth = Camera.facing_plane(center_mm=(10.0, -5.0))
        grid = np.stack(np.meshgrid(np.arange(-100, 101, 25.0), np.arange(-100, 101, 25.0), [0.0]))
        points = grid.reshape(3, -1).T
        pixels = np.stack(truth.pixels_from_points(points), axis=-1)
        fitted = calibrate_camera(
            points, pixels, (32, 32), focal_length_px=float(truth.matrix[0, 0])
        )
        np.testing.assert_allclose(fitted.center_mm, truth.center_mm, atol=0.01)

    def test_pixels_that_saw_nothing_are_left_out(self) -> None:
        rng = np.random.default_rng(6)
        truth = some_camera(rng)
        points, pixels = some_points(rng, truth, 40)
        pixels[3] = np.nan
        fit = fit_camera(points, pixels, (32, 32))
        assert np.isnan(fit.residuals_px[3]).all()
        assert np.isfinite(np.delete(fit.residuals_px, 3, axis=0)).all()


class TestErrors:
    """Stated errors are the errors made."""

    @staticmethod
    def pulls(*, planar: bool, runs: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Pose errors (runs, 6) in standard errors, and their chi-square (runs,).

        60 points, 0.1 px; principal point and lens drawn as the fit's priors assume (the
        radial terms more narrowly: the prior's tails fold the picture).
        """
        rng = np.random.default_rng(seed)
        scaled: list[np.ndarray] = []
        squared: list[np.ndarray] = []
        for _ in range(runs):
            lens = rng.normal(0.0, (0.1, 0.1, 0.005, 0.005, 0.05))
            drawn = some_camera(rng, lens=lens)
            row, col = rng.normal(15.5, 3.2, 2)
            matrix = np.array([[61.0, 0, col], [0, 61.0, row], [0, 0, 1.0]])
            truth = Camera(matrix, drawn.distortion, drawn.world_from_camera, (32, 32))
            points, pixels = some_points(rng, truth, 60, planar=planar)
            noisy = pixels + rng.normal(0.0, 0.1, pixels.shape)
            fitted = calibrate_camera(points, noisy, (32, 32), pixel_std_px=0.1)
            error = pose_error(fitted, truth)
            assert fitted.pose_covariance is not None
            scaled.append(error / np.sqrt(np.diag(fitted.pose_covariance)))
            squared.append(np.asarray(error @ np.linalg.solve(fitted.pose_covariance, error)))
        return np.array(scaled), np.array(squared)

    def test_points_in_space(self) -> None:
        """20 cameras: the sum of chi-square (6 dof each) has its distribution.

        False alarm 5e-5 above; the lower bound is 20 % wider for the narrower radial terms.
        """
        _, squared = self.pulls(planar=False, runs=20, seed=20)
        low, high = np.asarray(chi2_distribution.ppf([0.5e-4, 1 - 0.5e-4], 120))
        assert 0.8 * low < squared.sum() < high

    @pytest.mark.long
    def test_points_in_a_plane(self) -> None:
        """25 cameras: width of each pull 1 +- 0.14; bound 4 of these, false alarm 4e-4.

        One plane leaves the principal point to its prior (3 px): the errors are so large that
        their joint distribution bends, and only each on its own is Gaussian.
        """
        scaled, _ = self.pulls(planar=True, runs=25, seed=20)
        width = np.sqrt(np.mean(scaled**2, axis=0))
        assert ((width > 0.43) & (width < 1.57)).all(), width

    def test_noise_is_read_off_the_residuals(self) -> None:
        """2 x 200 coordinates: the 1-sigma error of the estimate is 3.6 %; bound 4 sigma."""
        rng = np.random.default_rng(21)
        truth = some_camera(rng)
        points, pixels = some_points(rng, truth, 200)
        fit = fit_camera(points, pixels + rng.normal(0.0, 0.2, pixels.shape), (32, 32))
        assert fit.pixel_std_px == pytest.approx(0.2, rel=0.15)
        assert 400 - 15 < fit.dof < 400 - 6

    def test_lens_follows_the_pose(self) -> None:
        """One sigma along the pose's worst direction: the picture moves by far less than with
        the lens held, because focal length and distance were fitted together."""
        rng = np.random.default_rng(22)
        truth = some_camera(rng)
        points, pixels = some_points(rng, truth, 60)
        fitted = calibrate_camera(points, pixels, (32, 32), pixel_std_px=0.1)
        assert fitted.pose_covariance is not None
        std = np.sqrt(np.diag(fitted.pose_covariance))
        values, vectors = np.linalg.eigh(fitted.pose_covariance / np.outer(std, std))
        step = 0.1 * std * vectors[:, -1] * np.sqrt(values[-1])
        rigid = Camera(
            fitted.matrix, fitted.distortion, fitted.world_from_camera, (32, 32)
        ).perturbed(step)
        seen = np.array(fitted.pixels_from_points(points))
        together = np.abs(fitted.perturbed(step).pixels_from_points(points) - seen).max()
        alone = np.abs(rigid.pixels_from_points(points) - seen).max()
        assert together < 0.25 * alone

    def test_what_the_data_do_not_fix_keeps_its_prior(self) -> None:
        """Points near the axis know nothing of the distortion."""
        rng = np.random.default_rng(23)
        truth = some_camera(rng, lens=())
        row, col = rng.uniform(13.0, 18.0, (2, 60))
        points = truth.center_mm + rng.uniform(300, 900, (60, 1)) * truth.rays_from_pixels(row, col)
        noisy = np.stack([row, col], -1) + rng.normal(0.0, 0.01, (60, 2))
        fit = fit_camera(points, noisy, (32, 32))
        assert fit.lens_std["k2"] == pytest.approx(0.3, rel=0.01)
        assert abs(fit.lens["k2"]) < 0.01

    def test_jacobian_and_pose_convention(self) -> None:
        """Analytic derivatives against differences, and the step's pose against `perturbed`."""
        rng = np.random.default_rng(24)
        camera = some_camera(rng, fy=58.0)
        points, pixels = some_points(rng, camera, 12)
        views = [View(points, pixels + 0.3)]
        lens = np.array([np.log(61.0), np.log(58.0 / 61.0), 15.0, 16.0, *LENS])
        model = LensModel(
            (32, 32), lens, (np.array(camera.world_from_camera),), np.zeros(9), np.ones(9)
        )
        jacobian = system(model, views, 0.5)[1]
        for index in range(15):
            step = np.zeros(15)
            step[index] = 1e-6
            ahead = system(model.moved(step, views), views, 0.5)[0]
            behind = system(model.moved(-step, views), views, 0.5)[0]
            scale = np.abs(jacobian[:, index]).max()
            np.testing.assert_allclose(
                (ahead - behind) / 2e-6, jacobian[:, index], atol=1e-6 * scale
            )
        step = 1e-6 * rng.normal(size=15)
        step[6:] = 0.0
        moved = model.moved(step, views).camera(0)
        delta = pose_error_from_step(model.poses[0], views[0]) @ step[:6]
        np.testing.assert_allclose(
            moved.world_from_camera, model.camera(0).perturbed(delta).world_from_camera, atol=1e-8
        )


class TestRefusals:
    def test_a_plane_that_faces_the_camera(self) -> None:
        truth = Camera.facing_plane()
        rng = np.random.default_rng(1)
        points = np.column_stack([rng.uniform(-100, 100, (50, 2)), np.zeros(50)])
        pixels = np.stack(truth.pixels_from_points(points), axis=-1)
        with pytest.raises(GeometryError, match="focal length and distance"):
            calibrate_camera(points, pixels + rng.normal(0, 0.05, pixels.shape), (32, 32))

    @pytest.mark.parametrize(("n", "planar", "needed"), [(3, True, 4), (5, False, 6)])
    def test_too_few(self, n: int, planar: bool, needed: int) -> None:
        rng = np.random.default_rng(2)
        points, pixels = some_points(rng, some_camera(rng), n, planar=planar)
        with pytest.raises(GeometryError, match=f"at least {needed}"):
            calibrate_camera(points, pixels, (32, 32))

    def test_points_on_a_line(self) -> None:
        points = np.linspace(0, 1, 20)[:, None] * [10.0, 20.0, 5.0]
        with pytest.raises(GeometryError, match="points_mm lie on a line"):
            calibrate_camera(points, np.random.default_rng(0).uniform(0, 31, (20, 2)), (32, 32))

    def test_all_in_one_pixel(self) -> None:
        points = np.random.default_rng(0).uniform(0, 100, (20, 3))
        with pytest.raises(GeometryError, match="pixels lie on a line"):
            calibrate_camera(points, np.full((20, 2), 4.0), (32, 32))

    def test_row_and_col_exchanged(self) -> None:
        rng = np.random.default_rng(3)
        points, pixels = some_points(rng, some_camera(rng), 60)
        with pytest.raises(GeometryError, match="row and col exchanged they fit"):
            calibrate_camera(points, pixels[:, ::-1], (32, 32))

    def test_shuffled_points(self) -> None:
        rng = np.random.default_rng(4)
        points, pixels = some_points(rng, some_camera(rng), 60)
        with pytest.raises(GeometryError, match=r"no camera explains|do not fix"):
            calibrate_camera(rng.permutation(points), pixels, (32, 32))

    def test_outlier_is_named(self) -> None:
        rng = np.random.default_rng(5)
        points, pixels = some_points(rng, some_camera(rng), 100)
        pixels += rng.normal(0.0, 0.05, pixels.shape)
        pixels[17] += 3.0
        with pytest.warns(SuspectDataWarning, match="first at index 17"):
            calibrate_camera(points, pixels, (32, 32))

    def test_wrong_shapes(self) -> None:
        with pytest.raises(ValueError, match=r"pixels must have shape \(7, 2\)"):
            calibrate_camera(np.zeros((7, 3)), np.zeros((6, 2)), (32, 32))

    def test_hardly_enough_points_say_so(self) -> None:
        rng = np.random.default_rng(6)
        points, pixels = some_points(rng, some_camera(rng, lens=()), 4, planar=True)
        with pytest.warns(SuspectDataWarning, match="too few points to read the pixel error"):
            fitted = calibrate_camera(points, pixels, (32, 32), focal_length_px=61.0)
        assert fitted.pose_covariance is not None
        assert np.sqrt(np.diag(fitted.pose_covariance))[3:].max() > 1.0


@pytest.fixture(scope="module")
def wall(data_dir: Path) -> tuple[np.ndarray, np.ndarray]:
    path = data_dir / "pf32-pixel-pointing" / "C0017_pixels_cali_result.mat"
    if not path.exists():
        pytest.skip(f"{path.name} is not among the real recordings")
    x, y = 1000.0 * loadmat(path)["coords"].reshape(2, -1)
    row, col = np.indices((32, 32)).reshape(2, -1)
    return np.stack([x, y, np.zeros(1024)], axis=-1), np.stack([row, col], axis=-1)


@pytest.fixture(scope="module")
def fit(wall: tuple[np.ndarray, np.ndarray]) -> CameraFit:
    return fit_camera(*wall, (32, 32))


class TestRealCamera:
    """A PF32 whose 1,024 pixels were pointed at a wall with a galvanometer (others' data)."""

    def test_every_pixel_is_explained(self, fit: CameraFit) -> None:
        """The map is a homography by construction: nothing but rounding may remain."""
        assert np.abs(fit.residuals_px).max() < 1e-4

    def test_lens_is_the_makers(self, fit: CameraFit) -> None:
        """Square 50 um pixels behind a 20 mm lens: 400 px, known to 1 % from one plane."""
        assert fit.camera.matrix[0, 0] == pytest.approx(400.0, rel=1e-3)
        assert fit.lens["log_pixel_aspect"] == 0.0
        assert 0.002 < fit.lens_std["log_focal_length"] < 0.03

    def test_camera_stands_before_the_wall(self, fit: CameraFit) -> None:
        camera = fit.camera
        assert camera.center_mm[2] > 500.0
        assert camera.pose_covariance is not None
        std = np.sqrt(np.diag(camera.pose_covariance))
        # One tilted plane and an unknown principal point: the pupil is known to a centimetre.
        assert 1.0 < std[3:].max() < 30.0

    def test_orientation(self, fit: CameraFit, wall: tuple[np.ndarray, np.ndarray]) -> None:
        """x grows along a row of pixels, y falls from row to row."""
        along = fit.camera.pixel_jacobian(wall[0][500])
        assert along[1, 0] > 0.0
        assert along[0, 1] < 0.0


@pytest.fixture(scope="module")
def boards() -> tuple[list[np.ndarray], list[Camera]]:
    """Four pictures of a 7 x 5-corner board, ray-traced with a distorted lens."""
    rng = np.random.default_rng(9)
    shape, focal = (240, 320), 300.0
    matrix = np.array([[focal, 0, 162.0], [0, focal, 117.0], [0, 0, 1.0]])
    cameras, pictures = [], []
    for tilt in (
        (0.5, 0.1, 0),
        (-0.4, 0.3, 0.1),
        (0.1, -0.5, 0.05),
        (0.3, 0.4, -0.1),
    ):
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_vector(tilt) @ np.diag([1.0, -1.0, -1.0])
        pose[:3, 3] = np.array([60.0, -40.0, 0]) - 260.0 * pose[:3, 2]
        camera = Camera(matrix, np.array([-0.1, 0.02, 0, 0]), pose, shape)
        pictures.append(board_picture(camera) + rng.normal(0.0, 2.0, shape))
        cameras.append(camera)
    return pictures, cameras


def board_picture(camera: Camera, square: float = 20.0, over: int = 2) -> np.ndarray:
    rows, cols = camera.shape
    row = (np.arange(rows * over) + 0.5) / over - 0.5
    col = (np.arange(cols * over) + 0.5) / over - 0.5
    rays = camera.rays_from_pixels(row[:, None], col[None, :])
    reach = -camera.center_mm[2] / rays[..., 2]
    spot = camera.center_mm + reach[..., None] * rays
    i, j = np.floor(spot[..., 0] / square), np.floor(-spot[..., 1] / square)
    on_board = (i >= -1) & (i < 7) & (j >= -1) & (j < 5)
    grey = np.where(on_board & ((i + j) % 2 == 0), 20.0, 220.0)
    return grey.reshape(rows, over, cols, over).mean(axis=(1, 3))


class TestBoards:
    def test_lens_and_pose(self, boards: tuple[list[np.ndarray], list[Camera]]) -> None:
        pytest.importorskip("cv2")
        pictures, cameras = boards
        fit = calibrate_camera_from_boards(pictures, corners=(7, 5), square_mm=20.0)
        assert fit.pixel_std_px < 0.25
        assert fit.camera.matrix[0, 0] == pytest.approx(300.0, rel=0.01)
        assert fit.lens["k1"] == pytest.approx(-0.1, abs=4.0 * fit.lens_std["k1"])
        assert fit.lens_std["k1"] < 0.06
        error = pose_error(fit.camera, cameras[0])
        assert fit.camera.pose_covariance is not None
        # 6 dof: chance exceeds 60 once in 2e10, corner finding is not exactly Gaussian.
        assert error @ np.linalg.solve(fit.camera.pose_covariance, error) < 60.0

    def test_picture_without_board(self) -> None:
        pytest.importorskip("cv2")
        with pytest.raises(GeometryError, match=r"no chessboard with 7 x 5 .* in image 0"):
            calibrate_camera_from_boards([np.zeros((64, 64))], corners=(7, 5), square_mm=20.0)
