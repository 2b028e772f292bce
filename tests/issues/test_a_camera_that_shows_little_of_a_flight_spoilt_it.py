"""Two cameras of random laboratories: eight of the first 14 were trusted, four of the others right.

A second camera may see a leg along its line of sight, three pixels of it, or nothing that tells of
any leg. Light of legs that it showed too little of was light of no leg: contradicted at 37 sigma.
Pixels in line with the path, beyond its ends, counted as the path's and as lost: nothing was
examined. And a camera that told of no leg ended in an IndexError
(`benchmarks/piece_labs.py --only cameras`).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import lightflight as lf
from benchmarks.piece_labs import drawn_scene, path_of, pulls_of, right_legs
from lightflight.errors import NothingFoundError
from lightflight.path.verdict import Level
from lightflight.reconstruct.all_counts import photon
from lightflight.reconstruct.verdict import going_on

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(4, marks=pytest.mark.long),  # a leg more, after the last, that no pulse shows
        pytest.param(5, marks=pytest.mark.long),  # legs of 3 and 6 px beside one of 14
        8,  # one leg that goes half across the second picture
        pytest.param(11, marks=pytest.mark.long),  # three legs of 6 to 8 px: told of none
    ],
)
def test_the_path_is_right_and_trusted(seed):
    """Of 18 numbers the largest is above five errors by chance once in 100,000."""
    scene = drawn_scene("cameras", seed)
    path = path_of(scene)
    assert right_legs(scene, path)
    assert path.verdict.level is Level.TRUST
    assert (pulls_of(scene, path)[:, 1] < 5.0).all()


def test_counts_of_which_no_camera_tells_of_a_leg_are_refused(monkeypatch):
    monkeypatch.setattr(photon, "view_of_counts", lambda *_: None)
    rough: Any = SimpleNamespace(goodness=SimpleNamespace(error_floor_ps=0.0))
    nothing: Any = None
    with pytest.raises(NothingFoundError, match="no picture tells where a leg"):
        photon._views([nothing], nothing, nothing, (), 50.0, rough)


def test_light_behind_an_end_is_not_looked_for_where_a_camera_shows_no_pulse(monkeypatch):
    """Its pulses have no width: "cannot convert float NaN to integer" (scene 11, above)."""
    camera = Mock(pixels_from_points=lambda points: (np.array([3.0]), np.array([4.0])))
    monkeypatch.setattr(going_on, "stand_in_of", lambda *_: (camera, 0.0))
    width = Mock(return_value=float("nan"))
    monkeypatch.setattr(going_on, "pulse_std_in_view", width)
    whole: Any = SimpleNamespace(view=0, blind=np.zeros((8, 8)), usable_pulses=[])
    fit: Any = SimpleNamespace(solution=SimpleNamespace(cameras=[camera], medium=lf.Medium()))
    path: Any = SimpleNamespace(vertices_mm=np.zeros((2, 3)))
    assert going_on._dark_pixels_after(path, fit, whole, 0, nominal=False) is None
    assert not width.called
