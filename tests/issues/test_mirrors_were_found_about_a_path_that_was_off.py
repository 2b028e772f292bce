"""Fault: a mirror that was found about a path which was off stayed, and kept it there.

Legs that run over each other in the picture: what a first path left unexplained looked like a
mirror's image of it. The next path was fitted beside it, 90 stated errors off (contradicted),
and of another recording 8 ("check"). Where the path moves far, mirrors are looked for anew.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.random_labs import drawn_lab, path_of, pulls_of
from lightflight.reconstruct.model.second_pulse import Echo
from lightflight.reconstruct.other_light import twice

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


@pytest.mark.parametrize("stands", [True, False])
def test_what_was_found_is_asked_for_first_where_the_path_stands(monkeypatch, stands):
    """Else only after all that the counts show without it."""
    found, asked_for = Echo(0.1, 400.0, 70.0), []

    def strengths(second=None, **_):
        asked_for.append(second)
        return SimpleNamespace(
            settled=True, second=second, lags_ps=None, misfit=lambda: 0.0 if second else 1e3
        )

    for name in ("_with_second_pulse", "_with_mirror"):
        monkeypatch.setattr(twice, name, lambda *_: None)
    asked: Any = SimpleNamespace(strengths=strengths)
    so_far: Any = SimpleNamespace(second=found)
    nothing: Any = None
    known = twice.with_second(asked, nothing, so_far, nothing, stands=stands)
    assert (known.second is found) == stands
    assert (asked_for[0] is found) == stands


@pytest.mark.long
@pytest.mark.parametrize("seed", [552, 623])
def test_legs_over_each_other_need_no_mirror(seed):
    """The chance of a pull above 5 is 1e-6 a number."""
    lab = drawn_lab(seed)
    path = path_of(lab)
    assert path.n_legs == 3
    assert (pulls_of(lab, path)[:, 1] < 5.0).all()
