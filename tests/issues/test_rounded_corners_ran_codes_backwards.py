"""A right recording was refused: "the codes run backwards".

Two legs that turn little looked like one in the picture. Its times bend sharply at the corner,
which the spot rounds, and the wrong way beside it: a parabola found a bend of nine errors.
"""

import numpy as np
import pytest

from lightflight.reconstruct.legs.bend import _second_derivative

PLACES = np.linspace(-8.0, 8.0, 53)
ERRORS = np.full(53, 5.0)


def rounded(curve: np.ndarray) -> np.ndarray:
    """As a spot of 0.6 px shows it."""
    fine = np.linspace(-12.0, 12.0, 2401)
    spot = np.exp(-0.5 * ((PLACES[:, np.newaxis] - fine) / 0.6) ** 2)
    return (spot @ curve) / spot.sum(axis=1)


def times_about(corner_px: float, turn_ps: float, bend_ps: float) -> np.ndarray:
    fine = np.linspace(-12.0, 12.0, 2401)
    return rounded(0.5 * bend_ps * fine**2 - turn_ps * np.maximum(fine - corner_px, 0.0))


def test_a_curve_that_bends_both_ways_says_nothing():
    # Errors of pulses that scatter less than they say: a kink is not told from a cubic then.
    noise = np.random.default_rng(3).normal(size=53) * 0.6 * ERRORS
    bend, std = _second_derivative(PLACES, times_about(-3.0, 15.0, 0.3) + noise, ERRORS)
    assert bend / std > -6.0


@pytest.mark.parametrize("bend_ps", [1.5, -1.5])
def test_straight_light_still_says_which_way(bend_ps):
    noise = np.random.default_rng(4).normal(size=53) * ERRORS
    bend, std = _second_derivative(PLACES, times_about(-3.0, 0.0, bend_ps) + noise, ERRORS)
    assert bend == pytest.approx(bend_ps, abs=4.0 * std)
    assert abs(bend / std) > 6.0
