"""A leg lit only beyond both its ends has no place inside to go outwards from: IndexError.

Found with a roof mirror beside the picture (`benchmarks/unseen_legs.py`, seed 26003), where a path
with one bent leg was tried for two straight ones.
"""

from __future__ import annotations

import numpy as np

import lightflight as lf
from lightflight.reconstruct.model.freedom import last_in_view

CAMERA = lf.Camera.facing_plane(center_mm=(0.0, 0.0), distance_mm=500.0)


def along(number):
    return np.multiply.outer(np.asarray(number), [10.0, 0.0, 0.0])


def test_no_place_is_in_view_where_none_is_tried():
    assert last_in_view(CAMERA, along, np.empty(0)) is None
    assert last_in_view(CAMERA, along, np.array([0.0, 1.0])) is None
    assert last_in_view(CAMERA, along, np.array([0.0, 1000.0])) is not None
