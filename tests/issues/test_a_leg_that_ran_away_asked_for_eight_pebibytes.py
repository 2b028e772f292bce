"""Fault: a leg that ran away to where light takes days asked for eight pebibytes of time.

An arm that was tried beside a wall ended there, and the light that a halo spreads from it was laid
out picosecond by picosecond: `reconstruct` ended in NumPy's MemoryError.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lightflight.errors import NothingFoundError
from lightflight.reconstruct.other_light import diffuse
from lightflight.reconstruct.other_light.lit_places import LitPlaces


@pytest.mark.parametrize(("farthest_ps", "refused"), [(5e4, False), (1e15, True)])
def test_a_leg_that_runs_away_is_no_path(monkeypatch, farthest_ps, refused):
    place, event = np.full(4, 10.0), np.linspace(0.0, farthest_ps, 4)
    leg = LitPlaces(0, np.zeros((4, 3)), place, place, event, np.ones(4), np.zeros(4, dtype=bool))
    monkeypatch.setattr(diffuse, "lit_places", lambda *_, **__: [leg])
    camera = SimpleNamespace(
        shape=(32, 32), return_times_ps=lambda points, return_group_index: np.zeros(len(points))
    )
    medium = SimpleNamespace(return_group_index=1.0)
    fit = SimpleNamespace(solution=SimpleNamespace(cameras=[camera], medium=medium))
    whole = SimpleNamespace(view=0, histograms=SimpleNamespace(photons=np.full((32, 32), 9.0)))
    beam_of_path: Any = diffuse.beam_of_path
    if refused:
        with pytest.raises(NothingFoundError, match="runs away"):
            beam_of_path(fit, 0, whole, 70.0, source_told=True)
    else:
        assert len(beam_of_path(fit, 0, whole, 70.0, source_told=True).photons) == 4
