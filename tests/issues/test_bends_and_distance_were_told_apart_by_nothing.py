"""Legs that may bend, with nothing told of the source: 430 mm off, stated to 2, with "trust".

Times of a leg curve the more the nearer it is, and so they do where it bends in depth. A fibre
bowed by 20 mm on 177 was told as a straight leg a seventh as far away, or as a bent one there.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.path.verdict import FindingName, Level
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.verdict.doubtful import findings_of_depth
from tests.oracles.bent import fibre_in_view
from tests.oracles.refracted_border import histograms, what_the_user_tells


@pytest.mark.usefixtures("nothing_twice")
def test_bends_and_distance_were_told_apart_by_nothing():
    scene = fibre_in_view("depth", index=1.00027, end_mm=260.0)
    hist = histograms(scene, 1)
    call = what_the_user_tells(scene, hist) | {"source": lf.Source()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lf.errors.SuspectDataWarning)
        path = lf.reconstruct(hist, n_legs=1, free=("bend",), **call)
    assert path.verdict.level is Level.CHECK
    assert path.verdict.findings[0].name is FindingName.CURVED_LEG
    assert "how far away the whole path is" in path.verdict.findings[0].sentence


@pytest.mark.parametrize("told", ["source", "curve"])
def test_a_source_or_the_curve_tells(told):
    scene = fibre_in_view("depth")
    curve = lf.DrawnCurve(scene.points_on(0, np.linspace(0.0, 1.0, 9)), point_std_mm=0.3)
    setting = Setting(
        lf.Camera.facing_plane(),
        lf.Source((85.0, 20.0, 0.0)) if told == "source" else lf.Source(),
        lf.Medium(),
        curves=(curve,) if told == "curve" else (),
    )
    assert findings_of_depth(setting) == ()
    assert len(findings_of_depth(replace(setting, source=lf.Source(), curves=()))) == 1
