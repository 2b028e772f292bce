"""Beam splitters in view: whether both arms are found, and how near to the bound of the tree.

    python benchmarks/splitters.py   # 50 scenes each, half and a tenth turned off
    python benchmarks/splitters.py --shares 0.9 --runs 20
    python benchmarks/splitters.py --methods photon --runs 12
    python benchmarks/splitters.py --others 100          # worlds where nothing splits
    python benchmarks/splitters.py --rows rows.jsonl     # keep rows, and go on from there

Scenes are those of `tests/oracles/splitter.py`, each drawn by its own seed, source and emission
time known, ideal codes of 55 ps. Printed: scenes with both arms found (three legs, one fork within
5 mm of the splitter, both arms within 5 degrees) with the 95 % interval of Clopper and Pearson; of
these the error over the bound, sqrt(e' C^-1 e / 7) of splitter (3 numbers) and the direction of
both arms (2 each) with C of `lf.bounds` for the tree; the same over the stated covariance (pull),
both rms over scenes with the 95 % interval of a bootstrap; verdicts; CPU seconds of the middle one.
`--others`: of so many recordings with a defect of `tests/oracles/worlds` at full strength (none of
the held-out ones), one and three legs in turn, how many contradict their path, and how many are
told with an arm, which is always wrong.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.stats import beta

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.refraction import interval
from lightflight.errors import LightflightWarning
from lightflight.path.verdict import Level
from tests.oracles.refracted import caught, light_scale, signal_counts, stations
from tests.oracles.refracted_border import camera_told
from tests.oracles.splitter import Splitter, splitter_world
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import defects
from tests.oracles.worlds.random_worlds import random_world

Row = dict[str, Any]
KEYS = ("share", "photons", "method", "seed")
WITHIN_MM, WITHIN_DEG = 5.0, 5.0
"""Many errors; what is farther off is another splitter."""
FORKS = ((2, 1),)


def path_of(world: Splitter, seed: int, method: str = "joint", **told: Any) -> lf.LightPath:
    """What `reconstruct` makes of a recording of it."""
    hist = lf.Histograms(
        world.recording(seed),
        bin_width_ps=world.base.clock.width,
        laser_period_ps=world.base.clock.period,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        return lf.reconstruct(
            hist, camera=camera_told(world.base), source=source_of(world),
            timing=lf.TimingCalibration.nominal(hist), method=method, **told,
        )  # fmt: skip


def source_of(world: Splitter) -> lf.Source:
    """Where and when the light starts, both known."""
    return lf.Source(tuple(world.source_mm), emission_time_ps=world.base.emission_time_ps)


def arms_of(path: lf.LightPath, world: Splitter) -> tuple[int, int, int] | None:
    """Vertices of the splitter and of the ends of the true arms; None: they are not all there."""
    if path.n_legs != 3 or len(path.forks) != 1:
        return None
    splitter, ends = path.forks[0][1], path.ends[1:]
    if np.linalg.norm(path.vertices_mm[splitter] - world.splitter_mm) > WITHIN_MM:
        return None
    cosines = np.array(
        [
            [direction(path.vertices_mm, splitter, end) @ direction(world.vertices_mm, 1, true)
             for end in ends]
            for true in (2, 3)
        ]
    )  # fmt: skip
    straight, turned = np.argmax(cosines, axis=1)
    if straight == turned or cosines.max(axis=1).min() < np.cos(np.deg2rad(WITHIN_DEG)):
        return None
    return splitter, ends[straight], ends[turned]


def direction(vertices_mm: np.ndarray, start: int, end: int) -> np.ndarray:
    """(3,), unit."""
    step = vertices_mm[end] - vertices_mm[start]
    return np.asarray(step / np.linalg.norm(step))


def numbers_of(
    vertices_mm: np.ndarray, covariance: np.ndarray, places: tuple[int, int, int], true: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (7,) of splitter and both arms' directions about the truth, and their covariance."""
    size = len(covariance)
    splitter, *ends = places
    gain, off = [], []

    def row(vertex: int, across: np.ndarray) -> np.ndarray:
        out = np.zeros(size)
        out[4 * vertex : 4 * vertex + 3] = across
        return out

    for axis in np.eye(3):
        gain.append(row(splitter, axis))
        off.append(axis @ (vertices_mm[splitter] - true[1]))
    for end, right in zip(ends, (2, 3), strict=True):
        length = float(np.linalg.norm(vertices_mm[end] - vertices_mm[splitter]))
        # Across the true arm: the same two directions for what is found and for the bound.
        for across in np.linalg.svd(direction(true, 1, right)[np.newaxis])[2][1:]:
            gain.append((row(end, across) - row(splitter, across)) / length)
            off.append(across @ direction(vertices_mm, splitter, end))
    by = np.array(gain)
    return np.array(off), by @ covariance @ by.T


@cache
def bound_of(share: float, photons: float, seed: int) -> lf.Bounds:
    """The least errors that the scene's photons allow."""
    world = splitter_world(seed, share=share, photons=photons)
    by_leg = (1.0, 1.0 - share, share)
    pairs = [caught(arm, stations(arm)) for arm in world.arms]
    scale = light_scale(world.arms[0], pairs[0])
    brightest = max(
        float(signal_counts(arm, own, part * scale).sum(axis=-1).max())
        for arm, own, part in zip(world.arms, pairs, by_leg, strict=True)
    )
    base = world.base
    subject = SimpleNamespace(
        vertices_mm=world.vertices_mm,
        forks=FORKS,
        strength=lambda length_mm, leg: np.full_like(length_mm, by_leg[leg]),
    )
    return lf.bounds(
        subject, photons_per_pixel=brightest, source=source_of(world), camera=camera_told(base),
        spot_std_px=float(np.hypot(base.spot_std_px, base.active_side_px / np.sqrt(12.0))),
        pulse_std_ps=base.pulse_std_ps, code_width_ps=base.clock.width,
        background_per_code=base.background_per_ps * base.clock.width,
    )  # fmt: skip


def result_of(share: float, photons: float, method: str, seed: int) -> Row:
    """One scene."""
    world = splitter_world(seed, share=share, photons=photons)
    row: Row = dict(zip(KEYS, (share, photons, method, seed), strict=True))
    start = time.process_time()
    try:
        path = path_of(world, seed, method)
    except (ValueError, RuntimeError) as refused:
        return row | {"says": f"{type(refused).__name__}: {refused}"}
    row |= {"cpu_s": time.process_time() - start, "level": str(path.verdict.level)}
    row |= {"named": [str(one.name) for one in path.verdict.findings], "forks": path.forks}
    places = arms_of(path, world)
    if places is None:
        return row
    true = world.vertices_mm
    off, stated = numbers_of(path.vertices_mm, path.covariance, places, true)
    bound = bound_of(share, photons, seed).path
    _, least = numbers_of(bound.vertices_mm, bound.covariance, (1, 2, 3), true)
    return row | {
        "error2": float(off @ np.linalg.solve(least, off)) / len(off),
        "pull2": float(off @ np.linalg.solve(stated, off)) / len(off),
        "off_mm": float(np.linalg.norm(off[:3])),
    }


def share_with_interval(hits: int, runs: int) -> str:
    """Hits of runs, and the 95 % interval of their number by Clopper and Pearson."""
    low = beta.ppf(0.025, hits, runs - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, runs - hits) if hits < runs else 1.0
    return f"{hits}/{runs} [{low * runs:.0f}, {high * runs:.0f}]"


def line_of(own: list[Row]) -> str:
    """A row of the table."""
    right = [row for row in own if "error2" in row]
    cells = [f"{own[0]['share']:g}", f"{own[0]['photons']:g}", own[0]["method"]]
    cells.append(share_with_interval(len(right), len(own)))
    cells += [
        interval(np.array([row[key] for row in right]), 1.0) if right else ""
        for key in ("error2", "pull2")
    ]
    levels = [sum(row.get("level") == level for row in own)
              for level in ("trust", "check", "contradicted")]  # fmt: skip
    cpu = np.median([row.get("cpu_s", np.nan) for row in own])
    return "| " + " | ".join([*cells, "/".join(map(str, levels)), f"{cpu:.1f}"]) + " |"


def print_others(first: int, runs: int, method: str) -> None:
    """Worlds without a splitter: how many contradict their path, and are told with an arm."""
    kinds, contradicted, forked, told = defects(held_out=False), 0, [], 0
    for number in range(runs):
        defect, seed = kinds[number % len(kinds)], first + number
        world = defect.applied(random_world(seed, 1 + 2 * (number % 2)), defect.strengths[2])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LightflightWarning)
            try:
                path = lf.reconstruct(
                    record(world, seed), method=method, **what_the_user_tells(world)
                )
            except (ValueError, RuntimeError):
                continue
        told += 1
        contradicted += path.verdict.level is Level.CONTRADICTED
        forked += [f"{defect.name} ({path.verdict.level})"] if path.forks else []
    print(
        f"{runs} others, {told} with a path: {contradicted} contradicted, "
        f"{share_with_interval(len(forked), told)} with an arm {forked or ''}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--first", type=int, default=53_000, help="first seed")
    parser.add_argument("--photons", type=float, nargs="+", default=[4_000.0])
    parser.add_argument("--shares", type=float, nargs="+", default=[0.5, 0.1])
    parser.add_argument("--methods", nargs="+", default=["joint"])
    parser.add_argument("--others", type=int, help="recordings where nothing splits, and no more")
    parser.add_argument("--rows", type=Path, help="JSON lines to keep, and to go on from")
    options = parser.parse_args()
    if options.others:
        print_others(options.first, options.others, options.methods[0])
        return
    kept: dict[tuple[Any, ...], Row] = {}
    if options.rows and options.rows.exists():
        done = [json.loads(line) for line in options.rows.read_text().splitlines()]
        kept = {tuple(row[name] for name in KEYS): row for row in done}
    print("| turned off | photons | method | both arms | error / bound | pull | t/c/c | CPU, s |")
    print("|---:|---:|---|---:|---:|---:|---:|---:|", flush=True)
    for share in options.shares:
        for photons in options.photons:
            for method in options.methods:
                own = []
                for seed in range(options.first, options.first + options.runs):
                    key = (share, photons, method, seed)
                    if key not in kept:
                        kept[key] = result_of(*key)
                        if options.rows:
                            with options.rows.open("a") as file:
                                file.write(json.dumps(kept[key]) + "\n")
                    own.append(kept[key])
                print(line_of(own), flush=True)


if __name__ == "__main__":
    main()
