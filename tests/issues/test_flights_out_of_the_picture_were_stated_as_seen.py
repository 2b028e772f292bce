"""Flights that leave the picture and come back, in random laboratories: four of 14 were found.

Whether a detour was right hung on the share of pulses, as found at first, that lie on it: 95 % of
the light. By corners, where legs cross and on cameras with a tail less does, of any path. What was
left were wrong legs, or a leg beside the picture whose mirrors were stated to a few millimetres by
a pulse or two of other legs: 110 mm off, and "trust" (`benchmarks/piece_labs.py --only unseen`).
"""

from __future__ import annotations

import importlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.piece_labs import drawn_scene, path_of, pulls_of, right_legs
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.verdict import bent, detours
from tests.path_fakes import make_path

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(2, marks=pytest.mark.long),  # an unseen way, and no second pulse
        pytest.param(7, marks=pytest.mark.long),  # was refused
        pytest.param(16, marks=pytest.mark.long),  # two pulses of other legs: was trusted
    ],
)
def test_the_way_nobody_saw_is_stated_as_such(seed):
    """Depths after it are known to tens of millimetres, of which linear errors say little."""
    scene = drawn_scene("unseen", seed)
    path = path_of(scene)
    assert right_legs(scene, path)
    assert path.verdict.level is Level.CHECK
    before = pulls_of(scene, path)[:2]
    assert (before[:, 1] < 5.0).all()


@pytest.mark.parametrize("holds_all", [False, True])
def test_the_counts_decide_where_pulses_leave_light(holds_all, monkeypatch):
    """A detour that its counts contradict is taken only where it holds all but all of the light."""
    answer = importlib.import_module("lightflight.reconstruct.answer")
    finding = Finding(FindingName.UNEXPLAINED_LIGHT, "", 9.0, "", Severity.CONTRADICTED)
    path = make_path(verdict=Verdict(Level.CONTRADICTED, (finding,)))
    detoured = SimpleNamespace(fit=None, holds_all=holds_all)
    monkeypatch.setattr(answer, "detour_instead", lambda *_: detoured)
    monkeypatch.setattr(answer, "_told", lambda *_: (path, None))
    monkeypatch.setattr(answer, "_judged", lambda *_: path)
    request = SimpleNamespace(
        start=None, setting=SimpleNamespace(lengths=()), sightings=[], n_legs=None
    )
    found, _ = answer._detour(None, request, SimpleNamespace(of_fit=True))
    assert (found == (path, None)) == holds_all


@pytest.mark.parametrize(("curve", "gap", "is_curve"), [(100.0, 95.0, True), (130.0, 95.0, False)])
def test_of_a_curve_and_a_way_nobody_saw_the_counts_choose(curve, gap, is_curve, monkeypatch):
    """The two mirrors cost five numbers, ln 100 each: 23."""
    costs = {"curve": curve, "gap": gap}
    unseen = {"curve": (), "gap": (1,)}
    fits: Any = {
        name: SimpleNamespace(
            solution=SimpleNamespace(state=SimpleNamespace(unseen=legs)), name=name
        )
        for name, legs in unseen.items()
    }
    by_state = {id(fit.solution.state): fit for fit in fits.values()}
    monkeypatch.setattr(bent, "refitted", lambda _, state, __: by_state[id(state)])
    monkeypatch.setattr(bent, "_scatter", lambda _: 1.0)
    monkeypatch.setattr(bent, "priced", lambda fit, *_: costs[fit.name])
    seen: Any = [SimpleNamespace(usable_pulses=np.arange(100))]
    nothing: Any = None
    assert bent.costs_less(fits["curve"], fits["gap"], seen, nothing) == is_curve


@pytest.mark.parametrize(("unseen", "left_out"), [((), True), ((1,), False)])
def test_a_path_does_not_end_in_a_leg_that_nobody_saw(unseen, left_out, monkeypatch):
    """A last leg without light is left out, but not behind an unseen one."""
    vertices = np.array([(0, 0, 0), (300, 0, 0), (300, 30, 0), (0, 30, 0)], dtype=float)
    fit: Any = SimpleNamespace(
        solution=SimpleNamespace(state=PathState(vertices, 1000.0, unseen)), label="as it is"
    )
    light = [20, 0] if unseen else [20, 20, 0]
    monkeypatch.setattr(detours, "pulses_of_legs", lambda _: np.array(light))
    monkeypatch.setattr(detours, "refitted", lambda _, state, __: state)
    nothing: Any = None
    state = detours.without_light_unseen(fit, [], nothing, None)
    assert (state is not None) == left_out
    if left_out:
        assert len(state.vertices_mm) == 3
