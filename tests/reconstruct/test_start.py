"""A first path from legs in the picture: near enough for the fit to finish, at any angle."""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.camera.model import Camera
from lightflight.errors import GeometryError
from lightflight.flight import Medium, Source
from lightflight.reconstruct.fit.start import curve_from_leg, state_from_legs, world_rays
from lightflight.reconstruct.legs.find import find_legs
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.image_plane import mean_focal_px, undistorted_px
from tests.path_fakes import PAPER_VERTICES, vertex_times
from tests.reconstruct.fakes import PAPER, arrivals_of, camera_like

CAMERA = Camera.facing_plane((32, 32))
ANGLES = (-80, -60, -45, -30, -10, 0, 10, 30, 45, 60, 80)
START_PS = 2000.0


def leg_at(angle_deg: float, *, y: float = 7.0, turn_deg: float = 0.0) -> np.ndarray:
    """300 mm about the middle of the field, at an elevation, flown along x turned about z."""
    alpha, turn = np.deg2rad([angle_deg, turn_deg])
    along = np.array([np.cos(turn), np.sin(turn), 0.0]) * np.cos(alpha)
    direction = along + np.array([0.0, 0.0, np.sin(alpha)])
    middle = np.array([0.0, y, 0.0])
    return np.array([middle - 150.0 * direction, middle + 150.0 * direction])


def started(vertices, camera, source, medium=None) -> PathState:
    medium = Medium() if medium is None else medium
    arrivals = arrivals_of(vertices, camera, start=START_PS, medium=medium)
    convex = medium.path_group_index == medium.return_group_index
    legs = find_legs(arrivals, camera=camera, n_legs=len(vertices) - 1, convex=convex)
    assert len(legs) == len(vertices) - 1
    return state_from_legs(legs, camera=camera, source=source, medium=medium)


def turn_deg(state: PathState, vertices: np.ndarray, leg: int = 0) -> float:
    """Angle between found and true direction of a leg."""
    found, true = np.diff(state.vertices_mm, axis=0)[leg], np.diff(vertices, axis=0)[leg]
    size = np.linalg.norm(np.cross(found, true))
    return float(np.rad2deg(np.arctan2(size, found @ true)))


class TestSteepLegs:
    """A search that started at 0 deg and walked downhill would end in the wrong valley at -45."""

    @pytest.mark.parametrize("angle", ANGLES)
    @pytest.mark.parametrize("turn", [0.0, 130.0])
    def test_source_and_time_known(self, angle, turn):
        vertices = leg_at(angle, turn_deg=turn)
        source = Source(vertices[0], emission_time_ps=START_PS)
        state = started(vertices, CAMERA, source)
        np.testing.assert_allclose(state.vertices_mm[0], vertices[0], atol=1e-9)
        assert state.start_time_ps == START_PS
        assert turn_deg(state, vertices) < 1.0

    @pytest.mark.parametrize("angle", ANGLES)
    def test_emission_time_unknown(self, angle):
        vertices = leg_at(angle)
        state = started(vertices, CAMERA, Source(vertices[0]))
        assert turn_deg(state, vertices) < 1.0
        assert state.start_time_ps == pytest.approx(START_PS, abs=5.0)

    @pytest.mark.parametrize("angle", ANGLES)
    def test_nothing_known(self, angle):
        """Blind: line and time, from entry into view; a picosecond of error is worth 0.7 deg and
        7 mm here, and raw lines are off by a third of a pixel."""
        vertices = leg_at(angle)
        state = started(vertices, CAMERA, Source())
        assert turn_deg(state, vertices) < 3.0
        direction = (vertices[1] - vertices[0]) / 300.0
        entry = state.vertices_mm[0]
        flown = float((entry - vertices[0]) @ direction)
        beside = np.linalg.norm(entry - vertices[0] - flown * direction)
        assert beside < 30.0
        late = state.start_time_ps - START_PS - 1.00027 * flown / 0.299792458
        assert abs(late) < 200.0


class TestSource:
    def test_a_doubtful_time_is_moved_by_the_data(self):
        vertices = leg_at(20.0)
        wrong = Source(vertices[0], emission_time_ps=START_PS + 40, emission_time_std_ps=100.0)
        state = started(vertices, CAMERA, wrong)
        assert state.start_time_ps == pytest.approx(START_PS, abs=3.0)

    def test_a_firm_time_is_kept(self):
        vertices = leg_at(20.0)
        state = started(vertices, CAMERA, Source(vertices[0], emission_time_ps=START_PS + 5))
        assert state.start_time_ps == START_PS + 5

    def test_fibre_out_air_back(self):
        medium = Medium(1.47, 1.00027)
        vertices = leg_at(25.0)
        source = Source(vertices[0], emission_time_ps=START_PS)
        assert turn_deg(started(vertices, CAMERA, source, medium), vertices) < 1.0


class TestChains:
    @pytest.mark.parametrize(
        "source",
        [
            Source(PAPER_VERTICES[0], emission_time_ps=START_PS),
            Source(PAPER_VERTICES[0]),
            Source(PAPER_VERTICES[0], position_std_mm=1.0),
        ],
    )
    def test_the_papers_mirrors_lie_outside_the_picture(self, source):
        state = started(PAPER_VERTICES, PAPER, source)
        assert state.start_time_ps == pytest.approx(START_PS, abs=3.0)
        away = np.linalg.norm(state.vertices_mm - PAPER_VERTICES, axis=1)
        assert away[1] < 15.0
        assert away[2] < 35.0
        assert all(turn_deg(state, PAPER_VERTICES, k) < 8.0 for k in range(3))

    def test_blind_chain(self):
        state = started(PAPER_VERTICES, PAPER, Source())
        away = np.linalg.norm(state.vertices_mm - PAPER_VERTICES, axis=1)
        assert away[1:3].max() < 35.0

    @pytest.mark.parametrize("seed", range(4))
    def test_from_anywhere(self, seed):
        camera = camera_like(seed)
        rays = camera.rays_from_pixels(np.array([4.0, 7.0, 27.0]), np.array([3.0, 28.0, 5.0]))
        distance = np.linalg.norm(camera.center_mm) + np.array([[0.0], [60.0], [-40.0]])
        vertices = camera.center_mm + distance * rays
        source = Source(vertices[0], emission_time_ps=START_PS)
        state = started(vertices, camera, source)
        assert turn_deg(state, vertices, 0) < 2.0
        assert turn_deg(state, vertices, 1) < 5.0

    def test_legs_in_one_viewing_plane_have_a_corner_by_their_times(self):
        """A mirror that turns the flight within the plane through the camera: the picture shows
        one line, and only the times say where the corner is."""
        vertices = np.array([(-180.0, 0, 0), (20, 0, 60), (180, 0, -60)])
        times = vertex_times(vertices, start=START_PS)
        parts = (arrivals_of(vertices[k : k + 2], CAMERA, start=float(times[k])) for k in range(2))
        legs = tuple(leg for part in parts for leg in find_legs(part, camera=CAMERA, n_legs=1))
        source = Source(vertices[0], emission_time_ps=START_PS)
        state = state_from_legs(legs, camera=CAMERA, source=source, medium=Medium())
        assert np.linalg.norm(state.vertices_mm[1] - vertices[1]) < 40.0


class TestRefusals:
    def test_source_behind_the_flight(self):
        """No straight flight from beyond the exit passes the pixels in this order."""
        arrivals = arrivals_of(leg_at(0.0), CAMERA, start=START_PS)
        legs = find_legs(arrivals, camera=CAMERA)
        with pytest.raises(GeometryError, match="no straight flight from the source"):
            state_from_legs(
                legs,
                camera=CAMERA,
                source=Source((0.0, 0.0, 2000.0), emission_time_ps=START_PS),
                medium=Medium(),
            )


def test_rays_of_undistorted_pixels_are_the_cameras():
    camera = camera_like(2)
    row, col = np.array([3.0, 20.0, 30.0]), np.array([30.0, 11.0, 2.0])
    found = world_rays(camera, undistorted_px(camera, row, col))
    np.testing.assert_allclose(found, camera.rays_from_pixels(row, col), atol=1e-10)


def test_curve_of_a_leg_turns_about_its_plane():
    arrivals = arrivals_of(leg_at(10.0), CAMERA)
    (leg,) = find_legs(arrivals, camera=CAMERA)
    curve = curve_from_leg(leg, CAMERA)
    assert np.linalg.norm(curve.plane_normal) == pytest.approx(1.0)
    assert np.abs(curve.rays @ curve.plane_normal).max() < 1e-9
    assert (np.diff(curve.arrival_ps) > 0).all()
    # ray x flight, for a flight to the right: down in the picture, -y in the world.
    assert curve.plane_normal @ [0.0, -1.0, 0.0] > 0.9
    assert mean_focal_px(CAMERA) == pytest.approx(32 * 535 / 245)
