"""A fifth of the light in haze moved a path by 6 mm, at 14 stated errors."""

import warnings

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import LightflightWarning
from lightflight.reconstruct.model.cells import Cells, lag_edges
from lightflight.reconstruct.model.counted import cumulated, lit_pixels
from lightflight.reconstruct.model.expected_counts import Pulses
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.usefixtures("unexamined")
@pytest.mark.parametrize(
    ("defect", "strength", "method"),
    [
        ("haze_500ps", 1, "joint"),
        ("haze_150ps", 1, "photon"),
        pytest.param("veiling_glare", 1, "joint", marks=pytest.mark.long),
    ],
)
def test_one_leg_in_other_light_is_right_within_its_errors(defect, strength, method):
    """40,000 photons, source and emission known; false alarm 1e-4."""
    assert not DEFECTS[defect].held_out
    plain = random_world(288, 1)
    world = DEFECTS[defect].applied(plain, DEFECTS[defect].strengths[strength])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        path = lf.reconstruct(record(world, 288), method=method, **what_the_user_tells(world))
    step = np.diff(world.vertices, axis=0)[0]
    truth = np.degrees(np.arcsin(-step @ world.view.axes[2] / np.linalg.norm(step)))
    assert abs(path.legs[0].angle_deg - truth) < 4.0 * path.legs[0].angle_std_deg
    # Without a place for that light the errors were up to 0.9 degrees.
    assert path.legs[0].angle_std_deg < 0.02


def test_times_are_those_of_the_core_where_the_tail_is_known():
    """Expected counts of a pulse with two tails: fitted with them, its time is that of the rest."""
    tails, late = ((0.2, 150.0), (0.1, 500.0)), np.array([12.0, -7.0])
    edges = np.tile(lag_edges(70.0, 56.0, 1.3, 50_000.0), (2, 1))
    std = np.full(2, 70.0)
    share = 0.7 * cumulated(edges, late, std, 0.0)
    for part, wait in tails:
        share = share + part * cumulated(edges, late, std, wait)
    counts = 40_000.0 * np.diff(share, axis=1) + 0.02 * np.diff(edges, axis=1)
    everywhere = np.ones(counts.shape)
    cells = Cells(edges, counts, everywhere > 0.0, 0.0 * everywhere, everywhere)
    pulses = Pulses(np.zeros((2, 1)), std[:, np.newaxis])
    known = lit_pixels(cells, pulses, tails=tails)
    np.testing.assert_allclose(known.late_ps[:, 0], late, atol=1e-3)
    np.testing.assert_allclose(known.photons[:, 0], 40_000.0, rtol=1e-4)
    plain = lit_pixels(cells, pulses)
    assert (plain.late_ps[:, 0] - late > 20.0).all()
