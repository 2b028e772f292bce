"""Lens blur and active area: shares against the error function, draws against shares."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lightflight.simulate.optics import Catch


def reference_share(distance, std, width):
    def below(x):
        return 0.5 * math.erfc(-x / (std * math.sqrt(2.0)))

    return below(distance + width / 2) - below(distance - width / 2)


@pytest.mark.parametrize(("std", "width"), [(0.35, 0.122), (0.6, 0.78), (1.0, 1.0), (0.05, 0.122)])
def test_share_is_the_gaussian_integrated_over_the_active_width(std, width):
    catch = Catch(std, width)
    for distance in (-1.7, -0.4, 0.0, 0.061, 0.5, 2.0):
        assert catch.probability(distance) == pytest.approx(
            reference_share(distance, std, width), rel=1e-9, abs=1e-15
        )


def test_pixels_without_gaps_catch_everything():
    position = np.linspace(5.0, 9.0, 101)
    np.testing.assert_allclose(Catch(0.4, 1.0).caught_fraction(position, 20), 1.0, atol=1e-8)


def test_light_far_from_the_array_or_nowhere_is_not_caught():
    caught = Catch(0.35, 0.122).caught_fraction(np.array([-9.0, 40.0, np.nan]), 32)
    np.testing.assert_array_equal(caught, 0.0)


def test_light_just_outside_still_reaches_the_rim():
    catch = Catch(0.35, 0.122)
    caught = catch.caught_fraction(np.array([-0.8, 32.0]), 32)
    for got, position in zip(caught, (-0.8, 32.0), strict=True):
        wanted = sum(reference_share(position - k, 0.35, 0.122) for k in range(32))
        assert got == pytest.approx(wanted, rel=1e-6)


def test_bound_is_never_exceeded_and_tight():
    catch = Catch(0.35, 0.122)
    caught = catch.caught_fraction(np.linspace(10.0, 11.0, 5001), 32)
    assert caught.max() <= catch.most_caught <= 1.001 * caught.max()


@pytest.mark.parametrize("position", [12.0, 12.37, 12.5, 0.1, -0.9, 31.4])
def test_pixels_are_drawn_by_their_shares(position):
    # 400,000 photons: each share within 6 standard errors, chance of a false alarm < 1e-7
    n, n_pixels = 400_000, 32
    catch = Catch(0.35, 0.122)
    uniform = np.random.default_rng(7).random(n)
    drawn = catch.draw_pixels(
        np.full(n, position), n_pixels, table=catch.choice_table(), uniform=uniform
    )
    share = np.array([reference_share(position - k, 0.35, 0.122) for k in range(n_pixels)])
    share /= share.sum()
    counted = np.bincount(drawn, minlength=n_pixels) / n
    error = np.sqrt(share * (1 - share) / n) + 2e-4 * share + 1e-6
    assert (np.abs(counted - share) < 6 * error).all()


def test_extreme_random_numbers_stay_in_the_array():
    catch = Catch(0.35, 0.122)
    table = catch.choice_table()
    uniform = np.array([0.0, np.nextafter(1.0, 0.0)])
    for position in (-1.5, -0.5, 0.0, 15.5, 31.5, 32.4):
        drawn = catch.draw_pixels(np.full(2, position), 32, table=table, uniform=uniform)
        assert ((drawn >= 0) & (drawn < 32)).all()
