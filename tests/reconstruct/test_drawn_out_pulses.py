"""Pulses that flight draws out, and what of a pixel's light each of its legs gives, one by one."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import make_interp_spline
from scipy.stats import expon, exponnorm, norm

from lightflight.reconstruct.fit.membership import mean_of_cut_light_ps, shift_by_ends_ps
from lightflight.reconstruct.model.cells import Cells
from lightflight.reconstruct.model.counted import lit_pixels
from lightflight.reconstruct.model.expected_counts import Pulses
from lightflight.reconstruct.model.pulse_shape import GAUSSIAN, Shape
from lightflight.reconstruct.model.state import PathState
from lightflight.reconstruct.other_light.drawn_out import kurtosis_of_flight, variance_of_light

WINDOW = np.linspace(-600.0, 600.0, 61)


def cells_of(counts: np.ndarray) -> Cells:
    """One pixel with even cells, its clock known."""
    live = np.ones((1, len(counts)), dtype=bool)
    return Cells(WINDOW[np.newaxis], counts[np.newaxis], live, np.zeros(live.shape), live * 1.0)


def test_the_skewed_pulse_is_that_of_light_that_runs_unevenly():
    """Against the time of each place in a Gaussian spot, summed up by brute force."""
    own, slope, bend, spot = 64.0, 60.0, 4.0, 0.7
    places = np.linspace(-6.0, 6.0, 4001) * spot
    weight = norm.pdf(places, scale=spot)
    late = slope * places + 0.5 * bend * places**2
    come = (norm.cdf((WINDOW[:, np.newaxis] - late) / own) @ weight) / weight.sum()
    mean = 0.5 * bend * spot**2
    std = np.sqrt(own**2 + (slope * spot) ** 2 + 0.5 * (bend * spot**2) ** 2)
    skewness = (3.0 * slope**2 * bend * spot**4 + bend**3 * spot**6) / std**3
    z = (WINDOW - mean) / std
    told = (
        GAUSSIAN.come(z)
        + GAUSSIAN.unevenly(z, GAUSSIAN.at(z)[1], np.array(skewness), np.array(0.0))[0]
    )
    assert abs(told - come).max() < 0.1 * abs(GAUSSIAN.come(z) - come).max()


def test_uneven_light_fills_less_of_a_spot_where_it_is_brightest():
    """Against the variance of places in a Gaussian spot, weighed by light in waves, summed up."""
    spot, wave = 0.7, 2.0 * np.pi / 5.0
    places = np.linspace(-8.0 * spot, 8.0 * spot, 4001)
    at = np.linspace(2.0, 18.0, 129)
    weight = norm.pdf(places, scale=spot) * np.exp(
        0.8 * np.sin(wave * (at[:, np.newaxis] + places))
    )
    seen = np.log(weight.sum(axis=1))
    mean = (weight @ places) / weight.sum(axis=1)
    variance = (weight @ places**2) / weight.sum(axis=1) - mean**2
    light = SimpleNamespace(
        spline=make_interp_spline(at, seen, k=3),
        spot_std_at=lambda along: np.full(len(along), spot),
    )
    told, doubt = variance_of_light(light, at[4:-4])
    assert_allclose(told, variance[4:-4] / spot**2, atol=0.02)
    assert np.ptp(told) > 0.4
    assert (doubt > 0.2).all()


def test_the_flat_pulse_is_that_of_light_through_an_active_area():
    """Against the time of each place in a square pixel, whole as the pitch, summed up."""
    own, slope, spot = 40.0, 90.0, 0.4
    places = np.linspace(-0.5, 0.5, 2001)
    mean_of_spot = slope * spot
    std = np.sqrt(own**2 + mean_of_spot**2 + slope**2 / 12.0)
    come = np.mean(
        norm.cdf((WINDOW[:, np.newaxis] - slope * places) / np.hypot(own, mean_of_spot)), axis=1
    )
    z, kurtosis = WINDOW / std, -((slope / std) ** 4) / 120.0
    told = (
        GAUSSIAN.come(z)
        + GAUSSIAN.unevenly(z, GAUSSIAN.at(z)[1], np.array(0.0), np.array(kurtosis))[0]
    )
    assert abs(told - come).max() < 0.2 * abs(GAUSSIAN.come(z) - come).max()


def test_edges_of_active_areas_make_pulses_flat():
    """Flight alone through a pixel as wide as the pitch: the cumulants are those of a square."""
    light = SimpleNamespace(area=SimpleNamespace(side_px=1.0, fourth_std=0.01))
    picture = SimpleNamespace(legs=[SimpleNamespace(dark=False)], fits=[light])
    slope, spot = np.array([100.0]), 0.5
    std = slope * np.sqrt(spot**2 + 1.0 / 12.0)
    for side, sixth in ((1.0, 1.0), (0.5, 0.25)):
        kurtosis, departure = kurtosis_of_flight(slope, np.array([side]), np.zeros(1), std, picture)
        assert kurtosis[0] == pytest.approx(-side / 120.0 * (slope / std)[0] ** 4, rel=0.02)
        left = sixth / 252.0 * (slope / std)[0] ** 6 / np.sqrt(720.0)
        assert departure[0] == pytest.approx(left, rel=0.1)


@pytest.mark.parametrize("shape", ["Gaussian", "table"])
def test_slopes_of_the_uneven_part_are_those_of_differences(shape):
    place = np.linspace(-8.0, 8.0, 1601)
    table = Shape(np.stack((place, norm.cdf(place), norm.pdf(place))))
    asked = GAUSSIAN if shape == "Gaussian" else table
    for cumulants in ((np.array(1.0), np.array(0.0)), (np.array(0.0), np.array(1.0))):
        told = asked.unevenly(place, asked.at(place)[1], *cumulants)
        assert_allclose(np.gradient(told[0], place), told[1], atol=1e-3)
        plain = GAUSSIAN.unevenly(place, GAUSSIAN.at(place)[1], *cumulants)
        assert_allclose(told, plain, atol=1e-3)


# A pulse with a tail: half of its light waits, for six of the width of its core.
_PLACE = np.arange(-6.0, 40.0, 0.02)
_DENSITY = 0.5 * norm.pdf(_PLACE, scale=0.5) + 0.5 * exponnorm.pdf(_PLACE, 6.0, scale=0.5)
_COME = np.append(0.0, np.cumsum(0.01 * (_DENSITY[1:] + _DENSITY[:-1])))
TAILED = Shape(np.stack((_PLACE, _COME / _COME[-1], _DENSITY / _COME[-1])))


def test_a_shape_is_spread_by_each_pixels_own_flight():
    """Against the pulse of each place in a Gaussian spot, summed up by brute force."""
    flight = np.array([[0.0, 0.01], [0.3, np.nan], [1.7, 4.0], [12.0, 0.5]])
    drawn_out, z = TAILED.drawn_out(flight), np.linspace(-25.0, 60.0, 301)
    for leg in (0, 1):
        own = np.nan_to_num(flight[:, leg])
        told = drawn_out.of(np.arange(4), leg).come(np.tile(z, (4, 1)))
        for half_variance, come in zip(own, told, strict=True):
            places = np.linspace(-6.0, 6.0, 1201)
            late = np.sqrt(2.0 * half_variance) * places
            summed = 0.01 * TAILED.come(z[:, np.newaxis] - late) @ norm.pdf(places)
            assert_allclose(come, summed, atol=1.2e-3)
    few = drawn_out.of(np.array([2, 3]), 1)
    assert_allclose(few.drawn_out_ps(np.full((2, 1), 50.0)), 50.0 * np.sqrt([[9.0], [2.0]]))


def test_what_flight_adds_is_that_of_a_little_more():
    z, more = np.linspace(-10.0, 30.0, 201)[np.newaxis], np.array([[0.05]])
    for half_variance in (0.2, 2.0):
        drawn_out = TAILED.drawn_out(np.array([[half_variance]]))
        by_difference = drawn_out.with_more(more).come(z) - drawn_out.with_more(-more).come(z)
        assert_allclose(drawn_out.widening(z), by_difference / 0.1, atol=5e-3)


def test_waits_keep_back_what_they_do_of_the_shape_that_is_spread():
    z, ratio = np.linspace(-10.0, 40.0, 101), 0.5
    drawn_out = TAILED.drawn_out(np.array([[1.0]]))
    wait = np.linspace(0.0, 20.0 / ratio, 20_001)
    kept = 1.0 - expon.cdf(wait, scale=1.0 / ratio)
    for row in drawn_out.kept_back(z[np.newaxis], np.array([[ratio]])):
        # What has come and still waits: the density, as old as it waits.
        density = drawn_out.at((z[:, np.newaxis] - wait)[np.newaxis].reshape(1, -1))[1]
        waiting = np.trapezoid(density.reshape(len(z), -1) * kept, wait, axis=1)
        assert_allclose(row, waiting, atol=3e-3)


def test_pulses_under_each_other_share_the_light_as_the_picture_says():
    """Thirty ps apart, half a pulse: nothing in the counts says which of two is the brighter."""
    late, std = np.array([[0.0, -30.0]]), np.full((1, 2), 64.0)
    light = 40_000.0 * np.diff(norm.cdf(WINDOW / 64.0))
    for seed in range(20):
        counts = np.random.default_rng(seed).poisson(light + 1.0).astype(float)
        known = Pulses(late, std, share=np.array([[1.0, 0.0]]))
        told = lit_pixels(cells_of(counts), known)
        assert told.photons[0, 0] == pytest.approx(40_000.0, rel=0.02)
        assert abs(told.late_ps[0, 0]) < 5.0 * told.inverse[0, 2, 2] ** 0.5 < 5.0
        free = lit_pixels(cells_of(counts), Pulses(late, std))
        assert free.inverse[0, 2, 2] > 4.0 * told.inverse[0, 2, 2]


def test_an_end_of_the_light_moves_the_mean_of_what_is_left_of_a_spot():
    """Of a Gaussian cut two to four of its standard deviations ahead of a pixel's foot."""
    path = PathState(np.array([[0.0, 0, 0], [100, 0, 0], [100, 100, 0]]), 0.0)
    spot, slope, per_leg = 0.7, 30.0, 12.0
    within = spot * np.array([2.0, 2.5, 3.0, 4.0])
    foot = SimpleNamespace(
        fraction=1.0 - within / per_leg,
        px_per_leg=np.full(4, per_leg),
        slope_ps_per_px=np.full(4, -slope),
    )
    shift = shift_by_ends_ps(foot, 0, spot, path, (None, None), None)
    places = np.linspace(-8.0 * spot, 8.0 * spot, 200_001)
    for d, told in zip(within, shift, strict=True):
        left = norm.pdf(places, scale=spot) * (places < d)
        assert told == pytest.approx(-slope * (left @ places) / left.sum(), rel=0.03)
    # Where light leaves the picture it does not end.
    assert shift_by_ends_ps(foot, 1, spot, path, (None, None), None)[0] < 1e-6


def test_light_that_an_end_cuts_comes_at_its_own_mean():
    """Of a Gaussian cut by the end of a leg, the foot before it, at it and beyond it; summed up."""
    path = PathState(np.array([[0.0, 0, 0], [100, 0, 0], [100, 100, 0]]), 0.0)
    spot, slope, per_leg = 0.7, 200.0, 12.0
    within = np.array([3.0, 0.5, 0.0, -1.0])
    foot = SimpleNamespace(
        fraction=1.0 - within / per_leg,
        px_per_leg=np.full(4, per_leg),
        slope_ps_per_px=np.full(4, slope),
    )
    told = mean_of_cut_light_ps(foot, 0, spot, path, (None, None), None)
    places = np.linspace(-8.0 * spot, 8.0 * spot, 200_001)
    for d, late in zip(within, told, strict=True):
        left = norm.pdf(places, scale=spot) * (places < d)
        assert late == pytest.approx(slope * (left @ places) / left.sum(), abs=0.05)
    # At a leg's beginning what is left comes later; where light leaves the picture nothing is cut.
    foot.fraction = np.array([0.0, 0.0, 0.5, 1.0])
    assert (mean_of_cut_light_ps(foot, 1, spot, path, (None, None), None)[:2] > 100.0).all()
    assert abs(mean_of_cut_light_ps(foot, 1, spot, path, (None, None), None)[2:]).max() < 1e-6
