"""How fast the twin records: the paper's 200 s as histograms, and as a million raw frames.

    python benchmarks/speed_twin.py                  # both
    python benchmarks/speed_twin.py --frames 100000  # a tenth of the frames

Wall times are of this machine as it is; CPU times are less moved by what else it does. Before
anything is timed, the same seed is recorded on one and on two threads and as frames and histograms,
and must agree.
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
import time
from pathlib import Path
from typing import Any

import numba
import numpy as np

import lightflight as lf
from lightflight.simulate import paper_scene

HISTOGRAM_GOAL_S, FRAMES_GOAL_S = 2.0, 60.0
PAPER_FRAMES = 1_000_000  # 200 s at 5,000 frames a second


def timed(work: Any) -> tuple[Any, float, float]:
    """What the work gives, its wall time and its CPU time, s."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, time.perf_counter() - wall, time.process_time() - cpu


def check(scene: lf.Scene) -> None:
    """Same seed, same recording: on any number of threads."""
    one, two = (
        lf.simulate(scene, photons_per_pixel=2000.0, seed=5, threads=threads) for threads in (1, 2)
    )
    np.testing.assert_array_equal(one.counts, two.counts)
    frames = [
        lf.simulate(scene, photons_per_pixel=200.0, seed=5, kind="frames", threads=threads).frames
        for threads in (1, 2)
    ]
    np.testing.assert_array_equal(*frames)


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=PAPER_FRAMES)
    parser.add_argument("--rounds", type=int, default=3, help="of the histograms; the best counts")
    parser.add_argument("--folder", type=Path, help="where the frames are written (2 GB)")
    args = parser.parse_args()
    scene = paper_scene()
    print(
        f"lightflight {lf.__version__}, numpy {np.__version__}, numba {numba.__version__}, "
        f"Python {platform.python_version()}, {os.cpu_count()} cores"
    )
    check(scene)
    rounds = [
        timed(lambda: lf.simulate(scene, photons_per_pixel=40_000.0, seed=1))
        for _ in range(args.rounds)
    ]
    hist, wall, cpu = min(rounds, key=lambda one: one[1])
    photons = int(hist.photons.sum())
    print(
        f"200 s as histograms ({photons:,} photons): {wall:.2f} s wall, {cpu:.2f} s CPU "
        f"(goal {HISTOGRAM_GOAL_S:g} s)"
    )
    share = args.frames / PAPER_FRAMES
    with tempfile.TemporaryDirectory(dir=args.folder) as folder:
        out = np.lib.format.open_memmap(
            Path(folder) / "frames.npy", "w+", np.uint16, (args.frames, 32, 32)
        )
        recording, wall, cpu = timed(
            lambda: lf.simulate(
                scene,
                photons_per_pixel=40_000.0 * share,
                seed=1,
                kind="frames",
                n_frames=args.frames,
                frames_out=out,
            )
        )
        fired = int(np.count_nonzero(recording.frames[:: max(1, args.frames // 1000)]))
    print(
        f"{args.frames:,} raw frames: {wall:.1f} s wall, {cpu:.1f} s CPU "
        f"(goal {FRAMES_GOAL_S * share:g} s); {fired:,} codes in a thousand of them"
    )


if __name__ == "__main__":
    main()
