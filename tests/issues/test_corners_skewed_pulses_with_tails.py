"""What a corner leaves of a footprint is half of a Gaussian, and light that bends is none at all.

All counts took both for Gaussians. Where more than half of a pulse is its tail its front says when
it came, which a skewed flight moves: bright corners were up to four stated errors off.
"""

import numpy as np
import pytest

import lightflight as lf
from benchmarks.random_labs import drawn_lab, expected_counts, histograms, pulls_of, told_of

pytestmark = [
    pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning"),
    pytest.mark.usefixtures("unexamined", "nothing_twice"),
]


@pytest.mark.long
def test_a_bright_corner_is_where_it_is():
    """Counts without noise of photons: what pixels and clock err by is left, 0.9 (2.5 before)."""
    lab = drawn_lab(603)
    counts = np.round(expected_counts(lab)).astype(int)
    path = lf.reconstruct(histograms(lab, counts), method="photon", **told_of(lab))
    assert path.n_legs == 2
    assert pulls_of(lab, path)[:, 1].max() < 1.5
