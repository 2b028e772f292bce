"""Fault: a halo of less than none grew and grew, and the counts became ever less likely.

Other light may come out less than none; counts may not, and keep half of the background. There the
score went on as if they followed: thirty rounds, each of which said that the next were better.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from lightflight.reconstruct.model.cells import Cells
from lightflight.reconstruct.model.counted import dark_pixels

N, CELLS = 30, 40
STEP = 1e-3


def likelihood(counts, width, halo, share):
    """Log-likelihood of all pixels, the background of each where it is largest."""

    def lacks(background, of):
        own = background * width[of]
        lacking = np.maximum(share * halo / own - 0.25, 0.0) / 0.25
        taken = np.where(lacking > 0.0, 0.5 - 0.25 * np.exp(-lacking), share * halo / own)
        mean = own * (1.0 - taken)
        return float(np.sum(mean - counts[of] * np.log(mean)))

    return -sum(
        minimize_scalar(lacks, bounds=(1e-4, 1.0), args=(of,), method="bounded").fun
        for of in range(len(counts))
    )


@pytest.mark.parametrize("share", [0.1, 0.6, 1.5])
def test_the_score_is_the_slope_of_the_likelihood(share):
    """To 1 %, at shares that take less, about and more than half of the background.

    The pixels are held to their background by a prior of itself: nothing beside 400 counts. What
    their two steps leave of it is the score's too (`Pixels.said_of`).
    """
    rng = np.random.default_rng(27)
    edges = np.tile(np.linspace(-2000.0, 2000.0, CELLS + 1), (N, 1))
    width = np.diff(edges, axis=1)
    counts = rng.poisson(0.1 * width).astype(float)
    everywhere = np.ones_like(width)
    cells = Cells(edges, counts, everywhere > 0.0, 0.0 * everywhere, everywhere)
    halo = 8.0 * np.exp(-0.5 * (np.linspace(-3.0, 3.0, CELLS)) ** 2)
    pixels = dark_pixels(cells, other=np.broadcast_to(-share * halo, width.shape))
    columns = (halo * pixels.follow)[..., np.newaxis]
    score = pixels.said_of(columns)[0][0]
    sides = [likelihood(counts, width, halo, share + side * STEP) for side in (1.0, -1.0)]
    # The size of a halo is minus the share.
    assert score == pytest.approx((sides[1] - sides[0]) / (2.0 * STEP), rel=0.01)
    assert (pixels.follow.min() == 1.0) == (share < 0.3)
