"""Light that no test would show: what `blind_to` says it does to a path, against what it does."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.timing.clock.response import Response
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


def path_in(world, seed, **others):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return lf.reconstruct(record(world, seed), **what_the_user_tells(world) | others)


def spot_of(path, name):
    return next((spot for spot in path.verdict.blind_to if spot.name == name), None)


@pytest.mark.parametrize("n_legs", [1, 3])
@pytest.mark.long
def test_a_second_pulse_moves_the_path_as_far_as_is_told(n_legs):
    """To first order, which light above the background falls short of; noise is a tenth of it.

    The fit, whose mean waits are free, takes up a third of the rest beyond first order; about one
    leg it finds a mirror that shows the second pulse, and takes up all of it.
    """
    world = random_world(0, n_legs, 40_000.0, "known", uneven=0.0)
    plain = path_in(world, 0)
    spot = spot_of(plain, "other_pulse")
    assert spot is not None
    assert plain.verdict.level == "trust"
    lag_ps = float(spot.unit.split()[-2])
    other = path_in(world.but(second=spot.size, second_ps=lag_ps), 0)
    moved = np.linalg.norm(other.vertices_mm - plain.vertices_mm, axis=1).max()
    assert (0.25 * spot.moves_mm if n_legs > 1 else 0.0) < moved < 1.3 * spot.moves_mm
    twice = path_in(world.but(second=2.0 * spot.size, second_ps=lag_ps), 0)
    # Twice as bright it shows, and is contradicted, or "check" where the fit has taken it up.
    assert twice.verdict.level != "trust"
    assert twice.verdict.findings[0].name == "other_pulse"


def test_haze_is_no_blind_spot_where_the_fit_has_a_place_for_it():
    """Whatever the shape of pulses: what is unknown of haze stands in the stated errors."""
    world = random_world(2, 1, 40_000.0, "known", uneven=0.0)
    assert spot_of(path_in(world, 2), "haze") is None
    shape = Response.with_tail(std_ps=world.std_ps, tail_ps=200.0, tail_share=0.3)
    told = what_the_user_tells(world)["timing"]
    curve = np.array([shape.time_ps, shape.density])
    world = world.but(tail=0.3, tail_ps=200.0, offset_ps=-60.0)
    path = path_in(world, 2, timing=replace(told, response_curve=curve))
    assert path.verdict.level == "trust"
    assert spot_of(path, "haze") is None


def test_little_is_unseen_that_moves_by_less_than_is_stated():
    """An emission time that is fitted takes up what all pulses are late by."""
    path = path_in(random_world(0, 3, 400.0, "lab"), 0)
    assert spot_of(path, "other_pulse") is None
