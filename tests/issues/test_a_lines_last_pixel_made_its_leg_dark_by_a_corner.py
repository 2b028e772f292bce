"""Clean recordings of bright light were contradicted: by a corner a leg was to be all but dark.

How a pixel's light is shared by two legs was read off the brightness along each at its very end,
which hangs on one pixel; where the light of both runs together it may have nothing. Of 67,000
photons a leg that gives a pixel two thirds was to give 0.3 %: pulses by the corner did not fit, and
two of six recordings were contradicted at 7 and 9 sigma (`benchmarks/piece_labs.py`).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from benchmarks.piece_labs import drawn_scene
from benchmarks.random_labs import path_of
from lightflight.reconstruct.other_light.around import _light_given


@pytest.mark.parametrize("end_px", [-30.0, 30.0])
def test_a_line_is_as_bright_at_its_end_as_a_step_before(end_px):
    along = np.linspace(-30.0, 30.0, 41)
    log_bright = np.full(41, 10.0)
    log_bright[np.argmin(np.abs(along - end_px))] = 2.0
    seen = SimpleNamespace(log_light=np.zeros(1))
    light = SimpleNamespace(
        spline=make_interp_spline(along, log_bright),
        spot_std_at=lambda _: np.full(1, 0.5),
        seen=lambda *_: seen,
    )
    line = SimpleNamespace(span_px=(-34.0, 34.0), heading_rad=lambda _: np.zeros(1))
    picture: Any = SimpleNamespace(legs=[line], fits=[light])
    (given,) = _light_given(picture, 0, np.array([1.05 * end_px]), np.zeros(1))
    # The interpolating spline rings by a third of that step; it was exp(2).
    assert abs(np.log(given) - 10.0) < 3.0


@pytest.mark.long
@pytest.mark.parametrize("noise", [0, 4])
def test_a_bright_corner_is_no_contradiction(noise):
    path = path_of(drawn_scene("block", 21).lab, "joint", noise)
    assert path.verdict.level == "trust", path.verdict
