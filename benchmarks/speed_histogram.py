"""How fast frames and events become histograms, as ratios to reading the same bytes from memory.

Everything runs in one process on one core, interleaved in rounds; ratios are medians of per-round
ratios, since absolute rates move with whatever else the machine does. The answers are compared
with NumPy before anything is timed.
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numba
import numpy as np

import lightflight as lf
from lightflight.formats.photons import photon_blocks

GOALS = {
    "frames -> histogram, of memory read": 0.15,
    "frames -> histogram, times np.bincount": 40.0,
    "frames -> events, of memory read": 0.3,
    "events -> histogram, of memory read": 0.08,
    "file -> histogram, of frames in memory": 0.6,
}
N_CODES = 1024
SHAPE = (32, 32)
BINCOUNT_SHARE = 20


def paper_frames(n_frames: int, rng: np.random.Generator) -> np.ndarray:
    """(n, 32, 32) codes like the paper's: 4 % of pixels fire, 80 % of photons in the pulse."""
    frames = np.zeros((n_frames, *SHAPE), np.uint16)
    centre = 500 + np.arange(SHAPE[0] * SHAPE[1]).reshape(SHAPE) / 20
    for part in np.array_split(frames, max(1, n_frames // 5000)):
        fired = np.nonzero(rng.random(part.shape) < 0.04)
        pulse = rng.normal(centre[fired[1:]], 3.0)
        flat = rng.integers(8, 915, len(fired[0]))
        part[fired] = np.where(rng.random(len(flat)) < 0.8, np.rint(pulse), flat)
    return frames


@numba.njit(nogil=True)
def sum_of_words(words):
    """Read every byte once."""
    total = np.uint64(0)
    for i in range(words.size):
        total += words[i]
    return total


def bincount_cube(frames: np.ndarray) -> np.ndarray:
    """The histogram by np.bincount over all codes, (rows, cols, codes)."""
    n_pixels = SHAPE[0] * SHAPE[1]
    flat = frames.reshape(-1, n_pixels) + np.arange(n_pixels) * N_CODES
    return np.bincount(flat.ravel(), minlength=n_pixels * N_CODES).reshape(*SHAPE, N_CODES)


def events_of(recording: lf.Recording, n_photons: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixel and code of every photon, as the writers list them."""
    pixel, code = np.empty(n_photons, np.uint16), np.empty(n_photons, np.uint16)
    n = 0
    for block in photon_blocks(recording):
        end = n + block.code.size
        pixel[n:end], code[n:end] = block.pixel, block.code
        n = end
    return pixel, code


def cpu_seconds(work: Callable[[], Any]) -> float:
    """CPU time of one call, all threads together: the better of two, so that caches are warm."""
    taken = []
    for _ in range(2):
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return min(taken)


def measure(n_frames: int, rounds: int, folder: Path) -> dict[str, float]:
    """Median ratios; raises AssertionError where an answer is wrong."""
    rng = np.random.default_rng(20200520)
    frames = paper_frames(n_frames, rng)
    recording = lf.Recording.from_frames(frames, n_codes=N_CODES, no_photon_code=0)
    raw = folder / "frames.bin"
    frames.tofile(raw)
    from_file = lf.read(raw, footer_bytes=0)
    n_photons = int(np.count_nonzero(frames))
    pixel, code = events_of(recording, n_photons)
    events = lf.Recording(SHAPE, n_codes=N_CODES, pixel=pixel, code=code)
    few = frames[: max(1, n_frames // BINCOUNT_SHARE)]
    words, event_words = frames.reshape(-1).view(np.uint64), np.ones(n_photons // 2, np.uint64)

    expected = sum(bincount_cube(part) for part in np.array_split(frames, BINCOUNT_SHARE))
    for one in (recording, from_file):
        assert np.array_equal(lf.histogram(one).counts, expected)
    assert np.array_equal(lf.histogram(events).counts[..., 1:], expected[..., 1:])
    assert np.array_equal(code, frames[frames != 0])

    works: dict[str, Callable[[], Any]] = {
        "read": lambda: sum_of_words(words),
        "read events": lambda: sum_of_words(event_words),
        "frames": lambda: lf.histogram(recording),
        "file": lambda: lf.histogram(from_file),
        "list": lambda: events_of(recording, n_photons),
        "events": lambda: lf.histogram(events),
        "bincount": lambda: bincount_cube(few),
    }
    sum_of_words(event_words)
    taken = [{name: cpu_seconds(work) for name, work in works.items()} for _ in range(rounds)]
    scale = n_frames / len(few)
    gigabytes = frames.nbytes / 1e9
    print(f"{n_frames} frames, {gigabytes:.3g} GB, {n_photons} photons")
    for name in works:
        size = {"read events": 4e-9 * n_photons, "events": 4e-9 * n_photons}.get(name, gigabytes)
        size /= scale if name == "bincount" else 1.0
        rate = size / median(one[name] for one in taken)
        print(f"  {name:12s} {rate:8.3g} GB/s of input")

    def ratio(top: str, bottom: str, factor: float = 1.0) -> float:
        return median(factor * one[top] / one[bottom] for one in taken)

    # Events are held against the rate at which the frames are read: both are from memory.
    events_share = 4e-9 * n_photons / gigabytes
    return dict(
        zip(
            GOALS,
            (
                ratio("read", "frames"),
                ratio("bincount", "frames", scale),
                ratio("read", "list"),
                ratio("read", "events", events_share),
                ratio("frames", "file"),
            ),
            strict=True,
        )
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=250_000, help="frames of 2 KiB")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, Numba {numba.__version__}")
    print(f"{os.cpu_count()} cores, {platform.machine()}, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        found = measure(options.frames, options.rounds, Path(folder))
    print("| figure | measured | goal |\n|---|---|---|")
    for name, goal in GOALS.items():
        print(f"| {name} | {found[name]:.3g} | {goal:g} |")


if __name__ == "__main__":
    main()
