"""What is named, and the path once all of it is freed: does it help, are its errors true?

    python benchmarks/freed.py                                   # the defects of the issue, 10 each
    python benchmarks/freed.py --cells clock_early:1,barrel:1 --runs 20 --first 61000

Three legs, 40,000 photons, source and emission time told as exact, one thing wrong
(`tests/oracles/worlds/defects.py`, by name and strength 0 to 2; besides these "skew": delays 20 ps
late at the last column, "askew": a lens decentred by half a pixel at the corner). Each recording is
reconstructed, and once more with all that the verdict names free. Printed: how many are not
trusted, in how many the cause is named first and at all, median size of the group, error of the
corners before (rms, mm) and after, pulls after: their rms with its 95 % interval (bootstrap over
recordings), the share above 3, and how many are trusted then.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import lightflight as lf
from lightflight.reconstruct import FREE_NAMES
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import World

CELLS = (
    "clock_early:1", "codes_shorter:1", "drift_over_four:1", "focal_length_longer:1", "barrel:1",
    "index_to_the_camera:2", "camera_turned:0", "skew:0", "askew:0",
)  # fmt: skip
ALSO_FREES = {
    "distortion": ("decentering",), "focal_length": ("aspect",), "pose": ("axis",),
    "curved_leg": ("bend",),
}  # fmt: skip
"""What a finding may mean beside what bears its name."""


def _askew(world: World) -> World:
    corner = np.array(world.view.shape) / 2
    by = 0.5 * world.view.focal_px[0] / (corner @ corner + 2 * corner[0] ** 2)
    return world.but(view=replace(world.view, askew=(by, 0.0)))


OWN: dict[str, tuple[str, Callable[[World], World]]] = {
    "skew": ("calibration", lambda world: world.but(skew_ps=(0.0, 20.0, 0.0))),
    "askew": ("distortion", _askew),
}


@dataclass(frozen=True)
class Run:
    """One recording, as told and with all freed that was named."""

    trusted: bool
    named: tuple[str, ...]
    before_mm: float
    after_mm: float
    pulls: np.ndarray
    cured: bool


def world_of(cell: str, seed: int) -> tuple[World, str]:
    """The world, and the name of what is wrong with it."""
    name, strength = cell.split(":")
    world = random_world(seed, 3)
    if name in OWN:
        return OWN[name][1](world), OWN[name][0]
    defect = DEFECTS[name]
    return defect.applied(world, defect.strengths[int(strength)]), defect.finding


def run_of(world: World, seed: int) -> Run | None:
    """None where a path was refused, or has another number of legs."""
    hist, told = record(world, seed), what_the_user_tells(world)
    try:
        path = lf.reconstruct(hist, **told)
        named = tuple(str(one.name) for one in path.verdict.findings)
        also = [name for one in named for name in ALSO_FREES.get(one, ())]
        free = [name for name in (*named, *also) if name in FREE_NAMES and name != "bend"]
        cured = lf.reconstruct(hist, free=free, **told)
    except (ValueError, RuntimeError):
        return None
    if cured.n_legs != world.n_legs:
        return None
    off = (cured.vertices_mm - world.vertices)[1:-1]
    before = np.inf
    if path.n_legs == world.n_legs:
        before = float(np.sqrt(np.mean((path.vertices_mm - world.vertices)[1:-1] ** 2)))
    return Run(
        path.verdict.level == "trust", named, before, float(np.sqrt(np.mean(off**2))),
        (off / cured.vertex_std[1:-1, :3]).ravel(), cured.verdict.level == "trust",
    )  # fmt: skip


def print_row(cell: str, cause: str, runs: list[Run], lost: int) -> None:
    if not runs:
        print(f"{cell:24s} all {lost} refused, or with another number of legs")
        return
    n, squares = len(runs), np.array([np.mean(run.pulls**2) for run in runs])
    drawn = squares[np.random.default_rng(1).integers(0, n, (2000, n))].mean(axis=1)
    low, high = np.sqrt(np.quantile(drawn, [0.025, 0.975]))
    over = float(np.mean(np.abs(np.concatenate([run.pulls for run in runs])) > 3.0))
    first = sum(run.named[:1] == (cause,) for run in runs)
    at_all = sum(cause in run.named for run in runs)
    print(
        f"{cell:24s} {n:3d} {lost:4d} {n - sum(run.trusted for run in runs):4d} {first:6d} "
        f"{at_all:6d} {np.median([len(run.named) for run in runs]):5.1f} "
        f"{np.median([run.before_mm for run in runs]):8.3f} "
        f"{np.median([run.after_mm for run in runs]):8.3f} "
        f"{np.sqrt(squares.mean()):5.2f} [{low:.2f}, {high:.2f}] {over:6.3f} "
        f"{sum(run.cured for run in runs):5d}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", default=",".join(CELLS), help="name:strength, by comma")
    parser.add_argument("--runs", type=int, default=10, help="recordings of each")
    parser.add_argument("--first", type=int, default=60_000, help="first seed")
    options = parser.parse_args()
    print(
        f"{'defect':24s} {'n':>3s} {'lost':>4s} {'seen':>4s} {'first':>6s} {'named':>6s} "
        f"{'group':>5s} {'mm, med.':>8s} {'freed':>8s} {'rms pull':>18s} {'> 3':>6s} {'trust':>5s}"
    )
    warnings.simplefilter("ignore")
    for cell in options.cells.split(","):
        runs, cause = [], ""
        for seed in range(options.first, options.first + options.runs):
            world, cause = world_of(cell, seed)
            runs.append(run_of(world, seed))
        kept = [run for run in runs if run is not None]
        print_row(cell, cause, kept, len(runs) - len(kept))


if __name__ == "__main__":
    main()
