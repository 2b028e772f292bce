"""Axes of a bend were those of the line it was first looked for on.

A straight path beside light that bends in depth ends elsewhere, and a parabola along axes across
that line is another than one across its own: by a quarter of a degree, which put the middle of a
leg of 20 mm over the field 1.8 stated errors away (rms, three legs, nothing told).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from tests.oracles.bent import bent_scene
from tests.oracles.refracted_border import histograms, what_the_user_tells
from tests.reconstruct.test_bends import squared_pulls


@pytest.mark.usefixtures("unexamined")
@pytest.mark.long
def test_axes_of_bends_stood_askew():
    """One recording: chance 1e-5."""
    scene = bent_scene(legs=3, sagitta_mm=20.0, way="depth")
    hist = histograms(scene, 1)
    path = lf.reconstruct(hist, free=("bend",), **what_the_user_tells(scene, hist))
    (bend,) = path.bends
    along = path.vertices_mm[bend.leg + 1] - path.vertices_mm[bend.leg]
    # A quarter of a degree before.
    assert np.abs(bend.axes @ along).max() < 1e-3 * np.linalg.norm(along)
    total, dof = squared_pulls(path, scene)
    assert total < chi2.ppf(1.0 - 1e-5, dof)
