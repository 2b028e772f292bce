"""What fits recover over many pixels: no bias, true error bars, few false pulses.

Every test names its sample size; limits are set where chance fails fewer than one run in 10,000
(seeds are fixed, so a failure is a change of the code).
"""

from __future__ import annotations

import numpy as np
import pytest

from lightflight import flags as fl
from lightflight.recording.histograms import Histograms
from lightflight.timing.pulses.pulses import fit_pulses
from tests.pulse_fakes import STD, WIDTH, expected_counts, pulse_cube, wrapped

N = 4000


def bound_of(photons, background_per_code, delays, *, n_codes=64):
    """Cramér-Rao bound of the delay (ps) for pulses at `delays`, by finite differences."""
    lower = np.arange(n_codes) * WIDTH
    bounds = []
    for delay in delays:
        theta = np.array([delay, STD, photons, background_per_code / WIDTH])
        rows = []
        for a, step in enumerate((1e-3, 1e-3, 1e-3, 1e-7)):
            high, low = theta.copy(), theta.copy()
            high[a] += step
            low[a] -= step
            rows.append(
                (expected_counts(lower, lower + WIDTH, *high)
                 - expected_counts(lower, lower + WIDTH, *low)) / (2 * step)
            )  # fmt: skip
        slopes = np.array(rows)
        mean = np.maximum(expected_counts(lower, lower + WIDTH, *theta), 1e-12)
        bounds.append(np.linalg.inv((slopes / mean) @ slopes.T)[0, 0])
    return np.sqrt(np.mean(bounds))


@pytest.mark.parametrize(
    ("photons", "background", "widest"), [(50, 0.2, 1.12), (200, 5.0, 1.06), (40_000, 5.0, 1.05)]
)
def test_times_reach_the_bound_with_true_errors(rng, photons, background, widest):
    """4,000 pixels: rms error over bound to 1.1 % (1 sigma), bias to 0.016 bounds."""
    delay = rng.uniform(800, 64 * WIDTH - 800, N)
    hist = pulse_cube(rng, N, [(delay, photons)], background, n_codes=64, folds=False)
    pulses = fit_pulses(hist, max_pulses=1)
    assert pulses.usable.mean() > 0.999
    error = (pulses.delay_ps - delay)[pulses.usable]
    bound = bound_of(photons, background, np.linspace(1500, 1500 + WIDTH, 7))
    assert np.sqrt(np.mean(error**2)) < widest * bound
    assert abs(error.mean()) < 0.065 * bound
    pull = error / np.sqrt(pulses.covariance[pulses.usable, 0, 0])
    assert 0.95 < pull.std() < widest
    assert np.abs(error).max() < (WIDTH if photons >= 200 else 3 * WIDTH)


def test_every_parameter_has_true_errors(rng):
    """4,000 pixels: pull widths to 1.1 %, pull means to 0.016 (1 sigma)."""
    delay = rng.uniform(0, 908 * WIDTH, N)
    pulses = fit_pulses(pulse_cube(rng, N, [(delay, 2000)], 0.5), max_pulses=1)
    errors = np.sqrt(np.diagonal(pulses.covariance, axis1=1, axis2=2))
    for i, (name, truth) in enumerate(
        [
            ("delay_ps", delay),
            ("std_ps", STD),
            ("photons", 2000),
            ("background_per_ps", 0.5 / WIDTH),
        ]
    ):
        off = getattr(pulses, name) - truth
        pull = (wrapped(off, 908 * WIDTH) if i == 0 else off) / errors[:, i]
        assert abs(pull.mean()) < 0.08, name
        assert 0.95 < pull.std() < 1.05, name
    assert (pulses.chi2 / pulses.dof).mean() == pytest.approx(1.0, abs=0.005)
    assert np.count_nonzero(pulses.flags & fl.POOR_FIT) == 0


def test_least_squares_errors_are_honest(rng):
    """4,000 pixels; the paper's fit is 1.2 times the bound, and its sandwich errors say so."""
    delay = rng.uniform(800, 64 * WIDTH - 800, N)
    hist = pulse_cube(rng, N, [(delay, 2000)], 0.5, n_codes=64, folds=False)
    plain = fit_pulses(hist, method="least_squares")
    pull = (plain.delay_ps - delay) / np.sqrt(plain.covariance[:, 0, 0])
    assert 0.95 < pull.std() < 1.05
    best = fit_pulses(hist, max_pulses=1)
    assert 1.1 < (plain.delay_ps - delay).std() / (best.delay_ps - delay).std() < 1.35


@pytest.mark.parametrize("background", [0.02, 1.0, 40.0])
def test_light_without_pulse_shows_none(rng, background):
    """20,000 pixels of 256 codes; at 1e-4 two false pulses are due, nine have chance 2e-4."""
    counts = rng.poisson(background, (1, 20_000, 256))
    hist = Histograms(counts, bin_width_ps=WIDTH, laser_period_ps=256 * WIDTH)
    pulses = fit_pulses(hist, max_pulses=1)
    assert np.isfinite(pulses.delay_ps).sum() < 9


def test_fifteen_photons_on_a_dark_background_are_found(rng):
    """2,000 pixels, 15 signal photons among 18 of the background in 908 codes."""
    delay = rng.uniform(0, 908 * WIDTH, 2000)
    pulses = fit_pulses(pulse_cube(rng, 2000, [(delay, 15)], 0.02))
    near = np.abs(wrapped(pulses.delay_ps - delay, 908 * WIDTH)) < 2 * STD
    assert near.mean() > 0.97
    assert np.count_nonzero(np.isfinite(pulses.delay_ps) & ~near) == 0


@pytest.mark.parametrize(("photons", "background"), [(60, 0.02), (1000, 1.0), (40_000, 0.5)])
def test_one_pulse_is_not_taken_for_two(rng, photons, background):
    """6,000 pixels each; at 1e-3 six are due, at most 16 have chance 1e-4."""
    delay = rng.uniform(0, 256 * WIDTH, 6000)
    pulses = fit_pulses(pulse_cube(rng, 6000, [(delay, photons)], background, n_codes=256))
    assert len(pulses.row) - 6000 < 16


def test_a_response_with_a_tail_is_one_pulse_and_as_a_gaussian_a_poor_fit(rng):
    """500 pixels of 40,000 photons, 5 % of them late by 200 ps on average."""
    times = rng.normal(5000.0, STD, (500, 40_000))
    late = rng.random(times.shape) < 0.05
    times[late] += rng.exponential(200.0, np.count_nonzero(late))
    counts = np.array([np.bincount((t // WIDTH).astype(int), minlength=256) for t in times])
    hist = Histograms(counts[None] + 1, bin_width_ps=WIDTH)
    for response, is_poor in (("clock", True), (None, False)):
        pulses = fit_pulses(hist, response=response)
        assert len(pulses.row) == 500
        assert ((pulses.flags & fl.POOR_FIT != 0) == is_poor).all()
        assert pulses.usable.all()
    # Of 500 pulls the spread is known to 3.2 %: four of that.
    assert np.std(pulses.delay_ps) == pytest.approx(
        np.sqrt(np.mean(pulses.covariance[:, 0, 0])), rel=0.13
    )


@pytest.mark.parametrize(
    "ratio", [*(pytest.param(ratio, marks=pytest.mark.long) for ratio in (1, 5)), 30]
)
def test_two_pulses_430_ps_apart_come_out_right(rng, ratio):
    """1,000 pixels: both times without bias and with true errors (pull width to 2.2 %)."""
    n = 1000
    first = rng.uniform(0, 908 * WIDTH, n)
    strong, weak = 30_000.0, 30_000.0 / ratio
    pulses = fit_pulses(pulse_cube(rng, n, [(first, weak), (first + 430.0, strong)], 0.5))
    assert len(pulses.row) == 2 * n
    by_pixel = np.lexsort((pulses.photons, pulses.col)) if ratio > 1 else None
    if by_pixel is None:  # equal pulses: told apart by their order in time around the fold
        ahead = wrapped(pulses.delay_ps[::2] - first, 908 * WIDTH) > 215
        pairs = np.arange(2 * n).reshape(n, 2)
        by_pixel = np.where(ahead[:, None], pairs[:, ::-1], pairs).ravel()
    for place, offset, photons in ((0, 0.0, weak), (1, 430.0, strong)):
        rows = by_pixel[place::2]
        error = wrapped(pulses.delay_ps[rows] - first - offset, 908 * WIDTH)
        pull = error / np.sqrt(pulses.covariance[rows, 0, 0])
        assert abs(pull.mean()) < 0.13
        assert 0.91 < pull.std() < 1.09
        off = (pulses.photons[rows] - photons) / np.sqrt(pulses.covariance[rows, 2, 2])
        assert 0.91 < off.std() < 1.09


def test_blends_two_std_apart_are_split_where_photons_suffice(rng):
    """200 blends of two 5,000-photon pulses 140 ps apart among 1,000 single pulses."""
    delay = rng.uniform(2000, 48_000, 1200)
    second = np.where(np.arange(1200) < 200, 5000.0, 0.0)
    hist = pulse_cube(rng, 1200, [(delay, 5000), (delay + 140.0, second)], 0.5)
    pulses = fit_pulses(hist)
    found = np.bincount(pulses.col)
    assert (found[:200] == 2).mean() > 0.9
    assert np.count_nonzero(found[200:] != 1) <= 5
    two = np.isin(pulses.col, np.flatnonzero(found[:200] == 2))
    error = pulses.delay_ps[two].reshape(-1, 2) - (delay[pulses.col[two][::2], None] + [0.0, 140.0])
    pull = error / np.sqrt(pulses.covariance[two, 0, 0]).reshape(-1, 2)
    assert (np.abs(pull.mean(axis=0)) < 0.3).all()
    assert (pull.std(axis=0) < 1.25).all()


def test_codes_that_the_clock_takes_as_equal_do_not_split_a_pulse(rng):
    """1,500 pixels of 4,000,000 photons, a PF32's pattern and 10 % rms of each pixel's own codes,
    read by a nominal clock: one false second pulse is 0.1 %, eight came before this was tested."""
    pattern = np.array([1.036, 0.922, 0.990, 1.096, 0.968, 0.982, 0.936, 1.069])
    widths = WIDTH * np.tile(pattern * rng.normal(1.0, 0.1, (1500, 8)), 8)
    edges = np.concatenate([np.zeros((1500, 1)), np.cumsum(widths, axis=1)], axis=1)
    delay = rng.uniform(1200.0, 2200.0, (1500, 1))
    counts = rng.poisson(expected_counts(edges[:, :-1], edges[:, 1:], delay, STD, 4e6, 0.01))
    pulses = fit_pulses(Histograms(counts[None], bin_width_ps=WIDTH))
    assert len(pulses.row) - 1500 <= 1
    assert ((pulses.flags & fl.POOR_FIT) != 0).mean() > 0.99
