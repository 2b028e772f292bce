"""A signal at one code in every pixel (a trigger's crosstalk) was called another camera's clock.

Times of pixels that hold nothing else are alike on raw codes and scattered by their delays once
calibrated: "it is of another camera" sent the user to calibrate anew, which changes nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import CalibrationError
from tests.labs import one_leg


def test_a_signal_at_one_code_is_named():
    """Brighter than the flight wherever it is: no pixel's delay is in its times."""
    lab, rng = one_leg(), np.random.default_rng(1)
    timing = replace(lab.timing, skew_ps=rng.normal(0.0, 160.0, lab.camera.shape))
    counts = rng.poisson(lab.mean(4_000.0))
    counts[..., 40:43] += rng.poisson([3_000, 6_000, 3_000], (*lab.camera.shape, 3))
    with pytest.raises(CalibrationError, match=r"of \d+ pixels come at the same code") as refused:
        lf.reconstruct(lab.histograms(counts), camera=lab.camera, source=lab.timed, timing=timing)
    assert refused.value.exit_code == 4
