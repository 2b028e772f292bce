"""A lens that sits askew, pixels that are not square, an optical axis beside the picture's middle:
called a source, a clock or a bent leg; of a lens only one zoom and one stretch were asked about.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.view import View


def _seen_by(view: View, aspect=0.0, axis_px=0.0, decentring_px=0.0):
    """The view by another lens; decentring: so much at the corner, along the rows."""
    row, col = view.axis()
    middle, corner = np.array([row, col]), np.array(view.shape) / 2
    p1 = decentring_px * view.focal_px[0] / (corner @ corner + 2 * corner[0] ** 2)
    return replace(
        view,
        focal_px=(view.focal_px[0] * (1 + aspect), view.focal_px[1]),
        axis_px=tuple(middle + axis_px),
        askew=(p1, 0.0),
    )


LENSES = {
    "distortion": {"decentring_px": 0.3},
    "focal_length": {"aspect": 0.01},
    "pose": {"axis_px": 0.5},
}


@pytest.mark.parametrize(
    "name",
    [
        "distortion",
        pytest.param("focal_length", marks=pytest.mark.long),
        pytest.param("pose", marks=pytest.mark.long),
    ],
)
def test_the_lens_is_named(name):
    """A third of a pixel, a hundredth, half a pixel: 0.4 to 15 mm off."""
    world = random_world(0, 3)
    world = world.but(view=_seen_by(world.view, **LENSES[name]))
    with pytest.warns(SuspectDataWarning, match="contradicts"):
        path = lf.reconstruct(record(world, 0), **what_the_user_tells(world))
    # A pose explains another height of the picture as well.
    assert name in [one.name for one in path.verdict.findings[:2]]


@pytest.mark.parametrize(
    ("free", "lens"),
    [
        ("decentering", {"decentring_px": 0.3}),
        pytest.param("aspect", {"aspect": 0.01}, marks=pytest.mark.long),
        pytest.param("axis", {"axis_px": 0.5}, marks=pytest.mark.long),
    ],
)
def test_it_can_be_fitted(free, lens):
    """Corners within four stated errors, and a millimetre."""
    world = random_world(0, 3)
    world = world.but(view=_seen_by(world.view, **lens))
    with warnings.catch_warnings():
        warnings.simplefilter("error", SuspectDataWarning)
        path = lf.reconstruct(record(world, 0), free=(free,), **what_the_user_tells(world))
    off = np.abs(path.vertices_mm - world.vertices)[1:-1]
    assert off.max() < 1.0
    assert (off / path.vertex_std[1:-1, :3]).max() < 4.0


def test_what_a_lens_does_is_what_the_oracle_does():
    """Camera and oracle, each with formulas of its own, see points at the same pixels."""
    view = _seen_by(random_world(0, 3).view, aspect=0.02, axis_px=0.7, decentring_px=0.4)
    world = random_world(0, 3)
    told = what_the_user_tells(world)["camera"]
    corner = np.array(view.shape) / 2
    p1 = 0.4 * view.focal_px[0] / 1.02 / (corner @ corner + 2 * corner[0] ** 2)
    camera = told.with_lens_moved(aspect=0.02, axis_px=(0.7, 0.7), decentering=(p1, 0.0))
    points = world.vertices.mean(axis=0) + np.random.default_rng(3).normal(0.0, 30.0, (20, 3))
    np.testing.assert_allclose(
        np.array(camera.pixels_from_points(points)), np.array(view.image(points)), atol=1e-9
    )
