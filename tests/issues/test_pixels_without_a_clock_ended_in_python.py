"""A pixel on the path that no flat had seen, NaN in the calibration, ended in NumPy's words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight import flags
from tests.labs import three_legs


@pytest.fixture(scope="module")
def lab():
    return three_legs()


def path_of(lab, timing, method):
    return lf.reconstruct(
        lab.recording(0, 4000.0), camera=lab.camera, source=lab.timed, timing=timing, method=method
    )


@pytest.mark.parametrize("method", ["joint", "photon"])
@pytest.mark.parametrize(
    "field",
    ["skew_ps", *(pytest.param(f, marks=pytest.mark.long) for f in ("gain", "phases", "end_code"))],
)
@pytest.mark.parametrize("flag", [0, pytest.param(flags.UNCALIBRATED, marks=pytest.mark.long)])
def test_the_others_tell_the_path(lab, method, field, flag):
    """16 pixels of the first leg's line and beside it: the path stays within its errors."""
    if (method, flag) == ("photon", 0) and field != "skew_ps":
        pytest.skip("as with the flag")
    values, words = np.array(getattr(lab.timing, field)), np.array(lab.timing.flags)
    values[14:18, :4], words[14:18, :4] = np.nan, flag
    timing = replace(lab.timing, **{field: values, "flags": words})
    path = path_of(lab, timing, method)
    assert path.n_legs == 3
    assert path.verdict.level == "trust"
    offset = np.abs(path.vertices_mm - lab.vertices_mm)[:3]
    assert (offset < 4.5 * path.vertex_std[:3, :3] + 1e-9).all()


@pytest.mark.parametrize("field", ["gain", "skew_ps"])
def test_no_pixel_with_a_clock_is_told(lab, field):
    timing = replace(lab.timing, **{field: np.full(lab.timing.shape, np.nan)})
    with pytest.raises((ValueError, RuntimeError)) as told:
        path_of(lab, timing, "joint")
    assert type(told.value).__module__.startswith("lightflight")
