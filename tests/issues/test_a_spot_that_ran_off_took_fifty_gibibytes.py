"""A bent leg was tried where three run over each other, and its spot, a parabola of the logarithm,
was a million pixels wide beyond its end: cells of its light took 52 GiB, and the program its end.

Laboratory 1247 of `benchmarks/random_labs.py`, noise 1: too slow for the suite, so this is what
the fit of all counts asked for there.
"""

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import NothingFoundError
from lightflight.reconstruct.all_counts.rest_in_counts import with_rest_of_light
from lightflight.reconstruct.fit.rest_of_light import Rest
from lightflight.reconstruct.fit.uneven import RestAlong
from lightflight.reconstruct.model.forward import Pixels
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.leg_in_picture import leg_in_picture
from lightflight.reconstruct.model.strength import SpotAlong
from lightflight.reconstruct.model.unknowns import Light

ROUND = np.zeros(3)
RUN_OFF = np.array([0.0, 0.0, -2.0])


def modes_with(varies_ln):
    """Of a row of pixels beside a straight leg."""
    camera = lf.Camera.facing_plane(distance_mm=535.0)
    state = PathState(np.array([[-90.0, 20.0, 0.0], [90.0, 20.0, 0.0]]), 0.0)
    line = leg_in_picture(state, 0, camera)
    cols = np.arange(32)
    rows = np.full(32, round(float(line.origin_px[1])))
    n = len(rows)
    pixels = Pixels(
        rows=rows, cols=cols, near=np.ones((n, 1), bool), points_px=np.column_stack((cols, rows)),
        skew_ps=np.zeros(n), pixel_var=np.zeros(n), modes_ps=np.zeros((n, 1, 0)),
    )  # fmt: skip
    light = Light(
        (line,), (np.zeros(8),), (np.zeros(4),), np.log(0.6), np.log(60.0), (0.0,),
        spots=(SpotAlong(np.array([-4.0, 4.0]), varies_ln),),
    )  # fmt: skip
    rest = RestAlong(0, 0, line, (-50.0, 50.0), Rest(0.1, 0.8, (), 0.9))
    return with_rest_of_light(pixels, [rest], light, state, camera, lf.Medium()).uneven


def test_a_spot_beyond_the_picture_is_no_spot():
    assert modes_with(ROUND).ln.shape[2] < 200
    with pytest.raises(NothingFoundError, match="the spot of leg 1 grows beyond the picture"):
        modes_with(RUN_OFF)
