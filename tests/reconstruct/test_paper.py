"""The paper's chain: its equations inverted, and its habits kept, on input without noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lightflight import flags
from lightflight.camera.model import Camera
from lightflight.errors import GeometryError
from lightflight.flight import (
    Medium,
    Source,
    arrival_time_from_propagation_time,
    propagation_time_from_projection,
)
from lightflight.path.error import path_error
from lightflight.reconstruct.fit.paper import angles_from_arrivals, paper_path
from lightflight.reconstruct.fit.paper_projection import projection_of_leg
from lightflight.reconstruct.legs.find import find_legs
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.recording.histograms import Histograms
from lightflight.timing.pulses.arrivals import Arrivals
from tests.path_fakes import PAPER_VERTICES, truth_of
from tests.reconstruct.fakes import PAPER, arrivals_of

CAMERA = Camera.facing_plane((32, 32))
START_PS = 2000.0
ROW_Y = -3.5 * 245.0 / 32
"""A height at which a leg in the plane z = 0 runs through pixel centres."""


def observed(arrivals: Arrivals) -> Sighting:
    """What the paper's chain looks at; it never opens the counts."""
    empty: Any = Histograms(np.zeros((*arrivals.shape, 1), dtype=np.uint8))
    blind = np.zeros(arrivals.shape, dtype=bool)
    return Sighting(empty, None, arrivals, arrivals.arrival_ps, blind)


def leg_at(angle_deg: float, *, y: float = ROW_Y) -> np.ndarray:
    start = np.array([-187.5, y, 0.0])
    run = np.array([np.cos(np.deg2rad(angle_deg)), 0.0, np.sin(np.deg2rad(angle_deg))])
    return np.array([start, start + 375.0 * run])


def reconstructed(arrivals, source, camera=CAMERA):
    sighting = observed(arrivals)
    legs = find_legs(arrivals, camera=camera)
    return paper_path([sighting], Setting(camera, source, Medium()), legs=legs)


class TestEquations:
    @pytest.mark.parametrize("seed", range(20))
    @pytest.mark.parametrize("index", [1.0, 1.33])
    def test_angles_are_those_that_went_into_eq_1_and_2(self, seed, index):
        """alpha -> t by Eq. 2 -> t_a by Eq. 1 -> alpha_i: the same to 1e-9 rad."""
        rng = np.random.default_rng(seed)
        start, camera = rng.normal(0, 100, 3), rng.normal((50.0, 0, 600.0), 50.0)
        normal = rng.normal((0, 0, 1.0), 0.1)
        normal /= np.linalg.norm(normal)
        sideways = rng.normal(0, 1, 3)
        along = sideways - (sideways @ normal) * normal
        along /= np.linalg.norm(along)
        # The viewing plane holds the camera, the start, and `along`; `upright` is its other axis.
        towards = camera - start
        upright = towards - (towards @ along) * along
        upright /= np.linalg.norm(upright)
        distance = float(np.linalg.norm(towards))
        theta = np.arcsin(towards @ along / distance)
        alpha = rng.uniform(-0.6, 0.6)
        length = rng.uniform(20.0, 400.0, 16)
        common = {
            "start_distance_mm": distance,
            "propagation_angle": alpha,
            "start_angle": theta,
            "group_index": index,
        }
        time = propagation_time_from_projection(length, **common)
        arrival = arrival_time_from_propagation_time(time, **common)
        meeting = start + length[:, np.newaxis] * along
        rays = meeting - camera
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        ahead = time > 0
        assert ahead.sum() > 3
        found = angles_from_arrivals(
            rays[ahead],
            arrival[ahead] + 7.0,
            start_mm=start,
            start_time_ps=7.0,
            along=along,
            upright=upright,
            camera_center_mm=camera,
            medium=Medium(index, index),
        )
        np.testing.assert_allclose(found, alpha, atol=1e-9)

    def test_a_ray_beside_the_plane_is_projected_into_it(self):
        arguments = {
            "start_mm": np.zeros(3),
            "start_time_ps": 0.0,
            "along": np.array([1.0, 0, 0]),
            "upright": np.array([0.0, 0, 1]),
            "camera_center_mm": np.array([0.0, 0, 500.0]),
            "medium": Medium(),
        }
        arrival = np.array([2500.0])
        ray = np.array([[0.3, 0.0, -1.0]]) / np.hypot(0.3, 1)
        beside = np.array([[0.3, 0.01, -1.0]]) / np.linalg.norm([0.3, 0.01, -1.0])
        np.testing.assert_allclose(
            angles_from_arrivals(beside, arrival, **arguments),
            angles_from_arrivals(ray, arrival, **arguments),
            atol=1e-12,
        )

    def test_light_too_early_has_no_angle(self):
        angle = angles_from_arrivals(
            np.array([[0.3, 0.0, -1.0]]) / np.hypot(0.3, 1),
            np.array([100.0]),
            start_mm=np.zeros(3),
            start_time_ps=0.0,
            along=np.array([1.0, 0, 0]),
            upright=np.array([0.0, 0, 1]),
            camera_center_mm=np.array([0.0, 0, 500.0]),
            medium=Medium(),
        )
        assert np.isnan(angle).all()


class TestProjection:
    def test_one_pixel_in_every_column_none_interpolated(self):
        """Columns counted from the middle lie at halves; rounding those once lost every other."""
        arrivals = arrivals_of(leg_at(5.0), CAMERA, start=START_PS, spot_px=0.6)
        (leg,) = find_legs(arrivals, camera=CAMERA)
        seen = projection_of_leg(leg, observed(arrivals), CAMERA)
        np.testing.assert_array_equal(np.rint(seen.cols), np.arange(32))
        assert not seen.interpolated.any()

    def test_a_steep_leg_in_the_picture_is_taken_row_by_row(self):
        vertices = np.array([[ROW_Y, -180.0, 0], [ROW_Y, 180.0, 10.0]])
        arrivals = arrivals_of(vertices, CAMERA, start=START_PS)
        (leg,) = find_legs(arrivals, camera=CAMERA)
        seen = projection_of_leg(leg, observed(arrivals), CAMERA)
        np.testing.assert_array_equal(np.rint(seen.rows), np.arange(32)[::-1])
        assert (np.diff(seen.arrival_ps) > 0).all()

    def test_bad_pixels_are_interpolated_and_say_so(self):
        arrivals = arrivals_of(leg_at(0.0), CAMERA, start=START_PS)
        bad = np.isin(arrivals.col, [8, 9, 20])
        words = np.where(bad, flags.TOO_WIDE, 0).astype(np.uint32)
        spoiled = replace(arrivals, flags=words, arrival_ps=arrivals.arrival_ps + 500.0 * bad)
        (leg,) = find_legs(spoiled, camera=CAMERA)
        seen = projection_of_leg(leg, observed(spoiled), CAMERA)
        np.testing.assert_array_equal(np.flatnonzero(seen.interpolated), [8, 9, 20])
        true = projection_of_leg(leg, observed(arrivals), CAMERA).arrival_ps
        # Linear between neighbours: off by the curvature of the arrival curve only.
        assert np.abs(seen.arrival_ps - true).max() < 1.0

    def test_bad_pixels_do_not_bend_the_projection(self):
        """One in ten pixels is blind, the brightest of a column among them: its neighbours' light
        stands in, or the centre of mass would jump to the next row."""
        rng = np.random.default_rng(3)
        arrivals = arrivals_of(leg_at(0.0), CAMERA, start=START_PS, spot_px=0.6)
        (leg,) = find_legs(arrivals, camera=CAMERA)
        blind = rng.random(CAMERA.shape) < 0.1
        blind[19, [2, 3, 28]] = True  # the leg's own row, by its ends
        lost = blind[arrivals.row, arrivals.col]
        words = np.where(lost, flags.SCREAMING, 0).astype(np.uint32)
        spoiled = replace(observed(replace(arrivals, flags=words)), blind=blind)
        (left,) = find_legs(spoiled.arrivals, camera=CAMERA)
        seen = projection_of_leg(left, spoiled, CAMERA)
        clean = projection_of_leg(leg, observed(arrivals), CAMERA)
        assert lost.sum() > 5
        assert np.abs(seen.rows - clean.rows[: len(seen.rows)]).max() < 0.02


class TestChain:
    @pytest.mark.parametrize("angle", [-10.0, -3.0, 0.0, 6.0, 10.0])
    def test_one_leg_without_noise(self, angle):
        vertices = leg_at(angle, y=0.0)
        source = Source(vertices[0], emission_time_ps=START_PS)
        path = reconstructed(arrivals_of(vertices, CAMERA, start=START_PS, spot_px=0.6), source)
        assert path.method == "paper"
        assert path.legs[0].paper_angle_deg == pytest.approx(angle, abs=0.03)
        assert path.vertex_times_ps[0] == START_PS
        assert np.isnan(path.goodness.chi2)
        assert path.goodness.n_rejected == 0

    def test_alpha_is_the_mean_and_its_error_the_scatter(self, rng):
        vertices = leg_at(4.0)
        source = Source(vertices[0], emission_time_ps=START_PS)
        exact = arrivals_of(vertices, CAMERA, start=START_PS)
        found, stated = [], []
        for _ in range(100):
            noise = exact.photon_std_ps * rng.normal(size=len(exact.row))
            path = reconstructed(replace(exact, arrival_ps=exact.arrival_ps + noise), source)
            found.append(path.legs[0].angle_deg)
            stated.append(path.legs[0].angle_std_deg)
        # 100 runs: the spread is known to 7 %, and five of these are a chance of 6e-7.
        assert np.std(found) == pytest.approx(np.mean(stated), rel=0.35)

    def test_emission_time_fitted(self):
        vertices = leg_at(5.0)
        arrivals = arrivals_of(vertices, CAMERA, start=START_PS, spot_px=0.6)
        path = reconstructed(arrivals, Source(vertices[0]))
        assert path.vertex_times_ps[0] == pytest.approx(START_PS, abs=2.0)
        assert path.legs[0].angle_deg == pytest.approx(5.0, abs=0.1)
        assert path.prior == "source known, emission time fitted"

    def test_the_papers_three_legs_without_noise(self):
        source = Source(PAPER_VERTICES[0], emission_time_ps=START_PS)
        arrivals = arrivals_of(PAPER_VERTICES, PAPER, start=START_PS, spot_px=0.6)
        path = reconstructed(arrivals, source, PAPER)
        assert path.n_legs == 3
        error = path_error(path, truth_of(PAPER_VERTICES), PAPER)
        # Lines through centres of mass of cut spots are the limit here, not times.
        assert error.position_rms_mm < 1.0
        assert error.event_time_rms_ps < 3.0
        for leg, true in zip(path.legs, np.diff(PAPER_VERTICES, axis=0), strict=True):
            elevation = np.rad2deg(np.arcsin(true[2] / np.linalg.norm(true)))
            assert leg.angle_deg == pytest.approx(elevation, abs=0.6)

    def test_entry_pixel_with_s_from_its_arrival_time(self):
        """Source unknown: the path starts on the first ray, at s = c (t_a - time of entry) / n."""
        vertices = leg_at(0.0)
        arrivals = arrivals_of(vertices, CAMERA, start=START_PS)
        entry = np.array([-122.5 + 245.0 / 64, ROW_Y, 0.0])
        flown = 1.00027 * np.linalg.norm(entry - vertices[0]) / 0.299792458
        source = Source(emission_time_ps=START_PS + flown)
        path = reconstructed(arrivals, source)
        np.testing.assert_allclose(path.vertices_mm[0], entry, atol=0.5)
        assert path.legs[0].angle_deg == pytest.approx(0.0, abs=0.2)

    def test_repeats_are_averaged_in_time(self):
        vertices = leg_at(3.0)
        source = Source(vertices[0], emission_time_ps=START_PS)
        arrivals = arrivals_of(vertices, CAMERA, start=START_PS)
        early, late = (
            replace(arrivals, arrival_ps=arrivals.arrival_ps + shift) for shift in (-4.0, 4.0)
        )
        legs = find_legs(early, camera=CAMERA)
        setting = Setting(CAMERA, source, Medium())
        both = paper_path([observed(early), observed(late)], setting, legs=legs)
        middle = reconstructed(arrivals, source)
        assert both.legs[0].angle_deg == pytest.approx(middle.legs[0].angle_deg, abs=1e-6)

    def test_the_path_ends_where_it_leaves_the_view(self):
        vertices = leg_at(5.0)
        source = Source(vertices[0], emission_time_ps=START_PS)
        path = reconstructed(arrivals_of(vertices, CAMERA, start=START_PS), source)
        _, col = CAMERA.pixels_from_points(path.vertices_mm[-1])
        assert float(col) == pytest.approx(31.5, abs=1e-6)

    def test_residuals_are_of_the_pixels_used(self):
        vertices = leg_at(5.0)
        source = Source(vertices[0], emission_time_ps=START_PS)
        path = reconstructed(arrivals_of(vertices, CAMERA, start=START_PS, spot_px=0.6), source)
        table = path.residuals
        np.testing.assert_array_equal(table["col"], np.arange(32))
        np.testing.assert_allclose(
            table["residual_ps"], table["arrival_ps"] - table["model_ps"], atol=1e-9
        )
        assert np.abs(table["residual_ps"]).max() < 2.0
        assert (table["leg"] == 0).all()


class TestRefusals:
    def test_a_start_of_the_users(self):
        setting = Setting(CAMERA, Source((0, 0, 0)), Medium())
        with pytest.raises(ValueError, match="method='paper' finds its own legs: leave start out"):
            paper_path([observed(arrivals_of(leg_at(0.0), CAMERA))], setting, legs=None)

    def test_nothing_known(self):
        arrivals = arrivals_of(leg_at(0.0), CAMERA, start=START_PS)
        with pytest.raises(GeometryError, match="give position_mm or emission_time_ps"):
            reconstructed(arrivals, Source())

    def test_light_before_the_time_of_entry(self):
        arrivals = arrivals_of(leg_at(0.0), CAMERA, start=START_PS)
        with pytest.raises(GeometryError, match="arrives before the time of entry"):
            reconstructed(arrivals, Source(emission_time_ps=50_000.0))

    def test_a_source_too_far_for_the_times(self):
        vertices = leg_at(0.0)
        arrivals = arrivals_of(vertices, CAMERA, start=START_PS)
        with pytest.raises(GeometryError, match="leg 1: no angle explains its arrival times"):
            reconstructed(arrivals, Source(vertices[0], emission_time_ps=START_PS + 3000.0))
