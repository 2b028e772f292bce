"""Kernels: compiled and plain Python agree; the cache is used, and not missed where absent."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import ndtr

from lightflight._kernels import bins as bin_kernels
from lightflight._kernels import jit as jit_module
from lightflight._kernels import pulse, pulse_lanes, pulse_split
from lightflight._kernels.amplitudes import amplitudes_at_times
from lightflight._kernels.pulse_tile import N_COLUMNS, fit_rest, fit_tile
from tests.pulse_fakes import STD, WIDTH, expected_counts

GAUSSIAN = np.empty((3, 0))


def plain(kernel: Any) -> Any:
    """The kernel as Python runs it, not compiled."""
    return kernel.py_func


def bins_of(counts, lower=None, upper=None, period=math.inf):
    """(counts, edges, exposure) of a row of codes, and how many bins."""
    counts = np.asarray(counts, float)
    lower = np.arange(len(counts)) * WIDTH if lower is None else lower
    upper = lower + WIDTH if upper is None else upper
    size = 2 * len(counts) + 2
    edges, exposure, codes = np.zeros(size + 1), np.zeros(size), np.zeros(size, np.int64)
    n = bin_kernels.bins_from_codes(lower, upper, period, edges, exposure, codes)
    values = np.zeros(size)
    total = bin_kernels.take_counts(counts, codes, n, values)
    assert total == pytest.approx(values[:n].sum(), rel=1e-12)
    return (values, edges, exposure), n


@pytest.fixture
def pixel(rng):
    codes = np.arange(64) * WIDTH
    return rng.poisson(expected_counts(codes, codes + WIDTH, 1500.0, STD, 400.0, 0.01)).astype(
        float
    )


def test_compiled_and_plain_evaluate_agree(pixel):
    window, m = bins_of(pixel)
    theta = np.array([1490.0, 380.0, 75.0, 0.012])
    results = []
    for function in (pulse.evaluate, plain(pulse.evaluate)):
        slope, grad, info = np.empty(4), np.empty(4), np.empty((4, 4))
        outside = np.array([3.0, 500.0])
        value = function(
            theta, 1, window, m, outside, (True, False, True, GAUSSIAN), slope, grad, info
        )
        results.append((value, grad, info))
    assert results[0][0] == pytest.approx(results[1][0], rel=1e-13)
    np.testing.assert_allclose(results[0][1], results[1][1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(results[0][2], results[1][2], rtol=1e-9)


@pytest.mark.parametrize("sampled", [False, True])
def test_slopes_of_the_model_are_its_derivatives(sampled):
    theta = np.array([1490.0, 1600.0, 380.0, 90.0, 75.0, 0.012])
    slope, spare = np.empty(6), np.empty(6)
    model = (True, sampled, True, GAUSSIAN)
    pulse.bin_model(theta, 2, 1540.0, 1595.0, 55.0, model, slope)
    for a in range(6):
        step = np.zeros(6)
        step[a] = 1e-5 * theta[a]
        high = pulse.bin_model(theta + step, 2, 1540.0, 1595.0, 55.0, model, spare)
        low = pulse.bin_model(theta - step, 2, 1540.0, 1595.0, 55.0, model, spare)
        assert slope[a] == pytest.approx((high - low) / (2 * step[a]), rel=1e-6)


def test_window_and_sums_give_the_likelihood_of_the_full_range(pixel):
    """Exactly: differences of the objective, gradient and information agree with all bins in."""
    whole, n = bins_of(pixel)
    part = tuple(np.empty(200) for _ in range(3))
    outside = np.zeros(4)
    m = pulse.load_around(
        whole, n, math.inf, np.array([1500.0, 1.0, STD, 1.0]), 1, 7.5, part, outside
    )
    assert m < n
    assert outside[0] > 0
    values = []
    for theta in (np.array([1500.0, 380.0, 70.0, 0.01]), np.array([1480.0, 420.0, 66.0, 0.012])):
        for window, size, out in ((whole, n, np.zeros(2)), (part, m, outside)):
            slope, grad, info = np.empty(4), np.empty(4), np.empty((4, 4))
            value = pulse.evaluate(
                theta, 1, window, size, out, (True, False, True, GAUSSIAN), slope, grad, info
            )
            values.append((value, grad, info))
    for first in (0, 2):
        assert values[first][0] == pytest.approx(values[first + 1][0], rel=1e-12)
        np.testing.assert_allclose(values[first][1], values[first + 1][1], rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(values[first][2], values[first + 1][2], rtol=1e-8, atol=1e-12)


def test_bins_skip_dead_codes_fill_gaps_and_stop_at_the_period():
    counts = np.array([5.0, 7.0, 1.0, 2.0, 3.0])
    lower = np.array([0.0, 10.0, 20.0, 35.0, 45.0])
    upper = np.array([10.0, 10.0, 30.0, 45.0, 60.0])
    made, n = bins_of(counts, lower, upper, 52.0)
    assert made[1][: n + 1].tolist() == [0.0, 10.0, 20.0, 30.0, 35.0, 45.0, 52.0]
    assert made[0][:n].tolist() == [5.0, 0.0, 1.0, 0.0, 2.0, 3.0]
    assert made[2][:n].tolist() == [10.0, 0.0, 10.0, 0.0, 10.0, 7.0]
    made, n = bins_of(counts, -upper, -lower, 52.0)
    assert made[1][: n + 1].tolist() == [-52.0, -45.0, -35.0, -30.0, -20.0, -10.0, 0.0]
    assert made[0][:n].tolist() == [3.0, 2.0, 0.0, 1.0, 0.0, 5.0]


@pytest.mark.parametrize("backward", [False, True])
def test_counts_of_a_plain_run_of_codes_are_copied_in_time_order(backward):
    lower = np.arange(7) * 10.0
    lower = -lower - 10.0 if backward else lower
    made, n = bins_of(np.arange(7.0), lower, lower + 10.0, 75.0)
    assert n == 8
    run = made[0][:n].tolist()
    expected = [6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0] if backward else list(np.arange(7.0))
    assert run == [*expected, 0.0]


@pytest.mark.parametrize("folds", [False, True])
@pytest.mark.parametrize("uneven", [False, True])
def test_scan_finds_the_window_of_a_brute_force_search(rng, folds, uneven):
    for _ in range(20):
        exposure = rng.uniform(0.5, 1.5, 40) if uneven else np.ones(40)
        counts = rng.poisson(exposure)
        where = rng.integers(0, 40 if folds else 37)
        counts[np.arange(where, where + 3) % 40] += 6
        reach = 80 if folds else 40
        levels = np.zeros((8, reach), np.int32)
        levels[0, :reach] = np.tile(counts, 2)[:reach]
        covered = np.zeros(reach + 1)
        bin_kernels.accumulate(exposure, 40, reach, covered)
        best = np.empty(3)
        total, peak = float(counts.sum()), float(counts.max())
        even = bin_kernels.even_width(exposure)
        bin_kernels.scan_for_pulse(levels, 40, reach, covered, even, 0.0, total, peak, 0.0, best)
        highest, found = 0.0, (0, 0)
        for length in (1, 2, 4, 8, 16):
            for first in range(40 if folds else 41 - length):
                at = np.arange(first, first + length) % 40
                inside, due = counts[at].sum(), total * exposure[at].sum() / exposure.sum()
                if inside > due:
                    out = total - inside
                    value = inside * np.log(inside / due) + out * np.log(out / (total - due))
                    if value > highest:
                        highest, found = value, (first, length)
        assert (best[1], best[2]) == found
        assert best[0] == pytest.approx(highest)
        assert bin_kernels.log_trials(40) == pytest.approx(np.log(40 * 5))


def test_valley_separates_two_bumps_from_a_slope():
    codes = np.arange(64) * WIDTH
    two = expected_counts(codes, codes + WIDTH, 1000.0, STD, 3000.0, 0.01)
    two += expected_counts(codes, codes + WIDTH, 1430.0, STD, 100.0, 0.0)
    window, m = bins_of(two)
    tail = np.where(codes > 1000.0, 600.0 * np.exp(-(codes - 1000.0) / 200.0), 0.0)
    one = expected_counts(codes, codes + WIDTH, 1000.0, STD, 3000.0, 0.01)
    falling, _ = bins_of(one + tail)
    valley = pulse_split.valley_between
    assert valley(window, m, 1000.0, 1430.0, 1430.0, STD, 1.0) > pulse_split.VALLEY
    assert valley(falling, m, 1000.0, 1430.0, 1430.0, STD, 1.0) == 0.0


def test_amplitudes_have_the_largest_likelihood_given_times_and_widths(rng):
    """Two pulses that overlap across the fold and a place without one, over a known background."""
    lower, period = np.arange(128) * WIDTH, 128 * WIDTH
    delays, stds = np.array([[30.0, np.nan, period - 90.0]]), np.full((1, 3), STD)
    shapes = [
        expected_counts(lower, lower + WIDTH, delay, STD, 1.0, 0.0, period)
        for delay in delays[0, [0, 2]]
    ]
    counts = rng.poisson(np.array([400.0, 150.0]) @ shapes + 2.0).astype(float)
    photons, empty, background = np.empty((1, 3)), np.empty((1, 3)), np.empty(1)
    amplitudes_at_times(
        counts[None], lower[None], lower[None] + WIDTH, period, delays, stds, photons, empty,
        background,
    )  # fmt: skip
    away = (np.array(shapes) < 1e-7).all(axis=0)
    assert background[0] == pytest.approx(counts[away].mean() / WIDTH, rel=0.02)

    def minus_log_likelihood(amplitudes):
        mean = amplitudes @ shapes + background[0] * WIDTH
        return np.sum(mean - counts * np.log(mean))

    best = minimize(minus_log_likelihood, (300.0, 200.0), bounds=[(1, None)] * 2).x
    np.testing.assert_allclose(photons[0, [0, 2]], best, atol=0.1 * np.sqrt(best.min()))
    assert np.isnan(photons[0, 1])
    assert np.isnan(empty[0, 1])
    other = best[1] * shapes[1] + background[0] * WIDTH
    assert 1.0 / empty[0, 0] == pytest.approx(np.sum(shapes[0] ** 2 / other), rel=0.05)


def run_tile(function, counts, lower, upper, period=math.inf):
    """Values, covariances, table of `fit_tile`, and how many pixels lanes left over."""
    m = len(counts)
    values, covariances = np.full((4, m), np.nan), np.full((4, 4, m), np.nan)
    table = np.full((N_COLUMNS, m), np.nan)
    starts, left = np.empty((m, 4)), np.empty(m, np.int64)
    model, zero, never = (True, False, True, GAUSSIAN), np.zeros(m), np.full(m, np.inf)
    n_left = function(
        counts, lower, upper, period, np.ones(m, bool), zero, never, zero, zero, 7.0, model, starts,
        left, 0, values, covariances, table,
    )  # fmt: skip
    fit_rest(
        counts, lower, upper, period, left[:n_left], zero, never, zero, zero, model, starts, 0,
        values, covariances, table,
    )  # fmt: skip
    return values.T, covariances.T, table.T, n_left


def test_fit_tile_gives_the_same_in_plain_python(pixel):
    lower = np.arange(64)[None] * WIDTH
    counts = pixel[None].astype(np.uint32)
    compiled = run_tile(fit_tile, counts, lower, lower + WIDTH)
    in_python = run_tile(plain(fit_tile), counts, lower, lower + WIDTH)
    np.testing.assert_allclose(compiled[0], in_python[0], rtol=1e-5)
    np.testing.assert_allclose(compiled[1], in_python[1], rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize(
    ("photons", "background"), [(40_000, 2.0), (40_000, 0.0), (1000, 0.1), (200, 5.0), (60, 0.1)]
)
@pytest.mark.parametrize("uneven", [False, True])
def test_lanes_agree_with_the_general_kernel(rng, photons, background, uneven, monkeypatch):
    """300 pixels, most of them settled by lanes: to 2 % of a standard error, and the errors too."""
    m, n = 300, 128
    widths = WIDTH * (rng.uniform(0.6, 1.4, (m, n)) if uneven else np.ones((1, n)))
    edges = np.concatenate([np.zeros((len(widths), 1)), np.cumsum(widths, axis=1)], axis=1)
    lower, upper = edges[:, :-1].copy(), edges[:, 1:].copy()
    delay = rng.uniform(1500, 5500, (m, 1))
    mean = expected_counts(lower, upper, delay, STD, photons, background / WIDTH)
    counts = rng.poisson(mean).astype(np.uint32)
    fast = run_tile(fit_tile, counts, lower, upper)
    assert fast[3] < 0.1 * m
    alone = [run_tile_without_lanes(counts[i], lower[i % len(lower)], upper[i % len(upper)])
             for i in range(m)]  # fmt: skip
    values = np.array([values for values, _ in alone])
    errors = np.sqrt(np.array([np.diag(covariance) for _, covariance in alone]))
    off = np.abs(fast[0] - values) / errors
    assert off[:, :3].max() < 0.02
    if background > 0:
        assert off[:, 3].max() < 0.02
    got = np.sqrt(np.diagonal(fast[1], axis1=1, axis2=2))
    np.testing.assert_allclose(got[:, :3], errors[:, :3], rtol=0.01)


def run_tile_without_lanes(counts, lower, upper):
    """(centre, std, photons, background) and covariance by the general kernel."""
    bins, n = bins_of(counts, lower, upper)
    _, window, _, small = pulse.new_scratch(2 * len(counts) + 2, 1)
    total, peak = bins[0][:n].sum(), int(np.argmax(bins[0][:n]))
    start = bins[1][peak] + 0.5 * WIDTH
    theta, outcome = np.array([start, 0.8 * total, STD, 0.01]), np.empty(4)
    model = (True, False, True, GAUSSIAN)
    m = pulse.fit_bins(bins, n, math.inf, theta, 1, model, True, window, small, outcome)
    covariance = np.empty((4, 4))
    whole = bins[2][:n].sum()
    assert pulse.covariance_of_fit(theta, 1, model, whole, window, m, small, covariance)
    order = [0, 2, 1, 3]
    return theta[order], covariance[np.ix_(order, order)]


def test_results_do_not_depend_on_the_company_a_pixel_travels_in(rng):
    lower = np.arange(128)[None] * WIDTH
    photons = 10 ** rng.uniform(1.5, 4.5, (200, 1))
    delay = rng.uniform(1500, 5500, (200, 1))
    mean = expected_counts(lower, lower + WIDTH, delay, STD, photons, 0.3 / WIDTH)
    counts = rng.poisson(mean).astype(np.uint32)
    order = rng.permutation(200)
    together = run_tile(fit_tile, counts, lower, lower + WIDTH)
    mixed = run_tile(fit_tile, counts[order], lower, lower + WIDTH)
    by_itself = run_tile(fit_tile, counts[:1], lower, lower + WIDTH)
    for a, b, c in zip(together[:3], mixed[:3], by_itself[:3], strict=True):
        np.testing.assert_array_equal(a[order], b)
        np.testing.assert_array_equal(a[:1], c)


def test_lane_normal_integrals_are_precise_in_the_tails():
    z = np.linspace(-8.0, 8.0, 4001).astype(np.float32)
    pdf, tail = np.array([pulse_lanes.normal_pdf_tail(x) for x in z]).T
    exact = z.astype(float)
    np.testing.assert_allclose(pdf, np.exp(-0.5 * exact**2) / np.sqrt(2 * np.pi), rtol=2e-5)
    np.testing.assert_allclose(tail, ndtr(-np.abs(exact)), rtol=3e-5)


def test_kernels_compile_without_a_cache_where_numba_finds_no_place_for_one(monkeypatch):
    real = numba.njit

    def without_place(*, cache, **options):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return real(cache=False, **options)

    monkeypatch.setattr(numba, "njit", without_place)
    double = jit_module.jit(lambda x: 2 * x)
    assert double(21) == 42


def test_the_cache_knows_when_any_kernel_file_has_changed():
    """Numba looks at a function's own file only; the stamp of all of them must get in."""
    kernel: Any = fit_tile
    index = kernel._cache._cache_file
    assert index._source_stamp == jit_module._STAMP
    files = list(Path(jit_module.__file__).parent.glob("*.py"))
    assert jit_module._STAMP[1] == sum(file.stat().st_size for file in files)


def test_a_cache_folder_that_cannot_be_made_does_no_harm(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    code = (
        "from lightflight._kernels.jit import jit\n"
        "import types\n"
        "made = types.FunctionType(compile('def f(x): return x + 1', '<nowhere>', 'exec')"
        ".co_consts[0], {}, 'f')\n"
        "print(jit(made)(1))\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env={**os.environ, "NUMBA_CACHE_DIR": str(blocked / "below"), "HOME": str(blocked)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("2\n", "")
