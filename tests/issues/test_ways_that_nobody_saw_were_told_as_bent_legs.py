"""Legs about a way that nobody saw were cut otherwise and bent: by 18 and 35 mm, and stood.

Detours were asked about where a path left misfit that nothing named takes up. Where a curve did, or
the path with one was another answer and far likelier, they were not: 154 of 161 pulses lay on a
bent path, all of them on the one with a detour. Scenes 26126, 26242 and 26256 of
`benchmarks/unseen_legs.py`.
"""

from __future__ import annotations

import importlib
from types import SimpleNamespace

import pytest

from benchmarks.unseen_legs import result_of
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from tests.path_fakes import make_path

answer = importlib.import_module("lightflight.reconstruct.answer")


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")
@pytest.mark.parametrize("seed", [26126, 26242, 26256])
def test_they_are_ways_that_nobody_saw(seed):
    """The delay within four stated errors (false alarm 6e-5 a scene)."""
    found = result_of(4_000.0, "joint", seed)
    assert found["found"]
    assert found["level"] == "check"
    assert abs(found["pull"]) < 4.0


def said(level, severity, *names):
    names = names or (FindingName.CURVED_LEG,)
    findings = tuple(Finding(name, "", 9.0, "", severity) for name in names)
    return make_path(verdict=Verdict(level, findings))


CURVED = said(Level.CONTRADICTED, Severity.CONTRADICTED)
SLIP = said(
    Level.CONTRADICTED, Severity.CONTRADICTED, FindingName.FOCAL_LENGTH, FindingName.CURVED_LEG
)
BENT, GAP = (said(Level.CHECK, Severity.CHECK) for _ in range(2))


@pytest.mark.parametrize(
    ("first", "has_bend", "gap", "is_cheaper", "told"),
    [
        (BENT, True, GAP, True, BENT),
        (BENT, True, GAP, False, GAP),
        (BENT, True, CURVED, False, BENT),
        (CURVED, False, GAP, True, GAP),
        (CURVED, True, GAP, False, GAP),
        (CURVED, True, None, False, BENT),
        (SLIP, False, GAP, True, None),
    ],
    ids=["cheaper", "dearer", "gap contradicted", "no bend", "contradicted", "no gap", "a slip"],
)
def test_of_a_curve_and_a_way_that_nobody_saw_pulses_choose(
    first, has_bend, gap, is_cheaper, told, monkeypatch
):
    """Also where the curve explains the counts by itself, or contradicts and is none; not where
    something else is likelier: a lens read off wrong took as long again."""
    monkeypatch.setattr(answer, "_bent", lambda *_: "curve" if has_bend else None)
    monkeypatch.setattr(answer, "_detour", lambda *_: (gap and (gap, "gap"), True))
    monkeypatch.setattr(answer, "costs_less", lambda *_: is_cheaper)
    monkeypatch.setattr(answer, "_told", lambda *_: (BENT, "curve"))
    monkeypatch.setattr(answer, "_judged", lambda path, *_: path)
    request = SimpleNamespace(may_bend=False, sightings=[], setting=None)
    assert answer._detour_or_bend(first, None, request, None) is told
