"""Flight: what `Source` and `Medium` take and refuse, and the edges of the closed forms.

The physics itself is held against marched light in `physics/test_flight_against_brute_force.py`.
"""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.flight import (
    Medium,
    Source,
    apparent_speed_from_direction,
    arrival_time_from_event,
    distance_from_arrival,
    elevation_from_direction,
    event_times_from_vertices,
    point_from_arrival,
)

C = 0.299792458


class TestMedium:
    def test_air_both_ways_by_default(self):
        assert (Medium().path_group_index, Medium().return_group_index) == (1.00027, 1.00027)

    @pytest.mark.parametrize("name", ["path_group_index", "return_group_index"])
    @pytest.mark.parametrize("value", [0.99, 0.0, -1.0, 11.0, np.nan, np.inf])
    def test_no_light_is_faster_than_light(self, name, value):
        with pytest.raises(ValueError, match=f"{name} must lie between 1 and 10, got {value}"):
            Medium(**{name: value})


class TestSource:
    def test_nothing_is_known_by_default(self):
        source = Source()
        assert source.position_mm is None
        assert source.emission_time_ps is None
        assert source.pulse_fwhm_ps is None

    def test_position_is_kept_as_plain_numbers_apart_from_the_callers(self):
        mine = np.array([1.0, 2.0, 3.0])
        source = Source(mine)
        mine[0] = 99.0
        assert source.position_mm == (1.0, 2.0, 3.0)
        assert source == Source([1, 2, 3])

    def test_one_error_serves_all_axes(self):
        np.testing.assert_array_equal(Source(position_std_mm=2).position_std_xyz_mm, [2, 2, 2])
        np.testing.assert_array_equal(
            Source(position_std_mm=(1, 0, 3)).position_std_xyz_mm, [1, 0, 3]
        )

    @pytest.mark.parametrize("position", [(1, 2), (1, 2, np.nan), [[1, 2, 3]], 5.0, (1, 2, np.inf)])
    def test_position_must_be_three_finite_numbers(self, position):
        with pytest.raises(ValueError, match="position_mm must be three finite numbers"):
            Source(position)

    @pytest.mark.parametrize("std", [-1.0, np.nan, (1, 2), (1, 1, -1)])
    def test_position_error_must_be_one_or_three(self, std):
        with pytest.raises(ValueError, match="position_std_mm must be one number or three"):
            Source(position_std_mm=std)

    @pytest.mark.parametrize(
        ("name", "value"),
        [
            ("emission_time_ps", np.nan),
            ("emission_time_ps", np.inf),
            ("emission_time_std_ps", -1.0),
            ("emission_time_std_ps", np.nan),
            ("pulse_fwhm_ps", 0.0),
            ("pulse_fwhm_ps", np.nan),
        ],
    )
    def test_times_must_make_sense(self, name, value):
        with pytest.raises(ValueError, match=f"{name} must be .*, got {value}"):
            Source(**{name: value})


class TestEdges:
    def test_one_vertex_has_its_emission_time(self):
        times = event_times_from_vertices([[1.0, 2.0, 3.0]], emission_time_ps=7.0)
        np.testing.assert_array_equal(times, [7.0])

    @pytest.mark.parametrize("medium", [Medium(), Medium(1.33, 1.0), Medium(1.0, 1.33)])
    def test_point_next_to_the_source(self, medium):
        """A micrometre off: the equation's two roots nearly meet there."""
        source, center = np.array([3.0, -4.0, 5.0]), np.array([100.0, 50.0, 500.0])
        point = source + np.array([0.0006, 0.0008, 0.0])
        flown = medium.path_group_index * 0.001 / C
        arrival = arrival_time_from_event(
            point,
            10.0 + flown,
            camera_center_mm=center,
            return_group_index=medium.return_group_index,
        )
        found = point_from_arrival(
            (point - center) / np.linalg.norm(point - center),
            arrival,
            source_mm=source,
            emission_time_ps=10.0,
            camera_center_mm=center,
            medium=medium,
        )
        np.testing.assert_allclose(found, point, atol=1e-5)

    def test_many_rays_and_times_broadcast(self, rng):
        rays = rng.normal(size=(4, 5, 3))
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        arrival = np.linspace(3000.0, 4000.0, 5)
        common = {
            "source_mm": np.zeros(3),
            "emission_time_ps": 0.0,
            "camera_center_mm": np.array([0.0, 0.0, 400.0]),
        }
        together = distance_from_arrival(rays, arrival, **common)
        assert together.shape == (4, 5)
        alone = [
            [distance_from_arrival(r, t, **common) for r, t in zip(row, arrival, strict=True)]
            for row in rays
        ]
        np.testing.assert_allclose(together, alone, rtol=1e-12)

    def test_nan_times_stay_nan_and_alone(self):
        distance = distance_from_arrival(
            [[0, 0, -1.0], [0, 0, -1.0]],
            [np.nan, 4000.0],
            source_mm=np.zeros(3),
            emission_time_ps=0.0,
            camera_center_mm=np.array([0.0, 100.0, 400.0]),
        )
        assert np.isnan(distance[0])
        assert np.isfinite(distance[1])

    def test_head_on_the_pulse_seems_to_arrive_at_once(self):
        towards = np.array([0.0, 0.0, 1.0])
        with np.errstate(divide="ignore"):
            assert np.isinf(
                apparent_speed_from_direction(towards, towards, medium=Medium(1.0, 1.0))
            )
        away = apparent_speed_from_direction(-towards, towards, medium=Medium(1.0, 1.0))
        assert away == pytest.approx(C / 2, rel=1e-15)

    def test_elevation_keeps_its_digits_near_the_pole(self):
        tilt = 1e-9
        direction = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
        elevation = elevation_from_direction(direction, [0.0, 0.0, 1.0])
        assert np.pi / 2 - elevation == pytest.approx(tilt, rel=1e-6)

    def test_elevation_is_positive_towards_the_camera(self):
        n = [0.0, 0.0, 1.0]
        np.testing.assert_allclose(
            np.rad2deg(elevation_from_direction([[1, 0, 1], [1, 0, -1], [-1, 1, 0]], n)),
            [45.0, -45.0, 0.0],
            atol=1e-12,
        )
