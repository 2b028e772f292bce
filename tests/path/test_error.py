"""The metrics of every table, on cases whose answer can be written down."""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.camera.model import Camera
from lightflight.errors import GeometryError
from lightflight.path.error import path_error
from tests.path_fakes import (
    PAPER_CAMERA,
    PAPER_VERTICES,
    Truth,
    make_path,
    truth_of,
    vertex_times,
)

SPEED = 0.299792458 / 1.00027
CAMERA = Camera.facing_plane((32, 32), center_mm=(0.0, 0.0))
ACROSS = np.array([[-200.0, 0.0, 0.0], [200.0, 0.0, 0.0]])


def later(truth: Truth, delay: float) -> Truth:
    return Truth(truth.vertices_mm, truth.vertex_times_ps + delay)


def moved(vertices, *by: float) -> np.ndarray:
    return np.asarray(vertices + np.array(by))


def test_the_truth_is_without_error():
    truth = truth_of(PAPER_VERTICES)
    error = path_error(truth, truth, PAPER_CAMERA)
    assert error.position_rms_mm == pytest.approx(0.0, abs=1e-9)
    assert error.event_time_rms_ps == pytest.approx(0.0, abs=1e-9)


def test_a_light_path_or_anything_with_vertices_will_do():
    truth = truth_of(PAPER_VERTICES)
    assert path_error(make_path(), truth, PAPER_CAMERA) == path_error(
        truth, make_path(), PAPER_CAMERA
    )


@pytest.mark.parametrize("delay", [1e-3, 1.0, 40.0, -40.0, 300.0, -300.0])
def test_a_late_clock(delay):
    """Same places, other times. On three legs side by side a delay of 300 ps brings a pulse where
    the neighbouring leg's was: each leg is still compared with itself, but for a few pixels by
    the corners where two legs are less than half a pixel apart."""
    truth = truth_of(PAPER_VERTICES)
    error = path_error(later(truth, delay), truth, PAPER_CAMERA)
    rel = 1e-9 if abs(delay) < 100 else 5e-3
    assert error.event_time_rms_ps == pytest.approx(abs(delay), rel=rel)
    single = truth_of(ACROSS)
    error = path_error(later(single, delay), single, CAMERA)
    assert error.position_rms_mm == pytest.approx(SPEED * abs(delay), rel=1e-9)


@pytest.mark.parametrize("shift", [(0, 3.0, 0), (0, 0, -2.0), (0.5, 1.0, 2.0)])
def test_a_shifted_path(shift):
    truth = truth_of(ACROSS)
    error = path_error(Truth(moved(ACROSS, *shift), truth.vertex_times_ps), truth, CAMERA)
    assert error.position_rms_mm == pytest.approx(np.linalg.norm(shift), rel=1e-9)


def test_a_shift_along_the_flight_is_a_time():
    """On the rays of the pixels the shifted pulse passes earlier by the shift over the speed."""
    truth = truth_of(ACROSS)
    error = path_error(Truth(moved(ACROSS, 5.0, 0, 0), truth.vertex_times_ps), truth, CAMERA)
    assert error.event_time_rms_ps == pytest.approx(5.0 / SPEED, rel=1e-9)


def test_depth_slides_the_point_along_the_leg():
    """A leg parallel to the picture and dz nearer is met by the ray at x at x (D - dz) / D.

    The leg ends exactly on outer pixel edges: the first and last column count, none beyond.
    """
    truth, dz = truth_of(ACROSS), 5.0
    camera = Camera.facing_plane((31, 32))  # an odd number of rows: one runs along y = 0
    error = path_error(Truth(moved(ACROSS, 0, 0, dz), truth.vertex_times_ps), truth, camera)
    centres = (np.arange(32) - 15.5) * 245.0 / 32
    expected = np.sqrt(np.mean((centres * dz / 535.0) ** 2)) / SPEED
    assert error.event_time_rms_ps == pytest.approx(expected, rel=1e-9)


def test_a_wrong_angle_from_the_right_source():
    """|X_hat - X| = 2 sin(d alpha / 2) l: rms over the part in view, 77.5 to 322.5 mm from B."""
    tilt = np.deg2rad(0.5)
    end = ACROSS[0] + 400.0 * np.array([np.cos(tilt), 0, np.sin(tilt)])
    truth = truth_of(ACROSS)
    error = path_error(truth_of([ACROSS[0], end]), truth, CAMERA)
    length = np.linspace(0, 400.0, 1000)
    seen = length[(length > 77.5) & (length < 322.5)]
    expected = 2 * np.sin(tilt / 2) * np.sqrt(np.mean(seen**2))
    assert error.position_rms_mm == pytest.approx(expected, rel=1e-6)
    whole = path_error(truth_of([ACROSS[0], end]), truth, CAMERA, whole=True)
    until_exit = length[length < 322.5]
    expected = 2 * np.sin(tilt / 2) * np.sqrt(np.mean(until_exit**2))
    assert whole.position_rms_mm == pytest.approx(expected, rel=1e-6)
    assert whole.event_time_rms_ps == error.event_time_rms_ps


def test_corners_that_turn_nothing_cost_nothing():
    middle = 0.3 * ACROSS[0] + 0.7 * ACROSS[1]
    split = truth_of([ACROSS[0], middle, ACROSS[1]])
    for path, truth in ((split, truth_of(ACROSS)), (truth_of(ACROSS), split)):
        error = path_error(path, truth, CAMERA)
        assert error.position_rms_mm == pytest.approx(0.0, abs=1e-9)
        assert error.event_time_rms_ps == pytest.approx(0.0, abs=1e-9)


def test_a_path_that_ends_in_view_or_starts_late_is_prolonged():
    start, stop = moved(ACROSS[0], 150.0, 0, 0), moved(ACROSS[1], -150.0, 0, 0)
    piece = Truth(np.array([start, stop]), 2000.0 + np.array([150.0, 250.0]) / SPEED)
    error = path_error(piece, truth_of(ACROSS), CAMERA)
    assert error.position_rms_mm == pytest.approx(0.0, abs=1e-9)
    assert error.event_time_rms_ps == pytest.approx(0.0, abs=1e-9)


def test_what_is_out_of_view_is_not_compared():
    up, down = (np.vstack((ACROSS, [200.0, y, 0.0])) for y in (300.0, -300.0))
    error = path_error(truth_of(down), truth_of(up), CAMERA)
    assert error.position_rms_mm == pytest.approx(0.0, abs=1e-9)


def test_a_missing_leg_shows():
    truth = truth_of(PAPER_VERTICES)
    without = Truth(PAPER_VERTICES[:-1], vertex_times(PAPER_VERTICES)[:-1])
    error = path_error(without, truth, PAPER_CAMERA)
    assert error.position_rms_mm > 50.0


def test_unseen_path_is_refused():
    behind = moved(PAPER_VERTICES, 0, 0, 2000.0)
    with pytest.raises(GeometryError, match="sees no part of the true path"):
        path_error(make_path(), truth_of(behind), PAPER_CAMERA)
    aside = moved(PAPER_VERTICES, 5000.0, 0, 0)
    with pytest.raises(GeometryError, match="check the camera's pose"):
        path_error(make_path(), truth_of(aside), PAPER_CAMERA)
