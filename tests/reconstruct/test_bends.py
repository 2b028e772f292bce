"""Bent legs: their geometry against marched curves and finite steps, and fits of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from lightflight.flight import Medium
from lightflight.path.bends import Bend, BentCourse, checked_bends, shapes_at
from lightflight.path.tables import Goodness
from lightflight.path.verdict import Level
from lightflight.reconstruct.fit.bent import with_axes_across
from lightflight.reconstruct.model.geometry import (
    PathState,
    arrival_jacobian,
    footprints,
    vertex_time_jacobian,
)
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.offsets import line_offsets
from tests.oracles.bent import (
    BentScene,
    axes_of_leg,
    bent_scene,
    bow_freedoms,
    curved_arrival_ps,
)
from tests.oracles.refracted import in_picture, positions_at
from tests.oracles.refracted_border import camera_told, histograms, what_the_user_tells
from tests.oracles.refracted_bound import bound

AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
MEDIUM = Medium(1.3, 1.00027)


def bent_state(seed: int) -> PathState:
    """Two legs over the picture of the paper's camera, the first one bent by three shapes."""
    rng = np.random.default_rng([seed, 8])
    vertices = np.array([[0, 0, 0], [375, 25, 50], [0, 50, 10]]) + rng.normal(0, 5.0, (3, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    axes = turn - np.outer(turn @ [1, 0, 0], [1, 0, 0])
    axes = np.linalg.qr(axes.T)[0].T
    bend = Bend(0, axes, rng.normal(0, [12.0, 4.0, 2.0], (2, 3)))
    return PathState(vertices, 1000.0, bends=(bend,))


def pixels_on(state: PathState, camera, n: int = 40):
    """Legs, fractions, rows and columns of places on the path."""
    legs = np.repeat([0, 1], n)
    fraction = np.tile(np.linspace(0.25, 0.75, n), 2)
    row, col = camera.pixels_from_points(state.points_mm(legs, fraction))
    return legs, fraction, row, col


class TestTheCurve:
    def test_its_length_and_direction_are_those_of_small_chords(self):
        course = bent_state(1).courses[0][0]
        fine = np.linspace(0.0, 1.0, 200_001)
        chords = np.linalg.norm(np.diff(course.points_mm(fine), axis=0), axis=1)
        way = np.append(0.0, np.cumsum(chords))
        np.testing.assert_allclose(course.ways_mm(fine[::20_000]), way[::20_000], rtol=1e-9)
        steps = np.diff(course.points_mm(fine[:2]), axis=0) / fine[1]
        np.testing.assert_allclose(course.tangents_mm(np.zeros(1)), steps, rtol=1e-3)

    def test_places_are_found_by_their_length(self):
        course = bent_state(2).courses[0][0]
        fraction = np.linspace(-0.3, 1.4, 18)
        found = course.fractions_at(course.ways_mm(fraction))
        np.testing.assert_allclose(found, fraction, atol=1e-12)

    def test_straight_is_its_exact_limit(self):
        course = BentCourse(
            np.zeros(3), np.array([3.0, 4.0, 12.0]), Bend(0, AXES, np.zeros((2, 4)))
        )
        np.testing.assert_allclose(course.ways_mm(np.array([-0.5, 0.25, 2.0])), [-6.5, 3.25, 26.0])

    def test_a_part_is_the_same_curve(self):
        course = bent_state(3).courses[0][0]
        part = course.part(0.2, 0.9)
        inside = np.linspace(0.0, 1.0, 15)
        np.testing.assert_allclose(
            part.points_mm(inside), course.points_mm(0.2 + 0.7 * inside), atol=1e-9
        )

    def test_axes_follow_the_line_between_its_ends_and_the_curve_stays(self):
        """What shapes did along the line, by a degree, is left out; so is depth of spare shapes."""
        state, camera = bent_state(5), lf.Camera.facing_plane()
        (bend,) = state.bends
        flat = replace(bend, coefficients_mm=bend.coefficients_mm * [[1, 1, 1], [1, 1, 0]])
        state = replace(state, bends=(replace(flat, more_in_picture=1),))
        turned = with_axes_across(state, camera)
        (own,) = checked_bends(turned.bends, 2, ())
        along = turned.steps_mm[0] / np.linalg.norm(turned.steps_mm[0])
        np.testing.assert_allclose(own.axes @ along, 0.0, atol=1e-12)
        assert own.coefficients_mm[1, 2] == 0.0
        had = flat.vectors_mm[:2]
        across = had - np.outer(had @ along, along)
        np.testing.assert_allclose(own.vectors_mm[:2], across, atol=1e-9)

    def test_the_first_shape_s_coefficient_is_the_sagitta(self):
        assert shapes_at(np.array([0.5]), 3)[0].tolist() == [1.0, 0.0, -0.5]

    def test_an_end_that_is_moved_along_leaves_the_flight_as_it_was(self):
        state = bent_state(4)
        cut = state.prolonged(0, 0.1, MEDIUM, at_end=False)
        whole_ps, cut_ps = (one.vertex_times_ps(MEDIUM) for one in (state, cut))
        np.testing.assert_allclose(cut_ps[1:], whole_ps[1:], atol=1e-8)
        np.testing.assert_allclose(
            cut.points_mm(0, np.array([0.5])), state.points_mm(0, np.array([0.55])), atol=1e-9
        )


class TestTheModel:
    def test_arrival_times_are_those_of_a_marched_curve(self):
        """The oracle marches 4,000 chords; the package integrates."""
        scene = bent_scene(legs=3, sagitta_mm=20.0, way="depth")
        chord = np.diff(scene.vertices_mm, axis=0)[0]
        axes = np.linalg.qr(np.column_stack((chord, scene.bows_mm[0][0], [0.0, 1.0, 0.0])))[0].T[1:]
        bend = Bend(0, axes, (axes @ scene.bows_mm[0].T))
        state = PathState(scene.vertices_mm, scene.emission_time_ps, bends=(bend,))
        camera, medium = camera_told(scene), Medium(scene.path_group_index, scene.group_front)
        for leg in range(3):
            fraction = np.linspace(0.3, 0.7, 9)
            row, col = camera.pixels_from_points(scene.points_on(leg, fraction))
            found = footprints(state, camera=camera, medium=medium, legs=leg, rows=row, cols=col)
            np.testing.assert_allclose(found.fraction, fraction, atol=1e-6)
            expected = curved_arrival_ps(scene, leg, fraction)
            np.testing.assert_allclose(found.arrival_ps, expected, atol=2e-4)

    @pytest.mark.parametrize("seed", range(3))
    def test_derivatives_are_those_of_finite_steps(self, seed):
        state, camera = bent_state(seed), camera_told(bent_scene(legs=1, sagitta_mm=1, way="depth"))
        legs, _, row, col = pixels_on(state, camera)
        anchors = undistorted_px(camera, row, col)
        where = {"camera": camera, "legs": legs}

        def model(step):
            at = state.moved(step)
            print_ = footprints(at, medium=MEDIUM, rows=row, cols=col, **where)
            offset = line_offsets(at, anchors=anchors, **where)[0]
            vertices = np.column_stack((at.vertices_mm, at.vertex_times_ps(MEDIUM))).ravel()
            return print_.arrival_ps, offset, vertices

        jacobians = (
            arrival_jacobian(state, medium=MEDIUM, rows=row, cols=col, **where)[1],
            line_offsets(state, anchors=anchors, **where)[1],
            vertex_time_jacobian(state, MEDIUM),
        )
        h = 1e-4
        for k in range(state.size):
            step = h * np.eye(state.size)[k]
            both = zip(model(step), model(-step), strict=True)
            for (ahead, behind), jacobian in zip(both, jacobians, strict=True):
                steps = (ahead - behind) / (2 * h)
                np.testing.assert_allclose(jacobian[:, k], steps, rtol=2e-4, atol=2e-5)

    def test_the_state_s_vector_moves_with_it(self):
        state = bent_state(5)
        step = np.arange(state.size, dtype=float)
        moved = state.moved(step).vector - state.vector
        np.testing.assert_allclose(moved, step, atol=1e-9)

    def test_legs_beside_a_bent_one_are_untouched(self):
        state, camera = bent_state(6), camera_told(bent_scene(legs=1, sagitta_mm=1, way="depth"))
        legs, _, row, col = pixels_on(state, camera)
        straight = replace(state, bends=())
        own = legs == 1
        where = {"camera": camera, "medium": MEDIUM, "legs": 1, "rows": row[own], "cols": col[own]}
        for one, other in ((state, straight),):
            a, b = (footprints(s, **where) for s in (one, other))
            assert np.array_equal(a.fraction, b.fraction)
            assert np.array_equal(a.lateral_px, b.lateral_px)

    def test_corners_are_added_and_dropped_beside_bends(self):
        state = bent_state(7)
        assert state.with_corner(1, np.array([200.0, 40.0, 20.0])).bends[0].leg == 0
        assert state.with_corner(0, np.array([200.0, 10.0, 20.0])).bends == ()
        assert state.without([1]).bends == ()


def squared_pulls(path: lf.LightPath, scene: BentScene) -> tuple[float, int]:
    """Sum of squared pulls of the place in the middle of the bent leg's view, and their number."""
    ends = scene.vertex_times_ps
    times = np.linspace(ends[0], ends[1], 200)[:-1]
    true = positions_at(scene, times)
    told = path.position_at(times)
    seen = np.flatnonzero(in_picture(scene, true) & np.isfinite(told[:, 0]))
    k = seen[len(seen) // 2]
    variance, axes = np.linalg.eigh(path.position_covariance_at(times[[k]])[0])
    known = variance > 1e-6 * variance.max()
    pulls = (axes.T @ (told - true)[k])[known] / np.sqrt(variance[known])
    return float(np.sum(pulls**2)), int(known.sum())


def rough_start(scene: BentScene, call: dict[str, Any], seed: int) -> lf.LightPath:
    """Vertices off by 2 mm, the sagitta by 15 %."""
    rng = np.random.default_rng([seed, 29])
    vertices = np.array(scene.vertices_mm)
    vertices[1:] += rng.normal(0.0, 2.0, vertices[1:].shape)
    axes = np.stack(axes_of_leg(scene, 0))
    bends = (Bend(0, axes, 0.85 * axes @ scene.bows_mm[0].T),)
    state = PathState(vertices, scene.emission_time_ps, bends=bends)
    n = 4 * len(vertices)
    return lf.LightPath(
        vertices, state.vertex_times_ps(call["medium"]), np.zeros((n, n)), camera=call["camera"],
        source=call["source"], medium=call["medium"], bends=bends,
        goodness=Goodness(0.0, 0, 0, 0, 0.0, 0.0, False),
    )  # fmt: skip


class TestFits:
    @pytest.mark.parametrize(
        ("way", "sagitta"), [pytest.param("picture", 20.0, marks=pytest.mark.long), ("depth", 5.0)]
    )
    def test_errors_and_stated_errors_reach_the_bound_of_the_true_curve(self, way, sagitta):
        """Two recordings of one leg: false alarm 1e-4 for pulls; stated to 5 % of the bound."""
        scene = bent_scene(legs=1, sagitta_mm=sagitta, way=way)
        least = bound(scene, also=bow_freedoms(scene)).position_rms_mm
        total, dof = 0.0, 0
        for seed in range(2):
            hist = histograms(scene, seed)
            call = what_the_user_tells(scene, hist)
            path = lf.reconstruct(hist, start=rough_start(scene, call, seed), **call)
            own, n = squared_pulls(path, scene)
            total, dof = total + own, dof + n
            sampled = path.sample(300)
            seen = sampled["in_view"]
            stated2 = sum(sampled[f"{axis}_std_mm"][seen] ** 2 for axis in "xyz")
            assert np.sqrt(stated2.mean()) == pytest.approx(least, rel=0.05)
            assert path.verdict.level is Level.TRUST
        assert chi2.ppf(5e-5, dof) < total < chi2.ppf(1.0 - 5e-5, dof)

    @pytest.mark.usefixtures("unexamined", "nothing_twice")
    def test_photon_knows_bent_legs(self):
        scene = bent_scene(legs=1, sagitta_mm=5.0, way="picture", photons=400.0)
        hist = histograms(scene, 3)
        call = what_the_user_tells(scene, hist)
        path = lf.reconstruct(hist, start=rough_start(scene, call, 3), method="photon", **call)
        total, dof = squared_pulls(path, scene)
        assert path.method == "photon"
        assert total < chi2.ppf(1.0 - 1e-4, dof)

    def test_a_millimetre_of_sagitta_is_found_untold(self):
        scene = bent_scene(legs=1, sagitta_mm=1.0, way="picture")
        hist = histograms(scene, 4)
        with pytest.warns(SuspectDataWarning, match="leg 1 by"):
            path = lf.reconstruct(hist, **what_the_user_tells(scene, hist))
        (bend,) = path.bends
        # A parabola's sagitta over the whole leg, of which the field of view is a part.
        whole = np.linalg.norm(scene.bows_mm[0][0])
        length = np.linalg.norm(np.diff(scene.vertices_mm, axis=0))
        drawn = np.linalg.norm(path.vertices_mm[1] - path.vertices_mm[0])
        sagitta = np.linalg.norm(bend.coefficients_mm[:, 0]) * (length / drawn) ** 2
        assert sagitta == pytest.approx(whole, rel=0.1)
        # A lens that bows the line looks the same.
        assert path.verdict.level is Level.CHECK

    def test_one_leg_s_bend_in_depth_is_not_told_from_speed_unless_it_is_free(self):
        """Speed and a bend in depth are one direction of the data."""
        scene = bent_scene(legs=1, sagitta_mm=5.0, way="depth", photons=4_000.0)
        hist = histograms(scene, 5)
        call = what_the_user_tells(scene, hist)
        with pytest.warns(SuspectDataWarning):
            told = lf.reconstruct(hist, **call)
        assert told.bends == ()
        assert told.verdict.level is Level.CONTRADICTED
        free = lf.reconstruct(hist, free=("bend",), **call)
        assert [bend.leg for bend in free.bends] == [0]
        total, dof = squared_pulls(free, scene)
        assert total < chi2.ppf(1.0 - 1e-4, dof)

    @pytest.mark.parametrize(
        ("way", "sagitta"), [("picture", 20.0), pytest.param("depth", 5.0, marks=pytest.mark.long)]
    )
    def test_bounds_of_a_bent_path_are_those_of_the_oracle(self, way, sagitta):
        scene = bent_scene(legs=1, sagitta_mm=sagitta, way=way)
        call = what_the_user_tells(scene, histograms(scene, 0))
        rough = rough_start(scene, call, 0)
        axes = rough.bends[0].axes
        true = replace(
            rough,
            vertices_mm=scene.vertices_mm,
            vertex_times_ps=scene.vertex_times_ps,
            bends=(Bend(0, axes, axes @ scene.bows_mm[0].T),),
        )
        found = lf.bounds(
            true,
            photons_per_pixel=scene.photons,
            spot_std_px=scene.spot_std_px,
            pulse_std_ps=scene.pulse_std_ps,
            code_width_ps=scene.clock.width,
            background_per_code=scene.background_per_ps * scene.clock.width,
        )
        least = bound(scene, also=bow_freedoms(scene)).position_rms_mm
        assert found.position_rms_mm == pytest.approx(least, rel=0.03)
        assert found.path.bends
