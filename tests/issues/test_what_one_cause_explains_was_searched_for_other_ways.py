"""A camera told aside contradicted the path, and `source` or `pose` took up all that was seen:
detours and bends were searched for all the same, in nine tenths of the whole time. On a nominal
clock bends were for two thirds of it, though neighbouring pixels disagreed by 130 stated errors."""

from __future__ import annotations

import importlib

import pytest

from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from lightflight.reconstruct.model.geometry import state_of_path
from lightflight.reconstruct.verdict.bent import asks_for_bends
from lightflight.reconstruct.verdict.judge import leaves_misfit
from tests.path_fakes import make_path
from tests.reconstruct.test_verdict import reconstructed

# By its module: the package's name of it is the function.
answer = importlib.import_module("lightflight.reconstruct.answer")


def said(level, *names):
    found = (Finding(FindingName(one), "", 9.0, "", Severity.CONTRADICTED) for one in names)
    return Verdict(level, tuple(found))


@pytest.mark.parametrize(
    ("names", "left"),
    [
        (("source", "pose"), False),
        (("distortion",), False),
        (("calibration", "scatter"), True),
        (("source", "unexplained_light"), True),
        (("pose", "unseen_leg"), True),
    ],
)
def test_misfit_is_left_where_a_symptom_is_named(names, left):
    assert leaves_misfit(said(Level.CONTRADICTED, *names)) == left
    assert not leaves_misfit(said(Level.CHECK, *names))


def test_what_one_cause_explains_is_not_searched_for_other_ways(monkeypatch):
    asked = []
    for name in ("detour_instead", "bent_instead", "with_arms"):
        monkeypatch.setattr(answer, name, lambda *a, name=name, **k: asked.append(name))
    path = reconstructed(44, "camera_aside")
    assert path.verdict.level == "contradicted"
    assert {"source", "pose"} <= {one.name for one in path.verdict.findings}
    assert asked == []


@pytest.mark.parametrize(
    ("names", "asked"),
    [
        (("calibration", "trend", "scatter"), False),
        (("calibration", "curved_leg", "trend"), True),
        (("trend", "calibration"), True),
    ],
)
def test_what_pixels_err_by_themselves_asks_for_no_bends(names, asked):
    state = state_of_path(make_path())
    assert asks_for_bends(said(Level.CONTRADICTED, *names), state) == asked
