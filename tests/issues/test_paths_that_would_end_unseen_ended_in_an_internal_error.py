"""A dim last leg behind a way that nobody saw was tried without: what was left ended unseen.

Such a way has no second end: "index 1 is out of bounds", an internal error, on light of a wall
that was told as legs (`benchmarks/misfit_labs.py --only flash`, laboratory 970).
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lightflight.reconstruct.trials import revise
from lightflight.reconstruct.trials.outcome import NoFit


@pytest.mark.parametrize(("unseen", "ends"), [((), True), ((1,), False)])
def test_light_stops_at_corners_that_are_seen_alone(unseen, ends, monkeypatch):
    tried = []

    def refused(_, vertex, __):
        tried.append(vertex)
        return NoFit.NOTHING_FOUND

    monkeypatch.setattr(revise, "refitted", refused)
    monkeypatch.setattr(revise, "_is_dim", lambda *_: True)
    corners = () if unseen else (1, 2)
    state = SimpleNamespace(
        n_legs=3, forks=(), unseen=unseen, corners_seen=corners, leg_starts=np.arange(3),
        without=lambda vertices: vertices,
    )  # fmt: skip
    times = SimpleNamespace(leg=np.repeat([0, 1, 2], [40, 40, 2]), weight=np.ones(82))
    fit = SimpleNamespace(solution=SimpleNamespace(state=state), times=times)
    assert revise._thinned_once([], fit, None) is None
    assert ((3,) in tried) is ends
