"""What light beside the path does to it, against the bound of the model that has a place for it.

    python benchmarks/other_light.py                                  # all worlds, 10 seeds
    python benchmarks/other_light.py --worlds none,haze_500ps:0.2 --legs 1 --runs 3
    python benchmarks/other_light.py --json now.jsonl --before then.jsonl    # paired with another

Worlds of the tests' own forward model, source and emission time told as exact, 40,000 photons in
the brightest pixel, even light, number of legs not told; run k is world 288 + k. Each row: share
of paths with the right number of legs, and of these

error / bound   rms, whitened by the Cramer-Rao bound of the same world with the strength of its
                other light, and a wall's depth, free (`tests/oracles/worlds/fisher.py`); three
                legs: of the corners between legs, one leg: of its direction
pull            rms, whitened by the stated errors
stated / bound  rms
mm              median error
trust ...       how many the verdict trusts, checks, contradicts
silent          trusted with more than 20 mm and 3 stated errors off, or with another number of legs

Below: pulls of all worlds that have other light, by number of legs, and how many are above 3.

`--before` holds rows of the same seeds by another version: errors over those. `--json`
holds one line for each recording; a run that was cut short goes on from there.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import lightflight as lf
from tests.oracles.miss import across, error_and_covariance
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.fisher import fisher
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import World

WORLDS = (
    "none:0", "haze_500ps:0.05", "haze_500ps:0.2", "haze_500ps:0.5", "haze_150ps:0.05",
    "haze_150ps:0.2", "haze_150ps:0.5", "tail_200ps:0.3", "prompt_halo_8px:0.2",
    "prompt_halo_4px:0.2",
    "veiling_glare:0.05", "wall_60mm:0.1", "wall_15mm:0.1",
    "fog_8px:0.3", "fog_8px:0.6", "second_pulse_3ns:0.1", "pulse_before_2ns:0.5",
    "pulse_echo_300ps:0.1",
)  # fmt: skip
FREE = {
    "haze": ("haze",), "prompt": ("halo",), "veiling": ("glare",), "lens": ("ghost",),
    "wall": ("wall", "wall_depth_mm"), "tail": ("tail",), "fog": ("late_halo",),
    "second": ("second", "second_ps"), "pulse": ("second", "second_ps"),
}  # fmt: skip
"""By the first word of a world's name: the parameters that the bound leaves free."""
FAR_MM, FAR_STDS = 20.0, 3.0
"""A path farther off than both of these, by its own errors, must not be trusted."""
FIRST = 288

Row = dict[str, Any]


def world_of(name: str, n_legs: int, seed: int) -> World:
    plain = random_world(seed, n_legs)
    defect, _, strength = name.partition(":")
    if defect == "none":
        return plain
    if defect == "tail_200ps":
        # Of the recording's response; the clock's flat has none.
        return plain.but(tail=float(strength), tail_ps=200.0)
    if defect == "fog_8px":
        return plain.but(late_halo=float(strength), late_halo_std_px=8.0, late_halo_ps=600.0)
    if defect.startswith("prompt_halo_"):
        # Of any width: prompt_halo_4px.
        width_px = float(defect.removeprefix("prompt_halo_").removesuffix("px"))
        return plain.but(halo=float(strength), halo_std_px=width_px)
    if defect == "wall_15mm":
        # As `wall_60mm`, nearer: light that comes 100 ps later, a pulse's width.
        nearer = DEFECTS["wall_60mm"].applied(plain, float(strength))
        return nearer.but(wall_depth_mm=nearer.wall_depth_mm - 45.0)
    return DEFECTS[defect].applied(plain, float(strength))


def bound_of(world: World, name: str) -> np.ndarray:
    """(k, k), least covariance of what is compared."""
    words = FREE.get(name.partition("_")[0], ())
    known = fisher(world, also=dict.fromkeys(words, math.inf))
    vertices = range(1, world.n_legs) if world.n_legs > 1 else range(1, 2)
    own = [known.names.index(f"{axis}{k}") for k in vertices for axis in "xyz"]
    frame = across(world.vertices)
    return np.asarray(frame @ known.covariance[np.ix_(own, own)] @ frame.T)


def path_of(world: World, method: str, seed: int) -> tuple[lf.LightPath | None, Row]:
    """The path of a recording, None where it was refused; and what a row says of any."""
    hist, told = record(world, seed), what_the_user_tells(world)
    start = time.process_time()
    try:
        path = lf.reconstruct(hist, method=method, **told)
    except (ValueError, RuntimeError) as refused:
        return None, {"says": f"{type(refused).__name__}: {refused}"}
    return path, {
        "level": str(path.verdict.level),
        "cpu_s": time.process_time() - start,
        "legs_found": path.n_legs,
        "named": [str(finding.name) for finding in path.verdict.findings],
    }


def result_of(name: str, n_legs: int, method: str, seed: int) -> Row:
    world = world_of(name, n_legs, seed)
    path, row = path_of(world, method, seed)
    if path is not None and path.n_legs == n_legs:
        error, stated = error_and_covariance(path, world.vertices)
        row["error"], row["stated"] = error.tolist(), stated.tolist()
    return row


def done_in(file: Path | None) -> list[Row]:
    if file is None or not file.exists():
        return []
    return [json.loads(line) for line in file.read_text("utf-8").splitlines() if line]


def key_of(row: Row) -> tuple[Any, ...]:
    return tuple(row[name] for name in ("world", "n_legs", "method", "seed"))


def run(cells: list[Row], file: Path | None) -> list[Row]:
    done = {key_of(row): row for row in done_in(file)}
    rows = []
    for cell in cells:
        row = done.get(key_of(cell))
        if row is None:
            name, n_legs, method, seed = key_of(cell)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                if method == "bound":
                    found = {"bound": bound_of(world_of(name, n_legs, seed), name).tolist()}
                else:
                    found = result_of(name, n_legs, method, seed)
            row = cell | found
            if file is not None:
                with file.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(row) + "\n")
        rows.append(row)
    return rows


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


def whitened(error: np.ndarray, covariance: np.ndarray) -> float:
    return float(np.sqrt(error @ np.linalg.solve(covariance, error) / len(error)))


def line_of(own: list[Row], bounds: dict[Any, np.ndarray], before: dict[Any, Row]) -> str:
    right = [row for row in own if "error" in row]
    found: dict[str, list[float]] = {"bound": [], "pull": [], "stated": [], "mm": []}
    now, then = [], []
    for row in right:
        error, stated = np.array(row["error"]), np.array(row["stated"])
        found["mm"].append(float(np.abs(error).max()))
        found["pull"].append(whitened(error, stated))
        least = bounds.get(key_of(row | {"method": "bound"}))
        if least is not None:
            found["bound"].append(whitened(error, least))
            ratio = np.trace(np.linalg.solve(least, stated)) / len(error)
            found["stated"].append(float(np.sqrt(ratio)))
        other = before.get(key_of(row), {})
        if "error" in other and least is not None:
            now.append(whitened(error, least))
            then.append(whitened(np.array(other["error"]), least))
    middle = float(np.median(found["mm"])) if right else float("nan")
    levels = " ".join(
        f"{sum(row.get('level') == level for row in own):5d}"
        for level in ("trust", "check", "contradicted")
    )
    silent = sum(
        row.get("level") == "trust"
        and float(np.abs(row["error"]).max()) > FAR_MM
        and whitened(np.array(row["error"]), np.array(row["stated"])) > FAR_STDS
        for row in right
    )
    silent += sum(row.get("level") == "trust" for row in own if "error" not in row)
    cpu = float(np.median([row.get("cpu_s", np.nan) for row in own]))
    paired = f"{rms(now) / rms(then):8.3f}" if then else ""
    return (
        f"{len(right):3d}/{len(own):<3d} {rms(found['bound']):10.2f} {rms(found['pull']):7.2f} "
        f"{rms(found['stated']):8.2f} {middle:9.3f} {levels} {silent:6d} {cpu:6.2f} {paired}"
    )


def print_pooled(rows: list[Row]) -> None:
    for n_legs in dict.fromkeys(row["n_legs"] for row in rows):
        pulls = [
            whitened(np.array(row["error"]), np.array(row["stated"]))
            for row in rows
            if row["n_legs"] == n_legs and "error" in row and not row["world"].startswith("none")
        ]
        above = sum(pull > FAR_STDS for pull in pulls)
        print(
            f"other light, {n_legs} legs: {len(pulls)} pulls, rms {rms(pulls):.2f}, {above} above 3"
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--worlds", default=",".join(WORLDS), help="name:strength, by comma")
    parser.add_argument("--legs", default="1,3")
    parser.add_argument("--methods", default="joint,photon")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first world")
    parser.add_argument("--json", type=Path, help="one line for each recording; goes on from there")
    parser.add_argument("--bounds", type=Path, help="where bounds are kept, which last")
    parser.add_argument("--before", type=Path, help="rows of another version, to pair with")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.runs)
    kinds = list(product(options.worlds.split(","), [int(n) for n in options.legs.split(",")]))

    def cells_of(methods: list[str]) -> list[Row]:
        return [
            {"world": name, "n_legs": n_legs, "method": method, "seed": seed}
            for name, n_legs in kinds
            for method in methods
            for seed in seeds
        ]

    rows = run(cells_of(options.methods.split(",")), options.json)
    least = run(cells_of(["bound"]), options.bounds or options.json)
    bounds = {key_of(row): np.array(row["bound"]) for row in least}
    before = {key_of(row): row for row in done_in(options.before)}
    head = (
        "right     error/bnd    pull stat/bnd mm (med.) trust check contr silent  cpu s now/before"
    )
    print(f"{'world':22s} {'':14s} {head}")
    for (name, n_legs), method in product(kinds, options.methods.split(",")):
        own = [row for row in rows if key_of(row)[:3] == (name, n_legs, method)]
        print(f"{name:22s} {n_legs} legs {method:7s} {line_of(own, bounds, before)}")
    print_pooled(rows)


if __name__ == "__main__":
    main()
