"""LightPath: where the pulse is, how well that is known, and at which angle each leg flies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lightflight.camera.model import Camera
from lightflight.flight import Medium, Source
from lightflight.path.light_path import paper_angle_from_leg
from lightflight.path.on_legs import extrapolated_position
from lightflight.path.tables import SAMPLE_DTYPE, Goodness
from tests.path_fakes import (
    PAPER_CAMERA,
    PAPER_VERTICES,
    make_path,
    random_covariance,
    vertex_times,
)

DRAWS = 200_000


class TestRecord:
    def test_holds_copies_that_cannot_be_written(self):
        vertices = PAPER_VERTICES.copy()
        path = make_path(vertices)
        vertices[0] = 99.0
        np.testing.assert_array_equal(path.vertices_mm[0], 0.0)
        for array in (path.vertices_mm, path.vertex_times_ps, path.covariance):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0

    def test_legs_follow_the_vertices(self):
        path = make_path()
        assert path.n_legs == 3
        assert path.emission_time_ps == 2000.0
        for k, leg in enumerate(path.legs):
            np.testing.assert_array_equal(leg.start_mm, PAPER_VERTICES[k])
            np.testing.assert_array_equal(leg.end_mm, PAPER_VERTICES[k + 1])
            assert leg.length_mm == pytest.approx(
                0.299792458 * (leg.end_time_ps - leg.start_time_ps) / 1.00027
            )
            assert np.linalg.norm(leg.direction) == pytest.approx(1.0)

    @pytest.mark.parametrize(
        ("vertices", "times"),
        [
            (np.zeros((1, 3)), [0.0]),
            (PAPER_VERTICES, [0.0, 1.0]),
            (PAPER_VERTICES[:, :2], np.arange(4.0)),
            (PAPER_VERTICES.ravel(), np.arange(4.0)),
        ],
    )
    def test_shapes_must_agree(self, vertices, times):
        with pytest.raises(ValueError, match=r"a path needs vertices_mm of shape \(m, 3\)"):
            make_path(
                vertices, np.zeros((16, 16)), vertex_times_ps=np.array(times), source=Source()
            )

    def test_covariance_is_of_all_vertices(self):
        with pytest.raises(ValueError, match=r"covariance must be \(16, 16\), got \(12, 12\)"):
            make_path(covariance=np.zeros((12, 12)))

    @pytest.mark.parametrize("times", [[0.0, 1.0, np.nan, 3.0], [0, 2, 1, 3.0], [0, 1, 1, 3.0]])
    def test_event_times_must_ascend(self, times):
        with pytest.raises(ValueError, match="vertex_times_ps must be finite and ascend"):
            make_path(vertex_times_ps=np.array(times, dtype=float))

    def test_a_path_is_somewhere(self):
        vertices = PAPER_VERTICES.copy()
        vertices[2, 1] = np.nan
        with pytest.raises(ValueError, match="vertices_mm must be finite: vertex 2 is"):
            make_path(vertices, vertex_times_ps=np.arange(4.0), source=Source())

    def test_a_path_is_not_beyond_what_pictures_hold(self):
        """`export -o x.glb` of such a file ended in an internal error."""
        vertices = PAPER_VERTICES.copy()
        vertices[2, 1] = 1e300
        with pytest.raises(ValueError, match=r"vertices_mm must lie within 1e\+15 mm"):
            make_path(vertices, vertex_times_ps=np.arange(4.0), source=Source())

    def test_goodness_without_freedom_has_no_ratio(self):
        assert np.isnan(Goodness(3.0, 0, 1, 0, 1.0, 0.0, True).reduced_chi2)
        assert Goodness(3.0, 2, 1, 0, 1.0, 0.0, True).reduced_chi2 == 1.5


class TestPositions:
    def test_vertices_are_hit_at_their_times(self):
        path = make_path()
        np.testing.assert_allclose(
            path.position_at(path.vertex_times_ps), PAPER_VERTICES, atol=1e-9
        )

    def test_nan_before_the_source_and_after_the_exit(self):
        path = make_path()
        first, last = path.vertex_times_ps[[0, -1]]
        position = path.position_at([first - 0.01, first, last, last + 0.01, np.nan])
        np.testing.assert_array_equal(
            np.isnan(position).all(axis=1), [True, False, False, True, True]
        )

    def test_pulse_keeps_its_speed(self):
        path = make_path()
        first, second = path.vertex_times_ps[:2]
        times = np.linspace(first, second, 11)
        steps = np.linalg.norm(np.diff(path.position_at(times), axis=0), axis=1)
        np.testing.assert_allclose(steps / np.diff(times), 0.299792458 / 1.00027, rtol=1e-9)

    def test_one_time_will_do_and_none_too(self):
        path = make_path()
        assert path.position_at(2100.0).shape == (1, 3)
        assert path.position_at([]).shape == (0, 3)

    def test_leg_at_corners_and_outside(self):
        path = make_path()
        t = path.vertex_times_ps
        asked = [t[0] - 5, t[0], t[1] - 1e-6, t[1], t[2] + 1e-6, t[3], t[3] + 5]
        np.testing.assert_array_equal(path.leg_at(asked), [0, 0, 0, 1, 2, 2, 2])

    @given(st.floats(-3.0, 4.0))
    def test_prolonged_legs_stay_straight(self, fraction):
        vertices = np.array([[0.0, 0, 0], [10, 20, 30]])
        times = np.array([5.0, 7.0])
        found = extrapolated_position(vertices, times, np.array([5.0 + 2.0 * fraction]))
        np.testing.assert_allclose(found[0], fraction * vertices[1], atol=1e-12)


class TestSample:
    def test_equal_event_times_from_end_to_end(self):
        path = make_path()
        table = path.sample(301)
        assert table.dtype == SAMPLE_DTYPE
        assert len(table) == 301
        np.testing.assert_allclose(
            np.diff(table["event_time_ps"]), np.ptp(path.vertex_times_ps) / 300
        )
        np.testing.assert_allclose(
            np.column_stack([table[f"{axis}_mm"] for axis in "xyz"]),
            path.position_at(table["event_time_ps"]),
        )
        assert set(table["leg"]) == {0, 1, 2}

    def test_arrival_is_event_plus_return(self):
        medium = Medium(1.3, 1.1)
        table = make_path(medium=medium).sample(50)
        position = np.column_stack([table[f"{axis}_mm"] for axis in "xyz"])
        back = 1.1 * np.linalg.norm(position - PAPER_CAMERA.center_mm, axis=1) / 0.299792458
        np.testing.assert_allclose(table["arrival_time_ps"], table["event_time_ps"] + back)

    def test_view_is_between_the_outer_pixel_edges(self):
        table = make_path().sample(2000)
        inside = np.abs(table["x_mm"] - 187.5) < 122.5 * (535.0 - table["z_mm"]) / 535.0
        np.testing.assert_array_equal(table["in_view"], inside)

    def test_needs_two_points(self):
        with pytest.raises(ValueError, match="n must be at least 2, got 1"):
            make_path().sample(1)


class TestErrorsAgainstMonteCarlo:
    """First-order errors against 200,000 paths drawn from the covariance.

    The relative error of a standard deviation from N draws is 1 / sqrt(2 N) = 0.16 %; six times
    that is exceeded by chance in 2e-9 of comparisons, of which there are about 60 here.
    """

    RTOL = 6.0 / np.sqrt(2 * DRAWS)

    def drawn(self, scale=1e-3):
        rng = np.random.default_rng(7)
        covariance = random_covariance(rng, 4, scale=scale)
        path = make_path(covariance=covariance)
        state = np.column_stack((path.vertices_mm, path.vertex_times_ps)).ravel()
        draws = rng.multivariate_normal(state, covariance, size=DRAWS).reshape(DRAWS, 4, 4)
        return path, draws

    def test_positions_at_fixed_times(self):
        path, draws = self.drawn()
        t = path.vertex_times_ps
        times = np.array([t[0] + 1, 0.3 * t[0] + 0.7 * t[1], t[1] + 5, t[2] - 3, t[3] - 200])
        covariance = path.position_covariance_at(times)
        for k, time in enumerate(times):
            leg = int(path.leg_at(time)[0])
            a, b = draws[:, leg], draws[:, leg + 1]
            f = ((time - a[:, 3]) / (b[:, 3] - a[:, 3]))[:, np.newaxis]
            position = (1 - f) * a[:, :3] + f * b[:, :3]
            expected = np.cov(position.T)
            size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
            assert np.abs(covariance[k] - expected).max() < 2 * self.RTOL * size.max()

    def test_sampled_errors_are_those(self):
        path, _ = self.drawn()
        table = path.sample(7)
        variance = np.diagonal(
            path.position_covariance_at(table["event_time_ps"]), axis1=1, axis2=2
        )
        for axis, column in zip("xyz", variance.T, strict=True):
            np.testing.assert_allclose(table[f"{axis}_std_mm"], np.sqrt(column))

    def test_time_at_a_fixed_fraction_of_a_leg(self):
        path, draws = self.drawn()
        table = path.sample(9)
        for row in table[1:-1]:
            leg = int(row["leg"])
            t0, t1 = path.vertex_times_ps[leg : leg + 2]
            f = (row["event_time_ps"] - t0) / (t1 - t0)
            drawn = (1 - f) * draws[:, leg, 3] + f * draws[:, leg + 1, 3]
            assert row["event_time_std_ps"] == pytest.approx(drawn.std(), rel=self.RTOL)

    def test_angles(self):
        path, draws = self.drawn()
        for k, leg in enumerate(path.legs):
            step = draws[:, k + 1, :3] - draws[:, k, :3]
            angle = np.rad2deg(np.arcsin(step[:, 2] / np.linalg.norm(step, axis=1)))
            assert leg.angle_std_deg == pytest.approx(angle.std(), rel=self.RTOL)
            assert leg.angle_deg == pytest.approx(angle.mean(), abs=6 * angle.std() / 400)

    def test_vertex_errors_are_the_diagonal(self):
        path, draws = self.drawn()
        np.testing.assert_allclose(path.vertex_std, draws.std(axis=0), rtol=self.RTOL)


class TestAngles:
    def test_elevation_and_paper_angle_part_away_from_the_middle(self):
        """They agree where the plane of camera and leg holds the normal; at y = 80 mm an
        elevation of 10.00 deg is a paper angle of 10.12 deg."""
        run = 200.0
        for y, differ in ((0.0, False), (80.0, True)):
            camera = Camera.facing_plane((32, 32))
            start = np.array([-100.0, y, 0.0])
            end = start + run * np.array([np.cos(np.deg2rad(10)), 0, np.sin(np.deg2rad(10))])
            leg = make_path([start, end], camera=camera).legs[0]
            assert leg.angle_deg == pytest.approx(10.0, abs=1e-9)
            assert leg.paper_angle_deg == pytest.approx(10.12 if differ else 10.0, abs=0.011)
            assert (abs(leg.paper_angle_deg - 10.0) > 0.1) is differ

    def test_angle_in_a_tilted_plane_by_hand(self):
        """The angle between the leg and the line in which viewing and reference plane meet."""
        y, distance = 80.0, 535.0
        camera = Camera.facing_plane((32, 32), distance_mm=distance)
        end = np.array([100 * np.cos(0.2), y, 100 * np.sin(0.2)])
        angle = paper_angle_from_leg(
            [0.0, y, 0.0], end, camera_center_mm=camera.center_mm, normal=camera.backward_axis
        )
        leaning = np.arctan2(y, distance)
        step = end - [0.0, y, 0.0]
        plane = np.cross([0.0, -y, distance], step)
        along = np.cross(plane, [0.0, 0.0, 1.0])
        expected = np.arccos(step @ along / np.linalg.norm(step) / np.linalg.norm(along))
        assert angle == pytest.approx(expected, abs=1e-12)
        assert np.tan(angle) > np.tan(0.2)
        assert angle == pytest.approx(0.2 / np.cos(leaning), rel=0.02)

    def test_towards_the_camera_is_positive(self):
        for z, sign in ((30.0, 1), (-30.0, -1)):
            leg = make_path([[0, 0, 0], [100, 0, z]]).legs[0]
            assert leg.angle_deg == pytest.approx(sign * np.degrees(np.arctan2(30.0, 100.0)))
            assert np.sign(leg.paper_angle_deg) == sign

    def test_paper_angle_does_not_care_which_way_it_flies_sideways(self):
        right = make_path([[100, 0, 0], [200, 0, 20]]).legs[0]
        left = make_path([[275, 0, 0], [175, 0, 20]]).legs[0]
        assert right.paper_angle_deg == pytest.approx(left.paper_angle_deg, abs=1e-9)

    def test_a_leg_at_the_camera_has_no_viewing_plane(self):
        center = PAPER_CAMERA.center_mm
        angle = paper_angle_from_leg(
            center - [10, 20, 400], center - [5, 10, 200], camera_center_mm=center, normal=[0, 0, 1]
        )
        assert np.isnan(angle)

    def test_along_the_axis_is_ninety_degrees_with_a_finite_error(self):
        path = make_path([[0, 0, 0], [0, 0, 100]], covariance=1e-6 * np.eye(8))
        assert path.legs[0].angle_deg == pytest.approx(90.0)
        assert np.isfinite(path.legs[0].angle_std_deg)


def test_times_of_the_fakes_are_the_packages():
    from lightflight.flight import event_times_from_vertices

    np.testing.assert_allclose(
        vertex_times(PAPER_VERTICES),
        event_times_from_vertices(PAPER_VERTICES, emission_time_ps=2000.0),
    )
