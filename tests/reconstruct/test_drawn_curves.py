"""Legs along told curves: what places say of a path, and fits of curve and index along them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.errors import GeometryError, LimitError, NothingFoundError, SuspectDataWarning
from lightflight.path.bends import Bend
from lightflight.path.verdict import Level
from lightflight.reconstruct.model.drawn import told_of_curve
from lightflight.reconstruct.model.geometry import PathState
from tests.oracles.bent import ArcScene, BentScene, arc_scene, bent_scene, measured_places
from tests.oracles.refracted_border import histograms, what_the_user_tells
from tests.reconstruct.test_bends import squared_pulls

INDEX = 1.47
AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def arch() -> PathState:
    """A parabola of 30 mm on 300, along x."""
    vertices = np.array([[0.0, 0.0, 0.0], [300.0, 0.0, 0.0]])
    return PathState(vertices, 0.0, bends=(Bend(0, AXES, np.array([[30.0], [-10.0]])),))


def drawn_on(state: PathState, **errors: float) -> lf.DrawnCurve:
    return lf.DrawnCurve(state.points_mm(0, np.linspace(0.02, 0.98, 15)), **errors)


class TestTheRecord:
    def test_a_circle_keeps_its_radius_and_turns_by_the_right_hand(self):
        curve = lf.DrawnCurve.circle(
            (50.0, 0.0, 3.0), (0.0, 0.0, 9.0), (0.0, 0.0, 2.0), 90.0, point_std_mm=0.1
        )
        places = curve.places_mm
        np.testing.assert_allclose(np.hypot(places[:, 0], places[:, 1]), 50.0)
        np.testing.assert_allclose(places[-1], [0.0, 50.0, 3.0], atol=1e-12)

    def test_a_parabola_has_its_sagitta_in_the_middle(self):
        curve = lf.DrawnCurve.parabola(
            (0.0, 0.0, 0.0), (100.0, 0.0, 0.0), (0.0, 5.0, 1.0), leg=1, point_std_mm=0.1
        )
        np.testing.assert_allclose(curve.places_mm[16], [50.0, 5.0, 1.0])
        assert curve.leg == 1

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"points_mm": [[0, 0, 0], [1, 0, 0], [2, 0, 0]]}, "4 to 200 rows"),
            ({"points_mm": [[0, 0, 0]] * 5}, "differ from one to the next"),
            ({"points_mm": [[0, 0], [1, 0], [2, 0], [3, 0]]}, "points_mm must"),
            ({"points_mm": "line"}, "points_mm must"),
            ({"point_std_mm": 0.0}, "point_std_mm must be positive"),
            ({"position_std_mm": -1.0}, "position_std_mm must"),
            ({"turn_std_deg": 90.0}, "between 0 and 45 deg"),
            ({"leg": -1}, "whole number from 0"),
        ],
    )
    def test_what_is_no_curve_is_refused(self, changes, words):
        told = {"points_mm": [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 1, 0]], "point_std_mm": 0.1}
        with pytest.raises(ValueError, match=words):
            lf.DrawnCurve(**told | changes)

    def test_too_many_places_are_refused(self):
        with pytest.raises(LimitError, match="every second place"):
            lf.DrawnCurve(np.arange(603.0).reshape(-1, 3), point_std_mm=0.1)


class TestWhatPlacesSay:
    def test_of_the_path_they_were_measured_on_nothing_is_amiss(self):
        state = arch()
        told = told_of_curve(state, drawn_on(state, point_std_mm=0.1))
        np.testing.assert_allclose(told.rows @ state.vector, told.values, atol=1e-6)

    @pytest.mark.parametrize("errors", [{}, {"position_std_mm": 2.0, "turn_std_deg": 3.0}])
    def test_rows_are_the_change_of_what_is_amiss(self, errors):
        state = arch()
        curve = drawn_on(state, point_std_mm=0.1, **errors)
        told = told_of_curve(state, curve)
        step = 1e-3 * np.array([0.3, 1.0, -0.5, 0.2, 0.4, -1.0, 0.0, 0.7, -0.6])
        moved = state.moved(step)
        after = told_of_curve(moved, curve)
        amiss = after.rows @ moved.vector - after.values
        np.testing.assert_allclose(
            np.linalg.norm(amiss), np.linalg.norm(told.rows @ step), rtol=1e-2
        )

    def test_their_errors_are_those_of_curves_that_were_moved_and_measured(self):
        """200 curves of 30 distances, shifted and turned: false alarm 1e-4."""
        state, std, shift, turn = arch(), 0.2, 2.0, 4.0
        places = state.points_mm(0, np.linspace(0.02, 0.98, 15))
        rng, total, dof = np.random.default_rng(17), 0.0, 0
        for _ in range(200):
            axis = np.deg2rad(turn) * rng.standard_normal(3)
            size = np.linalg.norm(axis)
            k = np.cross(np.eye(3), axis / size)
            turned = np.eye(3) + np.sin(size) * k + (1.0 - np.cos(size)) * k @ k
            middle = places.mean(axis=0)
            seen = (places - middle) @ turned + middle + shift * rng.standard_normal(3)
            seen = seen + std * rng.standard_normal(places.shape)
            told = told_of_curve(
                state,
                lf.DrawnCurve(seen, point_std_mm=std, position_std_mm=shift, turn_std_deg=turn),
            )
            amiss = told.rows @ state.vector - told.values
            total, dof = total + float(amiss @ amiss), dof + len(amiss)
        assert chi2.ppf(5e-5, dof) < total < chi2.ppf(1.0 - 5e-5, dof)


def told_of(scene: BentScene, hist: lf.Histograms, curve: lf.DrawnCurve) -> dict[str, Any]:
    """What a lab tells that has drawn its fibre, and knows its index to 5 percent."""
    call = what_the_user_tells(scene, hist)
    medium = lf.Medium(
        1.44, call["medium"].return_group_index, path_group_index_std=0.05, index_correlation=0.0
    )
    return call | {"medium": medium, "curves": [curve]}


def fibre(way: str = "depth") -> ArcScene:
    return arc_scene(sagitta_mm=20.0, way=way, index=INDEX)


@pytest.mark.usefixtures("nothing_twice")
class TestFits:
    @pytest.mark.usefixtures("unexamined")
    @pytest.mark.parametrize(
        ("way", "errors", "source_known"),
        [
            pytest.param("depth", {"std_mm": 0.3}, True, marks=pytest.mark.long),
            ("depth", {"std_mm": 0.3, "shift_mm": 1.0, "turn_deg": 2.0}, False),
            ("picture", {"std_mm": 0.05}, False),
        ],
    )
    def test_index_and_places_err_as_stated(self, way, errors, source_known):
        """Two recordings, each with its own measured places: false alarm 1e-4, two tests each."""
        scene, of_index, total, dof = fibre(way), 0.0, 0.0, 0
        for seed in range(2):
            hist = histograms(scene, seed)
            curve = lf.DrawnCurve(
                measured_places(scene, 0, seed, **errors),
                point_std_mm=errors["std_mm"],
                position_std_mm=errors.get("shift_mm", 0.0),
                turn_std_deg=errors.get("turn_deg", 0.0),
            )
            call = told_of(scene, hist, curve)
            if not source_known:
                call["source"] = lf.Source()
            path = lf.reconstruct(hist, **call)
            of_index += ((path.medium.path_group_index - INDEX) / path.group_index_std) ** 2
            own, n = squared_pulls(path, scene)
            total, dof = total + own, dof + n
        assert chi2.ppf(2.5e-5, 2) < of_index < chi2.ppf(1.0 - 2.5e-5, 2)
        assert chi2.ppf(2.5e-5, dof) < total < chi2.ppf(1.0 - 2.5e-5, dof)

    def test_index_is_as_good_as_a_straight_line_through_the_times(self):
        """Where curve, source and time are exact, each pulse tells of the index by its own way."""
        scene = fibre()
        hist = histograms(scene, 8)
        curve = lf.DrawnCurve(scene.points_on(0, np.linspace(0, 1, 41)), point_std_mm=1e-3)
        path = lf.reconstruct(hist, **told_of(scene, hist, curve))
        used = path.residuals[path.residuals["used"]]
        way_ps = used["event_time_ps"] - scene.emission_time_ps
        least = 1.0 / np.sqrt(np.sum((way_ps / INDEX / used["std_ps"]) ** 2))
        assert path.group_index_std == pytest.approx(least, rel=0.1)
        assert path.verdict.level is Level.TRUST
        assert any("told to run along a curve" in said for said in path.statements)

    def test_all_counts_find_the_same(self):
        scene = fibre()
        hist = histograms(scene, 9)
        curve = lf.DrawnCurve(measured_places(scene, 0, 9, std_mm=0.3), point_std_mm=0.3)
        call = told_of(scene, hist, curve)
        joint, photon = (lf.reconstruct(hist, method=m, **call) for m in ("joint", "photon"))
        gap = photon.medium.path_group_index - joint.medium.path_group_index
        assert abs(gap) < joint.group_index_std
        assert photon.group_index_std == pytest.approx(joint.group_index_std, rel=0.2)

    def test_a_curve_that_stands_elsewhere_is_named(self):
        scene = fibre()
        hist = histograms(scene, 10)
        places = measured_places(scene, 0, 10, std_mm=0.3) + np.array([0.0, 1.0, 2.0])
        call = told_of(scene, hist, lf.DrawnCurve(places, point_std_mm=0.3))
        with pytest.warns(SuspectDataWarning):
            path = lf.reconstruct(hist, **call | {"source": lf.Source()})
        assert path.verdict.level is Level.CONTRADICTED
        assert "drawn_curve" in {one.name for one in path.verdict.findings}

    def test_a_start_says_where_other_legs_are(self):
        scene = bent_scene(legs=3, sagitta_mm=20.0, way="depth")
        hist = histograms(scene, 11)
        call = what_the_user_tells(scene, hist)
        curve = lf.DrawnCurve(measured_places(scene, 0, 11, std_mm=0.3), point_std_mm=0.3)
        begun = np.array(scene.vertices_mm)
        begun[1:] += 1.0
        path = lf.reconstruct(hist, start=begun, curves=curve, **call)
        assert path.n_legs == 3
        assert [bend.leg for bend in path.bends] == [0]
        assert path.verdict.level is Level.TRUST
        total, dof = squared_pulls(path, scene)
        assert total < chi2.ppf(1.0 - 1e-4, dof)

    def test_it_is_written_and_read(self, tmp_path):
        scene = fibre()
        hist = histograms(scene, 12)
        curve = lf.DrawnCurve(measured_places(scene, 0, 12, std_mm=0.3), point_std_mm=0.3)
        path = lf.reconstruct(hist, **told_of(scene, hist, curve))
        path = replace(path, bends=tuple(b.with_orders(b.orders, 1) for b in path.bends),
                       bend_covariance=None)  # fmt: skip
        path.save(tmp_path / "path.h5")
        again = lf.LightPath.load(tmp_path / "path.h5")
        assert again.group_index_std == path.group_index_std > 0.0
        assert [bend.more_in_picture for bend in again.bends] == [1]


@cache
def seen_fibre() -> tuple[ArcScene, lf.Histograms]:
    """A scene and its recording, for calls that are refused."""
    return fibre(), histograms(fibre(), 13)


class TestBadCalls:
    def test_light_that_runs_the_other_way_is_refused(self):
        scene, hist = seen_fibre()
        places = measured_places(scene, 0, 13, std_mm=0.3)[::-1]
        call = told_of(scene, hist, lf.DrawnCurve(places, point_std_mm=0.3))
        with pytest.raises(GeometryError, match="order of flight"):
            lf.reconstruct(hist, **call | {"source": lf.Source()})

    def test_places_that_scatter_more_than_stated_are_refused(self):
        scene, hist = seen_fibre()
        curve = lf.DrawnCurve(measured_places(scene, 0, 13, std_mm=2.0), point_std_mm=0.1)
        with pytest.raises(GeometryError, match="times their point_std_mm"):
            lf.reconstruct(hist, **told_of(scene, hist, curve))

    def test_a_loop_is_refused(self):
        scene, hist = seen_fibre()
        start = scene.points_on(0, np.array([0.5]))[0]
        curve = lf.DrawnCurve.circle(
            start, start + np.array([0.0, 20.0, 0.0]), (0.0, 0.0, 1.0), 300.0, point_std_mm=0.1
        )
        with pytest.raises(GeometryError, match="turns back on itself"):
            lf.reconstruct(hist, **told_of(scene, hist, curve))

    def test_a_curve_out_of_view_is_refused(self):
        scene, hist = seen_fibre()
        places = measured_places(scene, 0, 13, std_mm=0.3) + np.array([0.0, 900.0, 0.0])
        call = told_of(scene, hist, lf.DrawnCurve(places, point_std_mm=0.3))
        with pytest.raises(GeometryError, match="are in view"):
            lf.reconstruct(hist, **call | {"source": lf.Source()})

    def test_a_curve_beside_the_light_is_refused(self):
        scene, hist = seen_fibre()
        places = measured_places(scene, 0, 13, std_mm=0.3) + np.array([0.0, -60.0, 0.0])
        call = told_of(scene, hist, lf.DrawnCurve(places, point_std_mm=0.3))
        with pytest.raises(NothingFoundError, match="pulses lie within"):
            lf.reconstruct(hist, **call | {"source": lf.Source()})

    @pytest.mark.parametrize(
        ("call", "words"),
        [
            ({"legs": [1]}, "nothing says where the others are"),
            ({"legs": [0, 0]}, "leg of its own"),
            ({"legs": [0], "n_legs": 3}, "nothing says where the others are"),
            ({"legs": [4], "n_legs": 3}, "of the 3 that there are"),
            ({"legs": [0], "method": "paper"}, "knows straight legs"),
            ({"legs": "leg"}, "list of lightflight.DrawnCurve"),
        ],
    )
    def test_what_is_told_of_curves_is_checked(self, call, words):
        scene, hist = seen_fibre()
        one = lf.DrawnCurve(measured_places(scene, 0, 13, std_mm=0.3), point_std_mm=0.3)
        legs = call.pop("legs")
        curves = [replace(one, leg=k) for k in legs] if isinstance(legs, list) else legs
        with pytest.raises(ValueError, match=words):
            lf.reconstruct(hist, **told_of(scene, hist, one) | {"curves": curves} | call)
