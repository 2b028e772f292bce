"""The benchmarks that asv follows over commits are found by it, and run."""

import os
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]


def test_asv_finds_the_benchmarks_and_nothing_wrong_with_them():
    words = ("check", "--environment", f"existing:{sys.executable}")
    done = subprocess.run(
        [sys.executable, "-m", "asv", *words],
        cwd=REPOSITORY, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "No problems found" in done.stdout


def test_a_benchmark_gives_its_ratio():
    """Small, in a process of its own: it sets how many threads Numba has, and a path."""
    code = "import ratios; print(ratios.track_pulse_fits(64, n_pixels=512, n_loop=20, rounds=1))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=REPOSITORY, capture_output=True, text=True, check=True,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY / "benchmarks" / "asv")},
    )  # fmt: skip
    assert float(done.stdout) > 10.0  # hundreds, on a quiet machine
