"""A tail that the clock knows lay beneath the light of the leg that follows: its line moved.

Photons of each leg were counted by Gaussians, though times were fitted with the flat's pulse: where
two legs run side by side, the tail of the first was taken for light of the second on that side. In
random laboratory 654 lines were 0.005 to 0.015 px off, and its path 7 stated errors, trusted.
"""

import numpy as np
import pytest
from scipy.stats import exponnorm, norm

from benchmarks.random_labs import drawn_lab, path_of, pulls_of
from lightflight.timing.clock.response import Response
from lightflight.timing.pulses.amplitudes import amplitudes_at_times

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")

_STD_PS, _TAIL_PS, _SHARE = 80.0, 85.0, 0.3
_WIDTH_PS, _PERIOD_PS = 50.0, 10_000.0


def with_tail(delay_ps):
    """Share of a pulse in each code, by SciPy: a Gaussian of which a part is late."""
    edges = np.arange(0.0, _PERIOD_PS + 1.0, _WIDTH_PS)
    early = norm.cdf(edges, delay_ps, _STD_PS)
    late = exponnorm.cdf(edges, _TAIL_PS / _STD_PS, delay_ps, _STD_PS)
    return np.diff((1.0 - _SHARE) * early + _SHARE * late)


@pytest.mark.parametrize("apart_ps", [400.0, 700.0, 1_000.0])
def test_a_dark_pulse_behind_a_bright_one_is_dark(apart_ps):
    """Expected counts, no noise: Gaussians gave it up to 1.5 % of the other's light."""
    response = Response.with_tail(std_ps=_STD_PS, tail_ps=_TAIL_PS, tail_share=_SHARE)
    first = 3_000.0
    counts = 1e5 * with_tail(first)[np.newaxis] + 0.01 * _WIDTH_PS
    lower = np.arange(0.0, _PERIOD_PS, _WIDTH_PS)[np.newaxis]
    mean = first + _SHARE * _TAIL_PS
    delays, stds = np.array([[mean, mean + apart_ps]]), np.full((1, 2), response.std_ps)

    def photons(table):
        return amplitudes_at_times(
            counts, lower, lower + _WIDTH_PS, _PERIOD_PS, delays, stds, table=table
        )[0][0]

    # What a mean within codes leaves: 2e-4 of the light.
    assert photons(response.table()) == pytest.approx([1e5, 0.0], abs=40.0)
    if apart_ps < 500.0:
        assert photons(None)[1] > 500.0


@pytest.mark.long
def test_the_laboratory():
    """No part of the path is 4.5 stated errors off: by chance one in 30,000 is."""
    lab = drawn_lab(654)
    path = path_of(lab, "joint")
    assert path.n_legs == 3
    assert path.verdict.level == "trust"
    assert pulls_of(lab, path)[:, 1].max() < 4.5
