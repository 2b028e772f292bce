"""The verdict of `reconstruct`, against worlds of the tests' own forward model."""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2, kstest

import lightflight as lf
from lightflight.errors import SuspectDataWarning, UncalibratedWarning
from lightflight.path.verdict import FindingName
from lightflight.reconstruct.verdict.bookkeeping import corners_without_a_turn, noticed
from lightflight.reconstruct.verdict.evidence import Evidence, evidence_from_deviate
from lightflight.reconstruct.verdict.judge import family_p_value, named, verdict_from_evidence
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world
from tests.path_fakes import make_path


@cache
def recording(seed, defect="", n_legs=3, photons=40_000.0, prior="known"):
    world = random_world(seed, n_legs, photons, prior)
    if defect:
        assert not DEFECTS[defect].held_out
        world = DEFECTS[defect].applied(world, DEFECTS[defect].strengths[1])
    return record(world, seed), what_the_user_tells(world)


def reconstructed(*world, method="joint", **others):
    hist, told = recording(*world, **others)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        return lf.reconstruct(hist, method=method, **told)


def along(columns, data, name=FindingName.INDEX, symptom=False):
    """Evidence of data (N,) along orthonormal columns (N, k)."""
    z = columns.T @ data
    return Evidence(name, float(z @ z), len(z), float(z @ z) - len(z), "", "", columns, z, symptom)


class TestJudge:
    def test_family_p_value_is_uniform_for_correlated_tests(self):
        """24 tests of 1 to 3 parameters in 12 dimensions, and four of other data."""
        rng = np.random.default_rng(5)
        columns = [np.linalg.qr(rng.normal(size=(12, 1 + k % 3)))[0] for k in range(24)]
        found = []
        for _ in range(400):
            data = rng.normal(size=12)
            tests = [along(own, data) for own in columns]
            tests += [
                evidence_from_deviate(FindingName.HAZE, z, sentence="", remedy="")
                for z in rng.normal(size=4)
            ]
            found.append(family_p_value(tests))
        assert kstest(found, "uniform").pvalue > 1e-3
        assert 1e-3 < np.mean(np.array(found) < 0.05) < 0.1

    @pytest.mark.parametrize("n", [1, 30, 60])
    def test_threshold_of_independent_tests(self, n):
        """Of so many tests one has to be this clear: 2.6, 3.6, 3.8 sigma for 1 %."""
        quiet = [evidence_from_deviate(FindingName.HAZE, 0.0, sentence="", remedy="")] * (n - 1)
        needed = float(np.sqrt(chi2.isf(-np.expm1(np.log(0.99) / n), 1)))
        loud, soft = (
            evidence_from_deviate(FindingName.GLARE, needed + more, sentence="", remedy="")
            for more in (0.01, -0.01)
        )
        assert verdict_from_evidence([*quiet, loud]).level == "check"
        assert verdict_from_evidence([*quiet, soft]).level == "trust"

    def test_tests_that_seldom_speak_take_their_own_chance_alone(self):
        """29 tests that are silent below 3 sigma, and one at 2: 12 %, not the 79 % of 30 tests."""
        silent, loud = (
            evidence_from_deviate(FindingName.HAZE, z, sentence="", remedy="", silent_below=below)
            for z, below in ((0.0, 9.0), (1.96, 0.0))
        )
        passed = (1.0 - loud.p_value) * (1.0 - chi2.sf(9.0, 1)) ** 29
        assert family_p_value([*[silent] * 29, loud]) == pytest.approx(1.0 - passed, rel=1e-6)

    def test_causes_within_nine_of_the_best_are_named_together(self):
        basis = np.eye(4)
        data = np.array([12.0, 3.0, 0.0, 0.0])
        tilted = (12.0 * basis[0] + 3.0 * basis[1])[:, None] / np.hypot(12.0, 3.0)
        best = along(tilted, data, FindingName.INDEX)
        near = along(basis[:, :1], data, FindingName.POSE)
        far = along((basis[:, :1] + basis[:, 2:3]) / np.sqrt(2.0), data, FindingName.SOURCE)
        assert [e.name for e in named([far, near, best])] == ["index"]
        data[1] = 2.9
        best = along(tilted, data, FindingName.INDEX)
        near = along(basis[:, :1], data, FindingName.POSE)
        assert len(named([far, near, best])) == 2

    def test_a_symptom_is_named_only_where_no_cause_explains_it(self):
        basis = np.eye(5)
        data = np.array([9.0, 0.5, -0.3, 0.8, 0.1])
        cause = along(basis[:, :1], data, FindingName.DISTORTION)
        trend = along(basis[:, :3], data, FindingName.TREND, symptom=True)
        assert [e.name for e in named([trend, cause])] == ["distortion"]
        data[1] = 7.0
        cause = along(basis[:, :1], data, FindingName.DISTORTION)
        trend = along(basis[:, :3], data, FindingName.TREND, symptom=True)
        assert [e.name for e in named([trend, cause])] == ["distortion", "trend"]


@pytest.mark.parametrize(
    ("seed", "n_legs", "photons", "prior"),
    [
        pytest.param(5, 3, 40_000.0, "known", marks=pytest.mark.long),
        (7, 3, 400.0, "known"),
        (8, 3, 40_000.0, "lab"),
        pytest.param(29, 1, 40_000.0, "lab", marks=pytest.mark.long),
        (10, 1, 400.0, "known"),
    ],
)
def test_undisturbed_recordings_are_trusted(seed, n_legs, photons, prior):
    """1 % of recordings may raise an alarm; none does at these seeds."""
    assert reconstructed(seed, "", n_legs, photons, prior).verdict.level == "trust"


# A barrel, by `joint` and `photon`: tests/issues/test_misfit_was_taken_for_scatter.py.
@pytest.mark.usefixtures("as_found")
@pytest.mark.parametrize(("defect", "seed"), [("focal_length_longer", 0), ("camera_aside", 2)])
def test_a_defect_is_named(defect, seed):
    hist, told = recording(seed, defect)
    with pytest.warns(SuspectDataWarning, match="the recording contradicts this path"):
        verdict = lf.reconstruct(hist, **told).verdict
    assert verdict.level == "contradicted"
    assert DEFECTS[defect].finding in [finding.name for finding in verdict.findings]
    assert len(verdict.findings) <= 6


@pytest.mark.usefixtures("as_found")
def test_no_leg_is_opened_for_a_late_trigger_and_all_its_causes_are_named():
    path = reconstructed(0, "clock_early")
    assert path.n_legs == 3
    assert path.verdict.level == "contradicted"
    # The oracle's own group (`fisher.inseparable`): none of these can be told from another.
    group = {"clock_offset", "clock_drift", "clock_scale", "source", "index", "pose"}
    assert {finding.name for finding in path.verdict.findings} == group


@pytest.mark.usefixtures("as_found")
def test_no_leg_that_no_pulse_speaks_for_is_opened_for_a_drift():
    """The search opened one, and nothing but that it is unseen was said."""
    path = reconstructed(4, "drift_in_one")
    assert path.n_legs == 3
    assert path.verdict.level == "contradicted"
    assert "clock_drift" in [finding.name for finding in path.verdict.findings]


@pytest.mark.usefixtures("as_found")
def test_wrong_pulses_that_a_misfit_hides_do_not_decide_between_causes():
    """Two pulses that merge at a corner are 19 of their errors off once the drift is freed."""
    path = reconstructed(5, "drift_in_one")
    assert path.verdict.level == "contradicted"
    assert "clock_drift" in [finding.name for finding in path.verdict.findings]


def test_the_papers_estimator_gives_a_verdict():
    verdict = reconstructed(1, "barrel", method="paper").verdict
    assert verdict.level == "contradicted"
    assert verdict.n_tests > 5


def test_a_nominal_clock_is_warned_of_once_and_checked():
    hist, told = recording(1)
    with pytest.warns() as given:
        path = lf.reconstruct(hist, **(told | {"timing": None}))
    assert [one.category for one in given] == [UncalibratedWarning, SuspectDataWarning]
    assert "check this path before you rely on it: the clock is nominal" in str(given[1].message)
    assert path.verdict.level == "check"
    assert "calibration" in [finding.name for finding in path.verdict.findings]


@pytest.mark.parametrize(("told", "names"), [(2, ["leg_count"]), (3, []), (None, [])])
def test_legs_that_were_told_and_not_found_are_noticed(told, names):
    found = noticed(make_path(), nominal_clock=False, n_legs=told)
    assert [finding.name for finding in found] == names


def test_light_that_turns_back_turns():
    """Errors of many degrees: of legs that run against each other nothing is seen to lean aside."""
    unsure = 100.0 * np.eye(16)
    back = make_path([[0, 0, 0], [300, 0, 0], [0, 1, 0], [300, 2, 0]], unsure)
    assert corners_without_a_turn(back) == []
    on = make_path([[0, 0, 0], [100, 0, 0], [200, 1, 0], [0, 1, 0]], unsure)
    assert corners_without_a_turn(on) == [1]


def test_blind_spots_are_what_moves_the_path_unseen():
    """Seen at half of the power where it is as large as said; what is larger would be seen."""
    spots = reconstructed(1).verdict.blind_to
    # Of light out of the picture counts tell, of all else here the times.
    assert {"index", "pose", "focal_length"} < {spot.name for spot in spots}
    assert all(spot.moves_mm > 0.0 and spot.size > 0.0 for spot in spots)
    moved = [spot.moves_mm for spot in spots]
    assert moved == sorted(moved, reverse=True)
