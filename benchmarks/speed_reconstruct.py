"""How long `lightflight reconstruct raw.bin` takes, against the bare read of the same file.

The whole command is timed, start of the process included, on raw frames of the paper's experiment
that lie in the page cache; the bare read takes the same file in 8 MiB pieces and does nothing with
them. Both alternate in rounds, and the ratio is the median of the rounds; on a busy machine that of
the CPU times tells more than that of the clock. What the command finds
is compared with the truth of the simulation before anything is timed.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

import lightflight as lf
from lightflight.simulate import paper_scene, pf32

GOAL = 20.0
FULL_FRAMES = 1_000_000
PHOTONS_PER_FRAME = 0.04
READ_BYTES = 8 << 20
LAB = """
[camera]
distance_mm = 535.0
field_of_view_mm = [245.0, 245.0]
center_mm = [187.5, 37.5]

[source]
position_mm = [0.0, 0.0, 0.0]
pulse_fwhm_ps = 68.0

[recording]
footer_bytes = 0
laser_period_ps = 50000.0
periods_per_frame = 4000
"""


def write_recording(folder: Path, n_frames: int) -> None:
    """raw.bin, lab.toml and calibration.h5 of the paper's three legs."""
    scene = paper_scene(pf32())
    photons = PHOTONS_PER_FRAME * n_frames
    recording = lf.simulate(
        scene, photons_per_pixel=photons, seed=1, kind="frames", n_frames=n_frames
    )
    lf.write(recording, folder / "raw.bin")
    bright = lf.simulate(scene, photons_per_pixel=4e6, seed=1, kind="code_density")
    flat = lf.simulate(scene, photons_per_pixel=4e5, seed=1, kind="flat")
    lf.calibrate_timing(bright, flat=flat).save(folder / "calibration.h5")
    (folder / "lab.toml").write_text(LAB)


def read_seconds(file: Path) -> tuple[float, float]:
    """(wall, CPU) time of reading every byte of a file, and doing nothing with it."""
    buffer = bytearray(READ_BYTES)
    start, busy = time.perf_counter(), time.process_time()
    with file.open("rb", buffering=0) as stream:
        while stream.readinto(buffer):
            pass
    return time.perf_counter() - start, time.process_time() - busy


def command_seconds(folder: Path) -> tuple[float, float, dict]:
    """(wall, CPU) time of the whole command, and what it printed."""
    words = ("reconstruct", "raw.bin", "--lab", "lab.toml", "--timing", "calibration.h5", "--json")
    start, busy = time.perf_counter(), children_seconds()
    done = subprocess.run(
        [sys.executable, "-m", "lightflight", *words, "-o", "path.h5"],
        cwd=folder, capture_output=True, text=True, check=True,
    )  # fmt: skip
    wall, cpu = time.perf_counter() - start, children_seconds() - busy
    return wall, cpu, json.loads(done.stdout)


def children_seconds() -> float:
    """CPU time of all processes started here that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure(folder: Path, n_frames: int, rounds: int) -> tuple[float, float]:
    """Median ratios of wall and of CPU time; raises AssertionError where the path is wrong."""
    write_recording(folder, n_frames)
    *_, found = command_seconds(folder)  # kernels are compiled by now, and the file is cached
    corners = slice(1, 3)  # the last vertex is where the view ends
    truth = np.asarray(paper_scene(pf32()).vertices_mm)[corners]
    error = np.linalg.norm(np.asarray(found["vertices_mm"])[corners] - truth, axis=1)
    std = np.linalg.norm(np.asarray(found["vertex_std_mm"])[corners], axis=1)
    print(f"corners are {error[0]:.2f} and {error[1]:.2f} mm off")
    assert (error < 5 * std).all()
    size = (folder / "raw.bin").stat().st_size / 1e9
    read_seconds(folder / "raw.bin")
    walls, cpus = [], []
    for _ in range(rounds):
        bare, bare_cpu = read_seconds(folder / "raw.bin")
        whole, whole_cpu, _ = command_seconds(folder)
        walls.append(whole / bare)
        cpus.append(whole_cpu / bare_cpu)
        print(
            f"  {size:.3g} GB: bare read {bare:.3f} s ({bare_cpu:.3f} s of CPU), "
            f"command {whole:.2f} s ({whole_cpu:.2f} s of CPU)"
        )
    return median(walls), median(cpus)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=50_000, help="frames of 2 KiB")
    parser.add_argument("--full", action="store_true", help=f"{FULL_FRAMES} frames, 2 GB")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    n_frames = FULL_FRAMES if options.full else options.frames
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as folder:
        wall, cpu = measure(Path(folder), n_frames, options.rounds)
    goal = f"goal {GOAL:g}" if options.full else "its goal is for --full"
    print(f"command / bare read: {wall:.1f} by the clock, {cpu:.1f} by CPU time ({goal})")


if __name__ == "__main__":
    main()
