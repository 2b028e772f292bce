"""Beam splitters in view: whether the verdict names the arm that a path leaves, and where.

    python benchmarks/splitters.py   # 50 scenes each, half and a tenth turned off
    python benchmarks/splitters.py --shares 0.9 --runs 20
    python benchmarks/splitters.py --others 100          # worlds where nothing splits

Scenes are those of `tests/oracles/splitter.py`, each drawn by its own seed, source and emission
time known, ideal codes of 55 ps. Printed: scenes whose path is called contradicted; those whose
verdict names an arm within 5 mm of the splitter; the median of how far off that is; CPU seconds of
the middle one. `--others`: of so many recordings with a defect of `tests/oracles/worlds` at full
strength (none of the held-out ones), one and three legs in turn, how many contradict their path,
and in how many an arm is named, which is always wrong.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
import warnings
from pathlib import Path

import numpy as np

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from lightflight.errors import LightflightWarning
from lightflight.path.verdict import Level
from tests.oracles.refracted_border import camera_told
from tests.oracles.splitter import Splitter, splitter_world
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import defects
from tests.oracles.worlds.random_worlds import random_world

WITHIN_MM = 5.0


def path_of(world: Splitter, seed: int) -> lf.LightPath:
    """What `reconstruct` makes of a recording of it."""
    hist = lf.Histograms(
        world.recording(seed),
        bin_width_ps=world.base.clock.width,
        laser_period_ps=world.base.clock.period,
    )
    source = lf.Source(tuple(world.source_mm), emission_time_ps=world.base.emission_time_ps)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        return lf.reconstruct(
            hist, camera=camera_told(world.base), source=source,
            timing=lf.TimingCalibration.nominal(hist),
        )  # fmt: skip


def arm_named(path: lf.LightPath) -> np.ndarray | None:
    """(x, y, z) mm and ps at which the verdict says that an arm leaves; None: it names none."""
    for finding in path.verdict.findings:
        said = re.search(
            r"an arm that leaves the path at \((.*?)\) mm at (\S+) ps", finding.sentence
        )
        if said:
            return np.array([float(x) for x in (*said[1].split(","), said[2])])
    return None


def print_others(first: int, runs: int) -> None:
    """Worlds without a splitter: how many contradict their path, and name an arm."""
    kinds, contradicted, named = defects(held_out=False), 0, []
    for number in range(runs):
        defect, seed = kinds[number % len(kinds)], first + number
        world = defect.applied(random_world(seed, 1 + 2 * (number % 2)), defect.strengths[2])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LightflightWarning)
            try:
                path = lf.reconstruct(record(world, seed), **what_the_user_tells(world))
            except (ValueError, RuntimeError):
                continue
        contradicted += path.verdict.level is Level.CONTRADICTED
        named += [defect.name] if arm_named(path) is not None else []
    print(f"{runs} others: {contradicted} contradicted, {len(named)} with an arm {named or ''}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--first", type=int, default=53_000, help="first seed")
    parser.add_argument("--photons", type=float, default=4_000.0)
    parser.add_argument("--shares", type=float, nargs="+", default=[0.5, 0.1])
    parser.add_argument("--others", type=int, help="recordings where nothing splits, and no more")
    options = parser.parse_args()
    if options.others:
        print_others(options.first, options.others)
        return
    print("| share turned off | contradicted | arm named within 5 mm | median off, mm | CPU, s |")
    print("|---:|---:|---:|---:|---:|", flush=True)
    for share in options.shares:
        contradicted, off, spent = 0, [], []
        for seed in range(options.first, options.first + options.runs):
            world = splitter_world(seed, share=share, photons=options.photons)
            start = time.process_time()
            path = path_of(world, seed)
            spent.append(time.process_time() - start)
            contradicted += path.verdict.level is Level.CONTRADICTED
            place = arm_named(path)
            if place is not None:
                off.append(float(np.linalg.norm(place[:3] - world.splitter_mm)))
        near = sum(one < WITHIN_MM for one in off)
        middle = f"{np.median(off):.2f}" if off else "-"
        print(
            f"| {share:g} | {contradicted}/{options.runs} | {near}/{options.runs} | {middle} | "
            f"{np.median(spent):.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
