"""Fault: a mirror that all counts show gave way to one that they hardly do.

Its fit had used up its rounds on the way there (the plane moves 5 mm in each): the next mirror was
tried, which explains six thousand less, but stood. The path was right and contradicted.
"""

from __future__ import annotations

import pytest

import lightflight as lf
from benchmarks.misfit_labs import recording_of
from benchmarks.random_labs import pulls_of

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


def test_it_goes_on_from_where_it_is():
    lab, hist, told = recording_of("wall", 0.1, 1038)
    path = lf.reconstruct(hist, **told)
    assert path.verdict.level == "check", path.verdict
    assert "mirror" in path.verdict.findings[0].sentence
    assert (pulls_of(lab, path)[:, 1] < 5.0).all()
