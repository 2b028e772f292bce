"""A fit that walked a leg into the camera's own plane, where it has no picture, divided by zero.

Seen where the fit of legs nobody told drew two corners together onto the camera's centre: their
height over it is rounded to zero first, since it is a difference of two distances.
"""

from dataclasses import replace

import numpy as np
import pytest

from lightflight.camera.model import Camera
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.offsets import line_offsets
from tests.reconstruct import test_least_squares as exact
from tests.reconstruct.fakes import PAPER

CAMERA = Camera.facing_plane((32, 32))
PICTURELESS = {
    "in the plane of the camera": [(1e-14, 2e-14, 535.0), (-1e-14, 1e-14, 535.0)],
    "in the camera": [(0.0, 0.0, 535.0), (1.0, 2.0, 300.0)],
    "end-on": [(0.0, 0.0, 0.0), (0.0, 0.0, 100.0)],
}


@pytest.mark.parametrize("vertices", PICTURELESS.values(), ids=PICTURELESS)
def test_a_leg_without_a_picture_has_no_offset(vertices):
    offset, jacobian = line_offsets(
        PathState(np.array(vertices), 0.0),
        camera=CAMERA,
        legs=np.zeros(1, dtype=int),
        anchors=np.array([[3.0, 4.0]]),
    )
    assert np.isnan(offset).all()
    assert np.isnan(jacobian[:, :6]).all()


def test_a_fit_steps_back_from_a_leg_without_a_picture(monkeypatch):
    freedom = exact.freedom_for(exact.KNOWN)
    away = exact.TRUE.moved(freedom.basis @ np.full(freedom.basis.shape[1], 2.0))
    steps = iter(["into the plane of the camera"])
    tried = []

    def moved(state, step):
        if next(steps, None):
            step = np.zeros_like(step)
            vertices = state.vertices_mm.copy()
            vertices[1:3, 2] = PAPER.center_mm[2]
            tried.append(vertices)
            return replace(state, vertices_mm=vertices)
        return really(state, step)

    really = PathState.moved
    monkeypatch.setattr(PathState, "moved", moved)
    found = exact.solved(
        exact.times_of(exact.TRUE, PAPER),
        exact.lines_of(exact.TRUE, PAPER),
        freedom,
        start=away,
    )
    assert len(tried) == 1
    assert found.converged
    np.testing.assert_allclose(found.state.vertices_mm[1:3], exact.TRUE.vertices_mm[1:3], atol=2e-3)
