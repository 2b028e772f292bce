"""Fault: a mirror that all counts show gave way to one that they hardly do.

Its fit had used up its rounds on the way there (the plane moves 5 mm in each): the next mirror was
tried, which explains six thousand less, but stood. The path was right and contradicted.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from benchmarks.misfit_labs import recording_of
from benchmarks.random_labs import pulls_of
from lightflight.reconstruct.other_light import twice

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


def known(misfit: float, second: str, *, settled: bool = True) -> Any:
    pixels = SimpleNamespace(std_ps=np.array([[50.0]]))
    return SimpleNamespace(
        misfit=lambda: misfit, second=second, settled=settled, lags_ps=None, pixels=pixels,
        dark=None, ahead=0.0,
    )  # fmt: skip


def mirror_among(monkeypatch, rounds: dict[str, Any], repeated: Any = None) -> Any:
    """The one that is taken of several, whose fits by where they begin are `rounds`."""
    monkeypatch.setattr(twice, "second_paths_in", lambda *_: ["best", "next"])
    monkeypatch.setattr(twice, "_possible", lambda _: True)
    monkeypatch.setattr(twice, "_explains", lambda *_: True)
    asked: Any = SimpleNamespace(strengths=lambda second, **_: rounds[second], seen=None)
    none = known(9_000.0, "none")
    places: Any = lambda _: SimpleNamespace(n_legs=1)  # noqa: E731
    return twice._with_mirror(asked, none, none, repeated, places, lf.Camera.facing_plane())


def test_the_best_goes_on_where_its_rounds_went_by(monkeypatch):
    rounds = {
        "best": known(2_000.0, "its plane has moved", settled=False),
        "its plane has moved": known(1_000.0, "best"),
        "next": known(8_000.0, "next"),
    }
    assert mirror_among(monkeypatch, rounds) is rounds["its plane has moved"]


@pytest.mark.long
def test_it_goes_on_from_where_it_is():
    lab, hist, told = recording_of("wall", 0.1, 1038)
    path = lf.reconstruct(hist, **told)
    assert path.verdict.level == "check", path.verdict
    assert "mirror" in path.verdict.findings[0].sentence
    assert (pulls_of(lab, path)[:, 1] < 5.0).all()
