"""A leg that fans out spreads light across its flight, and times were corrected as a lens asks for.

A lens out of focus mixes times along the leg as well. With the last mirror shaking about one axis
paths were up to seven stated errors off, and some trusted (laboratories 6020, 6022, 6037).
"""

import pytest

import lightflight as lf
from benchmarks.misfit_labs import recording_of
from benchmarks.random_labs import pulls_of

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


@pytest.mark.parametrize("seed", [6029, 6037, pytest.param(6022, marks=pytest.mark.long)])
def test_its_places_lie_within_their_errors(seed):
    """Farthest of two places, by pulses, and of six, by all counts: 3.3 errors off once in 300.

    They were 3.8, 3.5 and 4.7 off.
    """
    lab, recording, told = recording_of("sheet", 0.7, seed)
    path = lf.reconstruct(recording, **told)
    assert path.n_legs == len(lab.vertices) - 1
    assert pulls_of(lab, path)[:, 1].max() < 3.3
    all_counts = any("all counts" in sentence for sentence in path.statements)
    assert any("fans out" in sentence for sentence in path.statements) == all_counts
