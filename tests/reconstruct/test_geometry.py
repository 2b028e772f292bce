"""Footprints, and every derivative of the fit, against central differences; signs in words."""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.camera.model import Camera
from lightflight.flight import Medium
from lightflight.reconstruct.model.geometry import (
    PathState,
    arrival_jacobian,
    footprints,
    nearest_fractions,
    travelled_jacobian,
    vertex_time_jacobian,
)
from lightflight.reconstruct.model.image_plane import mean_focal_px, undistorted_px
from lightflight.reconstruct.model.offsets import line_offsets
from tests.reconstruct.fakes import C, camera_like, path_in_view

MEDIA = [Medium(), Medium(1.47, 1.00027), Medium(1.0, 1.33)]
LENSES = [(), (-0.21, 0.06, 0.002, -0.003, 0.01), (0.3, -0.1, 0.001, 0.002, 0.02, 0.5, -0.05, 0.01)]
CASES = [(seed, lens, medium) for seed, lens in enumerate(LENSES) for medium in MEDIA]


def on_leg_pixels(state: PathState, camera: Camera, n: int, seed: int):
    """Fractional pixels whose centre lies on a leg: there the derivative is exact."""
    rng = np.random.default_rng(seed)
    legs = rng.integers(0, state.n_legs, n)
    fraction = rng.uniform(0.05, 0.95, n)[:, np.newaxis]
    points = (1 - fraction) * state.vertices_mm[legs] + fraction * state.vertices_mm[legs + 1]
    row, col = camera.pixels_from_points(points)
    return legs, np.asarray(row), np.asarray(col), points, fraction[:, 0]


def central(function, size: int, step: float):
    """(n, size) central differences of a function of a step of the state."""
    columns = []
    for k in range(size):
        nudge = np.zeros(size)
        nudge[k] = step
        columns.append((function(nudge) - function(-nudge)) / (2 * step))
    return np.column_stack(columns)


class TestFootprints:
    @pytest.mark.parametrize(("seed", "lens", "medium"), CASES)
    def test_pixel_on_the_leg_has_its_foot_there(self, seed, lens, medium):
        camera = camera_like(seed, lens=lens)
        state = path_in_view(camera, 3, seed)
        legs, row, col, points, fraction = on_leg_pixels(state, camera, 40, seed)
        found = footprints(state, camera=camera, medium=medium, legs=legs, rows=row, cols=col)
        np.testing.assert_allclose(found.fraction, fraction, atol=1e-10)
        np.testing.assert_allclose(found.lateral_px, 0.0, atol=1e-9)
        distance = np.linalg.norm(points - camera.center_mm, axis=1)
        np.testing.assert_allclose(found.distance_mm, distance, rtol=1e-12)
        lengths = np.linalg.norm(np.diff(state.vertices_mm, axis=0), axis=1)
        before = np.concatenate(([0.0], np.cumsum(lengths)))[legs] + fraction * lengths[legs]
        expected = state.start_time_ps + medium.path_group_index * before / C
        expected = expected + medium.return_group_index * distance / C
        np.testing.assert_allclose(found.arrival_ps, expected, atol=1e-7)

    def test_foot_is_nearest_in_pixels_even_under_a_lens(self):
        """No point of a finely stepped leg is nearer to the pixel than its foot."""
        camera = camera_like(4)
        state = path_in_view(camera, 2, 4)
        rng = np.random.default_rng(0)
        legs, row, col, _, _ = on_leg_pixels(state, camera, 30, 1)
        row, col = row + rng.normal(0, 1.0, 30), col + rng.normal(0, 1.0, 30)
        start, end = state.vertices_mm[legs], state.vertices_mm[legs + 1]
        found = nearest_fractions(state, camera, legs, row, col)
        grid = np.linspace(-0.2, 1.2, 14001)
        for k in range(30):
            points = start[k] + grid[:, np.newaxis] * (end[k] - start[k])
            seen_row, seen_col = camera.pixels_from_points(points)
            best = grid[np.nanargmin(np.hypot(seen_row - row[k], seen_col - col[k]))]
            assert found[k] == pytest.approx(best, abs=1.01e-4)

    def test_slope_and_scale_are_those_of_finite_steps(self):
        camera, medium = camera_like(5), Medium(1.2, 1.1)
        state = path_in_view(camera, 2, 5)
        legs, row, col, _, fraction = on_leg_pixels(state, camera, 25, 2)
        found = footprints(state, camera=camera, medium=medium, legs=legs, rows=row, cols=col)
        times = state.vertex_times_ps(medium)
        h = 1e-5

        def at(f):
            points = state.vertices_mm[legs] + f[:, np.newaxis] * (
                state.vertices_mm[legs + 1] - state.vertices_mm[legs]
            )
            pixel = np.column_stack(camera.pixels_from_points(points))
            back = medium.return_group_index * np.linalg.norm(points - camera.center_mm, axis=1) / C
            return pixel, times[legs] + f * np.diff(times)[legs] + back

        (after, late), (before, early) = at(fraction + h), at(fraction - h)
        travelled = np.linalg.norm(after - before, axis=1)
        np.testing.assert_allclose(found.px_per_leg, travelled / (2 * h), rtol=1e-6)
        np.testing.assert_allclose(found.slope_ps_per_px, (late - early) / travelled, rtol=1e-6)


class TestLateralSign:
    """Positive to the right of the flight as the picture is shown, rows downwards."""

    camera = Camera.facing_plane((32, 32))

    @pytest.mark.parametrize(
        ("flight", "pixel", "sign"),
        [
            (((-50, 0, 0), (50, 0, 0)), (17.5, 15.5), 1),  # flies right: below is right of it
            (((-50, 0, 0), (50, 0, 0)), (13.5, 15.5), -1),
            (((50, 0, 0), (-50, 0, 0)), (13.5, 15.5), 1),  # flies left: above is right of it
            (((0, -50, 0), (0, 50, 0)), (15.5, 17.5), 1),  # flies up: larger col is right of it
            (((0, 50, 0), (0, -50, 0)), (15.5, 13.5), 1),  # flies down: smaller col
        ],
    )
    def test_of_footprints_and_of_lines(self, flight, pixel, sign):
        state = PathState(np.array(flight, dtype=float), 0.0)
        leg = np.zeros(1, dtype=int)
        row, col = np.array([pixel[0]]), np.array([pixel[1]])
        found = footprints(state, camera=self.camera, medium=Medium(), legs=leg, rows=row, cols=col)
        assert np.sign(found.lateral_px[0]) == sign
        assert abs(found.lateral_px[0]) == pytest.approx(2.0, rel=1e-9)
        offset, _ = line_offsets(
            state,
            camera=self.camera,
            legs=leg,
            anchors=undistorted_px(self.camera, row, col),
        )
        assert np.sign(offset[0]) == sign
        assert abs(offset[0]) == pytest.approx(2.0, rel=1e-9)


class TestDerivatives:
    @pytest.mark.parametrize(("seed", "lens", "medium"), CASES)
    @pytest.mark.parametrize("n_legs", [1, 4])
    def test_arrival_times(self, seed, lens, medium, n_legs):
        camera = camera_like(seed, lens=lens)
        state = path_in_view(camera, n_legs, seed)
        legs, row, col, _, _ = on_leg_pixels(state, camera, 30, seed)

        def arrival(step):
            return footprints(
                state.moved(step), camera=camera, medium=medium, legs=legs, rows=row, cols=col
            ).arrival_ps

        expected = central(arrival, 3 * (n_legs + 1) + 1, 1e-3)
        _, found = arrival_jacobian(
            state, camera=camera, medium=medium, legs=legs, rows=row, cols=col
        )
        np.testing.assert_allclose(found, expected, atol=2e-5 * np.abs(expected).max())

    def test_arrival_times_off_the_leg_are_right_to_first_order(self):
        """Half a pixel beside the leg the derivative is off by the turn of the picture only."""
        camera = camera_like(8)
        state = path_in_view(camera, 2, 8)
        legs, row, col, _, _ = on_leg_pixels(state, camera, 40, 3)
        row, col = np.rint(row), np.rint(col)

        def arrival(step):
            return footprints(
                state.moved(step), camera=camera, medium=Medium(), legs=legs, rows=row, cols=col
            ).arrival_ps

        expected = central(arrival, 10, 1e-3)
        _, found = arrival_jacobian(
            state, camera=camera, medium=Medium(), legs=legs, rows=row, cols=col
        )
        assert np.abs(found - expected).max() < 0.15 * np.abs(expected).max()

    @pytest.mark.parametrize("seed", range(4))
    def test_line_offsets(self, seed):
        camera = camera_like(seed)
        state = path_in_view(camera, 3, seed)
        rng = np.random.default_rng(seed)
        legs, row, col, _, _ = on_leg_pixels(state, camera, 20, seed)
        anchors = undistorted_px(camera, row, col) + rng.normal(0, 1.0, (20, 2))
        focal = mean_focal_px(camera)

        def offset(step):
            return line_offsets(state.moved(step), camera=camera, legs=legs, anchors=anchors)[0]

        found, jacobian = line_offsets(state, camera=camera, legs=legs, anchors=anchors)
        expected = central(offset, 13, 1e-3)
        np.testing.assert_allclose(jacobian, expected, atol=1e-6 * np.abs(expected).max())
        np.testing.assert_array_equal(jacobian[:, -1], 0.0)
        # The image of a straight leg is straight: offset from the line through its two ends.
        image = focal * _normalized(camera, state.vertices_mm)
        step = image[legs + 1] - image[legs]
        away = anchors - image[legs]
        by_hand = (step[:, 0] * away[:, 1] - step[:, 1] * away[:, 0]) / np.linalg.norm(step, axis=1)
        np.testing.assert_allclose(found, by_hand, atol=1e-9)

    def test_travelled_length_and_vertex_times(self):
        camera, medium = camera_like(3), Medium(1.3, 1.0)
        state = path_in_view(camera, 5, 3)

        def length(step):
            vertices = state.moved(step).vertices_mm
            return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(vertices, axis=0), axis=1)))

        expected = central(length, 19, 1e-3)[:, :-1]
        np.testing.assert_allclose(travelled_jacobian(state)[:, :-1], expected, atol=1e-9)

        def table(step):
            at = state.moved(step)
            return np.column_stack((at.vertices_mm, at.vertex_times_ps(medium))).ravel()

        np.testing.assert_allclose(
            vertex_time_jacobian(state, medium), central(table, 19, 1e-3), atol=1e-8
        )


def _normalized(camera: Camera, points: np.ndarray) -> np.ndarray:
    """(x, y) on the plane at unit depth, by hand."""
    inside = (points - camera.center_mm) @ camera.world_from_camera[:3, :3]
    return np.asarray(inside[:, :2] / inside[:, 2:])


def test_a_moved_state_is_another_state():
    state = PathState(np.array([[0.0, 0, 0], [1, 2, 3]]), 5.0)
    moved = state.moved(np.arange(7.0))
    np.testing.assert_array_equal(moved.vertices_mm, [[0, 1, 2], [4, 6, 8]])
    assert moved.start_time_ps == 11.0
    np.testing.assert_array_equal(state.vertices_mm[0], 0.0)
