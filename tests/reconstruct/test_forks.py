"""Paths that fork: two legs leave a beam splitter, on one clock.

The model and the fit are shown here from a start that is roughly right; recordings are those of an
oracle that shares no line with the package (`tests/oracles/splitter.py`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.flight import Medium
from lightflight.reconstruct.fit.ends import freedom_at
from lightflight.reconstruct.fit.joint import fit_joint
from lightflight.reconstruct.model.footing import corner_distances
from lightflight.reconstruct.model.geometry import (
    PathState,
    arrival_jacobian,
    footprints,
    travelled_jacobian,
    vertex_time_jacobian,
)
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.offsets import line_offsets
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import vertices_by_parameters
from lightflight.reconstruct.sightings import sighting_from_histograms
from tests.oracles.refracted_border import camera_told
from tests.oracles.splitter import Splitter, splitter_world
from tests.reconstruct.fakes import C, camera_like, path_in_view
from tests.reconstruct.test_geometry import central

SEEDS = range(6)
"""Fixed before looking."""


def forked() -> PathState:
    """Four legs: two to a fork at vertex 2, one on, and one aside from there."""
    return replace(path_in_view(camera_like(3), 4, 11), forks=((3, 2),))


class TestTree:
    def test_legs_begin_where_their_light_comes_from(self):
        state = forked()
        assert state.leg_starts.tolist() == [0, 1, 2, 2]
        assert state.last_legs == (2, 3)
        assert state.corners_seen == (1,)
        np.testing.assert_array_equal(
            state.steps_mm[3], state.vertices_mm[4] - state.vertices_mm[2]
        )

    def test_a_chain_is_the_tree_without_forks(self):
        chain = path_in_view(camera_like(3), 4, 11)
        assert chain.leg_starts.tolist() == [0, 1, 2, 3]
        assert chain.last_legs == (3,)
        assert chain.corners_seen == (1, 2, 3)
        np.testing.assert_allclose(
            chain.legs_before @ np.linalg.norm(chain.steps_mm, axis=1), chain.travelled_mm
        )

    def test_both_arms_count_from_the_fork(self):
        state, medium = forked(), Medium(1.3, 1.0)
        times = state.vertex_times_ps(medium)
        for end in (3, 4):
            way = np.linalg.norm(state.vertices_mm[end] - state.vertices_mm[2])
            assert times[end] - times[2] == pytest.approx(1.3 * way / C, rel=1e-12)

    def test_a_corner_more_and_away_again_changes_no_number(self):
        state = forked()
        for leg in range(4):
            corner = 0.5 * (state.vertices_mm[leg + 1] + state.vertices_mm[state.leg_starts[leg]])
            longer = state.with_corner(leg, corner)
            again = longer.without((leg + 1,))
            assert again.forks == state.forks
            np.testing.assert_array_equal(again.vertices_mm, state.vertices_mm)
            # Straight through the new corner every old vertex keeps its time.
            kept = np.delete(longer.vertex_times_ps(Medium()), leg + 1)
            np.testing.assert_allclose(kept, state.vertex_times_ps(Medium()), atol=1e-9)

    def test_every_end_moves_in_a_plane_and_the_fork_freely(self):
        setting = Setting(
            camera_like(3), lf.Source((0.0, 0.0, 0.0), emission_time_ps=0.0), Medium()
        )
        labels = freedom_at(forked(), setting).labels
        assert labels == (
            *(f"corner {vertex} {axis}" for vertex in (1, 2) for axis in "xyz"),
            *(f"exit {vertex} {move}" for vertex in (3, 4) for move in ("depth", "height")),
        )


class TestDerivatives:
    def test_ways_and_times_of_vertices(self):
        state, medium = forked(), Medium(1.3, 1.0)

        def table(step):
            at = state.moved(step)
            return np.column_stack((at.vertices_mm, at.vertex_times_ps(medium))).ravel()

        found = central(lambda step: state.moved(step).travelled_mm, 16, 1e-3)[:, :-1]
        np.testing.assert_allclose(travelled_jacobian(state)[:, :-1], found, atol=1e-9)
        expected = central(table, 16, 1e-3)
        np.testing.assert_allclose(vertex_time_jacobian(state, medium), expected, atol=1e-8)

    def test_arrivals_and_lines_of_both_arms(self):
        state, medium, camera = forked(), Medium(1.3, 1.1), camera_like(3)
        legs = np.repeat(np.arange(4), 5)
        share = np.tile(np.linspace(0.1, 0.9, 5), 4)[:, np.newaxis]
        points = state.vertices_mm[state.leg_starts[legs]] + share * state.steps_mm[legs]
        row, col = (np.asarray(each) for each in camera.pixels_from_points(points))
        where = {"camera": camera, "legs": legs}

        def arrival(step):
            at = state.moved(step)
            return footprints(at, medium=medium, rows=row, cols=col, **where).arrival_ps

        print_, by_state = arrival_jacobian(state, medium=medium, rows=row, cols=col, **where)
        np.testing.assert_allclose(print_.fraction, share[:, 0], atol=1e-9)
        np.testing.assert_allclose(by_state, central(arrival, 16, 1e-3), atol=1e-5)

        anchors = undistorted_px(camera, row + 0.3, col - 0.2)

        def offset(step):
            return line_offsets(state.moved(step), anchors=anchors, **where)[0]

        by_state = line_offsets(state, anchors=anchors, **where)[1]
        np.testing.assert_allclose(by_state, central(offset, 16, 1e-3), atol=1e-6)

    def test_light_is_cut_at_the_fork_on_all_three_legs(self):
        state, camera = forked(), camera_like(3)
        row, col = (np.atleast_1d(each) for each in camera.pixels_from_points(state.vertices_mm[2]))
        for leg, side in ((1, "after"), (2, "before"), (3, "before")):
            print_ = footprints(state, camera=camera, medium=Medium(), legs=leg, rows=row, cols=col)
            cut = corner_distances(state, print_, leg, camera=camera)
            assert getattr(cut, side)[0] == pytest.approx(0.0, abs=1e-6)
            # It follows the fork's own three numbers.
            moves = np.flatnonzero(np.any(getattr(cut, f"{side}_by_state"), axis=0))
            assert set(moves) <= {6, 7, 8}
        assert not np.isfinite(cut.after[0])


def fitted(world: Splitter, seed: int):
    """The joint fit from a start some mm off, and its setting."""
    hist = lf.Histograms(
        world.recording(seed),
        bin_width_ps=world.base.clock.width,
        laser_period_ps=world.base.clock.period,
    )
    source = lf.Source(tuple(world.source_mm), emission_time_ps=world.base.emission_time_ps)
    setting = Setting(camera_told(world.base), source, Medium())
    sighting = sighting_from_histograms(
        hist, setting, timing=lf.TimingCalibration.nominal(hist), background=None,
        exclude_mask=None, least_squares=False,
    )  # fmt: skip
    off = np.random.default_rng([seed, 7]).normal(0.0, 3.0, (4, 3))
    off[0] = 0.0
    start = PathState(world.vertices_mm + off, world.base.emission_time_ps, forks=((2, 1),))
    return fit_joint([sighting], start, setting, legs=None), setting


class TestRecovery:
    def test_splitter_and_both_arms_are_right_in_stated_errors(self):
        """Splitter (3 numbers) and the direction of each arm (2), of six recordings: chi-square
        with 42 degrees of freedom, each tail cut at 5e-5; rms pull about 1 +- 0.11."""
        total = 0.0
        for seed in SEEDS:
            world = splitter_world(seed)
            fit, setting = fitted(world, seed)
            solution = fit.solution
            state = solution.state
            rows, by = vertices_by_parameters(
                state, setting.medium, fit.freedom.basis, solution.errors,
                first=len(solution.covariance) - len(solution.shared),
            )  # fmt: skip
            covariance = by @ solution.covariance[np.ix_(rows, rows)] @ by.T
            xyz = np.arange(16).reshape(4, 4)[:, :3]
            true, gain, off = world.vertices_mm, [], []
            for axis in np.eye(3):
                gain.append(_row(xyz[1], axis))
                off.append(axis @ (state.vertices_mm[1] - true[1]))
            for end in (2, 3):
                step = state.vertices_mm[end] - state.vertices_mm[1]
                length, along = np.linalg.norm(step), step / np.linalg.norm(step)
                right = true[end] - true[1]
                right = right / np.linalg.norm(right)
                for across in np.linalg.svd(along[np.newaxis])[2][1:]:
                    gain.append((_row(xyz[end], across) - _row(xyz[1], across)) / length)
                    off.append(across @ (along - right))
            of_these = np.array(gain) @ covariance @ np.array(gain).T
            total += float(np.array(off) @ np.linalg.solve(of_these, np.array(off)))
            assert set(fit.times.leg[fit.times.weight > 0]) == {0, 1, 2}
        low, high = chi2.ppf(np.array([5e-5, 1 - 5e-5]), 7 * len(SEEDS))
        assert low < total < high


def _row(columns: np.ndarray, direction: np.ndarray) -> np.ndarray:
    row = np.zeros(16)
    row[columns] = direction
    return row
