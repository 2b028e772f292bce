"""A short leg was 6 mm off, by 3.3 stated errors, trusted: nine pulses spoke for it.

The path by all counts, 0.15 mm off, was refused for a chi-square of its pulses 14 above that of
their own best path. Of two paths that are both right the second is worse by one for each of its
numbers, and chance.
"""

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from benchmarks.check_blind_scenes import PHOTONS, Outcome, calibration, drawn_case, judged
from lightflight.reconstruct.all_counts import photon
from tests.oracles.brute_force import expected_counts


def outcome() -> Outcome:
    case = drawn_case(970_034)
    scene = case.scene
    mean = expected_counts(scene, brightest=PHOTONS)
    counts = np.random.default_rng([case.seed, 99]).poisson(mean)
    source = lf.Source(scene.vertices[0], emission_time_ps=scene.emission_time, pulse_fwhm_ps=68.0)
    return judged(case, counts, source, calibration(scene.clock, scene.tail), "joint", PHOTONS)


@pytest.mark.usefixtures("unexamined")
def test_all_counts_are_believed_where_chance_explains_what_pulses_miss():
    found = outcome()
    assert found.failure == ""
    assert found.rms_mm < 2.0 * found.bound_mm


@pytest.mark.usefixtures("unexamined")
def test_they_are_not_where_chance_does_not(monkeypatch):
    """A hundred more: the likelihood climbed another hill, and the pulses tell."""
    by_all_counts = photon.photon_path

    def far_from_pulses(*given, **told):
        path = by_all_counts(*given, **told)
        residuals = path.residuals.copy()
        used = residuals["used"]
        chi2 = np.sum((residuals["residual_ps"] / residuals["std_ps"])[used] ** 2)
        residuals["residual_ps"] *= np.sqrt(1.0 + 100.0 / chi2)
        return replace(path, residuals=residuals)

    monkeypatch.setattr(photon, "photon_path", far_from_pulses)
    found = outcome()
    assert found.rms_mm > 2.0 * found.bound_mm
