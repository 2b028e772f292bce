"""Legs in the picture, found without being told how many, through all that gets in the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lightflight import flags
from lightflight.camera.model import Camera
from lightflight.errors import NothingFoundError
from lightflight.reconstruct.legs.find import ImageLeg, find_legs, unwrapped_arrivals
from lightflight.reconstruct.model.image_plane import mean_focal_px, undistorted_px
from tests.path_fakes import PAPER_VERTICES
from tests.reconstruct.fakes import (
    PAPER,
    PULSE_STD_PS,
    arrivals_from_columns,
    arrivals_of,
    camera_like,
    joined,
)

CAMERA = Camera.facing_plane((32, 32))
ZIGZAG = np.array(
    [(-180, -90, 0), (170, -55, 30), (-170, -10, -20), (180, 20, 10), (-170, 60, 0), (170, 85, 40),
     (-30, 130, 0)],
    dtype=float,
)  # fmt: skip


def image_of(vertices: np.ndarray, camera: Camera) -> np.ndarray:
    """Undistorted (u, v) of the vertices, px."""
    inside = (np.asarray(vertices) - camera.center_mm) @ camera.world_from_camera[:3, :3]
    return np.asarray(mean_focal_px(camera) * inside[:, :2] / inside[:, 2:])


def assert_runs_along(
    leg: ImageLeg, start: np.ndarray, end: np.ndarray, *, px: float = 0.3
) -> None:
    """The leg's line is that of the true leg within its extent, flown the same way."""
    direction = (end - start) / np.linalg.norm(end - start)
    assert leg.direction_px @ direction > 0.99
    for point in leg.points_px(np.array(leg.extent_px)):
        away = point - start
        assert abs(away[0] * direction[1] - away[1] * direction[0]) < px


def assert_finds(legs: tuple[ImageLeg, ...], vertices: np.ndarray, camera: Camera) -> None:
    assert len(legs) == len(vertices) - 1
    image = image_of(vertices, camera)
    for k, leg in enumerate(legs):
        assert_runs_along(leg, image[k], image[k + 1])


class TestHowMany:
    @pytest.mark.parametrize("n_legs", range(1, 7))
    def test_one_to_six_with_corners_outside_the_picture(self, n_legs, rng):
        vertices = ZIGZAG[: n_legs + 1]
        legs = find_legs(arrivals_of(vertices, CAMERA, rng=rng), camera=CAMERA)
        assert_finds(legs, vertices, CAMERA)
        starts = [leg.span_ps[0] for leg in legs]
        assert starts == sorted(starts), "legs come in the order of flight"

    def test_the_papers_three(self, rng):
        legs = find_legs(arrivals_of(PAPER_VERTICES, PAPER, rng=rng), camera=PAPER)
        assert_finds(legs, PAPER_VERTICES, PAPER)

    @pytest.mark.parametrize("seed", range(5))
    def test_through_any_lens_from_anywhere(self, seed):
        """A strong lens bends the legs by pixels; undistorted they are straight."""
        camera = camera_like(seed, lens=(-0.35, 0.1, 0.003, -0.002))
        rng = np.random.default_rng(seed)
        rays = camera.rays_from_pixels(np.array([4.0, 7.0, 27.0]), np.array([3.0, 28.0, 5.0]))
        vertices = camera.center_mm + np.array([[550.0], [600.0], [520.0]]) * rays
        assert_finds(
            find_legs(arrivals_of(vertices, camera, rng=rng), camera=camera), vertices, camera
        )

    def test_crossing_legs_share_a_pixel(self, rng):
        vertices = np.array([(-180, -100, 0), (140, 90, 0), (140, -90, 0), (-180, 100, 0)], float)
        legs = find_legs(arrivals_of(vertices, CAMERA, rng=rng), camera=CAMERA)
        crossing = [leg for leg in legs if leg.n_pixels > 20]
        assert len(crossing) == 2
        image = image_of(vertices, CAMERA)
        assert_runs_along(crossing[0], image[0], image[1])
        assert_runs_along(crossing[1], image[2], image[3])

    def test_nearly_overlapping_legs_are_told_apart_by_time(self, rng):
        """There and back, 5 mm (0.65 px) at most between the lines, some 0.8 ns between times."""
        vertices = np.array([(-180, 0, 0), (250, 0, 0), (-180, 5, 0)], float)
        assert_finds(
            find_legs(arrivals_of(vertices, CAMERA, rng=rng), camera=CAMERA), vertices, CAMERA
        )

    def test_corner_in_the_picture(self, rng):
        vertices = np.array([(-180, -60, 0), (40, -40, 0), (-60, 160, 0)], float)
        legs = find_legs(arrivals_of(vertices, CAMERA, rng=rng), camera=CAMERA)
        assert_finds(legs, vertices, CAMERA)
        members = [set(leg.members) for leg in legs]
        assert not members[0] & members[1]

    def test_seen_by_few_pixels(self, rng):
        """A leg that clips a corner of the picture: four to seven pixels of it are in view."""
        vertices = np.array([(-180, 20, 0), (180, 40, 0), (20, 190, 0)], float)
        legs = find_legs(arrivals_of(vertices, CAMERA, rng=rng), camera=CAMERA)
        assert_finds(legs, vertices, CAMERA)
        assert 4 <= legs[1].n_pixels <= 7

    def test_along_one_row_or_column(self, rng):
        row_y = -3.5 * 245.0 / 32
        for start, end in (
            ((-180, row_y, 0), (180, row_y, 0)),
            ((row_y, -180, 0), (row_y, 180, 0)),
        ):
            vertices = np.array([start, end], float)
            legs = find_legs(arrivals_of(vertices, CAMERA, rng=rng), camera=CAMERA)
            assert_finds(legs, vertices, CAMERA)
            # Whole pixels lie at halves about the middle of 32: each is a position of its own.
            assert legs[0].n_pixels == 32

    def test_six_pixels_of_one_row_are_enough(self, rng):
        row_y = -3.5 * 245.0 / 32
        arrivals = arrivals_of(np.array([(-180.0, row_y, 0), (180, row_y, 0)]), CAMERA, rng=rng)
        words = np.where(np.abs(arrivals.col - 15.5) < 3, 0, flags.TOO_FEW).astype(np.uint32)
        (leg,) = find_legs(replace(arrivals, flags=words), camera=CAMERA)
        assert leg.n_pixels == 6

    def test_user_says_how_many(self, rng):
        arrivals = arrivals_of(ZIGZAG[:5], CAMERA, rng=rng)
        assert len(find_legs(arrivals, camera=CAMERA, n_legs=2)) == 2
        assert len(find_legs(arrivals, camera=CAMERA, n_legs=7)) == 4


class TestWhatGetsInTheWay:
    def test_faint_wings_found_no_leg_of_their_own(self, rng):
        """A wide spot lights five rows beside a leg."""
        vertices = np.array([(-180, -10, 0), (180, 14, 20)], float)
        arrivals = arrivals_of(vertices, CAMERA, rng=rng, spot_px=0.8, photons=40_000.0)
        assert len(np.unique(arrivals.row)) >= 7
        assert_finds(find_legs(arrivals, camera=CAMERA), vertices, CAMERA)

    def test_a_tenth_of_false_pulses(self, rng):
        true = arrivals_of(PAPER_VERTICES, PAPER, rng=rng)
        n = len(true.row) // 10
        false = arrivals_from_columns(
            rng.integers(0, 32, n),
            rng.integers(0, 32, n),
            rng.uniform(0, 50_000, n),
            np.full(n, 5.0),
            np.full(n, 200.0),
            (32, 32),
        )
        assert_finds(find_legs(joined(true, false), camera=PAPER), PAPER_VERTICES, PAPER)

    def test_flagged_pulses_take_no_part(self, rng):
        arrivals = arrivals_of(PAPER_VERTICES, PAPER, rng=rng)
        bad = np.zeros(len(arrivals.row), dtype=bool)
        bad[::3] = True
        times = np.where(bad, rng.uniform(0, 5000, len(bad)), arrivals.arrival_ps)
        words = np.where(bad, flags.SCREAMING, 0).astype(np.uint32)
        spoiled = replace(arrivals, arrival_ps=times, flags=words)
        legs = find_legs(spoiled, camera=PAPER)
        assert_finds(legs, PAPER_VERTICES, PAPER)
        assert not bad[np.concatenate([leg.members for leg in legs])].any()
        right = find_legs(replace(arrivals, flags=words), camera=PAPER)
        assert not bad[np.concatenate([leg.members for leg in right])].any()

    def test_nan_times_take_no_part(self, rng):
        arrivals = arrivals_of(PAPER_VERTICES, PAPER, rng=rng)
        times = arrivals.arrival_ps.copy()
        times[::4] = np.nan
        legs = find_legs(replace(arrivals, arrival_ps=times), camera=PAPER)
        assert_finds(legs, PAPER_VERTICES, PAPER)

    def test_dark_stretch_does_not_cut_a_leg(self, rng):
        arrivals = arrivals_of(PAPER_VERTICES[:2], PAPER, rng=rng)
        words = np.where((arrivals.col > 12) & (arrivals.col < 18), flags.TOO_FEW, 0)
        legs = find_legs(replace(arrivals, flags=words.astype(np.uint32)), camera=PAPER)
        assert_finds(legs, PAPER_VERTICES[:2], PAPER)
        assert legs[0].n_pixels < 32

    def test_the_same_seed_gives_the_same_legs(self, rng):
        arrivals = arrivals_of(ZIGZAG, CAMERA, rng=rng)
        first, second = (find_legs(arrivals, camera=CAMERA, seed=4) for _ in range(2))
        for a, b in zip(first, second, strict=True):
            np.testing.assert_array_equal(a.members, b.members)

    def test_order_of_the_table_does_not_matter(self, rng):
        arrivals = arrivals_of(PAPER_VERTICES, PAPER, rng=rng)
        order = rng.permutation(len(arrivals.row))
        names = [n for n, v in vars(arrivals).items() if isinstance(v, np.ndarray)]
        shuffled = replace(arrivals, **{n: getattr(arrivals, n)[order] for n in names})
        assert_finds(find_legs(shuffled, camera=PAPER), PAPER_VERTICES, PAPER)


class TestFold:
    PERIOD = 50_000.0

    @pytest.mark.parametrize("start", [-1500.0, -3000.0, 47_000.0, 20_000.0])
    def test_flight_across_the_end_of_the_period(self, start, rng):
        arrivals = arrivals_of(PAPER_VERTICES, PAPER, start=start, rng=rng, period_ps=self.PERIOD)
        legs = find_legs(arrivals, camera=PAPER)
        assert_finds(legs, PAPER_VERTICES, PAPER)
        assert legs[-1].span_ps[1] - legs[0].span_ps[0] < 5000.0

    def test_silence_is_cut_where_nothing_is_known(self):
        times = unwrapped_arrivals([49_800.0, 49_900.0, 100.0, 200.0], period_ps=self.PERIOD)
        np.testing.assert_allclose(np.diff(times), [100, 200, 100])

    def test_nothing_arrives_before_the_earliest(self):
        times = unwrapped_arrivals(
            [49_800.0, 100.0, 200.0, np.nan], period_ps=self.PERIOD, earliest_ps=150.0
        )
        np.testing.assert_allclose(times, [49_800, 50_100, 200, np.nan])

    def test_earliest_beyond_the_period(self):
        times = unwrapped_arrivals([100.0], period_ps=self.PERIOD, earliest_ps=120_000.0)
        np.testing.assert_allclose(times, [150_100.0])

    def test_one_sweep_stays_as_it_is(self):
        given = np.array([5.0, np.nan, -3.0])
        found = unwrapped_arrivals(given, period_ps=None)
        np.testing.assert_array_equal(found, given)
        assert found is not given

    def test_no_times_at_all(self):
        assert len(unwrapped_arrivals([], period_ps=self.PERIOD)) == 0
        assert np.isnan(unwrapped_arrivals([np.nan], period_ps=self.PERIOD)).all()


class TestWithoutScale:
    def test_no_camera_gives_legs_in_raw_pixels(self, rng):
        legs = find_legs(arrivals_of(PAPER_VERTICES, PAPER, rng=rng))
        assert len(legs) == 3
        row, col = PAPER.pixels_from_points(PAPER_VERTICES)
        image = np.column_stack((col, row))
        for k, leg in enumerate(legs):
            assert_runs_along(leg, image[k], image[k + 1])

    def test_undistorted_pixels_without_a_camera_are_the_pixels(self):
        np.testing.assert_array_equal(undistorted_px(None, [1, 2], [3, 4]), [[3, 1], [4, 2]])


class TestCurve:
    def test_times_and_speed_along_a_leg(self, rng):
        """Perpendicular flight: d t_a / ds at the foot is n / c mm per mm, and bends upwards."""
        arrivals = arrivals_of(np.array([(-180.0, 4, 0), (180, 4, 0)]), CAMERA, rng=rng)
        (leg,) = find_legs(arrivals, camera=CAMERA)
        per_px = 245.0 / 32 * 1.00027 / 0.299792458
        middle = image_of(np.array([[0.0, 4, 0]]), CAMERA)[0]
        s = float((middle - leg.origin_px) @ leg.direction_px)
        slope = (leg.arrival_ps(s + 0.5) - leg.arrival_ps(s - 0.5)) / 1.0
        assert slope == pytest.approx(per_px, rel=0.02)
        assert leg.apparent_speed_px_per_ps == pytest.approx(1 / per_px, rel=0.05)
        assert leg.curvature_ps_per_px2 > 0
        assert leg.residual_rms_ps < 3 * PULSE_STD_PS / np.sqrt(15.0)

    def test_points_and_times_take_any_shape(self, rng):
        (leg,) = find_legs(arrivals_of(PAPER_VERTICES[:2], PAPER, rng=rng), camera=PAPER)
        assert leg.points_px(np.zeros((2, 3))).shape == (2, 3, 2)
        assert np.shape(leg.arrival_ps(0.0)) == ()


class TestNothing:
    def test_too_few_usable_pulses(self, rng):
        arrivals = arrivals_of(PAPER_VERTICES, PAPER, rng=rng)
        words = np.full(len(arrivals.row), flags.TOO_FEW, dtype=np.uint32)
        words[:3] = 0
        with pytest.raises(NothingFoundError, match=r"only 3 pixels hold a usable pulse.*needs 4"):
            find_legs(replace(arrivals, flags=words), camera=PAPER)

    def test_noise_is_no_leg(self):
        """30 pulses strewn over 50 ns: four in line by chance within 35 ps have odds of 1e-4."""
        rng = np.random.default_rng(1)
        n = 30
        noise = arrivals_from_columns(
            rng.integers(0, 32, n), rng.integers(0, 32, n), rng.uniform(0, 50_000, n),
            np.full(n, 5.0), np.full(n, 200.0), (32, 32),
        )  # fmt: skip
        with pytest.raises(NothingFoundError, match="30 pixels hold a pulse but no 6 of them"):
            find_legs(noise, camera=CAMERA, min_pixels=6)

    def test_a_flash_everywhere_at_once_is_no_leg(self):
        rows, cols = (x.ravel() for x in np.indices((32, 32)))
        flash = arrivals_from_columns(
            rows, cols, np.full(1024, 3000.0), np.full(1024, 3.0), np.full(1024, 500.0), (32, 32)
        )
        with pytest.raises(NothingFoundError, match="times that run smoothly"):
            find_legs(flash, camera=CAMERA)
