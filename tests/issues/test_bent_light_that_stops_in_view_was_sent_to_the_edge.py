"""A curve whose light stops in the picture was followed to the picture's edge.

A fibre that ends 40 mm before the edge was told to end 35 mm farther on, with "trust". It was asked
of straight legs alone where their light stops, and `joint` fitted no bent leg, arm or way by a
mirror by all its counts there.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.path.verdict import Level
from tests.oracles.bent import fibre_in_view
from tests.oracles.refracted_border import histograms, what_the_user_tells


@pytest.mark.parametrize("method", ["joint", pytest.param("photon", marks=pytest.mark.long)])
def test_bent_light_that_stops_in_view_was_sent_to_the_edge(method):
    """Its end at its stated errors: chance 1e-5."""
    scene = fibre_in_view("picture", index=1.00027, end_mm=260.0)
    hist = histograms(scene, 5)
    path = lf.reconstruct(
        hist, method=method, n_legs=1, free=("bend",), **what_the_user_tells(scene, hist)
    )
    assert path.verdict.level is Level.TRUST
    assert len(path.bends) == 1
    off = path.vertices_mm[-1] - scene.vertices_mm[-1]
    assert off @ np.linalg.solve(path.covariance[4:7, 4:7], off) < chi2.ppf(1.0 - 1e-5, 3)
    assert np.linalg.norm(off) < 2.0
