"""Six causes of one misfit, all freed by their plausible sizes: pulls of 0.15, for bars of
centimetres around errors of a millimetre."""

from __future__ import annotations

import warnings

import numpy as np

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from lightflight.reconstruct import FREE_NAMES
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


def test_bars_are_those_of_the_misfit():
    """A clock 10 ps early, one recording: which of the causes it is stays open, not how much."""
    defect = DEFECTS["clock_early"]
    assert not defect.held_out
    world = defect.applied(random_world(100, 3), defect.strengths[1])
    hist, told = record(world, 100), what_the_user_tells(world)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        path = lf.reconstruct(hist, **told)
    named = [str(one.name) for one in path.verdict.findings]
    assert "clock_offset" in named
    cured = lf.reconstruct(hist, free=[name for name in named if name in FREE_NAMES], **told)
    assert cured.verdict.level == "trust"
    pulls = (cured.vertices_mm - world.vertices)[1:-1] / cured.vertex_std[1:-1, :3]
    assert 0.35 < np.sqrt(np.mean(np.square(pulls))) < 1.6
    assert np.abs(pulls).max() < 3.0


def test_a_leg_too_many_does_not_hide_how_far_things_are_off():
    """A fourth leg took up the misfit: freed by plausible sizes no path was found any more."""
    seed, defect = 60_000, DEFECTS["clock_early"]
    world = defect.applied(random_world(seed, 3), defect.strengths[1])
    hist, told = record(world, seed), what_the_user_tells(world)
    named = ("clock_offset", "clock_drift", "clock_scale", "index", "source", "pose")
    cured = lf.reconstruct(hist, free=named, **told)
    assert cured.verdict.level == "trust"
    off = (cured.vertices_mm - world.vertices)[1:-1]
    assert np.abs(off).max() < 10.0
    assert np.abs(off / cured.vertex_std[1:-1, :3]).max() < 3.0


def test_without_a_misfit_the_plausible_size_stands():
    """Nothing says how far a thing is off that nobody misses: its error is what all would say."""
    world = random_world(0, 3)
    hist, told = record(world, 0), what_the_user_tells(world)
    path = lf.reconstruct(hist, free=("pose",), **told)
    known = lf.reconstruct(hist, **told)
    assert path.vertex_std[1:-1, :3].max() > 3.0 * known.vertex_std[1:-1, :3].max()
