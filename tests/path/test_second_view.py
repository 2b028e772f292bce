"""What another camera would record: times and light by closed forms."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lightflight.camera.model import Camera
from lightflight.errors import GeometryError
from lightflight.flight import Medium, apparent_speed_from_direction
from lightflight.path.second_view import camera_towards, observe
from tests.view import fakes

C = 0.299792458


def side_camera() -> Camera:
    """A camera beyond M1 that looks back along the legs: -x, 600 mm from the middle."""
    pose = np.eye(4)
    # Camera axes in world: x right = -z, y down = -y, z forward = -x.
    pose[:3, :3] = np.array([[0.0, 0, -1], [0, -1, 0], [-1, 0, 0]])
    pose[:3, 3] = (790.0, 37.5, 30.0)
    matrix = np.array([[120.0, 0, 31.5], [0, 120.0, 23.5], [0, 0, 1]])
    return Camera(matrix, np.zeros(0), pose, (48, 64))


def test_own_camera_sees_the_arrival_times_of_the_path() -> None:
    path = fakes.fake_path()
    seen = observe(path, path.camera)
    when = path.position_at(seen.event_time_ps)
    back = np.linalg.norm(when - path.camera.center_mm, axis=1) * 1.00027 / C
    np.testing.assert_allclose(seen.arrival_ps, seen.event_time_ps + back, rtol=1e-12)
    row, col = path.camera.pixels_from_points(when)
    np.testing.assert_allclose(seen.row, row, atol=1e-9)
    np.testing.assert_allclose(seen.col, col, atol=1e-9)
    assert (seen.row >= -0.5).all()
    assert (seen.row <= 31.5).all()


@pytest.mark.parametrize("index", [1.0, 1.47])
def test_light_that_comes_towards_a_camera_seems_faster(index: float) -> None:
    path, camera = fakes.fake_path(), side_camera()
    medium = Medium(path_group_index=index, return_group_index=1.0)
    seen = observe(path, camera, medium=medium)
    for leg in range(3):
        of_leg = seen.leg == leg
        points = path.position_at(seen.event_time_ps[of_leg])
        direction = path.legs[leg].direction
        towards = camera.center_mm - points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        # Length of path per unit of arrival time, by finite differences; the path's own event
        # times are those of its own medium.
        length = np.linalg.norm(points - points[0], axis=1)
        speed = np.gradient(length, seen.arrival_ps[of_leg])
        n_path = float(np.gradient(seen.event_time_ps[of_leg], length).mean()) * C
        expected = apparent_speed_from_direction(
            direction, towards, medium=Medium(path_group_index=n_path, return_group_index=1.0)
        )
        np.testing.assert_allclose(speed[1:-1], expected[1:-1], rtol=1e-4)
        assert (np.median(speed) > C) == (direction[0] > 0)


def test_light_thins_with_the_square_of_the_distance() -> None:
    straight = SimpleNamespace(
        vertices_mm=np.array([[-100.0, 0, 0], [100, 0, 0]]), vertex_times_ps=np.array([0.0, 667.0])
    )
    camera = Camera.facing_plane((32, 32), distance_mm=300.0, field_of_view_mm=(190.0, 190.0))
    seen = observe(straight, camera)
    places = np.interp(seen.event_time_ps, [0, 667], [-100, 100])
    expected = 1.0 / (300.0**2 + places**2)
    np.testing.assert_allclose(seen.strength, expected / expected.max(), rtol=1e-9)


def test_frames_hold_a_gaussian_of_the_pulses_width() -> None:
    path = fakes.fake_path()
    seen = observe(path, path.camera)
    best = np.unravel_index(np.argmax(seen.image()), (32, 32))
    middle = seen.arrival_image()[best]
    times = middle + np.linspace(-300, 300, 601)
    light = seen.frames(times)[:, best[0], best[1]]
    mean = np.average(times, weights=light)
    std = np.sqrt(np.average((times - mean) ** 2, weights=light))
    assert mean == pytest.approx(middle, abs=0.05)
    # Transit through the pixel widens it: 8 mm of path are some 20 ps, 6 ps rms.
    assert 68.0 / 2.3548 < std < np.hypot(68.0 / 2.3548, 12.0)
    assert light.max() == pytest.approx(1.0, rel=0.2)
    wide = seen.frames(times, response_std_ps=70.0)[:, best[0], best[1]]
    spread = np.sqrt(np.average((times - mean) ** 2, weights=wide))
    assert spread == pytest.approx(np.hypot(std, 70.0), rel=0.01)


def test_images_are_empty_where_no_light_comes_from() -> None:
    path = fakes.fake_path()
    seen = observe(path, path.camera)
    assert np.isnan(seen.arrival_image()[0, 0])
    assert seen.image()[0, 0] == 0.0
    assert seen.image().max() == 1.0


def test_a_camera_that_looks_away_is_refused() -> None:
    away = Camera.facing_plane((8, 8), center_mm=(5000.0, 0.0))
    with pytest.raises(GeometryError, match="sees no part of the path"):
        observe(fakes.fake_path(), away)
    with pytest.raises(ValueError, match="steps_per_pixel"):
        observe(fakes.fake_path(), fakes.paper_camera(), steps_per_pixel=0)


def test_a_camera_that_looks_at_the_plane_is_the_facing_one() -> None:
    facing = Camera.facing_plane(center_mm=(10.0, 20.0))
    turned = Camera.looking_at(
        (10.0, 20.0, 0.0), position_mm=(10.0, 20.0, 535.0), focal_length_px=32 * 535 / 245
    )
    np.testing.assert_allclose(turned.matrix, facing.matrix, rtol=1e-12)
    np.testing.assert_allclose(turned.world_from_camera, facing.world_from_camera, atol=1e-12)


@pytest.mark.parametrize("place", [(800.0, 40.0, 30.0), (187.0, 900.0, 25.0), (-300.0, -50.0, 400)])
def test_a_camera_towards_a_path_sees_all_of_it_with_a_margin(place: tuple[float, ...]) -> None:
    path = fakes.fake_path()
    camera = camera_towards(path, place, shape=(40, 60))
    np.testing.assert_array_equal(camera.center_mm, place)
    row, col = camera.pixels_from_points(path.vertices_mm)
    reach = max(np.abs(row - 19.5).max() / 40, np.abs(col - 29.5).max() / 60)
    assert reach == pytest.approx(0.4)
    # Upright: what is higher in the world is higher in the picture, or (from above) further away.
    middle = path.vertices_mm.mean(axis=0)
    higher = middle + ((0, 0, -5.0) if place[1] > 800 else (0, 5.0, 0))
    low, high = camera.pixels_from_points(np.stack((middle, higher)))[0]
    assert high < low


@pytest.mark.parametrize("place", [(187.0, 37.0, 25.0), (100.0, 40.0, 20.0)])
def test_a_viewpoint_in_the_midst_of_a_path_is_refused(place: tuple[float, ...]) -> None:
    with pytest.raises(GeometryError, match="further away"):
        camera_towards(fakes.fake_path(), place)


def test_a_camera_cannot_look_at_itself() -> None:
    for position, focal in (((0, 0, 0), 30.0), ((0, 0, 9), 0.0), ((0, np.nan, 9), 30.0)):
        with pytest.raises(GeometryError, match=r"different points|focal_length_px"):
            Camera.looking_at((0, 0, 0), position_mm=position, focal_length_px=focal)
