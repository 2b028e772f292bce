"""Errors of a lens's aspect, axis and decentring, and of smooth delays, drawn as stated."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from lightflight.timing.clock.shared_modes import SKEWS, skewed_delays, with_shared_errors
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world

ASPECT, AXIS_PX, ASKEW, SKEW_PS = 0.005, 0.3, 2e-3, 4.0
FALSE_ALARM = 1e-4
SEEDS = range(40, 42)


@cache
def drawn(seed: int):
    """A world off by one draw of all eight numbers, and what is told of it."""
    world, rng = random_world(seed, 3), np.random.default_rng([seed, 15])
    told = what_the_user_tells(world)
    camera = replace(told["camera"], aspect_std=ASPECT, axis_std_px=AXIS_PX, decentering_std=ASKEW)
    timing = with_shared_errors(told["timing"], skew_std_ps=SKEW_PS)
    view = world.view
    seen = replace(
        view,
        focal_px=(view.focal_px[0] * (1 + ASPECT * rng.normal()), view.focal_px[1]),
        axis_px=tuple(np.array(view.axis()) + AXIS_PX * rng.normal(size=2)),
        askew=tuple(ASKEW * rng.normal(size=2)),
    )
    world = world.but(view=seen, skew_ps=tuple(SKEW_PS * rng.normal(size=3)))
    return world, told | {"camera": camera, "timing": timing, "n_legs": 3}


@pytest.mark.usefixtures("unexamined", "nothing_twice")
@pytest.mark.parametrize("method", ["joint", pytest.param("photon", marks=pytest.mark.long)])
def test_errors_hold_what_was_drawn(method):
    """Two recordings, the six numbers of their corners whitened: 12 degrees of freedom."""
    total, dof = 0.0, 0
    for seed in SEEDS:
        world, told = drawn(seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SuspectDataWarning)
            path = lf.reconstruct(record(world, seed), method=method, **told)
        places = [4 * k + axis for k in (1, 2) for axis in range(3)]
        off = (path.vertices_mm - world.vertices)[1:-1].ravel()
        values, axes = np.linalg.eigh(path.covariance[np.ix_(places, places)])
        total += float(np.sum((axes.T @ off) ** 2 / values))
        dof += len(off)
    assert chi2.ppf(FALSE_ALARM / 2, dof) < total < chi2.ppf(1 - FALSE_ALARM / 2, dof)


def test_a_set_up_file_keeps_them(tmp_path):
    _, told = drawn(40)
    arrays = told["camera"].to_arrays()
    again = lf.Camera.from_arrays(arrays)
    for name in ("aspect_std", "axis_std_px", "decentering_std"):
        assert getattr(again, name) == getattr(told["camera"], name)
    # What is exact leaves no trace: files of before mean the same.
    assert "aspect_std" not in replace(again, aspect_std=0.0).to_arrays()


def test_an_error_below_zero_is_refused():
    with pytest.raises(ValueError, match="axis_std_px must be finite and >= 0"):
        replace(lf.Camera.facing_plane(), axis_std_px=-1.0)
    with pytest.raises(ValueError, match="clock skew must be finite and >= 0"):
        with_shared_errors(drawn(40)[1]["timing"], skew_std_ps=-1.0)


def test_skewed_delays_are_one_at_the_edges():
    modes = skewed_delays((24, 32))
    assert modes.shape == (24, 32, len(SKEWS))
    assert modes[-1, 0, 0] == modes[0, -1, 1] == 1.0
    middle = modes[11:13, 15:17].reshape(-1, 3).mean(axis=0)
    np.testing.assert_allclose(middle, 0.0, atol=3e-3)
    np.testing.assert_allclose(modes[11:13, -1, 2].mean(), 1.0, atol=2e-3)
