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

from lightflight._kernels import bins as bin_kernels
from lightflight._kernels import jit as jit_module
from lightflight._kernels import pulse, pulse_split
from lightflight._kernels.pulse_tile import N_COLUMNS, fit_tile
from tests.pulse_fakes import STD, WIDTH, expected_counts


def plain(kernel: Any) -> Any:
    """The kernel as Python runs it, not compiled."""
    return kernel.py_func


def bins_of(counts, *, period=math.inf):
    n = len(counts)
    lower = np.arange(n) * WIDTH
    made = (np.empty(2 * n + 2), np.empty(2 * n + 3), np.empty(2 * n + 2))
    return made, bin_kernels.bins_from_codes(
        np.asarray(counts, float), lower, lower + WIDTH, period, made
    )


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
        value = function(theta, 1, window, m, outside, (True, False, True), slope, grad, info)
        results.append((value, grad, info))
    assert results[0][0] == pytest.approx(results[1][0], rel=1e-13)
    np.testing.assert_allclose(results[0][1], results[1][1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(results[0][2], results[1][2], rtol=1e-9)


@pytest.mark.parametrize("sampled", [False, True])
def test_slopes_of_the_model_are_its_derivatives(sampled):
    theta = np.array([1490.0, 1600.0, 380.0, 90.0, 75.0, 0.012])
    slope, spare = np.empty(6), np.empty(6)
    pulse.bin_model(theta, 2, 1540.0, 1595.0, 55.0, sampled, slope)
    for a in range(6):
        step = np.zeros(6)
        step[a] = 1e-5 * theta[a]
        high = pulse.bin_model(theta + step, 2, 1540.0, 1595.0, 55.0, sampled, spare)
        low = pulse.bin_model(theta - step, 2, 1540.0, 1595.0, 55.0, sampled, spare)
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
                theta, 1, window, size, out, (True, False, True), slope, grad, info
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
    made = (np.zeros(12), np.zeros(13), np.zeros(12))
    n = bin_kernels.bins_from_codes(counts, lower, upper, 52.0, made)
    assert made[1][: n + 1].tolist() == [0.0, 10.0, 20.0, 30.0, 35.0, 45.0, 52.0]
    assert made[0][:n].tolist() == [5.0, 0.0, 1.0, 0.0, 2.0, 3.0]
    assert made[2][:n].tolist() == [10.0, 0.0, 10.0, 0.0, 10.0, 7.0]
    backward = bin_kernels.bins_from_codes(counts, -upper, -lower, 52.0, made)
    assert made[1][: backward + 1].tolist() == [-52.0, -45.0, -35.0, -30.0, -20.0, -10.0, 0.0]


def test_scan_finds_the_window_of_a_brute_force_search(rng):
    counts = rng.poisson(1.0, 40).astype(float)
    counts[17:20] += 6
    made, n = bins_of(counts)
    sums = tuple(np.empty(200) for _ in range(3))
    best = np.empty(3)
    total = bin_kernels.scan_for_pulse(made, n, False, 0.0, sums, best)
    highest, where, trials = 0.0, (0, 0), 0
    for length in (1, 2, 3, 4, 6, 8, 12, 16):
        trials += n
        for first in range(n - length + 1):
            inside, due = counts[first : first + length].sum(), counts.sum() * length / n
            if inside > due:
                out = total - inside
                value = inside * np.log(inside / due) + out * np.log(out / (total - due))
                if value > highest:
                    highest, where = value, (first, length)
    assert (best[1], best[2]) == where
    assert best[0] == pytest.approx(highest - np.log(trials), abs=np.log(20 / 16) + 1e-9)


def test_valley_separates_two_bumps_from_a_slope():
    codes = np.arange(64) * WIDTH
    two = expected_counts(codes, codes + WIDTH, 1000.0, STD, 3000.0, 0.01)
    two += expected_counts(codes, codes + WIDTH, 1430.0, STD, 100.0, 0.0)
    window, m = bins_of(two)
    tail = np.where(codes > 1000.0, 600.0 * np.exp(-(codes - 1000.0) / 200.0), 0.0)
    one = expected_counts(codes, codes + WIDTH, 1000.0, STD, 3000.0, 0.01)
    falling, _ = bins_of(one + tail)
    valley = pulse_split.valley_between
    assert valley(window, m, 1000.0, 1430.0, 1430.0, STD) > pulse_split.VALLEY
    assert valley(falling, m, 1000.0, 1430.0, 1430.0, STD) == 0.0


def test_fit_tile_gives_the_same_in_plain_python(pixel):
    lower = np.arange(64)[None] * WIDTH
    results = []
    for function in (fit_tile, plain(fit_tile)):
        thetas, covariances = np.empty((1, 4)), np.empty((1, 4, 4))
        table = np.empty((1, N_COLUMNS))
        function(
            pixel[None], lower, lower + WIDTH, math.inf, np.ones(1, bool), np.zeros(1), np.zeros(1),
            0.0, 7.0, (True, False, True), thetas, covariances, table,
        )  # fmt: skip
        results.append((thetas, covariances))
    np.testing.assert_allclose(results[0][0], results[1][0], rtol=1e-9)
    np.testing.assert_allclose(results[0][1], results[1][1], rtol=1e-7, atol=1e-12)


def test_kernels_compile_without_a_cache_where_numba_finds_no_place_for_one(monkeypatch):
    real = numba.njit

    def without_place(*, cache, nogil):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return real(cache=False, nogil=nogil)

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
