"""Light that leaves the picture and comes back: found, told as open, and never taken for more.

Scenes of an oracle that shares no line with the package (`tests/oracles/unseen_ways.py`). The full
table is `benchmarks/unseen_legs.py`.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from benchmarks.unseen_legs import error2_in_view, found_its_gap, true_delay_ps
from lightflight.errors import LightflightWarning
from lightflight.reconstruct.model.detour import detours_of, mirrors, with_detours_level
from lightflight.reconstruct.model.freedom import Freedom
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.verdict import lost
from tests.oracles.refracted import paper_scene
from tests.oracles.refracted_border import camera_told, histograms
from tests.oracles.refracted_bound import bound
from tests.oracles.unseen_ways import roof_or_cube

SEEDS = [pytest.param(9, marks=pytest.mark.long), 12]
"""Two legs in view, which are quick: a cube and a roof. Fixed before looking."""


def found(scene, seed, *, told=None, **options):
    hist = histograms(scene, seed)
    call = {
        "camera": camera_told(scene),
        "source": lf.Source(tuple(scene.vertices_mm[0]), emission_time_ps=scene.emission_time_ps),
        "timing": lf.TimingCalibration.nominal(hist),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        return lf.reconstruct(hist, **(call | (told or {})), **options)


@pytest.fixture(scope="module", params=SEEDS)
def seed(request):
    return request.param


@pytest.fixture(scope="module")
def way(seed):
    return roof_or_cube(seed)


@pytest.fixture(scope="module")
def path(way, seed):
    return found(way.scene, seed)


class TestRoofMirror:
    def test_the_seen_legs_come_in_their_order_with_one_stretch_open(self, way, path):
        assert found_its_gap(path, way)

    def test_is_never_trusted(self, path):
        assert path.verdict.level == "check"
        assert "unseen_leg" in [finding.name for finding in path.verdict.findings]

    def test_the_delay_is_right_within_its_error(self, way, path):
        """By chance it is not once in 10,000 runs."""
        (gap,) = path.gaps
        pull = (gap.delay_ps - true_delay_ps(gap, way)) / gap.delay_std_ps
        assert pull**2 < chi2.isf(1e-4, 1)

    def test_seen_legs_are_as_near_as_the_light_allows(self, way, path):
        """Error over the bound of the broken path: mostly one number, the depth of the second run,
        so its square is nearly a chi-square of one.
        """
        ratio = error2_in_view(path, way)[0] / bound(way.scene).position_rms_mm ** 2
        assert ratio < chi2.isf(1e-4, 1)

    def test_leaves_the_mirrors_open(self, way, path):
        """The family is told: the first mirror's error along its leg spans what the way allows.

        Where on it a fit ends is chance (the last digit moves it by 4 mm), as is the error there.
        """
        gap, leg = path.gaps[0], path.legs[0]
        along = np.sqrt(leg.direction @ path.covariance[4:7, 4:7] @ leg.direction)
        spare = gap.length_mm - gap.shortest_mm
        # a - b runs evenly from -s to s: a, about half of it, has a spread of s / (2 sqrt 3).
        assert along / (spare / (2.0 * np.sqrt(3.0))) > 0.8
        off = path.vertices_mm[1] - way.scene.vertices_mm[1]
        assert (off @ leg.direction / along) ** 2 < chi2.isf(1e-4, 1)

    def test_what_is_said_names_no_mirror_that_is_open(self, path):
        assert not [said for said in path.statements if "orner 1 " in said]


@pytest.mark.long
def test_photon_finds_it_too():
    way = roof_or_cube(12)
    path = found(way.scene, 12, method="photon")
    assert path.method == "photon"
    assert found_its_gap(path, way)
    assert path.verdict.level == "check"
    gap = path.gaps[0]
    # Once in 10,000 times by chance.
    assert abs(gap.delay_ps - true_delay_ps(gap, way)) < 3.9 * gap.delay_std_ps


@pytest.mark.parametrize("n_legs", [2, 3])
@pytest.mark.long
def test_legs_that_nobody_saw_may_be_counted_or_not(n_legs):
    way = roof_or_cube(12)
    path = found(way.scene, 12, n_legs=n_legs)
    assert found_its_gap(path, way)
    assert "leg_count" not in [finding.name for finding in path.verdict.findings]


def test_straight_legs_about_mirrors_beside_the_picture_have_no_gap():
    """The paper's scene: both its mirrors stand outside, and light goes over one at a time."""
    scene = replace(paper_scene(), photons=4_000.0)
    path = found(scene, 3)
    assert path.n_legs == 3
    assert path.unseen_legs == ()
    assert path.verdict.level == "trust"


@pytest.mark.parametrize(
    "told",
    [
        pytest.param({"medium": lf.Medium(1.012, 1.012)}, marks=pytest.mark.long),
        pytest.param(
            {"source": lf.Source((4.0, 3.0, 5.0), emission_time_ps=2000.0)},
            marks=pytest.mark.long,
        ),
        {"source": lf.Source((0.0, 0.0, 0.0), emission_time_ps=2015.0)},
    ],
    ids=["index", "source", "time"],
)
def test_a_mirror_that_an_error_puts_off_is_no_detour(told):
    scene = replace(paper_scene(), photons=4_000.0)
    path = found(scene, 5, told=told)
    assert path.unseen_legs == ()
    assert path.verdict.level != "trust"


@pytest.mark.parametrize(("floor_ps", "cost"), [(0.0, 5000.0), (3.0, 150.0), (3.0, 5000.0)])
def test_a_path_that_leaves_misfit_does_not_explain_all(floor_ps, cost, monkeypatch):
    """All pulses lie on it, a hundred; the path that it stands for cost 6,000."""
    share = SimpleNamespace(n_found=100, photons=100.0, photons_found=100.0)
    monkeypatch.setattr(lost, "explained_by_fit", lambda *_: share)
    monkeypatch.setattr(lost, "cost_of_pulses", lambda *_: cost)
    fit: Any = SimpleNamespace(floor_ps=floor_ps)
    assert lost.explains_all(fit, [], 6000.0) == (floor_ps == 0.0 or cost < 1000.0)


# --- the model of a detour ------------------------------------------------------------------


def state(a=100.0, b=60.0):
    """A roof of 30 mm, its mirrors a and b beyond x = 300."""
    vertices = [(0, 0, 0), (300 + a, 0, 0), (300 + b, 30, 0), (0, 30, 0)]
    return PathState(np.array(vertices, dtype=float), 1000.0, (1,))


CAMERA = lf.Camera.facing_plane((32, 32), center_mm=(177.0, 15.0))


def test_mirrors_make_a_way_of_the_length_asked_for():
    last, again = np.array([300.0, 0.0, 0.0]), np.array([300.0, 30.0, 10.0])
    away, back = np.array([1.0, 0.0, 0.0]), np.array([-0.8, 0.6, 0.0])
    for length in (40.0, 120.0, 700.0):
        one, other = mirrors(last, away, again, back, length)
        way = np.linalg.norm([one - last, other - one, again - other], axis=1).sum()
        assert way == pytest.approx(length, abs=1e-6)


def test_a_way_shorter_than_straight_on_puts_the_mirrors_at_the_edge():
    last, again = np.zeros(3), np.array([0.0, 50.0, 0.0])
    unit = np.array([1.0, 0.0, 0.0])
    one, other = mirrors(last, unit, again, -unit, 20.0)
    np.testing.assert_allclose(one, last, atol=1e-6)
    np.testing.assert_allclose(other, again, atol=1e-6)


def test_a_detour_knows_its_way_and_the_straight_one():
    (detour,) = detours_of(state(), CAMERA)
    edge = detour.last_seen_mm[0]
    assert edge == pytest.approx(detour.seen_again_mm[0], abs=0.6)
    way = (400.0 - edge) + np.hypot(40.0, 30.0) + (360.0 - detour.seen_again_mm[0])
    assert detour.length_mm == pytest.approx(way, abs=1e-6)
    assert detour.shortest_mm == pytest.approx(30.0, abs=0.1)


def test_one_mirror_fails_by_what_two_lines_miss():
    """Lines that meet at (400, 0, 0) but for a height of 12 mm, way as over that corner."""
    vertices = np.array([(0, 0, 0), (399, 0, 6), (399, 0, 6.5), (0, 200, 12)], dtype=float)
    (detour,) = detours_of(PathState(vertices, 0.0, (1,)), CAMERA)
    assert detour.corner_misses_mm < 10.0
    (roof,) = detours_of(state(), CAMERA)
    assert roof.corner_misses_mm > 30.0


def test_the_prior_holds_one_number_and_nothing_that_is_seen():
    """Mirrors that slide along their legs by as much as each other cost nothing; the difference
    costs one over the spread; what moves both legs whole costs the same as where they stand.
    """
    here = state()
    n = here.vertices_mm.size + 1
    free = Freedom(np.eye(n), np.zeros((0, n)), np.zeros(0), ("",) * n)
    held = with_detours_level(free, here, CAMERA)
    assert held.prior_rows.shape == (1, n)
    (row,) = held.prior_rows
    (detour,) = detours_of(here, CAMERA)
    std = (detour.length_mm - detour.shortest_mm) / np.sqrt(3.0)
    farther = np.zeros(n)
    farther[3], farther[6] = 1.0, 1.0
    assert row @ farther == pytest.approx(0.0, abs=1e-12)
    apart = np.zeros(n)
    apart[3], apart[6] = 1.0, -1.0
    assert abs(row @ apart) == pytest.approx(2.0 / std)


def test_a_path_whose_legs_are_all_seen_has_no_such_prior():
    here = PathState(state().vertices_mm, 0.0)
    n = here.vertices_mm.size + 1
    free = Freedom(np.eye(n), np.zeros((0, n)), np.zeros(0), ("",) * n)
    assert with_detours_level(free, here, CAMERA) is free


class TestStateWithUnseenLegs:
    def test_counts_legs_that_are_seen(self):
        here = state()
        assert here.seen == (0, 2)
        assert here.corners_seen == ()
        assert here.has_legs(None)
        assert here.has_legs(2)
        assert here.has_legs(3)
        assert not here.has_legs(4)

    def test_numbers_follow_a_corner_that_is_put_in(self):
        here = state()
        assert here.with_corner(0, np.array([150.0, 0, 0])).unseen == (2,)
        assert here.with_corner(2, np.array([150.0, 30, 0])).unseen == (1,)
        assert here.with_corner(2, np.array([150.0, 30, 0])).corners_seen == (3,)

    def test_and_one_that_is_taken_out(self):
        longer = state().with_corner(0, np.array([150.0, 0, 0]))
        assert longer.without((1,)).unseen == (1,)
        np.testing.assert_array_equal(longer.without((1,)).vertices_mm, state().vertices_mm)
