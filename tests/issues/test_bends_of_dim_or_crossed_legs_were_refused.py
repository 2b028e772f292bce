"""Legs that are arcs, in random laboratories: nine of 14 were found, four contradicted.

A bend had to hold 95 % of the light by its pulses as found at first, which no path does by corners
and on cameras with a tail; and to win 40 of chi-square, where 292 photons contradict the straight
leg at six sigma with 39 (`benchmarks/piece_labs.py --only bent`).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.piece_labs import drawn_scene, path_of, pulls_of, right_legs
from lightflight.path.verdict import Level
from lightflight.reconstruct.verdict import bent

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


@pytest.mark.parametrize("stands", [False, True])
def test_little_is_enough_where_tests_contradict_the_straight_path(monkeypatch, stands):
    """39 of chi-square, as the 292 photons won."""
    state = SimpleNamespace(unseen=(), has_legs=lambda _: True)
    curved: Any = SimpleNamespace(solution=SimpleNamespace(state=state))
    monkeypatch.setattr(bent, "_joined", lambda *_: [state])
    monkeypatch.setattr(bent, "_bent_more", lambda *_: [])
    for name in ("_cheapest", "_grown", "_finer", "_pruned", "with_fine_light"):
        monkeypatch.setattr(bent, name, lambda *_: curved)
    monkeypatch.setattr(bent, "cost_with_kinks", lambda *_: 0.0)
    monkeypatch.setattr(bent, "_gained", lambda *_: 39.0)
    monkeypatch.setattr(bent, "_told_apart", lambda *_: True)
    setting: Any = None
    found = bent.bent_instead(curved, [], setting, None, stands=stands)
    assert (found is None) == stands


@pytest.mark.long
@pytest.mark.parametrize("seed", [10, 13])
def test_an_arc_is_found_where_light_is_dim_or_legs_meet(seed):
    """Of 36 numbers the largest is above five errors by chance once in 50,000."""
    scene = drawn_scene("bent", seed)
    path = path_of(scene)
    assert right_legs(scene, path)
    assert path.verdict.level is Level.CHECK
    assert (pulls_of(scene, path)[:, 1] < 5.0).all()
