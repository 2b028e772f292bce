"""Paths seen through a window or into a tank, against the bound of a forward model of its own.

    python benchmarks/refraction.py                         # 12 recordings a cell, joint and photon
    python benchmarks/refraction.py --runs 100 --methods joint
    python benchmarks/refraction.py --only tank_3 --told index
    python benchmarks/refraction.py --rows rows.jsonl       # keep rows, and go on from there
    python benchmarks/refraction.py --block 10              # glass in the beam that nobody told
    python benchmarks/refraction.py --told-block 100        # and that was told
    python benchmarks/refraction.py --told-block 10 --thickness 19  # too thin by a millimetre

Recordings are those of `tests/oracles/refracted.py`: rays shot by Snell's law, 40,000 photons in
the brightest pixel, ideal codes of 55 ps. `told` says what is uncertain, drawn anew for each
recording from what is stated: nothing ("known"), the emission time, the index of the scene by 0.5 %
(phase and group alike, out and back), or the window's distance by 1 mm. Printed: recordings with
the right number of legs (untold), rms error of the position in view over the bound with its
95 % interval (bootstrap), rms pull of the position in view, verdicts, and the CPU seconds of the
middle one.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.oracles.refracted import (
    RefractedScene,
    block_world,
    in_picture,
    paper_scene,
    positions_at,
    tank_world,
    window_world,
)
from tests.oracles.refracted_border import block_told, histograms, what_the_user_tells
from tests.oracles.refracted_bound import (
    Freedom,
    block_freedoms,
    bound,
    distance_freedom,
    emission_freedom,
    medium_freedom,
)

Row = dict[str, Any]

WORLDS: dict[str, Callable[[], RefractedScene]] = {
    "air_3": paper_scene,
    "window_3": window_world,
    "window_3_tilted": lambda: window_world(5.0),
    "tank_1": lambda: tank_world(1),
    "tank_3": lambda: tank_world(3),
    "tank_1_tilted": lambda: tank_world(1, 5.0),
    "tank_3_tilted": lambda: tank_world(3, 5.0),
}
INDEX_SHARE, DISTANCE_MM = 0.005, 1.0
LEVELS = ("trust", "check", "contradicted")
STATED: dict[str, dict[str, Any]] = {
    "known": {},
    "emission": {"emission_known": False},
    "index": {"index_share": INDEX_SHARE},
    "distance": {"distance_std_mm": DISTANCE_MM},
}


def freedom_of(told: str, scene: RefractedScene) -> Freedom | None:
    """What a case leaves uncertain."""
    if told == "emission":
        return emission_freedom()
    if told == "index":
        return medium_freedom([len(scene.planes) - 1], INDEX_SHARE)
    if told == "distance":
        return distance_freedom(range(len(scene.planes)), DISTANCE_MM)
    return None


@cache
def scene_of(world: str) -> RefractedScene:
    return WORLDS[world]()


@cache
def bound_mm(world: str, told: str) -> float:
    """Least rms error of the position in view."""
    scene = scene_of(world)
    free = freedom_of(told, scene)
    return bound(scene, also=() if free is None else (free,)).position_rms_mm


def result_of(world: str, told: str, method: str, seed: int) -> Row:
    """One recording of a world that differs from what is told by one draw of what is uncertain."""
    scene = scene_of(world)
    free, true = freedom_of(told, scene), scene
    if free is not None and np.isfinite(free.std):
        amount = np.random.default_rng([seed, 3]).normal(0.0, free.std)
        true = free.changed(scene, amount)
    hist = histograms(true, seed)
    row: Row = {"world": world, "told": told, "method": method, "seed": seed}
    call = what_the_user_tells(scene, hist, **STATED[told])
    start = time.process_time()
    try:
        path = lf.reconstruct(hist, method=method, **call)
    except (ValueError, RuntimeError) as refused:
        return row | {"says": f"{type(refused).__name__}: {refused}"}
    row |= {"cpu_s": time.process_time() - start, "level": str(path.verdict.level)}
    row |= {"legs": path.n_legs, "named": [str(one.name) for one in path.verdict.findings]}
    if path.n_legs != scene.n_legs:
        return row
    return row | errors_in_view(path, true)


def errors_in_view(path: lf.LightPath, true: RefractedScene) -> Row:
    """Mean square of error and of stated error, mm^2, at 1,000 equal times from source to exit."""
    ends = np.asarray(true.vertex_times_ps)
    times = np.linspace(ends[0], ends[-1], 1000)
    where = positions_at(true, times)
    seen = in_picture(true, where)
    off = path.position_at(times[seen]) - where[seen]
    known = np.isfinite(off).all(axis=1)
    stated = np.trace(path.position_covariance_at(times[seen][known]), axis1=1, axis2=2)
    squares = np.sum(off[known] ** 2, axis=1)
    return {"error2": float(squares.mean()), "stated2": float(stated.mean())}


def interval(squares: np.ndarray, over: float) -> str:
    """Root of the mean and its 95 % interval, by bootstrap over recordings."""
    draws = np.random.default_rng(0).integers(0, len(squares), (2000, len(squares)))
    low, high = np.quantile(np.sqrt(squares[draws].mean(axis=1)), [0.025, 0.975]) / over
    return f"{np.sqrt(squares.mean()) / over:.2f} [{low:.2f}, {high:.2f}]"


def line_of(own: list[Row]) -> str:
    """A row of the table."""
    world, told = own[0]["world"], own[0]["told"]
    right = [row for row in own if "error2" in row]
    levels = [sum(row.get("level") == level for row in own) for level in LEVELS]
    cells = [world, told, own[0]["method"], f"{len(right)}/{len(own)}"]
    if right:
        error2, stated2 = (np.array([row[key] for row in right]) for key in ("error2", "stated2"))
        cells += [f"{np.sqrt(error2.mean()):.4f}", interval(error2, bound_mm(world, told))]
        cells += [interval(error2 / stated2, 1.0)]
    else:
        cells += ["", "", ""]
    cpu = np.median([row.get("cpu_s", np.nan) for row in own])
    return "| " + " | ".join([*cells, "/".join(map(str, levels)), f"{cpu:.1f}"]) + " |"


def tell_blocks(runs: int, first: int) -> None:
    """Print what is named first where 20 mm of glass stand in the beam, with and without light."""
    named: list[str] = []
    for seed in range(first, first + runs):
        scene = block_world(float(seed % 2))
        hist = histograms(scene, seed)
        path = lf.reconstruct(hist, **what_the_user_tells(scene, hist))
        finding = next(iter(path.verdict.findings), None)
        named.append("" if finding is None else str(finding.name))
        print(seed, path.verdict.level, "" if finding is None else finding.sentence, flush=True)
    print(f"named first: {named.count('block')} of {runs}")


def with_told_block(tilt_deg: float, method: str, seed: int, thickness_mm: float) -> Row:
    """One recording of a told block; every other one shows light in the glass."""
    scene = block_world(float(seed % 2), tilt_deg)
    hist = histograms(scene, seed)
    call = what_the_user_tells(scene, hist)
    block = block_told(tilt_deg, thickness_mm=thickness_mm)
    call["medium"] = replace(call["medium"], blocks=block)
    path = lf.reconstruct(hist, method=method, **call)
    row = {"level": str(path.verdict.level), "named": [f.name for f in path.verdict.findings]}
    return row | errors_in_view(path, scene)


def told_blocks(runs: int, first: int, methods: list[str], thickness_mm: float) -> None:
    """Print errors over the bound and pulls of one beam through 20 mm of told glass."""
    print(
        "| tilt of the block, deg | method | rms, mm | / bound | pull | t/c/c | named block first |"
    )
    print("|---:|---|---:|---:|---:|---:|---:|", flush=True)
    for tilt in (0.0, 25.0):
        dark = block_world(0.0, tilt)
        least_mm = bound(dark, vertices=(), also=block_freedoms(tilt)).position_rms_mm
        for method in methods:
            seeds = range(first, first + runs)
            rows = [with_told_block(tilt, method, seed, thickness_mm) for seed in seeds]
            error2, stated2 = (np.array([r[key] for r in rows]) for key in ("error2", "stated2"))
            levels = [row["level"] for row in rows]
            cells = [f"{tilt:g}", method, f"{np.sqrt(error2.mean()):.4f}"]
            cells += [interval(error2, least_mm), interval(error2 / stated2, 1.0)]
            cells.append("/".join(str(levels.count(one)) for one in LEVELS))
            cells.append(str(sum("block" in row["named"][:1] for row in rows)))
            print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--first", type=int, default=17_000, help="first seed")
    parser.add_argument("--only", nargs="+", choices=WORLDS, default=list(WORLDS))
    parser.add_argument("--told", nargs="+", choices=STATED, default=list(STATED))
    parser.add_argument("--methods", nargs="+", default=["joint", "photon"])
    parser.add_argument("--rows", type=Path, help="JSON lines to keep, and to go on from")
    parser.add_argument("--block", type=int, metavar="N", help="N recordings of untold glass")
    parser.add_argument("--told-block", type=int, metavar="N", help="N recordings of told glass")
    parser.add_argument("--thickness", type=float, default=20.0, help="as told, mm; 20 is true")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    if args.block:
        tell_blocks(args.block, args.first)
        return
    if args.told_block:
        told_blocks(args.told_block, args.first, args.methods, args.thickness)
        return
    done: list[Row] = []
    if args.rows and args.rows.exists():
        done = [json.loads(line) for line in args.rows.read_text().splitlines()]
    names = ("world", "told", "method", "seed")
    kept = {tuple(row[name] for name in names): row for row in done}
    print("| world | told | method | right | rms, mm | / bound | pull | t/c/c | CPU, s |")
    print("|---|---|---|---:|---:|---:|---:|---:|---:|", flush=True)
    for world in args.only:
        for told in args.told:
            if told in ("index", "distance") and not scene_of(world).planes:
                continue
            for method in args.methods:
                own = []
                for seed in range(args.first, args.first + args.runs):
                    key = (world, told, method, seed)
                    if key not in kept:
                        kept[key] = result_of(*key)
                        if args.rows:
                            with args.rows.open("a") as file:
                                file.write(json.dumps(kept[key]) + "\n")
                    own.append(kept[key])
                print(line_of(own), flush=True)


if __name__ == "__main__":
    main()
