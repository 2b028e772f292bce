"""A short leg was 6 mm off, by 3.3 stated errors, trusted: nine pulses spoke for it.

The path by all counts, 0.15 mm off, was refused for a chi-square of its pulses 14 above that of
their own best path. Of two paths that are both right the second is worse by one for each of its
numbers, and chance.
"""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from benchmarks.check_blind_scenes import PHOTONS, Outcome, calibration, drawn_case, judged
from lightflight.reconstruct.all_counts import photon
from lightflight.reconstruct.ways import joint
from tests.oracles.brute_force import expected_counts
from tests.path_fakes import GOOD, make_path


def outcome() -> Outcome:
    case = drawn_case(970_034)
    scene = case.scene
    mean = expected_counts(scene, brightest=PHOTONS)
    counts = np.random.default_rng([case.seed, 99]).poisson(mean)
    source = lf.Source(scene.vertices[0], emission_time_ps=scene.emission_time, pulse_fwhm_ps=68.0)
    return judged(case, counts, source, calibration(scene.clock, scene.tail), "joint", PHOTONS)


@pytest.fixture
def farther(monkeypatch):
    """The path by all counts as far from its pulses, and by so much chi-square more."""
    by_all_counts = photon.photon_path

    def by(more: float) -> None:
        def far_from_pulses(*given, **told):
            path = by_all_counts(*given, **told)
            residuals = path.residuals.copy()
            used = residuals["used"]
            chi2 = np.sum((residuals["residual_ps"] / residuals["std_ps"])[used] ** 2)
            residuals["residual_ps"] *= np.sqrt(1.0 + more / chi2)
            return replace(path, residuals=residuals)

        monkeypatch.setattr(photon, "photon_path", far_from_pulses)

    return by


@pytest.mark.usefixtures("unexamined")
@pytest.mark.long
def test_all_counts_are_believed_where_chance_explains_what_pulses_miss(farther):
    """Of fourteen numbers chance explains 42, once in 10,000 times."""
    farther(14.0)
    found = outcome()
    assert found.failure == ""
    assert found.rms_mm < 2.0 * found.bound_mm


@pytest.mark.parametrize(("more", "believed"), [(42.0, True), (43.0, False)])
def test_of_fourteen_numbers_chance_explains_42(more, believed, monkeypatch):
    """A hundred pulses as far from their own best path as they err; once in 10,000 times."""
    table = np.zeros(100, dtype=[("used", bool), ("residual_ps", float), ("std_ps", float)])
    table["used"], table["residual_ps"], table["std_ps"] = True, 1.0, 1.0
    farther = table.copy()
    farther["residual_ps"] = np.sqrt(1.0 + more / 100.0)
    own = make_path(residuals=table)
    counted = make_path(residuals=farther, goodness=replace(GOOD, converged=True))
    monkeypatch.setattr(joint, "path_of_fit", lambda *_: own)
    monkeypatch.setattr(joint, "_why_all_counts", lambda *_: "a leg of few pulses")
    monkeypatch.setattr(photon, "path_of_all_counts", lambda *_: counted)
    fit: Any = SimpleNamespace(
        sightings=[SimpleNamespace(histograms=SimpleNamespace(poisson=True))],
        freedom=SimpleNamespace(labels=("",) * 14),
    )
    found = joint.path_of_pulses(fit, SimpleNamespace(setting=None))
    assert (found is not own) == believed


@pytest.mark.usefixtures("unexamined")
@pytest.mark.long
def test_they_are_not_where_chance_does_not(farther):
    """A hundred more: the likelihood climbed another hill, and the pulses tell."""
    farther(100.0)
    found = outcome()
    assert found.rms_mm > 2.0 * found.bound_mm
