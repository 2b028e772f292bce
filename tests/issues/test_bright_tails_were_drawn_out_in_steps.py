"""Pulses with more than half of their light in a tail were drawn out in steps too far apart.

How far apart tables lie was asked of the highest density, as if all of it were a Gaussian: the
front is twice as steep. Of a pulse of 60 ps and a tail of 200 ps, 0.9 % of the photons were
expected elsewhere.
"""

import numpy as np
import pytest

from lightflight.reconstruct.model.pulse_shape import Shape
from lightflight.timing.clock.response import Response


@pytest.mark.parametrize("flight_ps", [12.0, 20.0, 30.0, 40.0, 48.0])
def test_its_light_comes_when_it_does(flight_ps):
    """Against the pulse at 1,001 instants of a Gaussian flight."""
    response = Response.with_tail(std_ps=60.0, tail_ps=200.0, tail_share=0.5)
    table = response.table()
    z = np.linspace(-2.0, 10.0, 241)
    late = np.linspace(-5.0, 5.0, 1001)
    weight = np.exp(-0.5 * late**2)
    weight /= weight.sum()
    flight = flight_ps / response.std_ps
    moved = z[:, np.newaxis] - flight * late
    true = np.diff(np.interp(moved, table[0], table[1]) @ weight)
    shape = Shape(table).drawn_out(np.full((1, 1), 0.5 * flight**2))
    found = np.diff(shape.come(z[np.newaxis])[0])
    assert np.abs(found - true).sum() < 0.004
