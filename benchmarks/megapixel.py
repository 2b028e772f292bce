"""A megapixel camera on the cluster: what a campaign costs in CPU time, memory and workers.

Recordings of growing cameras (one straight leg, the same light per pixel everywhere) are drawn
photon by photon as events, and `lightflight batch` keeps a window of their codes, sorts photons
into tiles, fits the pulses of each tile and the path to all of them. Printed are, for each size:
CPU time of all processes with one worker and with two, and the largest memory of any worker. A
worker takes some seconds to load what it needs, whatever it then does; `--recordings` makes the
campaigns longer than that. The paths are compared with the truth, and the two tables with each
other, byte for byte.
"""

from __future__ import annotations

import argparse
import csv
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import lightflight as lf
from lightflight.simulate.presets import ideal

MOST_MEMORY_GB = 1.0
MOST_RATIO = 1.15
N_CODES, WINDOW = 128, (32, 96)
PHOTONS, BACKGROUND = 300.0, 600.0
ANGLE_DEG = 5.0
TICK_S = 0.05


def scene_of(side: int) -> lf.Scene:
    """One leg through the view of a camera of side x side pixels."""
    angle = np.deg2rad(ANGLE_DEG)
    return lf.Scene(
        [[0, -60, 0], [245 * np.cos(angle), 70, 245 * np.sin(angle)]],
        camera=lf.Camera.facing_plane(
            shape=(side, side),
            distance_mm=535.0,
            field_of_view_mm=(245.0, 245.0),
            center_mm=(122.5, 0.0),
        ),
        source=lf.Source((0, -60, 0), pulse_fwhm_ps=68.0),
        detector=replace(ideal(), n_codes=N_CODES, bin_width_ps=55.0),
        background=BACKGROUND,
    )


def events_of(hist: lf.Histograms, rng: np.random.Generator) -> lf.Recording:
    """The photons of histograms in any order, as a camera sends them."""
    n_pixels = hist.shape[0] * hist.shape[1]
    cells = np.flatnonzero(hist.counts.reshape(-1))
    cell = np.repeat(cells, hist.counts.reshape(-1)[cells])
    rng.shuffle(cell)
    return lf.Recording(
        hist.shape,
        n_codes=N_CODES,
        pixel=(cell // N_CODES).astype(np.uint16 if n_pixels <= 1 << 16 else np.uint32),
        code=(cell % N_CODES).astype(np.uint16),
        bin_width_ps=hist.bin_width_ps,
        laser_period_ps=hist.laser_period_ps,
    )


def write_campaign_folder(folder: Path, side: int, n_recordings: int = 1) -> int:
    """One recording under several names, and campaign.toml; gives the number of photons."""
    folder.mkdir()
    hist = lf.simulate(scene_of(side), photons_per_pixel=PHOTONS, seed=1, kind="histograms")
    recording = events_of(hist, np.random.default_rng(1))
    lf.write(recording, folder / "recording-1.h5")
    for k in range(1, n_recordings):
        os.link(folder / "recording-1.h5", folder / f"recording-{k + 1}.h5")
    (folder / "campaign.toml").write_text(
        f"""
        [campaign]
        codes = {list(WINDOW)}
        [camera]
        shape = [{side}, {side}]
        distance_mm = 535.0
        field_of_view_mm = [245.0, 245.0]
        center_mm = [122.5, 0.0]
        [source]
        position_mm = [0.0, -60.0, 0.0]
        pulse_fwhm_ps = 68.0
        [reconstruct]
        n_legs = 1
        [[groups]]
        recordings = "recording-*.h5"
        set_point_deg = {ANGLE_DEG}
        """
    )
    assert recording.code is not None
    return n_recordings * recording.code.shape[0]


@dataclass
class Used:
    """What a command and all processes below it took."""

    wall_s: float = 0.0
    cpu_s: float = 0.0
    worker_gb: float = 0.0
    main_gb: float = 0.0


def run_batch(folder: Path, n_workers: int) -> Used:
    """`lightflight batch`, watched from outside while it runs."""
    words = ("batch", "campaign.toml", "--workers", str(n_workers), "-o", f"out{n_workers}")
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "lightflight", *words],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    cpu: dict[int, float] = {}
    peak: dict[int, float] = {}
    over = threading.Event()

    def watch() -> None:
        while not over.wait(TICK_S):
            for one in family_of(process.pid):
                look_at(one, cpu, peak)

    watcher = threading.Thread(target=watch)
    watcher.start()
    _, said = process.communicate()
    over.set()
    watcher.join()
    assert process.returncode == 0, said
    main = peak.pop(process.pid, 0.0)
    wall = time.perf_counter() - start
    return Used(wall, sum(cpu.values()), max(peak.values(), default=0.0), main)


def family_of(root: int) -> set[int]:
    """A process and all below it."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(stat.parent.name)] = int(fields[1])
    family = {root}
    while True:
        more = {pid for pid, parent in parents.items() if parent in family} - family
        if not more:
            return family
        family |= more


def look_at(pid: int, cpu: dict[int, float], peak: dict[int, float]) -> None:
    """CPU seconds and largest resident memory (GB) of a process so far."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return
    cpu[pid] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    for line in status.splitlines():
        if line.startswith("VmHWM:"):
            peak[pid] = int(line.split()[1]) / 1e6


def check_path(folder: Path) -> None:
    """The angle is right, and the table the same for one worker and for two."""
    tables = [(folder / f"out{n}" / "table.csv").read_bytes() for n in (1, 2)]
    assert tables[0] == tables[1], "the tables of one and of two workers differ"
    row = next(csv.DictReader(tables[0].decode().splitlines()))
    truth = np.rad2deg(np.arcsin(245 * np.sin(np.deg2rad(ANGLE_DEG)) / np.hypot(245, 130)))
    error = float(row["leg1_angle_deg"]) - truth
    std = float(row["leg1_angle_std_deg"])
    print(f"    elevation {error:+.4f} deg from the truth, stated error {std:.4f} deg")
    assert abs(error) < 5 * std


def best_of(folder: Path, rounds: int) -> dict[int, Used]:
    """Least CPU time and most memory with one worker and with two, in turns."""
    runs: dict[int, list[Used]] = {1: [], 2: []}
    for _ in range(rounds):
        for n, found in runs.items():
            shutil.rmtree(folder / f"out{n}", ignore_errors=True)
            found.append(run_batch(folder, n))
    return {
        n: replace(
            min(found, key=lambda used: used.cpu_s),
            worker_gb=max(used.worker_gb for used in found),
        )
        for n, found in runs.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="up to 1,024 x 1,024 pixels")
    parser.add_argument(
        "--recordings", type=int, default=1, help="recordings in each campaign: more work per start"
    )
    parser.add_argument("--rounds", type=int, default=2, help="the least of so many counts")
    options = parser.parse_args()
    sides = (256, 512, 1024) if options.full else (128, 256)
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as name:
        write_campaign_folder(Path(name, "warm"), 32)
        run_batch(Path(name, "warm"), 1)  # kernels are compiled by now
        start = best_of(Path(name, "warm"), options.rounds)
        rows = []
        for side in sides:
            folder = Path(name, str(side))
            n_photons = write_campaign_folder(folder, side, options.recordings)
            rows.append((side, n_photons, best_of(folder, options.rounds)))
            check_path(folder)
    said = " and ".join(f"{start[n].cpu_s:.1f} s with {n}" for n in (1, 2))
    print(f"to start workers and reconstruct 32 x 32 pixels takes {said}; per Mpx: beyond that")
    print("| pixels | photons | CPU, 1 worker | per Mpx | CPU, 2 workers | ratio | memory |")
    print("|---:|---:|---:|---:|---:|---:|---:|")
    for side, n_photons, used in rows:
        n_mpx = options.recordings * side * side / 1e6
        per_mpx = (used[1].cpu_s - start[1].cpu_s) / n_mpx
        print(
            f"| {side} x {side} | {n_photons:,} | {used[1].cpu_s:.1f} s | {per_mpx:.1f} s | "
            f"{used[2].cpu_s:.1f} s | {used[2].cpu_s / used[1].cpu_s:.2f} | "
            f"{max(used[n].worker_gb for n in used):.2f} GB |"
        )
    goal = "" if options.full else " (meant for --full)"
    print(f"goals{goal}: ratio <= {MOST_RATIO}, memory of a worker <= {MOST_MEMORY_GB} GB")


if __name__ == "__main__":
    main()
