"""Flight against marched light, 40-digit arithmetic, invariances, and the figures of the method.

The oracle (`tests/oracles/brute_force.py`) shares no line with the package.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from lightflight.camera.model import Camera
from lightflight.camera.rigid import rotation_from_vector
from lightflight.flight import (
    Medium,
    apparent_speed_from_direction,
    arrival_time_from_event,
    arrival_time_from_propagation_time,
    arrival_time_from_viewing_angle,
    distance_from_arrival,
    elevation_from_direction,
    event_time_from_arrival,
    event_times_from_vertices,
    point_from_arrival,
    propagation_time_from_projection,
)
from tests.oracles.brute_force import C, camera_over_plane, march_back, march_out

EXACT_PS = 1e-9

PAPER_VERTICES = np.array([[0, 0, 0], [375, 25, 50], [0, 50, 10], [375, 75, 50]], dtype=float)
PAPER_CAMERA = np.array([187.5, 37.5, 535.0])
MEDIA = [Medium(), Medium(1.47, 1.00027), Medium(1.0, 1.33)]


def some_path(rng: np.random.Generator, n_legs: int) -> np.ndarray:
    return np.cumsum(rng.normal(0.0, 150.0, (n_legs + 1, 3)), axis=0)


class TestMarchedLight:
    @pytest.mark.parametrize("n_legs", range(1, 9))
    @pytest.mark.parametrize("medium", MEDIA)
    def test_event_and_arrival_times(self, n_legs: int, medium: Medium) -> None:
        rng = np.random.default_rng(n_legs)
        vertices, center = some_path(rng, n_legs), rng.normal(0.0, 600.0, 3)
        steps = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
        corners = [0.0, *np.cumsum(steps)]
        walked = march_out(vertices, corners, medium.path_group_index)
        times = event_times_from_vertices(
            vertices, emission_time_ps=123.0, path_group_index=medium.path_group_index
        )
        np.testing.assert_allclose(times, [123.0 + t for _, t in walked], atol=EXACT_PS, rtol=0)
        arrival = arrival_time_from_event(
            vertices,
            times,
            camera_center_mm=center,
            return_group_index=medium.return_group_index,
        )
        marched = [123.0 + t + march_back(x, center, medium.return_group_index) for x, t in walked]
        np.testing.assert_allclose(arrival, marched, atol=EXACT_PS, rtol=0)
        back = event_time_from_arrival(
            vertices,
            arrival,
            camera_center_mm=center,
            return_group_index=medium.return_group_index,
        )
        np.testing.assert_allclose(back, times, atol=EXACT_PS, rtol=0)

    @pytest.mark.parametrize("medium", MEDIA)
    def test_closed_form_finds_the_marched_point(self, medium: Medium) -> None:
        """Light marched to a point and back; the pixel's ray and the time give the point again."""
        rng = np.random.default_rng(11)
        for _ in range(100):
            source, center = rng.normal(0, 300, 3), rng.normal(0, 300, 3) + np.array([0, 0, 700])
            end = source + rng.normal(0, 300, 3)
            length = rng.uniform(5.0, np.linalg.norm(end - source))
            point, flown = march_out(np.array([source, end]), [length], medium.path_group_index)[0]
            arrival = 77.0 + flown + march_back(point, center, medium.return_group_index)
            sight = point - center
            ray = sight / np.linalg.norm(sight)
            found = point_from_arrival(
                ray,
                arrival,
                source_mm=source,
                emission_time_ps=77.0,
                camera_center_mm=center,
                medium=medium,
            )
            # With a slower way out than back a second point may give the same time.
            if np.linalg.norm(found - point) > 1e-3:
                assert medium.path_group_index != medium.return_group_index
            again = march_back(source, found, medium.path_group_index) + march_back(
                found, center, medium.return_group_index
            )
            assert 77.0 + again == pytest.approx(arrival, abs=EXACT_PS)

    def test_one_index_has_one_point(self) -> None:
        rng = np.random.default_rng(12)
        source, center = np.zeros(3), np.array([100.0, 20.0, 535.0])
        points = rng.uniform([-50, -50, -50], [300, 100, 100], (200, 3))
        sight = points - center
        rays = sight / np.linalg.norm(sight, axis=1, keepdims=True)
        times = event_times_from_vertices  # straight from the source: path length is the distance
        flown = [times(np.array([source, p]), emission_time_ps=0.0)[1] for p in points]
        arrival = arrival_time_from_event(points, flown, camera_center_mm=center)
        found = point_from_arrival(
            rays, arrival, source_mm=source, emission_time_ps=0.0, camera_center_mm=center
        )
        np.testing.assert_allclose(found, points, atol=1e-8)

    def test_every_point_that_is_found_explains_its_time(self) -> None:
        """Also in a fibre, where squaring the equation brings points behind the light."""
        rng = np.random.default_rng(13)
        rays = rng.normal(size=(2000, 3))
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        center = np.array([100.0, 20.0, 535.0])
        arrival = rng.uniform(0.0, 6000.0, len(rays))
        fibre = Medium(1.47, 1.0)
        away = distance_from_arrival(
            rays, arrival, source_mm=np.zeros(3), emission_time_ps=0.0, camera_center_mm=center,
            medium=fibre,
        )  # fmt: skip
        flown = 1.47 * np.linalg.norm(center + away[:, np.newaxis] * rays, axis=1) + away
        there = np.isfinite(away)
        assert 200 < there.sum() < 1800
        np.testing.assert_allclose(flown[there] / C, arrival[there], atol=1e-6)

    def test_light_that_came_too_soon_has_no_point(self) -> None:
        center = np.array([0.0, 0.0, 500.0])
        early = 0.5 * 500.0 / C
        distance = distance_from_arrival(
            [0.0, 0.0, -1.0],
            early,
            source_mm=np.zeros(3),
            emission_time_ps=0.0,
            camera_center_mm=center,
        )
        assert np.isnan(distance)


class TestPaperEquations:
    """Eq. 1 and 2 against vectors, in 40 digits: no rounding to hide behind."""

    @staticmethod
    def by_vectors(rng: np.random.Generator) -> dict[str, Any] | None:
        """One leg, camera and reference plane: scalars of the paper, and exact times."""
        mp = mpmath.mpf
        start, center = rng.normal(0, 200, 3), rng.normal(0, 100, 3) + np.array([0, 0, 500])
        direction = rng.normal(0, 1, 3) * [1, 1, 0.6]
        normal = rng.normal(0, 0.15, 3) + np.array([0, 0, 1])
        length = rng.uniform(1, 300)
        b, a, d, n = (mpmath.matrix([mp(v) for v in x]) for x in (start, center, direction, normal))
        d, n = d / mpmath.norm(d), n / mpmath.norm(n)

        def dot(u, v):
            return sum(u[i] * v[i] for i in range(3))

        point = b + mp(length) * d
        sight = point - a
        # The viewing ray meets the reference plane (through the start, normal n) at E.
        towards = dot(sight, n)
        if abs(towards) < 1e-3:
            return None
        reach = dot(b - a, n) / towards
        if reach <= 0:
            return None
        on_plane = a + reach * sight - b
        e = on_plane / mpmath.norm(on_plane)
        s = mpmath.norm(a - b)
        sine = dot(a - b, e) / s
        cosine = mpmath.sqrt(1 - sine**2)
        up = ((a - b) - s * sine * e) / (s * cosine)
        c = mp("0.299792458")
        time = mp(length) / c
        return {
            "l": mpmath.norm(on_plane),
            "s": s,
            "theta": mpmath.asin(sine),
            "alpha": mpmath.atan2(dot(d, up), dot(d, e)),
            "t": time,
            "t_a": time + mpmath.norm(sight) / c,
        }

    def test_eq_1_and_eq_2(self) -> None:
        rng = np.random.default_rng(2020)
        checked = 0
        with mpmath.workdps(40):
            for _ in range(200):
                case = self.by_vectors(rng)
                if case is None:
                    continue
                common = {
                    "start_distance_mm": float(case["s"]),
                    "propagation_angle": float(case["alpha"]),
                    "start_angle": float(case["theta"]),
                }
                time = propagation_time_from_projection(float(case["l"]), **common)
                arrival = arrival_time_from_propagation_time(float(case["t"]), **common)
                # Arguments are rounded to doubles: what 1e-16 of l and angles does to t.
                lever = abs(
                    float(case["t"])
                    * (
                        1
                        + float(case["s"])
                        / max(
                            float(case["s"])
                            * abs(np.cos(common["propagation_angle"] + common["start_angle"])),
                            1e-3,
                        )
                    )
                )
                assert float(time) == pytest.approx(
                    float(case["t"]), abs=max(EXACT_PS, 3e-14 * lever)
                )
                assert float(arrival) == pytest.approx(float(case["t_a"]), abs=EXACT_PS)
                checked += 1
        assert checked > 100

    def test_index_slows_both_ways(self) -> None:
        rng = np.random.default_rng(4)
        with mpmath.workdps(40):
            case = self.by_vectors(rng)
        assert case is not None
        common = {
            "start_distance_mm": float(case["s"]),
            "propagation_angle": float(case["alpha"]),
            "start_angle": float(case["theta"]),
            "group_index": 1.33,
        }
        time = propagation_time_from_projection(float(case["l"]), **common)
        assert time == pytest.approx(1.33 * float(case["t"]), abs=EXACT_PS)
        arrival = arrival_time_from_propagation_time(time, **common)
        assert arrival == pytest.approx(1.33 * float(case["t_a"]), abs=EXACT_PS)

    def test_paper_angle_is_the_elevation_only_in_the_plane_of_n(self) -> None:
        """10.00 degrees in the viewing plane are 10.12 in Eq. 1-2's at y = 80 mm, as stated."""
        source, center, n = np.zeros(3), np.array([187.5, -80.0, 535.0]), np.array([0.0, 0, 1])
        elevation = np.deg2rad(10.0)
        d = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
        assert elevation_from_direction(d, n) == pytest.approx(elevation, abs=1e-15)
        # Eq. 1-2 measure from the trace of the viewing plane on the reference plane.
        plane = np.cross(d, center - source)
        e = np.cross(plane, n)
        e *= np.sign(e @ d) / np.linalg.norm(e)
        in_plane = np.degrees(np.arccos(d @ e))
        assert in_plane == pytest.approx(10.12, abs=0.01)


class TestHalfAngleLaw:
    @pytest.mark.parametrize("medium", MEDIA)
    def test_against_marched_light(self, medium: Medium) -> None:
        rng = np.random.default_rng(31)
        for _ in range(60):
            center, foot = rng.normal(0, 300, 3), rng.normal(0, 300, 3)
            d = np.cross(center - foot, rng.normal(0, 1, 3))
            d /= np.linalg.norm(d)
            p = float(np.linalg.norm(center - foot))
            psi = rng.uniform(-1.4, 1.4)
            along = p * np.tan(psi)
            flown = medium.path_group_index * along / C
            point = foot + along * d
            marched = 50.0 + flown + march_back(point, center, medium.return_group_index)
            law = arrival_time_from_viewing_angle(
                psi, foot_time_ps=50.0, foot_distance_mm=p, medium=medium
            )
            assert law == pytest.approx(marched, abs=2e-9 if abs(psi) > 1.3 else EXACT_PS)

    def test_in_forty_digits_out_to_grazing(self) -> None:
        with mpmath.workdps(40):
            for degrees in (-89.99, -89.0, -45.0, 0.0, 30.0, 89.0):
                psi = float(np.deg2rad(degrees))
                for medium in MEDIA:
                    n_p, n_r = medium.path_group_index, medium.return_group_index
                    x = mpmath.mpf(psi)
                    exact = (535 / mpmath.mpf("0.299792458")) * (
                        mpmath.mpf(n_p) * mpmath.tan(x) + mpmath.mpf(n_r) / mpmath.cos(x)
                    )
                    law = arrival_time_from_viewing_angle(
                        psi, foot_time_ps=0.0, foot_distance_mm=535.0, medium=medium
                    )
                    # Beyond a nanosecond per degree the rounding of psi itself shows.
                    slope = 535.0 / 0.3 * (n_p + n_r) / np.cos(psi) ** 2
                    one_sided = n_p == n_r and degrees < 0
                    slack = EXACT_PS + (0.0 if one_sided else 4e-16 * slope)
                    assert float(law) == pytest.approx(float(exact), abs=slack)

    def test_clock_direction(self) -> None:
        """d2 t_a / d psi2 > 0 at every angle when light is no slower out than back."""
        psi = np.linspace(-1.5, 1.5, 3001)
        for medium in (Medium(), Medium(1.0, 1.33), Medium(1.33, 1.33)):
            arrival = arrival_time_from_viewing_angle(
                psi, foot_time_ps=0.0, foot_distance_mm=535.0, medium=medium
            )
            assert (np.diff(arrival, 2) > 0.0).all()

    def test_clock_direction_fails_in_a_fibre_that_is_left_behind(self) -> None:
        """2 n_p sin(psi) + n_r (1 + sin(psi)^2) < 0: from psi = -24 degrees on for 1.47 / 1."""
        medium = Medium(1.47, 1.00027)
        psi = np.deg2rad(np.linspace(-80.0, 80.0, 1601))
        arrival = arrival_time_from_viewing_angle(
            psi, foot_time_ps=0.0, foot_distance_mm=535.0, medium=medium
        )
        bends_down = psi[1:-1][np.diff(arrival, 2) < 0.0]
        ratio = 1.47 / 1.00027
        turn = np.arcsin(-ratio + np.sqrt(ratio**2 - 1.0))
        assert bends_down.max() == pytest.approx(turn, abs=np.deg2rad(0.2))

    def test_apparent_speed_is_the_slope_of_the_law(self) -> None:
        medium = Medium(1.47, 1.00027)
        for psi in (-1.0, -0.2, 0.0, 0.7):
            towards = np.array([-np.sin(psi), np.cos(psi)])
            speed = apparent_speed_from_direction([1.0, 0.0], towards, medium=medium)
            step = 1e-5
            ends = arrival_time_from_viewing_angle(
                np.array([psi - step, psi + step]),
                foot_time_ps=0.0,
                foot_distance_mm=535.0,
                medium=medium,
            )
            flown = 535.0 * (np.tan(psi + step) - np.tan(psi - step))
            assert speed == pytest.approx(flown / (ends[1] - ends[0]), rel=1e-7)


class TestInvariances:
    @staticmethod
    def arrivals(vertices, center, *, emission=0.0):
        times = event_times_from_vertices(vertices, emission_time_ps=emission)
        return arrival_time_from_event(vertices, times, camera_center_mm=center)

    @settings(max_examples=40)
    @given(
        turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
        shift=st.tuples(*[st.floats(-1e3, 1e3)] * 3),
        seed=st.integers(0, 2**31),
    )
    def test_rigid_motion_of_everything(self, turn, shift, seed) -> None:
        rng = np.random.default_rng(seed)
        vertices, center = some_path(rng, 4), rng.normal(0, 500, 3)
        rotation = rotation_from_vector(turn)
        moved = self.arrivals(vertices @ rotation.T + shift, rotation @ center + shift)
        np.testing.assert_allclose(moved, self.arrivals(vertices, center), atol=EXACT_PS)

    def test_mirror_time_shift_and_scale(self, rng: np.random.Generator) -> None:
        vertices, center = some_path(rng, 5), rng.normal(0, 500, 3)
        plain = self.arrivals(vertices, center)
        mirror = np.array([-1.0, 1.0, 1.0])
        np.testing.assert_array_equal(self.arrivals(vertices * mirror, center * mirror), plain)
        late = self.arrivals(vertices, center, emission=1000.0)
        np.testing.assert_allclose(late - plain, 1000.0, atol=EXACT_PS)
        large = self.arrivals(3.0 * vertices, 3.0 * center)
        np.testing.assert_allclose(large, 3.0 * plain, rtol=1e-13)

    def test_reversed_flight_is_not_the_same(self, rng: np.random.Generator) -> None:
        """Time has a direction: the same corners backwards arrive otherwise."""
        vertices, center = some_path(rng, 3), rng.normal(0, 500, 3)
        there, back = self.arrivals(vertices, center), self.arrivals(vertices[::-1], center)
        assert np.abs(np.diff(there) - np.diff(back[::-1])).max() > 1.0

    def test_camera_and_pixels_turn_with_the_scene(self, rng: np.random.Generator) -> None:
        camera = Camera.facing_plane(center_mm=(187.5, 37.5))
        rotation = rotation_from_vector(rng.normal(0, 1, 3))
        pose = camera.world_from_camera.copy()
        pose[:3, :3] = rotation @ pose[:3, :3]
        pose[:3, 3] = rotation @ pose[:3, 3]
        turned = Camera(camera.matrix, camera.distortion, pose, camera.shape)
        pixels = turned.pixels_from_points(PAPER_VERTICES @ rotation.T)
        np.testing.assert_allclose(pixels, camera.pixels_from_points(PAPER_VERTICES), atol=1e-11)


class TestCameraAgainstBruteForce:
    """The facing camera's convention, from two derivations."""

    def test_same_pixels(self) -> None:
        ours = Camera.facing_plane((24, 32), distance_mm=500.0, center_mm=(30.0, -10.0))
        theirs = camera_over_plane(rows=24, cols=32, distance=500.0, center=(30.0, -10.0))
        rng = np.random.default_rng(0)
        points = rng.uniform(-150.0, 150.0, (100, 3))
        np.testing.assert_allclose(
            np.stack(ours.pixels_from_points(points), -1),
            [theirs.image(p) for p in points],
            atol=1e-11,
        )


class TestFiguresOfTheMethod:
    """Numbers that documents quote, with the set-up that gives them."""

    def test_distortion_of_the_papers_path(self) -> None:
        """rms of t_a (from zero) against t over the three legs: 174-176 ps; paper: 174.80.

        174.1 at equal event times, 176.0 at the camera's 55 ps frames.
        """
        whole = float(np.sum(np.linalg.norm(np.diff(PAPER_VERTICES, axis=0), axis=1)))
        walked = march_out(PAPER_VERTICES, list(np.linspace(0, whole, 2001)), 1.00027, stride=50.0)
        places = np.array([x for x, _ in walked])
        times = np.array([t for _, t in walked])
        marched = times + [march_back(x, PAPER_CAMERA, 1.00027) for x in places]
        ours = arrival_time_from_event(places, times, camera_center_mm=PAPER_CAMERA)
        np.testing.assert_allclose(ours, marched, atol=EXACT_PS)
        seen = ours - ours[0]
        assert np.sqrt(np.mean((seen - times) ** 2)) == pytest.approx(174.1, abs=0.1)
        frames = np.arange(0.0, seen[-1], 55.0)
        late = frames - np.interp(frames, seen, times)
        assert np.sqrt(np.mean(late**2)) == pytest.approx(176.0, abs=0.1)

    @staticmethod
    def slopes(*, source_x: float, angle_deg: float = 0.0) -> dict[str, float]:
        """Least-squares errors of one leg in the paper's field, deg per ps or per mm.

        Camera 535 mm above the middle of a 245 mm field that starts at x = 65; 32 pixels along
        the leg; the leg starts at (source_x, 0).
        """
        columns = (np.arange(32) - 15.5) * 245.0 / 32.0 / 535.0

        def arrivals(angle: float, lift: float = 0.0, drop: float = 0.0) -> np.ndarray:
            center = np.array([187.5, 535.0 + lift])
            d = np.array([np.cos(angle), np.sin(angle)])
            start = np.array([source_x, drop])
            out = []
            for slope in columns:
                sight = np.array([slope, -1.0])
                _, length = np.linalg.solve(np.column_stack([sight, -d]), start - center)
                out.append(1.00027 / C * (length + np.linalg.norm(center - start - length * d)))
            return np.array(out)

        at, h = np.deg2rad(angle_deg), 1e-5
        by_angle = np.deg2rad(1.0) * (arrivals(at + h) - arrivals(at - h)) / (2 * h)
        by_lift = (arrivals(at, lift=1e-3) - arrivals(at, lift=-1e-3)) / 2e-3
        by_drop = (arrivals(at, drop=1e-3) - arrivals(at, drop=-1e-3)) / 2e-3
        one = np.ones(32)
        timed = np.linalg.inv(np.column_stack([by_angle, one]).T @ np.column_stack([by_angle, one]))
        free = np.column_stack([by_angle, one, by_drop])
        return {
            "known": 1.0 / float(np.linalg.norm(by_angle)),
            "emission_fitted": float(np.sqrt(timed[0, 0])),
            "blind": float(np.sqrt(np.linalg.inv(free.T @ free)[0, 0])),
            "shared_ps": abs(float(by_angle.sum() / (by_angle @ by_angle))),
            "distance_mm": abs(float(by_angle @ by_lift / (by_angle @ by_angle))),
        }

    def test_source_at_the_edge_of_the_field(self) -> None:
        assert self.slopes(source_x=65.0)["known"] == pytest.approx(0.019, abs=0.0005)
        assert self.slopes(source_x=65.0, angle_deg=-60.0)["known"] == pytest.approx(
            0.0015, abs=0.00005
        )
        assert self.slopes(source_x=65.0, angle_deg=60.0)["known"] == pytest.approx(
            0.039, abs=0.0005
        )

    def test_source_forty_mm_outside_the_field(self) -> None:
        slopes = self.slopes(source_x=25.0)
        assert slopes["emission_fitted"] == pytest.approx(0.03, abs=0.005)
        assert slopes["shared_ps"] == pytest.approx(0.08, abs=0.005)
        assert slopes["distance_mm"] == pytest.approx(0.28, abs=0.01)

    def test_nothing_known(self) -> None:
        assert self.slopes(source_x=0.0)["blind"] == pytest.approx(0.7, abs=0.05)
        psi = np.arctan((np.arange(32) - 15.5) * 245.0 / 32.0 / 535.0)

        def law(p: float, turn: float) -> np.ndarray:
            return arrival_time_from_viewing_angle(psi - turn, foot_time_ps=0.0, foot_distance_mm=p)

        design = np.column_stack(
            [
                np.ones(32),
                (law(535.01, 0.0) - law(534.99, 0.0)) / 0.02,
                (law(535.0, 1e-5) - law(535.0, -1e-5)) / 2e-5,
            ]
        )
        std = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
        assert std[1] == pytest.approx(7.0, abs=0.3)
        assert np.degrees(std[2]) == pytest.approx(0.7, abs=0.05)

    def test_apparent_length_of_the_pulse(self) -> None:
        """58-82 ps for 68 over -10 ... 10 degrees, in the middle of the field."""
        seen = [
            68.0
            * apparent_speed_from_direction(
                [np.cos(a), np.sin(a)], [0.0, 1.0], medium=Medium(1.0, 1.0)
            )
            / C
            for a in np.deg2rad([-10.0, 10.0])
        ]
        np.testing.assert_allclose(seen, [58.0, 82.0], atol=0.7)
