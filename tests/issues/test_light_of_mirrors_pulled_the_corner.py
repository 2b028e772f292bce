"""What a mirror in view scatters itself pulled the corner of the path.

`photon` expects two legs that end in the corner. A spot on the mirror ten times as bright as the
beam in a pixel put the corner 0.3 to 0.7 mm off, by 6 to 11 stated errors, three of four times with
"trust"; one of a hundred times up to 1.2 mm, by 4 to 22.
"""

import numpy as np
import pytest
from scipy.special import chdtri

from benchmarks.thick_beams import path_of, recording
from tests.oracles.thick_beam import PATHS, ThickBeam

CHANCE = 1e-5
"""That a right path with honest errors fails here: three numbers of one corner."""


@pytest.mark.parametrize(
    ("path", "beam", "seed"),
    [
        ("sharp", ThickBeam(0.7, photons=10_000.0, glint=10.0), 0),
        pytest.param(
            "grazing", ThickBeam(0.7, photons=10_000.0, glint=100.0), 0, marks=pytest.mark.long
        ),
    ],
    ids=["bright", "brighter"],
)
def test_light_of_mirrors_pulled_the_corner(path, beam, seed):
    """The corner, at its stated errors: whitened chi-square of three numbers, chance 1e-5 each."""
    vertices = PATHS[path]
    found = path_of(path, beam, recording(path, beam, seed), "photon")
    off = found.vertices_mm[1] - vertices[1]
    chi2 = off @ np.linalg.solve(found.covariance[4:7, 4:7], off)
    assert chi2 < chdtri(3, CHANCE)
    assert found.verdict.level.value != "contradicted"
