"""Lengths of legs that are told: what they say of a path, of its index, and of themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from benchmarks.bends import INDEX, told_of_fibre
from lightflight.errors import SuspectDataWarning
from lightflight.flight import Source
from lightflight.lab.lab import lab_from_table, reconstruct_options
from lightflight.path.verdict import FindingName, Level
from lightflight.reconstruct.model.freedom import Freedom, freedom_of_path
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.told import checked_lengths, way_along
from lightflight.reconstruct.trials.revise import setting_with_corner, setting_without
from lightflight.simulate import presets
from tests.oracles.bent import fibre_in_view
from tests.oracles.refracted import RefractedScene, paper_scene
from tests.oracles.refracted_border import histograms, what_the_user_tells
from tests.path_fakes import PAPER_VERTICES
from tests.reconstruct.fakes import camera_like
from tests.reconstruct.test_drawn_curves import arch

PLANE = np.eye(3)[:, :2]
CHAIN = PathState(PAPER_VERTICES, 2000.0)
KNOWN = Source((0.0, 0.0, 0.0), emission_time_ps=0.0)


def freedom(state: PathState, lengths, *, source=KNOWN, end=PLANE) -> Freedom:
    return freedom_of_path(
        state, source=source, waypoints=(), start_basis=PLANE, end_bases=(end,),
        lengths=checked_lengths(lengths, None),
    )  # fmt: skip


class TestWhatALengthSays:
    @pytest.mark.parametrize(
        ("state", "legs"), [(CHAIN, [1]), (CHAIN, [0, 2]), (arch(), [0])],
        ids=["straight", "two", "bent"],
    )  # fmt: skip
    def test_ways_follow_the_state(self, state, legs):
        way, by_state = way_along(state, legs)
        step = 1e-4
        for k, each in enumerate(np.eye(state.size)):
            ahead, behind = (way_along(state.moved(s * each), legs)[0] for s in (step, -step))
            assert by_state[k] == pytest.approx((ahead - behind) / (2 * step), abs=1e-6)
        assert way == pytest.approx(state.lengths_mm[legs].sum())

    def test_it_pulls_a_leg_to_it(self):
        length = float(np.linalg.norm(PAPER_VERTICES[2] - PAPER_VERTICES[1]))
        free = freedom(CHAIN, [(1, length + 0.6, 0.2)])
        misfit = free.prior_values - free.prior_rows @ CHAIN.vector
        np.testing.assert_allclose(misfit, [3.0], atol=1e-9)
        assert [one.words for one in free.told] == ["length of leg 2"]

    @pytest.mark.parametrize(
        ("lengths", "source", "words"),
        [
            ([(2, 300.0, 1.0)], KNOWN, "length of leg 2: the picture's edge cuts that leg"),
            ([(0, 300.0, 1.0)], Source(), "length of leg 0: the picture's edge cuts that leg"),
            ([(3, 300.0, 1.0)], KNOWN, "length of leg 3, but the path found has legs 0 to 2"),
        ],
    )
    def test_a_leg_without_ends_has_none(self, lengths, source, words):
        with pytest.raises(ValueError, match=words):
            freedom(CHAIN, lengths, source=source)

    def test_a_leg_whose_light_stops_in_view_has_one(self):
        assert len(freedom(CHAIN, [(2, 300.0, 1.0)], end=np.eye(3)).told) == 1

    @pytest.mark.parametrize(
        ("lengths", "words"),
        [
            ("x", "lengths must be a list of"),
            (5, "lengths must be a list of"),
            ([(1, 300.0)], r"a length must be \(leg, length_mm, std_mm\)"),
            ([(1.5, 3.0, 1.0)], "length of leg 1.5: give a leg from 0 to 2"),
            ([(3, 3.0, 1.0)], "length of leg 3: give a leg from 0 to 2"),
            ([(1, -3.0, 1.0)], "length of leg 1: length_mm must be positive"),
            ([(1, 3.0, 0.0)], "length of leg 1: std_mm must be positive"),
            ([(1, 3.0, 1.0), (1, 4.0, 1.0)], "length of leg 1: it is told twice"),
        ],
    )
    def test_what_is_none_is_refused(self, lengths, words):
        with pytest.raises(ValueError, match=words):
            checked_lengths(lengths, 3)

    def test_it_goes_with_its_leg(self):
        told = checked_lengths([(0, 1.0, 1.0), (2, 3.0, 1.0)], None)
        setting = Setting(camera_like(0), KNOWN, lf.Medium(), lengths=told)
        longer = setting_with_corner(setting, 1)
        assert [one.leg for one in longer.lengths] == [0, 3]
        assert setting_without(longer, (2,)).lengths == told
        assert setting.told_vertices == {0, 1, 2, 3}

    def test_it_is_told_in_the_set_up(self):
        lab = lab_from_table({"reconstruct": {"lengths": [[1, 378.0, 0.2]]}})
        assert reconstruct_options(lab)["lengths"] == [(1, 378.0, 0.2)]


def three() -> RefractedScene:
    return replace(paper_scene(), path_group_index=INDEX, photons=4000.0)


SCENES = {
    "three legs": (three, 1, {}),
    "in the picture": (lambda: fibre_in_view("picture"), 0, {"free": ("bend",), "n_legs": 1}),
    "in depth": (lambda: fibre_in_view("depth"), 0, {"free": ("bend",), "n_legs": 1}),
}


@pytest.mark.usefixtures("unexamined", "nothing_twice")
@pytest.mark.parametrize(
    ("name", "n"),
    [
        pytest.param("three legs", 2, marks=pytest.mark.long),
        # It takes longest.
        pytest.param("in the picture", 1, marks=pytest.mark.long),
        pytest.param("in the picture", 2, marks=pytest.mark.long),
        ("in depth", 1),
        pytest.param("in depth", 2, marks=pytest.mark.long),
    ],
)
def test_index_and_place_err_as_stated(name, n):
    """`n` recordings, each with a length measured anew: false alarm 1e-4, two tests each."""
    make, leg, more = SCENES[name]
    scene, of_index, of_place = make(), 0.0, 0.0
    true = np.asarray(scene.vertices_mm[1], dtype=float)
    for seed in range(n):
        hist = histograms(scene, seed)
        measured = scene.leg_lengths_mm[leg] + 0.2 * np.random.default_rng(seed).normal()
        call = told_of_fibre(scene, hist) | more
        path = lf.reconstruct(hist, lengths=[(leg, measured, 0.2)], **call)
        of_index += ((path.medium.path_group_index - INDEX) / path.group_index_std) ** 2
        off = path.vertices_mm[1] - true
        of_place += off @ np.linalg.solve(path.covariance[4:7, 4:7], off)
    assert chi2.ppf(2.5e-5, n) < of_index < chi2.ppf(1.0 - 2.5e-5, n)
    assert chi2.ppf(2.5e-5, 3 * n) < of_place < chi2.ppf(1.0 - 2.5e-5, 3 * n)


@pytest.mark.long
def test_a_length_belongs_to_where_the_light_stops():
    """And not to the picture's edge, seven pixels on."""
    scene = fibre_in_view("depth", end_mm=260.0)
    hist = histograms(scene, 1)
    told = [(0, float(scene.leg_lengths_mm[0]), 0.2)]
    path = lf.reconstruct(
        hist, n_legs=1, free=("bend",), lengths=told, **told_of_fibre(scene, hist)
    )
    assert path.verdict.level is Level.TRUST
    assert path.legs[0].length_mm == pytest.approx(told[0][1], abs=0.6)


@pytest.mark.long
def test_it_halves_the_error_of_the_index_and_all_counts_agree():
    scene = three()
    hist = histograms(scene, 7)
    call, told = told_of_fibre(scene, hist), [(1, float(scene.leg_lengths_mm[1]), 0.2)]
    without, joint = (lf.reconstruct(hist, lengths=each, **call) for each in ([], told))
    photon = lf.reconstruct(hist, method="photon", lengths=told, **call)
    assert joint.group_index_std < 0.6 * without.group_index_std
    assert photon.group_index_std == pytest.approx(joint.group_index_std, rel=0.2)
    gap = photon.medium.path_group_index - joint.medium.path_group_index
    assert abs(gap) < 0.5 * joint.group_index_std
    assert "Leg 2 was told to be 377.955 ± 0.2 mm long." in joint.statements
    assert joint.verdict.level is Level.TRUST


@pytest.mark.usefixtures("as_found")
@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"lengths": [(1, 378.955, 0.1)]}, "the told length of leg 2 is off by 1"),
        pytest.param(
            {"waypoints": [(1, (375.0, 25.0, 51.0), 0.1)]},
            "the told place of vertex 1 in z",
            marks=pytest.mark.long,
        ),
    ],
    ids=["length", "waypoint"],
)
def test_what_was_measured_wrongly_is_named(told, words):
    """A millimetre off where a tenth is stated: `prior` comes first."""
    scene = replace(paper_scene(), photons=20_000.0)
    hist = histograms(scene, 1)
    with pytest.warns(SuspectDataWarning):
        path = lf.reconstruct(hist, **what_the_user_tells(scene, hist), **told)
    assert path.verdict.level is Level.CONTRADICTED
    first = path.verdict.findings[0]
    assert first.name is FindingName.PRIOR
    assert words in first.sentence


def test_what_was_measured_rightly_is_not():
    scene = replace(paper_scene(), photons=20_000.0)
    hist = histograms(scene, 2)
    path = lf.reconstruct(
        hist, **what_the_user_tells(scene, hist), waypoints=[(1, scene.vertices_mm[1], 0.1)],
        lengths=[(1, float(scene.leg_lengths_mm[1]), 0.1)],
    )  # fmt: skip
    assert path.verdict.level is Level.TRUST


def test_the_paper_knows_no_lengths():
    scene = three()
    hist = histograms(scene, 3)
    call = what_the_user_tells(scene, hist)
    with pytest.raises(ValueError, match="takes no lengths of legs"):
        lf.reconstruct(hist, method="paper", lengths=[(1, 378.0, 0.2)], **call)


def test_bounds_know_of_lengths():
    """Index uncertain by 0.01, all else exact: what is left of corner 2 falls with the length."""
    scene = presets.paper_scene()
    medium = lf.Medium(path_group_index_std=0.01, index_correlation=0.0)
    length = float(np.linalg.norm(np.diff(scene.vertices_mm, axis=0)[1]))
    without, told = (
        lf.bounds(scene, medium=medium, lengths=each) for each in ((), ((1, length, 0.05),))
    )
    assert told.vertex_std[2, 2] < 0.7 * without.vertex_std[2, 2]
