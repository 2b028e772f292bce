"""The oracle itself: totals, limits and symmetries that need no second derivation."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad

from tests.oracles.brute_force import (
    BruteClock,
    BruteScene,
    C,
    camera_looking_at,
    camera_over_plane,
    collect,
    expected_counts,
    gaussian_share,
    march_back,
    march_out,
    mean_arrivals,
    tailed_share,
)

CLOCK = BruteClock(n_codes=1000, width=55.0, period=50_000.0)
LEG = np.array([[0.0, 0.0, 0.0], [375.0, 20.0, 40.0]])


def scene(**changes) -> BruteScene:
    camera = camera_over_plane(center=(187.5, 10.0))
    return BruteScene(**{"vertices": LEG, "camera": camera, "clock": CLOCK, **changes})


def test_oracle_stands_alone() -> None:
    from pathlib import Path

    assert "import lightflight" not in Path(__file__).with_name("brute_force.py").read_text()
    assert "from lightflight" not in Path(__file__).with_name("brute_force.py").read_text()


def test_marching_one_metre_takes_light_3336_ps() -> None:
    assert march_back(np.zeros(3), np.array([0.0, 0.0, 1000.0]), 1.0) == pytest.approx(3335.6409519)
    ((place, time),) = march_out(np.array([[0, 0, 0], [0, 0, 5000.0]]), [1000.0], 1.0)
    np.testing.assert_allclose(place, [0, 0, 1000.0])
    assert time == pytest.approx(3335.6409519)


@pytest.mark.parametrize(("tail", "delay"), [(50, 30), (5, -200), (300, 1000), (1, 10), (20, 2e4)])
def test_tailed_share_is_the_convolution(tail: float, delay: float) -> None:
    def late(wait: float) -> float:
        return math.exp(-wait / tail) / tail * float(gaussian_share(np.array(delay - wait), 80.0))

    ends = [0.0, *(w for w in (delay - 400.0, delay + 400.0) if 0.0 < w < 60 * tail), 60.0 * tail]
    whole = sum(quad(late, a, b, limit=200)[0] for a, b in itertools.pairwise(ends))
    assert tailed_share(np.array([delay]), 80.0, tail)[0] == pytest.approx(whole, abs=1e-8)


@pytest.mark.parametrize("tail", [0.0, 60.0])
@pytest.mark.parametrize("reverse", [False, True])
def test_no_photon_is_lost_in_the_codes(tail: float, reverse: bool) -> None:
    """Codes that tile a whole period hold all light; emission near the fold included."""
    clock = BruteClock(n_codes=1000, width=50.0, period=50_000.0, reversed=reverse)
    for emission in (2000.0, 47_500.0):
        trial = scene(clock=clock, emission_time=emission, tail=tail)
        counts = expected_counts(trial, brightest=1000.0)
        cube, _ = collect(trial)
        light = cube.sum(axis=2) * 1000.0 / cube.sum(axis=2).max()
        np.testing.assert_allclose(counts.sum(axis=2), light, atol=1e-6)


def test_reversed_codes_are_forward_codes_read_backwards() -> None:
    forward = BruteClock(n_codes=1000, width=50.0, period=50_000.0)
    backward = BruteClock(n_codes=1000, width=50.0, period=50_000.0, reversed=True)
    np.testing.assert_allclose(
        expected_counts(scene(clock=backward), brightest=10.0)[..., ::-1],
        expected_counts(scene(clock=forward), brightest=10.0),
        atol=1e-12,
    )


def test_spot_catches_what_a_square_of_light_holds() -> None:
    """A blur far wider than a pixel: the pixels share a fill factor of the light."""
    trial = scene(blur_std_px=1.5, active_side_px=0.5, inverse_square=False)
    cube, _ = collect(trial)
    inside = cube[:, 10:22].sum() / cube[:, 10:22].any(axis=(0, 2)).sum()
    per_px = 245.0 / 32.0 * math.hypot(375, 20, 40) / 375.0
    # A leg that rises by 40 mm is magnified by up to 8 %, and each pixel sees less of it.
    assert inside == pytest.approx(0.25 * per_px * (535.0 - 20.0) / 535.0, rel=0.03)


def test_finer_steps_change_nothing() -> None:
    coarse, first = collect(scene())
    fine, fine_first = collect(scene(), stride=0.05, fine=0.25, nodes=15)
    np.testing.assert_allclose(
        coarse.sum(axis=2), fine.sum(axis=2), atol=1e-3 * fine.sum(axis=2).max()
    )
    bright = fine.sum(axis=2) > 0.01 * fine.sum(axis=2).max()
    gap = mean_arrivals(coarse, first, 0.5) - mean_arrivals(fine, fine_first, 0.25)
    assert np.abs(gap[bright]).max() < 0.02


def test_roll_turns_the_picture() -> None:
    straight = camera_looking_at([0, 0, 500], [0, 0, 0])
    rolled = camera_looking_at([0, 0, 500], [0, 0, 0], roll=math.pi / 2)
    row, col = straight.image(np.array([10.0, 30.0, 0.0]))
    assert row < 15.5 < col
    turned = rolled.image(np.array([10.0, 30.0, 0.0]))
    np.testing.assert_allclose(turned, (15.5 + (15.5 - col), 15.5 + (row - 15.5)), atol=1e-9)


def test_light_takes_its_time() -> None:
    """The pixel at the foot of the camera sees the pulse when it passed there, plus the way."""
    leg = np.array([[-200.0, 0, 0], [200.0, 0, 0]])
    camera = camera_over_plane(rows=33, cols=33)
    trial = scene(vertices=leg, camera=camera, path_index=1.0, return_index=1.0)
    cube, first = collect(trial)
    seen = mean_arrivals(cube, first, 0.5)[16, 16]
    assert seen == pytest.approx(2000.0 + (200.0 + 535.0) / C, abs=0.1)
