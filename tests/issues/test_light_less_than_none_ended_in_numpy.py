"""Second pulses of 3 % after 300 ps ended in an error of NumPy (an independent forward model).

In the first rounds late light may come out less than none. Where nothing was left to expect in all
cells of a further pulse, the variance of its light was infinite, and then every strength no number.
Now half of the background is left.
"""

import numpy as np
from scipy.stats import norm

from lightflight.reconstruct.model.cells import Cells, lag_edges
from lightflight.reconstruct.model.counted import lit_pixels
from lightflight.reconstruct.model.expected_counts import Pulses

STD_PS = 40.0


def test_a_pulse_where_nothing_is_expected_has_a_finite_error():
    edges = lag_edges(STD_PS, 8.0 * STD_PS, 1.3, 10_000.0)[np.newaxis]
    everywhere = np.ones((1, edges.shape[1] - 1))
    counts = 15_000.0 * np.diff(norm.cdf(edges, 0.0, STD_PS)) + 1e-3 * np.diff(edges)
    cells = Cells(edges, counts, everywhere > 0.0, 0.0 * everywhere, everywhere)
    pulses = Pulses(np.array([[0.0, 2450.0]]), np.full((1, 2), STD_PS))
    pixels = lit_pixels(cells, pulses, tails=((-0.05, 2000.0),))
    about = np.abs(0.5 * (edges[:, 1:] + edges[:, :-1]) - 2450.0) < 5.0 * STD_PS
    assert (pixels.mean[about] > 0.0).all()
    assert np.isfinite(pixels.inverse).all()
    for told in pixels.said_of(everywhere[:, :, np.newaxis]):
        assert np.isfinite(told).all()
