"""`photon` slid the knots of its light with the lens, and took their spacing for knowledge of it.

A lens and smooth delays told as uncertain, in uneven light: up to 27 stated errors off, with
"trust". What lights a pixel is that pixel's, wherever the lens looks.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from lightflight.timing.clock.shared_modes import with_shared_errors
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world

STATED = {"aspect_std": 0.005, "axis_std_px": 0.3, "decentering_std": 2e-3}
SKEW_PS = 4.0
FALSE_ALARM = 1e-4


@pytest.mark.usefixtures("unexamined", "nothing_twice")
def test_knots_of_the_light_told_where_the_lens_looked():
    """Six numbers of two corners, whitened; the world is off by one draw of what is stated."""
    seed = 43
    right = random_world(seed, 3)
    told = what_the_user_tells(right) | {"n_legs": 3}
    told["camera"] = replace(told["camera"], **STATED)
    told["timing"] = with_shared_errors(told["timing"], skew_std_ps=SKEW_PS)
    (width_px, height_px), (u_px, v_px) = right.view.focal_px, right.view.axis()
    world = right.but(
        view=replace(
            right.view,
            focal_px=(0.994 * width_px, height_px),
            axis_px=(u_px, v_px - 0.2),
            askew=(2e-3, -1e-3),
        ),
        skew_ps=(0.7, 7.2, 8.7),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        path = lf.reconstruct(record(world, seed), method="photon", **told)
    places = [4 * k + axis for k in (1, 2) for axis in range(3)]
    off = (path.vertices_mm - world.vertices)[1:-1].ravel()
    squared = off @ np.linalg.solve(path.covariance[np.ix_(places, places)], off)
    assert squared < chi2.ppf(1 - FALSE_ALARM, len(off))
