"""Halos of 8 px about single legs were contradicted in four of twelve recordings.

Of the light that a leg spreads into a pixel only mean time and width were told, as of one pulse;
millions of photons show that it rises and falls as the leg does. False mirrors took the rest up.
"""

import numpy as np
import pytest
from scipy.stats import exponnorm, norm

from lightflight.reconstruct.model import spread
from lightflight.reconstruct.model.cells import Cells

SHAPE = (17, 21)
STD_PS = 50.0


@pytest.mark.parametrize("ps_per_px", [0.0, 30.0, -90.0])
def test_the_light_of_a_halo_comes_when_that_of_each_place_does(ps_per_px):
    """Against the sum over all places, each a pulse of its own: within 1e-3 of the light."""
    col = np.arange(-3.0, 14.0, 0.25) + 0.125
    places = np.column_stack((np.full(len(col), 8.0), col))
    beam = spread.Beam(
        places, np.zeros(len(col), dtype=int), 7000.0 + ps_per_px * col,
        250.0 * (1.0 + 0.5 * np.sin(col)), STD_PS,
    )  # fmt: skip
    points = np.array([[8, 0], [8, 10], [4, 20], [14, 13]])
    reference = np.array([7000.0, 7300.0, 6000.0, 7100.0])
    edges = np.tile(np.concatenate(([-9e4], np.arange(-3000.0, 6000.0, 70.0), [9e4])), (4, 1))
    one = np.ones((4, edges.shape[1] - 1))
    cells = Cells(edges, one, one > 0.0, 0.0 * one, one)
    found = spread.halo(cells, points, reference, beam, SHAPE, spread.WIDE_PX, spread.WIDE_LATE)
    after = edges[:, np.newaxis] + (reference[:, np.newaxis] - beam.arrival_ps)[:, :, np.newaxis]
    away = np.linalg.norm(points[:, np.newaxis] - places, axis=2)
    at_once = [(reach, 0.0) for reach in spread.WIDE_PX]
    for k, (reach, wait) in enumerate([*at_once, *spread.WIDE_LATE]):
        come = (
            exponnorm.cdf(after, wait / STD_PS, scale=STD_PS) if wait else norm.cdf(after / STD_PS)
        )
        share = np.exp(-0.5 * (away / reach) ** 2) / (2.0 * np.pi * reach**2)
        truth = np.diff(np.einsum("np,npm->nm", share * beam.photons, come), axis=1)
        assert np.abs(found[:, :, k] - truth).max() < 1e-3 * truth.sum(axis=1).max()
        assert found[:, :, k].sum(axis=1) == pytest.approx(truth.sum(axis=1), rel=1e-5)
