"""`paper` was 7.6 mm off and trusted: the verdict was that of another path, the joint fit's."""

import warnings

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


def worst(path, world):
    """Largest error of a corner's coordinate, mm, and in its own stated error."""
    off = np.abs(path.vertices_mm - world.vertices)[1:-1]
    return off.max(), (off / path.vertex_std[1:-1, :3]).max()


def by_paper(seed, prior):
    world = random_world(seed, 3, prior=prior)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        told = what_the_user_tells(world)
        return lf.reconstruct(record(world, seed), method="paper", **told), world


@pytest.mark.parametrize("seed", [1, 2])
def test_errors_that_leave_out_the_picture_are_not_trusted(seed):
    path, world = by_paper(seed, "known")
    off_mm, pull = worst(path, world)
    assert off_mm > 5.0
    assert pull > 100.0
    assert path.verdict.level == "contradicted"
    assert path.verdict.findings[0].name == "scatter"
    assert "all pulses fitted together" in path.verdict.findings[0].sentence


def test_large_errors_that_are_stated_are_trusted():
    """The source is known to 1 mm, its time is not: 8 mm off, and stated."""
    path, world = by_paper(0, "lab")
    off_mm, pull = worst(path, world)
    assert off_mm > 5.0
    assert pull < 3.0
    assert path.verdict.level == "trust"
