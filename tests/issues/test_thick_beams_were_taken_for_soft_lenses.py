"""A beam as thick as a pixel, turned by a mirror in view, was fitted as the spot of a soft lens.

The lens blurs the end of a leg, a mirror cuts a thick beam aslant: `photon` was six stated errors
off at such corners, `joint` five where the mirror grazes the beam, and a path of light that begins
and stops in view eight, most of them with "trust".
"""

import numpy as np
import pytest
from scipy.special import chdtri

from benchmarks.thick_beams import path_of, recording
from tests.oracles.thick_beam import PATHS, ThickBeam

CHANCE = 1e-5
"""That a right path with honest errors fails here: three numbers of one corner."""


@pytest.mark.parametrize(
    ("path", "beam_mm", "method", "seed", "photons"),
    [
        ("sharp", 2.0, "photon", 11, 10_000.0),
        pytest.param("grazing", 4.0, "joint", 12, 40_000.0, marks=pytest.mark.long),
        pytest.param("ending", 2.0, "joint", 13, 40_000.0, marks=pytest.mark.long),
    ],
)
def test_thick_beams_were_taken_for_soft_lenses(path, beam_mm, method, seed, photons):
    """The corner, at its stated errors: whitened chi-square of three numbers, chance 1e-5 each."""
    vertices = PATHS[path]
    beam = ThickBeam(beam_mm, photons=photons)
    found = path_of(path, beam, recording(path, beam, seed), method)
    assert found.n_legs == 2
    off = found.vertices_mm[1] - vertices[1]
    chi2 = off @ np.linalg.solve(found.covariance[4:7, 4:7], off)
    assert chi2 < chdtri(3, CHANCE)
    assert np.abs(off).max() < 0.3
    assert found.verdict.level.value != "contradicted"
