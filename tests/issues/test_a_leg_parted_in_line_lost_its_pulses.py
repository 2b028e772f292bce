"""A search that parts a leg in two, nearly in line, may lose pulses which the whole leg has.

Scene 1000219 of the blind ones: three legs came out as four, contradicted, with ten pulses on none
of them; told that there are three, all 151 lay on the path, and it was trusted.
"""

from __future__ import annotations

import numpy as np

import lightflight as lf
from benchmarks.check_blind_scenes import PHOTONS, calibration, drawn_case, judged
from tests.oracles.brute_force import expected_counts


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
