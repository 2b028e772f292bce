"""Compiled kernels against plain Python and brute force, and how they are compiled."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from scipy.special import ndtr

from lightflight._kernels import jit as jit_module, pulse
from lightflight._kernels.pulse import N_COLUMNS, fit_tile
from lightflight.timing.pulses.batch import Model, fit
from lightflight.timing.pulses.bins import bins_of
from lightflight.timing.pulses.fits import LOG_FALSE_SECOND
from lightflight.timing.pulses.split import DOUBTFUL, Search, residual_far_from_pulses
from tests.pulse_fakes import STD, WIDTH, expected_counts

GAUSSIAN = np.empty((3, 0))


def plain(kernel: Any) -> Any:
    """The kernel as Python runs it, not compiled."""
    return kernel.py_func


def bins_in_python(counts, lower, upper, period=math.inf):
    """(counts, edges, exposure) of a row of codes, and how many bins, by the kernel's pieces."""
    counts = np.asarray(counts, float)
    size = 2 * len(counts) + 2
    edges, exposure, codes = np.zeros(size + 1), np.zeros(size), np.zeros(size, np.int64)
    n = pulse.bins_from_codes(lower[None], upper[None], 0, period, edges, exposure, codes)
    levels = np.zeros((1, 2 * size))
    total, peak = pulse.take_counts(counts[None], 0, codes, n, n, levels)
    assert total == pytest.approx(levels[0, :n].sum(), rel=1e-12)
    assert peak == levels[0, :n].max()
    return (levels[0], edges, exposure), n


def bins_in_numpy(counts, lower, upper, period=math.inf):
    """The same by `_pulse_batch.bins_of`."""
    made = bins_of(
        np.asarray(counts)[None], lower[None], upper[None], period, np.full(1, np.inf),
        np.zeros((1, 2)),
    )  # fmt: skip
    return (made.counts[0], made.edges[0], made.exposure[0]), int(made.n[0])


both_ways = pytest.mark.parametrize("bins", [bins_in_python, bins_in_numpy])


@pytest.fixture
def pixel(rng):
    codes = np.arange(64) * WIDTH
    return rng.poisson(expected_counts(codes, codes + WIDTH, 1500.0, STD, 400.0, 0.01)).astype(
        float
    )


@both_ways
def test_bins_skip_dead_codes_fill_gaps_and_stop_at_the_period(bins):
    counts = np.array([5.0, 7.0, 1.0, 2.0, 3.0])
    lower = np.array([0.0, 10.0, 20.0, 35.0, 45.0])
    upper = np.array([10.0, 10.0, 30.0, 45.0, 60.0])
    made, n = bins(counts, lower, upper, 52.0)
    assert made[1][: n + 1].tolist() == [0.0, 10.0, 20.0, 30.0, 35.0, 45.0, 52.0]
    assert made[0][:n].tolist() == [5.0, 0.0, 1.0, 0.0, 2.0, 3.0]
    assert made[2][:n].tolist() == [10.0, 0.0, 10.0, 0.0, 10.0, 7.0]
    made, n = bins(counts, -upper, -lower, 52.0)
    assert made[1][: n + 1].tolist() == [-52.0, -45.0, -35.0, -30.0, -20.0, -10.0, 0.0]
    assert made[0][:n].tolist() == [3.0, 2.0, 0.0, 1.0, 0.0, 5.0]


@both_ways
@pytest.mark.parametrize("backward", [False, True])
def test_counts_of_a_plain_run_of_codes_are_copied_in_time_order(bins, backward):
    lower = np.arange(7) * 10.0
    lower = -lower - 10.0 if backward else lower
    made, n = bins(np.arange(7.0), lower, lower + 10.0, 75.0)
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
        levels = np.zeros((8, reach), np.uint32)
        levels[0, :reach] = np.tile(counts, 2)[:reach]
        covered, inverse = np.zeros(reach + 1), np.empty(40)
        live, even = pulse.sum_exposure(exposure, 40, reach, inverse, covered)
        assert (live, even) == (40, 0.0 if uneven else 1.0)
        np.testing.assert_allclose(inverse * exposure, 1.0)
        total, peak = float(counts.sum()), float(counts.max())
        best = pulse.scan_for_pulse(levels, 40, reach, covered, even, 0.0, total, peak, 0.0)
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
        assert pulse.log_trials(40) == pytest.approx(np.log(40 * 5))


class Tile(NamedTuple):
    """What `fit_tile` makes of pixels."""

    values: np.ndarray
    covariances: np.ndarray
    table: np.ndarray
    left: np.ndarray


def run_tile(function, counts, lower, upper, period=math.inf):
    """`fit_tile` of some pixels on a clock without faults."""
    m = len(counts)
    values, covariances = np.full((4, m), np.nan), np.full((4, 4, m), np.nan)
    table = np.full((N_COLUMNS, m), np.nan)
    starts, left = np.empty((m, 4)), np.empty(m, np.int64)
    zero, never = np.zeros(m), np.full(m, np.inf)
    n_left = function(
        counts, lower, upper, period, np.ones(m, bool), zero, never, zero, zero, 7.0, True, True,
        0, starts, left, values, covariances, table, *pulse.room_for(counts),
    )  # fmt: skip
    return Tile(values.T, covariances.T, table.T, left[:n_left])


def test_fit_tile_gives_the_same_in_plain_python(pixel):
    lower = np.arange(64)[None] * WIDTH
    counts = pixel[None].astype(np.uint32)
    compiled = run_tile(fit_tile, counts, lower, lower + WIDTH)
    in_python = run_tile(plain(fit_tile), counts, lower, lower + WIDTH)
    for one, other in zip(compiled, in_python, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)
    assert len(compiled.left) == 0


@pytest.mark.parametrize(
    ("photons", "background"), [(40_000, 2.0), (40_000, 0.0), (1000, 0.1), (200, 5.0), (60, 0.1)]
)
@pytest.mark.parametrize("uneven", [False, True])
def test_the_kernel_agrees_with_the_fit_in_numpy(rng, photons, background, uneven):
    """300 pixels, most of them settled by the kernel: to 1 % of a standard error, errors too."""
    m, n = 300, 128
    widths = WIDTH * (rng.uniform(0.6, 1.4, (m, n)) if uneven else np.ones((1, n)))
    edges = np.concatenate([np.zeros((len(widths), 1)), np.cumsum(widths, axis=1)], axis=1)
    lower, upper = edges[:, :-1].copy(), edges[:, 1:].copy()
    delay = rng.uniform(1500, 5500, (m, 1))
    mean = expected_counts(lower, upper, delay, STD, photons, background / WIDTH)
    counts = rng.poisson(mean).astype(np.uint32)
    fast = run_tile(fit_tile, counts, lower, upper)
    settled = np.ones(m, dtype=bool)
    settled[fast.left] = False
    assert settled.mean() > 0.9
    none = np.zeros((m, 2))
    bins = bins_of(counts, lower, upper, math.inf, np.full(m, np.inf), none)
    start = np.stack([delay[:, 0], np.full(m, 0.8 * photons), np.full(m, STD), none[:, 0]], axis=1)
    slow = fit(bins, start, Model(True, False, True, GAUSSIAN))
    order = [0, 2, 1, 3]
    errors = np.sqrt(np.diagonal(slow.covariance, axis1=1, axis2=2))[:, order]
    off = (np.abs(fast.values - slow.theta[:, order]) / errors)[settled]
    assert off[:, : 4 if background > 0 else 3].max() < 0.01
    got = np.sqrt(np.diagonal(fast.covariances, axis1=1, axis2=2))
    np.testing.assert_allclose(got[settled, :3], errors[settled, :3], rtol=0.01)
    for column, wanted in (
        (pulse.CHI2, slow.chi2), (pulse.CHI2_BINS, slow.chi2_bins),
        (pulse.CHI2_DEVIATE, slow.deviate), (pulse.HELD_SHARE, slow.held),
    ):  # fmt: skip
        close = np.isclose(fast.table[settled, column], wanted[settled], rtol=0.01, atol=0.02)
        assert close.mean() > 0.98  # a bin may be on either side of what counts
    search = Search(bins, Model(True, False, True, GAUSSIAN), math.nan, 0.0, none[:, 0])
    residual = residual_far_from_pulses(search, slow.theta)[settled]
    asked = LOG_FALSE_SECOND + DOUBTFUL  # from here on a second pulse is looked for
    assert ((fast.table[settled, pulse.RESIDUAL] > asked) == (residual > asked)).mean() > 0.99


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


def test_normal_integrals_are_precise_in_the_tails():
    z = np.linspace(-8.0, 8.0, 999)
    w = np.zeros(pulse.ROOM)
    w[pulse.EDGE : pulse.EDGE + 999] = z
    pulse.normal_at_edges(w, 998, 0.0, 1.0)
    below, density, steep = (
        w[row : row + 999] for row in (pulse.BELOW, pulse.DENSITY, pulse.STEEP)
    )
    exact = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    np.testing.assert_allclose(density, exact, rtol=2e-5)
    np.testing.assert_allclose(steep, z * exact, rtol=2e-5)
    np.testing.assert_allclose(below, ndtr(z), rtol=3e-5)
    np.testing.assert_allclose(below, ndtr(z), atol=2e-9)


def test_kernels_compile_without_a_cache_where_numba_finds_no_place_for_one(monkeypatch):
    real = numba.njit

    def without_place(*, cache, **options):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return real(cache=False, **options)

    monkeypatch.setattr(numba, "njit", without_place)
    double = jit_module.jit(lambda x: 2 * x)
    assert double(21) == 42


def test_who_listens_is_told_what_is_compiled_and_only_then(caplog, monkeypatch, tmp_path):
    # Beside this file it would be found again by the next run, which then compiles nothing.
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def double(x):
        return 2 * x

    kernel = jit_module.jit(double)
    with caplog.at_level("INFO", logger="lightflight"):
        assert (kernel(21), kernel(4)) == (42, 8)
    assert [record.getMessage().partition(" (")[0] for record in caplog.records] == [
        "compiling double"
    ]


def test_all_that_a_kernel_compiles_stands_in_its_own_file():
    """Numba compiles again where the file of a kernel has changed, and looks at no other."""
    folder = Path(jit_module.__file__).parent
    for path in folder.glob("*.py"):
        lines = path.read_text().splitlines()
        others = [line for line in lines if line.startswith("from lightflight._kernels")]
        assert set(others) <= {
            "from lightflight._kernels.jit import jit, piece",
        }, path.name


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
