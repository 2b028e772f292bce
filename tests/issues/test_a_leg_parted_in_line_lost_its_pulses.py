"""A search that parts a leg in two, nearly in line, may lose pulses which the whole leg has.

Scene 1000219 of the blind ones: three legs came out as four, contradicted, with ten pulses on none
of them; told that there are three, all 151 lay on the path, and it was trusted.
"""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from benchmarks.check_blind_scenes import PHOTONS, calibration, drawn_case, judged
from lightflight.errors import SuspectDataWarning
from lightflight.path.verdict import Level
from tests.labs import three_legs
from tests.oracles.brute_force import expected_counts


@pytest.mark.long
def test_a_leg_parted_in_line_lost_its_pulses():
    case = drawn_case(1_000_219)
    scene = case.scene
    counts = np.random.default_rng([1_000_219, 99]).poisson(
        expected_counts(scene, brightest=PHOTONS)
    )
    source = lf.Source(scene.vertices[0], emission_time_ps=scene.emission_time, pulse_fwhm_ps=68.0)
    clock = calibration(scene.clock, scene.tail)
    outcome = judged(case, counts, source, clock, "joint", PHOTONS)
    assert outcome.failure == ""
    assert outcome.level == "trust"


def test_it_is_one_again(monkeypatch, nothing_twice):
    """Of whatever search: parted by being told, it is found whole where nothing was told."""
    lab = three_legs()
    hist = lab.recording(10, 20_000.0)
    told = {"camera": lab.camera, "source": lab.known, "timing": lab.timing}
    with pytest.warns(SuspectDataWarning):
        parted = lf.reconstruct(hist, n_legs=4, **told)
    contradicted = replace(parted.verdict, level=Level.CONTRADICTED)
    answer = importlib.import_module("lightflight.reconstruct.answer")
    found = replace(parted, verdict=contradicted)
    monkeypatch.setattr(answer, "_reconsidered", lambda *_: found)
    path = lf.reconstruct(hist, **told)
    assert path.n_legs == 3
    assert path.verdict.level is Level.TRUST
    assert path.explained.n_pulses > parted.explained.n_pulses
