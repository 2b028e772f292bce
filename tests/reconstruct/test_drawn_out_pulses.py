"""Pulses that flight draws out, and what of a pixel's light each of its legs gives, one by one."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from lightflight.reconstruct.fit.membership import shift_by_ends_ps
from lightflight.reconstruct.model.cells import Cells
from lightflight.reconstruct.model.counted import GAUSSIAN, Pulses, Shape, lit_pixels
from lightflight.reconstruct.model.state import PathState

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
    told = GAUSSIAN.come(z) - skewness / 6.0 * GAUSSIAN.skewing(z)[0]
    assert abs(told - come).max() < 0.1 * abs(GAUSSIAN.come(z) - come).max()


@pytest.mark.parametrize("shape", ["Gaussian", "table"])
def test_slopes_of_the_skewed_part_are_those_of_differences(shape):
    place = np.linspace(-8.0, 8.0, 1601)
    table = Shape(np.stack((place, norm.cdf(place), norm.pdf(place))))
    come, density = (GAUSSIAN if shape == "Gaussian" else table).skewing(place)
    assert_allclose(np.gradient(come, place), density, atol=1e-3)
    assert_allclose(come, (place**2 - 1.0) * norm.pdf(place), atol=1e-3)


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
