"""Kinks in arrival curves: found where there is a corner, not where a straight leg bends."""

import numpy as np
import pytest

from lightflight.reconstruct.legs.curves import kink_place

S = np.arange(-15.0, 16.0)
N_RUNS = 400


def straight_light(s, foot_px=0.0):
    """Arrival time of a straight leg, ps: the half-angle law at 70 px of focal length."""
    psi = np.arctan((s - foot_px) / 70.0)
    return 1785.0 * np.tan(np.pi / 4 + psi / 2)


@pytest.mark.parametrize("foot_px", [-60.0, 0.0, 60.0])
def test_no_kink_in_straight_light(foot_px):
    """None in 400 runs: were the chance of a false kink above 0.75 %, one would show in 95 %."""
    rng = np.random.default_rng(3)
    found = [
        kink_place(
            S, straight_light(S, foot_px) + rng.normal(0.0, 2.0, len(S)), np.full(len(S), 2.0)
        )
        for _ in range(N_RUNS)
    ]
    assert sum(place is not None for place in found) == 0


@pytest.mark.parametrize("turn", [-8.0, 8.0])
def test_kink_is_found_at_its_place(turn):
    rng = np.random.default_rng(4)
    kinked = straight_light(S) + turn * np.maximum(S - 3.0, 0.0)
    places = [
        kink_place(S, kinked + rng.normal(0.0, 2.0, len(S)), np.full(len(S), 2.0))
        for _ in range(50)
    ]
    assert all(place is not None and abs(place - 3.0) <= 1.0 for place in places)


def test_errors_that_are_stated_too_small_make_no_kink():
    rng = np.random.default_rng(5)
    found = [
        kink_place(S, straight_light(S) + rng.normal(0.0, 20.0, len(S)), np.full(len(S), 2.0))
        for _ in range(N_RUNS)
    ]
    assert sum(place is not None for place in found) <= 0.02 * N_RUNS


def test_a_wild_pixel_makes_no_kink():
    times = straight_light(S)
    times[10] += 500.0
    assert kink_place(S, times, np.full(len(S), 2.0)) is None


def test_too_short_a_leg_says_nothing():
    assert kink_place(S[:7], straight_light(S[:7]), np.ones(7)) is None
