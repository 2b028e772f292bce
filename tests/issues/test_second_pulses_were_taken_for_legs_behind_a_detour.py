"""A second pulse, a tenth as strong and 3 ns later, made eight legs of three, in half a minute.

Legs of its light, joined to the first by mirrors that nobody saw, explained all of the recording.
"""

from __future__ import annotations

import importlib
from types import SimpleNamespace

import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world
from tests.path_fakes import make_path


@pytest.mark.long
def test_a_second_pulse_is_no_detour():
    world = random_world(300, 3).but(second=0.1, second_ps=3000.0)
    with pytest.warns(SuspectDataWarning, match="second pulse"):
        path = lf.reconstruct(record(world, 300), **what_the_user_tells(world))
    assert path.n_legs == 3
    assert not path.gaps
    assert path.verdict.findings[0].name == "other_pulse"


@pytest.mark.parametrize("name", [FindingName.OTHER_PULSE, FindingName.UNSEEN_LEG])
def test_no_detour_is_tried_beside_a_second_pulse(name, monkeypatch):
    """Whatever else the verdict leaves open; where it names none, one is tried."""
    answer = importlib.import_module("lightflight.reconstruct.answer")
    asked: list[tuple[object, ...]] = []

    def no_detour(*given):
        asked.append(given)
        return None, False

    finding = Finding(name, "", 9.0, "", Severity.CONTRADICTED)
    path = make_path(verdict=Verdict(Level.CONTRADICTED, (finding,)))
    monkeypatch.setattr(answer, "_without_images", lambda *_: None)
    monkeypatch.setattr(answer, "leaves_misfit", lambda _: True)
    monkeypatch.setattr(answer, "_detour", no_detour)
    monkeypatch.setattr(answer, "_bent", lambda *_: None)
    assert answer._reconsidered(path, None, SimpleNamespace(may_bend=False), None) is path
    assert len(asked) == (name is FindingName.UNSEEN_LEG)
