"""What a fit may move, what holds it, and where a leg leaves the view."""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.camera.model import Camera
from lightflight.flight import Source
from lightflight.reconstruct.fit.result import prior_in_words
from lightflight.reconstruct.fit.statements import statements_from_covariance
from lightflight.reconstruct.model.freedom import (
    end_in_picture,
    freedom_of_path,
    view_end,
)
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.told import checked_waypoints
from tests.path_fakes import PAPER_VERTICES
from tests.reconstruct.fakes import camera_like

CAMERA = Camera.facing_plane((32, 32))
STATE = PathState(PAPER_VERTICES, 2000.0)
PLANE = np.eye(3)[:, :2]


def freedom(source, waypoints=()):
    return freedom_of_path(
        STATE, source=source, waypoints=waypoints, start_basis=PLANE, end_bases=(PLANE,)
    )


class TestColumns:
    @pytest.mark.parametrize(
        ("source", "first"),
        [
            (Source((0, 0, 0), emission_time_ps=0.0), ()),
            (Source((0, 0, 0)), ("emission time",)),
            (Source((0, 0, 0), emission_time_ps=0.0, emission_time_std_ps=1.0), ("emission time",)),
            (
                Source((0, 0, 0), position_std_mm=(1, 0, 2), emission_time_ps=0.0),
                ("source x", "source z"),
            ),
            (Source(), ("entry depth", "entry height", "entry time")),
            (Source(emission_time_ps=0.0), ("entry depth", "entry height", "entry time")),
        ],
    )
    def test_what_is_unknown_moves(self, source, first):
        free = freedom(source)
        corners = tuple(f"corner {k} {axis}" for k in (1, 2) for axis in "xyz")
        assert free.labels == (*first, *corners, "exit depth", "exit height")
        assert free.basis.shape == (13, len(free.labels))
        assert np.linalg.matrix_rank(free.basis) == len(free.labels)

    def test_priors_hold_the_state_where_it_was_measured(self):
        source = Source(
            (1.0, 2.0, 3.0),
            position_std_mm=(0.5, 0.0, 2.0),
            emission_time_ps=1990.0,
            emission_time_std_ps=4.0,
        )
        free = freedom(source, ((2, (7.0, 8.0, 9.0), 0.1),))
        assert len(free.prior_values) == 2 + 1 + 3
        misfit = free.prior_values - free.prior_rows @ STATE.vector
        at_vertex = (np.array([7.0, 8.0, 9.0]) - PAPER_VERTICES[2]) / 0.1
        np.testing.assert_allclose(misfit, [1 / 0.5, 3 / 2.0, -10 / 4.0, *at_vertex], atol=1e-9)

    def test_an_exact_source_needs_no_prior(self):
        assert len(freedom(Source((0, 0, 0), emission_time_ps=0.0)).prior_values) == 0

    def test_a_vertex_there_is_not(self):
        with pytest.raises(ValueError, match="the path found has vertices 0 to 3"):
            freedom(Source((0, 0, 0)), ((4, (0.0, 0, 0), 1.0),))

    def test_waypoints_come_back_as_plain_numbers(self):
        vertex, position, std = checked_waypoints([(int(np.int64(1)), [1, 2, 3], 2)], 3)[0]
        assert (vertex, std) == (1, 2.0)
        np.testing.assert_array_equal(np.asarray(position), [1.0, 2.0, 3.0])


class TestViewEnds:
    @pytest.mark.parametrize("seed", range(4))
    def test_a_line_leaves_at_the_outer_edge_of_a_pixel(self, seed):
        camera = camera_like(seed)
        rng = np.random.default_rng(seed)
        inside = camera.center_mm + 600.0 * camera.rays_from_pixels(15.0, 14.0)
        direction = np.cross(inside - camera.center_mm, rng.normal(size=3))
        direction /= np.linalg.norm(direction)
        end = view_end(camera, inside, direction)
        assert end is not None
        row, col = (float(x) for x in camera.pixels_from_points(end.position_mm))
        edges = np.array([row + 0.5, 31.5 - row, col + 0.5, 31.5 - col])
        assert abs(edges).min() < 1e-6
        np.testing.assert_allclose(end.basis.T @ end.basis, np.eye(2), atol=1e-9)
        # Both free directions keep to the edge: the ray, and along the edge of the picture.
        for step in end.basis.T:
            moved = camera.pixels_from_points(end.position_mm + 0.5 * step)
            away = np.array([moved[0] + 0.5, 31.5 - moved[0], moved[1] + 0.5, 31.5 - moved[1]])
            assert abs(away[np.argmin(abs(edges))]) < 0.02

    def test_a_line_that_never_leaves_has_no_end(self):
        axis = -CAMERA.backward_axis
        assert view_end(CAMERA, CAMERA.center_mm + 300.0 * axis, axis) is None

    def test_a_point_out_of_view_has_none(self):
        assert view_end(CAMERA, np.array([900.0, 0, 0]), np.array([1.0, 0, 0])) is None

    def test_an_end_within_the_picture_moves_across_the_flight(self):
        end = end_in_picture(CAMERA, np.array([20.0, 10.0, 0.0]), (1.0, 0.0))
        row, col = CAMERA.pixels_from_points(end.position_mm + end.basis[:, 1])
        start_row, start_col = CAMERA.pixels_from_points(end.position_mm)
        assert abs(float(row - start_row)) > 0.1
        assert float(col) == pytest.approx(float(start_col), abs=1e-3)


class TestWords:
    @pytest.mark.parametrize(
        ("source", "words"),
        [
            (Source(), "source unknown"),
            (Source((0, 0, 0)), "source known, emission time fitted"),
            (Source((0, 0, 0), emission_time_ps=1.0), "source known, emission time known"),
            (
                Source((0, 0, 0), position_std_mm=1, emission_time_ps=1.0, emission_time_std_ps=3),
                "source ± 1 mm, emission time ± 3 ps",
            ),
        ],
    )
    def test_every_figure_names_its_prior(self, source, words):
        assert prior_in_words(source) == words

    def test_confounded_pairs_are_named_strongest_first(self):
        covariance = np.array([[1.0, 0.999, 0.0], [0.999, 1.0, 0.0], [0.0, 0.0, 4.0]])
        (said,) = statements_from_covariance(covariance, ("entry depth", "entry time", "corner"))
        assert said == "Entry depth and entry time are confounded (ρ = 0.999): give one of them."

    def test_what_is_hardly_fixed(self):
        covariance = np.diag([30.0**2, 5.0**2, 100.0**2])
        said = statements_from_covariance(covariance, ("exit depth", "corner 1 x", "entry time"))
        assert said == (
            "The exit depth is hardly fixed by these data (± 30 mm).",
            "The entry time is hardly fixed by these data (± 100 ps).",
        )

    def test_an_exact_parameter_is_no_partner(self):
        assert statements_from_covariance(np.zeros((2, 2)), ("a", "b")) == ()
