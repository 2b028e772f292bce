"""Light more uneven than splines, as modes of what pixels count."""

import numpy as np
import pytest
from scipy.stats import norm

from lightflight.reconstruct.all_counts.rest_in_counts import modes_of_rest
from lightflight.reconstruct.fit.rest_of_light import Rest
from lightflight.reconstruct.fit.uneven import RestAlong

SPOT = 0.6
PLACES = np.linspace(-6.0, 6.0, 121)
NOWHERE = -np.inf * np.ones(121), np.inf * np.ones(121)
SMOOTH = Rest(0.2, np.sqrt(2.0) * SPOT, (), 1.5 * SPOT, unequal=0.02)
GRAIN = Rest(0.05, np.sqrt(2.0) * SPOT, ((3.0, 0.6),), 1.5 * SPOT)


def modes(*rests, lit=NOWHERE):
    """Of a leg whose rest changes where told: (span, rest) each."""
    along = [RestAlong(0, 0, None, span, rest) for span, rest in rests]
    return modes_of_rest(along, PLACES, np.full(len(PLACES), SPOT), lit)


def test_modes_make_up_the_covariance_of_light_and_slopes():
    """Late by the spot's variance times the slope of the log of the light."""
    ln, late, _ = modes(((-50.0, 50.0), SMOOTH))
    slopes = late / SPOT**2
    of_light, of_slopes = SMOOTH.covariance(PLACES, PLACES), SMOOTH.of_slopes(PLACES)
    np.testing.assert_allclose(ln @ ln.T, of_light, atol=0.01 * of_light.max())
    np.testing.assert_allclose(slopes @ slopes.T, of_slopes, atol=0.01 * of_slopes.max())
    mixed = SMOOTH.of_slope(PLACES, PLACES)
    np.testing.assert_allclose(slopes @ ln.T, mixed, atol=0.01 * np.abs(mixed).max())


def test_wider_by_the_bend_of_the_light():
    """The spot's fourth power times the second derivative of the log of the light."""
    ln, _, wider = modes(((-50.0, 50.0), SMOOTH))
    bends = np.gradient(np.gradient(ln, PLACES, axis=0), PLACES, axis=0)[9:-9]
    found = wider[9:-9] / SPOT**4
    assert np.abs(found - bends).max() < 0.03 * np.abs(bends).max()


def test_a_grain_makes_its_place_uncertain():
    ln, _, _ = modes(((-50.0, 50.0), GRAIN))
    std = np.linalg.norm(ln, axis=1)
    assert PLACES[std.argmax()] == pytest.approx(3.0, abs=0.3)
    assert std.max() == pytest.approx(0.6, rel=0.15)
    assert std[PLACES < -2.0].max() == pytest.approx(0.05, rel=0.02)


def test_where_a_leg_ends_light_and_times_follow_the_cells_that_are_lit():
    """Against light drawn cell by cell, which pixels at a leg's end see half of; 4,000 draws."""
    end = 1.3
    ln, late, wider = modes(
        ((-50.0, 50.0), Rest(0.02, SMOOTH.alike_px, (), 1.0)), lit=(NOWHERE[0], end - PLACES)
    )
    rng = np.random.default_rng(5)
    cells = np.arange(-10.0, end, 0.05) + 0.025
    # Of this variance per cell light through the spot is uneven by 0.02.
    noise = 0.02 * np.sqrt(2.0 * np.sqrt(np.pi) * SPOT / 0.05)
    light = 1.0 + noise * rng.normal(size=(4000, len(cells)))
    for place in (0.0, 1.0, 1.6):
        k = np.abs(PLACES - place).argmin()
        seen = norm.pdf(cells, PLACES[k], SPOT)
        whole = light @ seen
        middle = light @ (seen * cells) / whole
        width = light @ (seen * cells**2) / whole - middle**2
        # One standard deviation of 4,000 draws is 1.1 % of it.
        assert np.linalg.norm(ln[k]) == pytest.approx(np.log(whole).std(), rel=0.08)
        assert np.linalg.norm(late[k]) == pytest.approx(middle.std(), rel=0.08)
        assert np.linalg.norm(wider[k]) == pytest.approx(width.std(), rel=0.12)


def test_each_stretch_is_as_uneven_as_it_is():
    ln, _, _ = modes(((-6.0, 0.0), SMOOTH), ((0.0, 6.0), Rest(0.05, SMOOTH.alike_px, (), 1.0)))
    std = np.linalg.norm(ln, axis=1)
    assert std[PLACES < -2.0] == pytest.approx(0.2, rel=0.02)
    assert std[PLACES > 2.0] == pytest.approx(0.05, rel=0.02)


def test_of_very_much_light_the_ends_are_told_alone():
    """Near an end as with all else; far from any nothing."""
    end = 1.3
    lit = NOWHERE[0], end - PLACES
    whole, ends = (
        modes_of_rest(
            [RestAlong(0, 0, None, (-50.0, 50.0), SMOOTH)], PLACES, np.full(len(PLACES), SPOT), lit,
            ends_alone=alone,
        )
        for alone in (False, True)
    )  # fmt: skip
    assert ends[0].shape[1] < 0.6 * whole[0].shape[1]
    near, far = np.abs(PLACES - end) < 1.5, end - 7.0 * SPOT - 2.0 > PLACES
    for all_of_it, of_ends in zip(whole, ends, strict=True):
        std = np.linalg.norm(all_of_it, axis=1)
        np.testing.assert_allclose(np.linalg.norm(of_ends, axis=1)[near], std[near], rtol=0.02)
        assert np.linalg.norm(of_ends, axis=1)[far].max() < 0.05 * std.max()
