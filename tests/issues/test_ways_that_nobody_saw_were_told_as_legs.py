"""Three ways in which light that was out of the picture came out otherwise than it was.

A search put two legs for which hardly a pulse spoke where one way was unseen (4029), and their
mirrors were stated to 17 m; a leg with three pulses stood for it and was off by 180 mm in a test of
its own, which the path did not stand (4033); and a piece about the tip of a wide beam kept every
chain from beginning at the source (4028: "no straight flight from the source explains the first
leg"). Laboratories of `benchmarks/piece_labs.py`, unseen legs.
"""

from __future__ import annotations

import importlib
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.piece_labs import drawn_scene, path_of, pulls_of, right_legs
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from lightflight.reconstruct.verdict import detours
from tests.path_fakes import make_path

# By its module: the package's name of it is the function.
answer = importlib.import_module("lightflight.reconstruct.answer")


@pytest.mark.parametrize(
    ("name", "asked"), [(FindingName.UNSEEN_LEG, True), (FindingName.SOURCE, False)]
)
def test_a_leg_that_contradicts_its_path_is_asked_about_as_a_way_unseen(monkeypatch, name, asked):
    for other in ("_without_images", "_going_on", "_detour_or_bend"):
        monkeypatch.setattr(answer, other, lambda *_: None)
    way = make_path()
    monkeypatch.setattr(answer, "_unseen_as_such", lambda *_: way)
    finding = Finding(name, "", 9.0, "", Severity.CONTRADICTED)
    found = make_path(verdict=Verdict(Level.CONTRADICTED, (finding,)))
    assert answer._reconsidered(found, None, None, None) is (way if asked else found)


def test_a_piece_about_the_tip_of_the_light_is_left_out(monkeypatch):
    """Where no path takes all: what has the fewest pixels is none of it."""
    legs = tuple(SimpleNamespace(n_pixels=n) for n in (30, 12, 25))
    sightings: Any = [SimpleNamespace(arrivals=None)]
    setting: Any = None
    monkeypatch.setattr(detours, "search_legs", lambda *_: legs)
    monkeypatch.setattr(detours, "_of_legs", lambda some, *_: some if len(some) < 3 else None)
    kept: Any = detours.detour_instead(None, sightings, setting, None)
    assert kept == (legs[0], legs[2])


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")
@pytest.mark.parametrize("seed", [4028, 4029, 4033])
def test_it_is_one_way_that_nobody_saw(seed):
    """Farthest of two places on each leg below 4.5 stated errors (false alarm 1e-4 for all)."""
    scene = drawn_scene("unseen", seed)
    path = path_of(scene)
    assert right_legs(scene, path)
    assert path.verdict.level == "check"
    assert pulls_of(scene, path)[:, 1].max() < 4.5
