"""Points along a path: both times, errors, places of pulses."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lightflight.path import trace as tr
from tests.view import fakes

C = 0.299792458


def test_a_trace_holds_both_clocks_of_the_path() -> None:
    path = fakes.fake_path()
    trace = tr.trace_from_path(path, per_leg=5)
    assert trace.points_mm.shape == (15, 3)
    np.testing.assert_allclose(trace.points_mm[[0, 4, 5, 14]], path.vertices_mm[[0, 1, 1, 3]])
    back = np.linalg.norm(trace.points_mm - path.camera.center_mm, axis=1) * 1.00027 / C
    np.testing.assert_allclose(trace.arrival_ps - trace.event_time_ps, back, rtol=1e-13)
    assert (np.diff(trace.arrival_ps) >= 0).all()
    np.testing.assert_array_equal(trace.in_view, path.camera.sees(trace.points_mm))
    np.testing.assert_allclose(
        tr.event_time_from_arrival_on(trace, trace.arrival_ps[3]), trace.event_time_ps[3]
    )
    assert np.isnan(tr.event_time_from_arrival_on(trace, trace.arrival_ps[0] - 1.0))


def test_covariance_between_vertices_is_the_propagated_one() -> None:
    path = fakes.fake_path()
    trace = tr.trace_from_path(path, per_leg=5)
    f = 0.25
    jacobian = np.hstack([np.zeros((4, 4)), (1 - f) * np.eye(4), f * np.eye(4), np.zeros((4, 4))])
    np.testing.assert_allclose(
        trace.covariance[6], jacobian @ path.covariance @ jacobian.T, rtol=1e-12
    )


def test_error_ellipse_is_taken_across_the_leg() -> None:
    path = SimpleNamespace(
        vertices_mm=np.array([[0.0, 0, 0], [100, 0, 0]]),
        vertex_times_ps=np.array([0.0, 333.0]),
        covariance=np.diag([25.0, 0.04, 0.16, 1.0] * 2),
    )
    trace = tr.trace_from_path(path, per_leg=3)
    variances, axes = tr.across_axes(trace)
    np.testing.assert_allclose(variances[0], [0.16, 0.04])
    np.testing.assert_allclose(np.abs(axes[0]), [[0, 0, 1], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(trace.std_mm[1], 0.4 / np.sqrt(2))


@pytest.mark.parametrize("spoil", ["none", "nan", "shape"])
def test_a_path_without_errors_has_nan_errors(spoil: str) -> None:
    path = fakes.fake_path()
    covariance = {"none": None, "nan": path.covariance * np.nan, "shape": np.eye(3)}[spoil]
    bare = SimpleNamespace(
        vertices_mm=path.vertices_mm, vertex_times_ps=path.vertex_times_ps, covariance=covariance
    )
    trace = tr.trace_from_path(bare)
    assert not tr.has_errors(bare)
    assert np.isnan(trace.std_mm).all()
    assert np.isnan(trace.arrival_ps).all()  # no camera either


def test_nearest_on_leg_agrees_with_a_search(rng: np.random.Generator) -> None:
    start, end, center = rng.normal(size=(3, 3)) * 100
    rays = rng.normal(size=(20, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    got = tr.nearest_on_leg(rays, center, start, end)
    for ray, fraction in zip(rays, got, strict=True):
        f = fraction + np.linspace(-0.01, 0.01, 2001)
        points = start + f[:, None] * (end - start) - center
        distance = np.linalg.norm(points - (points @ ray)[:, None] * ray, axis=1)
        assert abs(f[np.argmin(distance)] - fraction) < 1e-5


def test_truth_held_against_itself_has_no_time_error() -> None:
    truth, camera = fakes.truth_record(), fakes.paper_camera()
    trace = tr.trace_from_path(truth, camera=camera)
    when = tr.true_event_time_along(trace, truth, camera=camera)
    np.testing.assert_allclose(when, trace.event_time_ps, atol=1e-6)


def test_a_path_that_starts_at_the_second_leg_is_compared_with_the_second_leg() -> None:
    truth, camera = fakes.truth_record(), fakes.paper_camera()
    late = SimpleNamespace(
        vertices_mm=truth.vertices_mm[1:], vertex_times_ps=truth.vertex_times_ps[1:] + 2.0
    )
    trace = tr.trace_from_path(late, camera=camera)
    when = tr.true_event_time_along(trace, truth, camera=camera)
    np.testing.assert_allclose(trace.event_time_ps - when, 2.0, atol=1e-6)


def test_places_of_pulses_lie_on_their_legs() -> None:
    path = fakes.fake_path()
    places = tr.places_from_path(path)
    row, col = path.camera.pixels_from_points(places.points_mm)
    # The nearest point of a leg to a ray lies within half a pixel and the path's error of it.
    assert np.abs(row - places.row).max() < 0.75
    assert np.abs(col - places.col).max() < 0.75
    np.testing.assert_allclose(
        places.measured_event_time_ps - places.event_time_ps, places.residual_ps, atol=1e-9
    )
    assert (places.length_mm > 0).all()


def test_pulses_of_no_leg_have_no_place() -> None:
    path = fakes.fake_path()
    table = path.residuals.copy()
    table["leg"][:3] = -1
    places = tr.places_from_path(replace(path, residuals=table))
    assert np.isnan(places.length_mm[:3]).all()
    assert np.isfinite(places.length_mm[3:]).all()


def test_position_is_unknown_before_and_after_the_flight() -> None:
    truth = fakes.truth_record()
    when = [truth.vertex_times_ps[0] - 1, truth.vertex_times_ps[1], truth.vertex_times_ps[-1] + 1]
    position = tr.position_at(truth, when)
    assert np.isnan(position[[0, 2]]).all()
    np.testing.assert_allclose(position[1], fakes.VERTICES_MM[1])
