"""How fast pulses are fitted, as ratios to a loop of scipy.optimize.curve_fit in one process.

    python benchmarks/speed_pulses.py

Both sides get the same counts: 50 to 40,000 photons (evenly by their logarithm) in a pulse of
165 ps FWHM on codes of 55 ps, a background of a fifth of the signal. The loop fits a sampled
Gaussian and a constant (4 parameters, a start given, no bounds) and returns its covariance;
`fit_pulses` does the Poisson fit with errors and goodness of fit, looking for one pulse. The
loop is timed on some pixels, and both sides in turn, on one core; ratios are medians of those of
the rounds. Times of both are compared before anything is timed.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from statistics import median
from typing import Any

import numba
import numpy as np
import scipy
from scipy.optimize import curve_fit
from scipy.special import ndtr

import lightflight as lf

WIDTH, STD = 55.0, 70.0
LEAST, MOST = 50.0, 40_000.0
N_PIXELS = 65_536
MUST = {64: 200.0, 1024: 200.0}
MOST_THREADED = 1.15
MOST_START = 4.0
START = """
import numpy as np, lightflight as lf
codes = np.arange(64)
mean = 5.0 + 100.0 * np.exp(-0.5 * ((codes - 30.0) / 1.3) ** 2)
counts = np.random.default_rng(1).poisson(mean, (32, 32, 64))
pulses = lf.fit_pulses(lf.Histograms(counts, bin_width_ps=55.0))
assert pulses.usable.all()
"""


def pulses_in_codes(n_pixels: int, n_codes: int, seed: int = 7) -> tuple[lf.Histograms, np.ndarray]:
    """Histograms (1, pixels, codes) of one pulse each, and its delay in ps."""
    rng = np.random.default_rng(seed)
    delay = rng.uniform(8, n_codes - 8, n_pixels) * WIDTH
    photons = np.exp(rng.uniform(np.log(LEAST), np.log(MOST), n_pixels))
    counts = np.empty((1, n_pixels, n_codes), np.uint32)
    edges = np.arange(n_codes + 1) * WIDTH
    for part in np.array_split(np.arange(n_pixels), max(1, n_pixels // 2048)):
        cumulated = ndtr((edges - delay[part, None]) / STD)
        mean = photons[part, None] * (np.diff(cumulated, axis=1) + 0.2 / n_codes)
        counts[0, part] = rng.poisson(mean)
    counts.setflags(write=False)
    return lf.Histograms(counts, bin_width_ps=WIDTH), delay


def sampled(codes: np.ndarray, height: float, centre: float, std: float, level: float) -> Any:
    """Gaussian at the middle of each code on a constant."""
    return height * np.exp(-0.5 * ((codes - centre) / std) ** 2) + level


def curve_fits(counts: np.ndarray) -> np.ndarray:
    """(n,), centre in ps by curve_fit for rows of counts; NaN where it gives up."""
    codes = np.arange(counts.shape[1]) + 0.5
    centre = np.full(len(counts), np.nan)
    for i, row in enumerate(counts):
        peak = int(np.argmax(row))
        start = (float(row[peak]), peak + 0.5, STD / WIDTH, float(np.median(row)))
        try:
            found, _ = curve_fit(sampled, codes, row, p0=start)
        except RuntimeError:
            continue
        centre[i] = found[1] * WIDTH
    return centre


def seconds(work: Callable[[], Any], clock: Callable[[], float] = time.process_time) -> float:
    """CPU (or other) time of one call."""
    start = clock()
    work()
    return clock() - start


def check_answers(hist: lf.Histograms, delay: np.ndarray, n_loop: int) -> None:
    """Both sides find the pulses, ours at least as well."""
    ours = lf.fit_pulses(hist, max_pulses=1)
    assert ours.usable.mean() > 0.999, "pulses were missed"
    error = (ours.delay_ps - delay)[:n_loop]
    theirs = curve_fits(hist.counts[0, :n_loop]) - delay[:n_loop]
    fine = np.isfinite(theirs) & (np.abs(theirs) < WIDTH) & np.isfinite(error)
    assert fine.mean() > 0.95, "curve_fit fails too often to compare with"
    std = np.sqrt(ours.covariance[:n_loop, 0, 0])
    assert np.median(np.abs(error - theirs)[fine] / std[fine]) < 1.0, "the answers differ"
    assert np.std((error / std)[fine]) < np.std((theirs / std)[fine]), "the loop is more precise"


def speed(n_pixels: int, n_codes: int, n_loop: int, rounds: int) -> tuple[float, float, float]:
    """Seconds of CPU per fit, ratio of the loop to it, and CPU of two threads over one."""
    hist, delay = pulses_in_codes(n_pixels, n_codes)
    check_answers(hist, delay, n_loop)
    one, ratio, threaded = [], [], []
    for _ in range(rounds):
        loop = seconds(lambda: curve_fits(hist.counts[0, :n_loop])) / n_loop
        alone = seconds(lambda: lf.fit_pulses(hist, max_pulses=1)) / n_pixels
        both = seconds(lambda: lf.fit_pulses(hist, max_pulses=1, threads=2)) / n_pixels
        one.append(alone)
        ratio.append(loop / alone)
        threaded.append(both / alone)
    return median(one), median(ratio), median(threaded)


def start_ratio(rounds: int) -> float:
    """CPU from process start to 1,024 fits (warm cache) over that of `import numba`."""

    def child(code: str) -> float:
        before = os.times()
        subprocess.run([sys.executable, "-c", code], check=True)
        after = os.times()
        return (after.children_user + after.children_system) - (
            before.children_user + before.children_system
        )

    child(START)
    return median(child(START) / child("import numba") for _ in range(rounds))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--pixels", type=int, default=N_PIXELS)
    parser.add_argument("--loop", type=int, default=400, help="curve_fit calls per round")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, SciPy {scipy.__version__}")
    print(f"Numba {numba.__version__}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print("| figure | measured | must |\n|---|---:|---:|")
    misses = []

    def row(name: str, value: float, limit: float, *, at_least: bool, unit: str = "") -> None:
        sign = ">=" if at_least else "<="
        print(f"| {name} | {value:.3g}{unit} | {sign} {limit:g}{unit} |", flush=True)
        if (value < limit) == at_least:
            misses.append(name)

    for n_codes, must in MUST.items():
        per_fit, ratio, threaded = speed(options.pixels, n_codes, options.loop, options.rounds)
        size = f"{options.pixels:,} pixels x {n_codes:,} codes"
        row(f"curve_fit loop / fit_pulses, {size}", ratio, must, at_least=True)
        print(f"| ... per fit | {1e6 * per_fit:.2f} us | |")
        row(f"CPU, two threads / one, {size}", threaded, MOST_THREADED, at_least=False)
    row("process start to 1,024 fits / import numba", start_ratio(options.rounds), MOST_START,
        at_least=False)  # fmt: skip
    if misses:
        raise SystemExit(f"missed: {'; '.join(misses)}")


if __name__ == "__main__":
    main()
