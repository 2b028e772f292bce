"""Speeds as ratios to other code on the same data, so that machines can be compared.

The work, and the checks of its answers, are those of the scripts one folder up, made small enough
to be done for every commit.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

# asv takes this folder for a package of its own, away from the scripts.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # before Numba is imported

import speed_histogram
import speed_pulses
import speed_reconstruct


def track_pulse_fits(n_codes: int, n_pixels: int = 4096, n_loop: int = 100, rounds: int = 3):
    """CPU of `scipy.optimize.curve_fit` in a loop over that of `fit_pulses`: more is better."""
    return speed_pulses.speed(n_pixels, n_codes, n_loop, rounds)[1]


def track_counting(figure: str, n_frames: int = 20_000, rounds: int = 3):
    """Frames and events to histograms, as `speed_histogram` names its ratios: more is better."""
    with tempfile.TemporaryDirectory() as folder:
        return speed_histogram.measure(n_frames, rounds, Path(folder))[figure]


def track_start(rounds: int = 3):
    """CPU from start to 1,024 fits, kernels cached, over `import numba`: less is better."""
    return speed_pulses.start_ratio(rounds)


def track_reconstruct(n_frames: int = 20_000, rounds: int = 3):
    """CPU of `lightflight reconstruct` over the bare read of its raw frames: less is better."""
    with tempfile.TemporaryDirectory() as folder:
        return speed_reconstruct.measure(Path(folder), n_frames, rounds)[1]


track_pulse_fits.params = (64, 1024)
track_pulse_fits.param_names = ("codes",)
track_counting.params = tuple(speed_histogram.GOALS)
track_counting.param_names = ("figure",)
for one in (track_pulse_fits, track_counting, track_start, track_reconstruct):
    one.unit = "ratio"
    one.timeout = 600
