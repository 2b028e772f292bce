"""Delays of a real array against other ways to take them: why slopes between them are not 1.

    LIGHTFLIGHT_DATA=... python benchmarks/real_delays.py

Fluorescence on 128 x 192 pixels (`flimera-pixel-skew`): one pulse everywhere, if all pixels saw
the same decay. Each line is one way to take a pixel's delay and its slope against ours (per bin of
ours). Then what the cross-correlation's slope is made of, and the mean decays of early and of late
pixels.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
from scipy.io import loadmat

import lightflight as lf
from lightflight.timing.calibrate.shaped_flat import delays_from_shaped_flat
from lightflight.timing.clock.calibration import TimingCalibration

BIN_PS = 41.1
LEAST_PHOTONS = 300
FAR_BINS = 6.0
"""Pixels whose two delays differ by more are left out of slopes: dead or screaming ones."""


def shares(counts: np.ndarray, levels: tuple[float, ...]) -> np.ndarray:
    """Bins (..., levels) at which the cumulated counts (..., bins) reach these shares."""
    before = np.cumsum(counts, axis=-1) / np.maximum(counts.sum(axis=-1), 1)[..., np.newaxis]
    return np.stack([np.argmax(before >= level, axis=-1) for level in levels], axis=-1)


def correlation_lag(counts: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Lag in bins at which each pixel's histogram is most like the reference."""
    n = counts.shape[-1]
    spectrum = np.fft.rfft(counts, axis=-1) * np.conj(np.fft.rfft(reference))
    lag = np.argmax(np.fft.irfft(spectrum, n=n, axis=-1), axis=-1)
    return np.where(lag > n // 2, lag - n, lag)


def slopes(late: np.ndarray, *columns: np.ndarray) -> np.ndarray:
    """Coefficients of `late` on the columns, with a constant, without pixels that are far off."""
    near = np.abs(late - np.median(late)) < FAR_BINS
    design = np.column_stack([np.ones(near.sum()), *(column[near] for column in columns)])
    return np.linalg.lstsq(design, late[near], rcond=None)[0][1:]


def main() -> None:
    """Print the tables."""
    warnings.simplefilter("ignore")
    folder = Path(os.environ.get("LIGHTFLIGHT_DATA", "../shared/data")) / "flimera-pixel-skew"
    cube = loadmat(folder / "Coumarin.mat")["data_cube"]
    hist = lf.Histograms(cube, bin_width_ps=BIN_PS)
    found = delays_from_shaped_flat(hist, timing=TimingCalibration.nominal(hist))
    live = (hist.photons >= LEAST_PHOTONS) & (found.flags == 0)
    counts = cube[live].astype(np.float32)
    ours, photons = found.pulse_delay_ps[live] / BIN_PS, hist.photons[live]
    reference = counts[np.argmax(photons)]
    print(f"{live.sum()} pixels, delays over {np.ptp(np.percentile(ours, (0.5, 99.5))):.0f} bins\n")
    lags = correlation_lag(counts, reference)
    ways = {"cross-correlation with the brightest pixel": lags}
    reached = shares(counts, (0.02, 0.1, 0.5))
    for k, level in enumerate(("2 %", "10 %", "half")):
        ways[f"{level} of the cumulated counts"] = reached[:, k]
    delay = ours - np.median(ours)
    for name, value in ways.items():
        late = value - ours
        print(f"{name:44s} slope {1 + slopes(late, delay)[0]:.3f}")
    bright, row = photons / photons.mean() - 1.0, np.nonzero(live)[0] / live.shape[0]
    late = lags - ours
    print("\nthe first slope again, with other causes beside the delay")
    print(f"  brightness          {1 + slopes(late, delay, bright)[0]:.3f}")
    print(f"  brightness and row  {1 + slopes(late, delay, bright, row)[0]:.3f}")
    print("\nmean decay, bins after our delay at which 10, 50, 90 % of the counts have come")
    for name, low, high in (("early", -25, -12), ("middle", -2, 2), ("late", 12, 30)):
        chosen = np.flatnonzero((delay > low) & (delay < high))
        after = np.arange(-20, 430)
        at = np.floor(ours[chosen]).astype(int)[:, np.newaxis] + after
        mean = np.take_along_axis(counts[chosen], np.minimum(at, counts.shape[1] - 1), 1).sum(0)
        reached = after[shares(mean, (0.1, 0.5, 0.9))]
        light = f"{len(chosen):5d} pixels of {photons[chosen].mean():5.0f} photons"
        print(f"  {name:7s} {light}:", *reached)


if __name__ == "__main__":
    main()
