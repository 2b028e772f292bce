"""Fault: haze of half the light, fog and glare were in the fit, and right paths contradicted.

More than 0.3 of other light was called implausible, whatever the counts said; and a dim, wide pulse
of glare beside a line was claimed by the path from as far off as its errors are large.
"""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import LightflightWarning
from tests.oracles.miss import error_and_covariance
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.parametrize(
    ("defect", "seed", "share", "expected"),
    [
        ("haze_150ps", 5700, 0.5, 0.5),
        pytest.param("veiling_glare", 5700, 0.05, 0.05, marks=pytest.mark.long),
        pytest.param("haze_500ps", 5701, 0.5, 0.5, marks=pytest.mark.long),
        # As many times the light that is left on the path.
        pytest.param("fog", 5700, 0.6, 1.5, marks=pytest.mark.long),
    ],
)
def test_it_is_taken_into_the_fit(defect, seed, share, expected):
    """And told as large as it is; two numbers at fixed seeds, chi-square beyond 1e-5."""
    world = random_world(seed, 1)
    if defect == "fog":
        world = world.but(late_halo=share, late_halo_std_px=8.0, late_halo_ps=600.0)
    else:
        world = DEFECTS[defect].applied(world, share)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        path = lf.reconstruct(record(world, seed), **what_the_user_tells(world))
    assert path.verdict.level == "check", path.verdict
    said = path.verdict.findings[0].sentence
    assert said.endswith("taken into the fit")
    (told,) = re.findall(r"^([\d.]+) of the light", said)
    assert float(told) == pytest.approx(expected, rel=0.15)
    error, covariance = error_and_covariance(path, world.vertices)
    error = np.ravel(error)
    assert error @ np.linalg.solve(covariance, error) < 23.0
