"""A camera told aside contradicted the path, and `source` or `pose` took up all that was seen:
detours and bends were searched for all the same, in nine tenths of the whole time."""

from __future__ import annotations

import importlib

import pytest

from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from lightflight.reconstruct.verdict.judge import leaves_misfit
from tests.reconstruct.test_verdict import reconstructed

# By its module: the package's name of it is the function.
chain = importlib.import_module("lightflight.reconstruct.chain")


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
        monkeypatch.setattr(chain, name, lambda *a, name=name, **k: asked.append(name))
    path = reconstructed(44, "camera_aside")
    assert path.verdict.level == "contradicted"
    assert {"source", "pose"} <= {one.name for one in path.verdict.findings}
    assert asked == []
