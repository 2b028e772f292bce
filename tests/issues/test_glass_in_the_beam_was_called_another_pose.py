"""Twenty millimetres of glass in the beam, not told: contradicted, and called a pose or a source.

Light behind it is 36 ps late by one time, which no corner, clock or index makes.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.refracted import AIR, BK7, block_world
from tests.oracles.refracted_border import histograms, what_the_user_tells

LATE_PS = 20.0 * (BK7[1] - AIR) / 0.299792458


@pytest.mark.parametrize(("seed", "light_in_glass"), [(0, 0.0), (1, 1.0)])
def test_glass_in_the_beam_is_named(seed, light_in_glass):
    """And how much of it, to a fifteenth, and where, to two pixels (8 mm each).

    A path that fits nothing well says it by its slopes alone: of five recordings 34, 35, 36, 37 and
    37 ps, told in whole ones.
    """
    scene = replace(block_world(light_in_glass), photons=4_000.0)
    hist = histograms(scene, seed)
    with pytest.warns(SuspectDataWarning, match="contradicts"):
        path = lf.reconstruct(hist, **what_the_user_tells(scene, hist))
    first = path.verdict.findings[0]
    assert first.name == "block"
    late, x, y, z, glass = map(float, re.findall(r"-?\d+(?:\.\d+)?", first.sentence))
    assert late == pytest.approx(LATE_PS, abs=2.4)
    assert glass == pytest.approx(20.0, abs=1.4)
    assert np.linalg.norm(np.array([x, y, z]) - scene.vertices_mm[1]) < 16.0
