"""How exact pulse fits are: against the Cramér-Rao bound, and against their own stated errors.

    python benchmarks/accuracy_pulses.py

Pulses of 165 ps FWHM at random places on codes of 55 ps, drawn by NumPy's Poisson numbers (fixed
seeds). The bound is that of all four parameters, by finite differences of the expected counts,
averaged over the places of the pulse within a code. Pixels that are flagged count with what was
fitted; those that show no pulse are counted apart.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.special import ndtr

import lightflight as lf
from lightflight import flags as fl

WIDTH, STD, N_CODES = 55.0, 70.0, 64
CASES = ((50, 0.2), (50, 5.0), (200, 0.2), (200, 5.0), (1000, 1.0), (5000, 5.0), (40_000, 5.0),
         (40_000, 0.05))  # fmt: skip
"""(photons, background counts per code)."""

N_FITS = 20_480


def expected(delay: np.ndarray, std: float, photons: float, background: float) -> np.ndarray:
    """Counts due in every code, (..., codes)."""
    edges = np.arange(N_CODES + 1) * WIDTH
    cumulated = ndtr((edges - np.asarray(delay)[..., None]) / std)
    return photons * np.diff(cumulated, axis=-1) + background


def bound_ps(photons: float, background: float) -> float:
    """Cramér-Rao bound of the delay, root mean square over places within a code, ps."""
    variances = []
    for delay in 30 * WIDTH + np.arange(11) / 11 * WIDTH:
        theta = np.array([delay, STD, photons, background])
        slopes = []
        for i, step in enumerate((1e-3, 1e-3, 1e-3, 1e-5)):
            high, low = theta.copy(), theta.copy()
            high[i] += step
            low[i] -= step
            slopes.append((expected(*high) - expected(*low)) / (2.0 * step))
        by = np.array(slopes)
        variances.append(np.linalg.inv((by / expected(*theta)) @ by.T)[0, 0])
    return float(np.sqrt(np.mean(variances)))


def drawn(photons: float, background: float, n: int, seed: int) -> tuple[lf.Histograms, np.ndarray]:
    """Histograms (1, n, codes) of one pulse each, and the delays."""
    rng = np.random.default_rng(seed)
    delay = rng.uniform(10, N_CODES - 10, n) * WIDTH
    mean = expected(delay, STD, photons, background)
    return lf.Histograms(rng.poisson(mean)[None], bin_width_ps=WIDTH), delay


def strongest(pulses: lf.Pulses, delay: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Error of the delay and stated error, ps, of the one pulse of each pixel."""
    assert len(pulses.row) == len(delay)
    return pulses.delay_ps - delay, np.sqrt(pulses.covariance[:, 0, 0])


def main() -> None:
    """Print the table; leave with an error where a figure is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--fits", type=int, default=N_FITS, help="fits per row")
    n = parser.parse_args().fits
    misses = []
    print(f"{n:,} fits per row")
    print(
        "| photons | background per code | error / bound | bias / bound | pull width "
        "| > 1 code off | not found |"
    )
    print("|---:|---:|---:|---:|---:|---:|---:|")
    for seed, (photons, background) in enumerate(CASES):
        hist, delay = drawn(photons, background, n, seed)
        error, stated = strongest(lf.fit_pulses(hist, max_pulses=1), delay)
        missed = ~np.isfinite(error)
        error, stated = error[~missed], stated[~missed]
        bound = bound_ps(photons, background)
        ratio, bias = np.sqrt(np.mean(error**2)) / bound, error.mean() / bound
        pull = float(np.std(error / stated))
        far, lost = int(np.count_nonzero(np.abs(error) > WIDTH)), int(missed.sum())
        print(f"| {photons:,} | {background:g} | {ratio:.3f} | {bias:+.3f} | {pull:.3f} | {far} "
              f"| {lost} |",
              flush=True)  # fmt: skip
        name = f"{photons} photons on {background:g}"
        # A row of n fits knows its ratio to 1 / sqrt(2 n), its bias to 1 / sqrt(n).
        if ratio > (1.03 if photons >= 200 else 1.08) + 1.0 / np.sqrt(2 * n):
            misses.append(f"error / bound at {name}")
        if abs(bias) > 0.03 + 1.0 / np.sqrt(n):
            misses.append(f"bias at {name}")
        if not 0.95 <= pull <= 1.08:
            misses.append(f"pull width at {name}")
        if photons >= 200 and far + lost:
            misses.append(f"outliers at {name}")
    hist, _ = drawn(2000, 0.5, n, 99)
    pulses = lf.fit_pulses(hist)
    false = len(pulses.row) - n
    print(f"a false second pulse in {false} of {n:,} pixels of 2,000 photons ({false / n:.2%})")
    if false > 1e-3 * n:
        misses.append("false second pulses")
    rng = np.random.default_rng(100)
    first = rng.uniform(10, 40, 2000) * WIDTH
    both = expected(first, STD, 5000, 0.5) + expected(first + 430.0, STD, 1000, 0.0)
    pair = lf.fit_pulses(lf.Histograms(rng.poisson(both)[None], bin_width_ps=WIDTH))
    found = np.bincount(pair.col, minlength=2000) == 2
    rows = np.isin(pair.col, np.flatnonzero(found))
    truth = np.stack([first[found], first[found] + 430.0], axis=1).ravel()
    pull = (pair.delay_ps[rows] - truth) / np.sqrt(pair.covariance[rows, 0, 0])
    print(f"two pulses 430 ps apart, 5,000 and 1,000 photons: both found and in order in "
          f"{found.mean():.2%} of 2,000 pixels, pull width {pull.std():.3f}")  # fmt: skip
    flagged = ((pair.flags & fl.MULTIPLE_PULSES) != 0)[rows].all()
    if found.mean() < 0.99 or not flagged or not 0.9 < pull.std() < 1.1:
        misses.append("two pulses in a pixel")
    if misses:
        raise SystemExit(f"missed: {'; '.join(misses)}")


if __name__ == "__main__":
    main()
