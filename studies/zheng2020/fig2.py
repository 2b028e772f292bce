"""Fig. 2(b, c): the four kinds of pixel, and the map (x, y, t_a) of those that are kept.

The twin's pixels scream or are silent, but none has a broken clock: two on the path are broken by
hand, one whose photons scatter over 1.2 ns, one that writes the same code again and again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lightflight.recording.histograms import Histograms
from lightflight.simulate.presets import paper_scene, pf32
from lightflight.timing.pulses.arrivals import Arrivals, find_arrivals
from lightflight.timing.pulses.pulses import Pulses, fit_pulses
from lightflight.view.figures.camera import FIG_2B_CASES
from studies.zheng2020.laboratory import calibrated_clock, recorded

BACKGROUND_PER_PIXEL = 400.0
"""Daylight and dark counts over the recording."""

SCATTER_CODES = 9.0
"""Standard deviation of the time stamps of the pixel that scatters, codes (1.2 ns FWHM)."""


@dataclass(frozen=True, eq=False)
class Fig2:
    """One recording of the three legs, one Gaussian per pixel, as the paper fits them."""

    hist: Histograms
    """The recording."""
    pulses: Pulses
    """Pulses by least squares, at most one per pixel."""
    arrivals: Arrivals
    """The same on the calibrated clock."""
    n_kept: int
    """Effective pixels."""
    n_discarded: dict[str, int]
    """Discarded pixels by kind."""


def record(*, seed: int) -> Fig2:
    """Record the three legs with some background, break two pixels, and fit every pixel."""
    scene = paper_scene(pf32(), background=BACKGROUND_PER_PIXEL)
    whole = recorded(scene, seed=8_000_000 * (seed + 1))
    hist = _broken(whole, np.random.default_rng([seed, 2]))
    timing = calibrated_clock("delays", seed=seed, three_legs=True)
    pulses = fit_pulses(hist, timing=timing, method="least_squares", max_pulses=1)
    arrivals = find_arrivals(hist, timing=timing, method="least_squares", max_pulses=1)
    return Fig2(
        hist,
        pulses,
        arrivals,
        int(arrivals.usable.sum()),
        {name: int(((arrivals.flags & bits) != 0).sum()) for name, bits in FIG_2B_CASES if bits},
    )


def _broken(hist: Histograms, rng: np.random.Generator) -> Histograms:
    """The recording with the time stamps of two bright quiet pixels spoiled."""
    counts = np.array(hist.counts)
    live = np.array(counts[:, :, 1:], dtype=np.int64)
    light = live.sum(axis=2) - live.shape[2] * np.median(live, axis=2)
    light[hist.truth.screaming] = 0
    order = np.argsort(light.ravel())[::-1]
    wide, narrow = (np.unravel_index(order[k], light.shape) for k in (6, 12))
    peak = int(np.argmax(live[wide]))
    stamps = np.rint(rng.normal(peak, SCATTER_CODES, int(light[wide]))).astype(int)
    stamps = np.clip(stamps, 8, live.shape[2] - 1)
    flat = rng.poisson(max(float(np.median(live[wide])), 0.2), live.shape[2])
    live[wide] = np.where(live[wide] > 0, flat, 0) + np.bincount(stamps, minlength=live.shape[2])
    stuck = int(np.argmax(live[narrow]))
    total = int(light[narrow])
    live[narrow] = np.where(live[narrow] > 0, np.median(live[narrow]), 0).astype(np.int64)
    live[narrow][stuck] += total
    for pixel in (wide, narrow):
        counts[pixel][1:] = live[pixel]
        counts[pixel][0] = max(int(hist.n_frames or 0) - int(live[pixel].sum()), 0)
    return replace(hist, counts=counts)
