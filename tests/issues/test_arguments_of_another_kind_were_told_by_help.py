"""Python's calls said "see help()" of a wrong argument, and took a name for as many flats."""

import numpy as np
import pytest

import lightflight as lf

CUBE = np.ones((4, 4, 16), dtype=int)
HIST = lf.Histograms(CUBE, bin_width_ps=55.0)
CAMERA = lf.Camera.facing_plane(shape=(4, 4))


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: lf.reconstruct(CUBE, camera=CAMERA), "make them of a cube (lightflight.Histogr"),
        (lambda: lf.reconstruct(HIST, camera=CAMERA, source=(0, 0, 0)),
         "source must be a Source, such as Source((0, 0, 0)); got (0, 0, 0)"),
        (lambda: lf.reconstruct(HIST, camera=CAMERA, timing="calibration.h5"),
         "timing must be a TimingCalibration: calibrate_timing or TimingCalibration.load; got 'c"),
        (lambda: lf.find_legs(HIST), "arrivals must be Arrivals, from find_arrivals; got"),
        (lambda: lf.calibrate_timing(HIST, flat="flat.h5"),
         "flat must be Histograms or a list of them, got 'flat.h5'"),
    ],
)  # fmt: skip
def test_it_is_told_what_is_wanted(call, said):
    with pytest.raises(TypeError) as caught:
        call()
    assert said in str(caught.value)
