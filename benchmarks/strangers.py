"""Reflections, specks, occluders, splitters and second pulses: is a path far off ever trusted?

    python benchmarks/strangers.py                          # 200 recordings
    python benchmarks/strangers.py --kinds splitter --runs 50 --json out/strangers.jsonl
    python benchmarks/strangers.py --kinds splitter --seed 5 --methods photon      # one again

Worlds of the tests' own forward model, one and three legs in turn, source and emission time told as
exact, 40,000 photons in the brightest pixel, number of legs not told; recording k of a kind is
world `--first` + k, what is strange about it drawn anew:

reflection  the flight once more in a mirror 15 to 400 mm behind it, with 3 to 30 % of its light
speck       one to four grains in the beam, each ten times as bright as the light about it
occluder    one or two things before the beam, 10 to 50 mm of it dark
splitter    an arm that leaves the beam in view, 10 to 50 % of its light, by 20 to 160 degrees
second      a second pulse, 2 to 50 % of the first, 0.3 to 5 ns later

Printed for each kind and estimator: how many were refused, have the right number of legs, are
trusted, checked, contradicted; how many are far off (more than 20 mm and three stated errors,
anywhere in view, from where the light was then; an arm of a splitter is light as well), and how
many of those are trusted, each by seed, with the 95 % interval of their share (Clopper-Pearson). A
run that was cut short goes on from `--json`.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import warnings
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import lightflight as lf
from benchmarks.other_light import FAR_MM, FAR_STDS, path_of
from benchmarks.verdict import interval
from tests.oracles.worlds.mistakes import walled
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import NODE_MM, Arm, C, World

Row = dict[str, Any]

FIRST = 90_000
_DARK = -12.0
"""Log of the light behind an occluder."""


def reflection(world: World, rng: np.random.Generator) -> World:
    return walled(rng.uniform(15.0, 400.0))(world, rng.uniform(0.03, 0.3))


def _nodes_in_view(world: World) -> np.ndarray:
    """Nodes of the light, by number, where the beam is in view."""
    at = NODE_MM * np.arange(int(world.length_mm() / NODE_MM) + 2)
    return np.flatnonzero(world.view.inside(_places(world, at)))


def _places(world: World, walked_mm: np.ndarray) -> np.ndarray:
    steps = np.linalg.norm(np.diff(world.vertices, axis=0), axis=1)
    ends = np.append(0.0, np.cumsum(steps))
    return np.column_stack([np.interp(walked_mm, ends, axis) for axis in world.vertices.T])


def _with_light(world: World, change: Callable[[np.ndarray], None]) -> World:
    log = np.zeros(int(world.length_mm() / NODE_MM) + 2)
    log[: world.log_brightness.size] = world.log_brightness[: log.size]
    change(log)
    return world.but(log_brightness=log)


def speck(world: World, rng: np.random.Generator) -> World:
    places = rng.choice(_nodes_in_view(world), size=rng.integers(1, 5), replace=False)

    def grains(log: np.ndarray) -> None:
        log[places] += math.log(10.0)

    return _with_light(world, grains)


def occluder(world: World, rng: np.random.Generator) -> World:
    seen = _nodes_in_view(world)

    def stretches(log: np.ndarray) -> None:
        for _ in range(rng.integers(1, 3)):
            first = rng.choice(seen)
            log[first : first + round(rng.uniform(10.0, 50.0) / NODE_MM)] = _DARK

    return _with_light(world, stretches)


def splitter(world: World, rng: np.random.Generator) -> World:
    """The beam goes on in both arms: half-way along a leg, the straight one is its own."""
    share = rng.uniform(0.1, 0.5)
    leg = int(rng.integers(world.n_legs))
    start, end = world.vertices[leg], world.vertices[leg + 1]
    inside = [
        cut for cut in np.linspace(0.2, 0.8, 13) if _inside(world, start + cut * (end - start))
    ]
    place = start + rng.choice(inside) * (end - start)
    ahead = (end - start) / np.linalg.norm(end - start)
    # About the line of sight, so that the arm is seen; then a little out of the picture's plane.
    sight = (place - world.view.centre) / np.linalg.norm(place - world.view.centre)
    turn = math.radians(rng.uniform(20.0, 160.0)) * rng.choice([-1.0, 1.0])
    aside = Rotation.from_rotvec(turn * sight).apply(ahead) + rng.uniform(-0.2, 0.2) * sight
    passed = float(np.linalg.norm(place - start))
    when = world.vertex_times_ps()[leg] + world.path_index * passed / C
    arm = Arm(np.array([place, place + 400.0 * aside / np.linalg.norm(aside)]), share, when)
    split = np.insert(world.vertices, leg + 1, place, axis=0)
    left = math.log(1.0 - share)
    flux = (0.0,) * (leg + 1) + (left,) * (world.n_legs - leg)
    return world.but(vertices=split, arms=(arm,), leg_log_flux=flux)


def _inside(world: World, place: np.ndarray) -> bool:
    return bool(world.view.inside(place[np.newaxis])[0])


def second(world: World, rng: np.random.Generator) -> World:
    share = math.exp(rng.uniform(math.log(0.02), math.log(0.5)))
    return world.but(second=share, second_ps=rng.uniform(300.0, 5000.0))


KINDS = {
    "reflection": reflection,
    "speck": speck,
    "occluder": occluder,
    "splitter": splitter,
    "second": second,
}


def world_of(kind: str, seed: int, n_legs: int) -> World:
    number = list(KINDS).index(kind)
    return KINDS[kind](random_world(seed, n_legs), np.random.default_rng([seed, number, 5]))


def lights_of(world: World) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ways that light takes from the source on: (m, 3) vertices, mm, and (m,) their times, ps."""
    times = world.vertex_times_ps()
    ways = [(world.vertices, times)]
    for arm in world.arms:
        before = times < arm.start_ps - 1e-6
        vertices = np.vstack([world.vertices[before], arm.vertices])
        steps = np.linalg.norm(np.diff(arm.vertices, axis=0), axis=1)
        later = arm.start_ps + world.path_index * np.append(0.0, np.cumsum(steps)) / C
        ways.append((vertices, np.append(times[before], later)))
    return ways


def farthest(path: lf.LightPath, world: World) -> tuple[float, float]:
    """How far the path in view is from the nearest way of the light, mm, and in stated errors.

    At the place where it is farthest by the lesser of both, each in units of what is far.
    """
    points = path.sample(400)
    place = np.column_stack([points[f"{axis}_mm"] for axis in "xyz"])
    # A source that is told as exact has no error: a nanometre keeps the ratio finite there.
    std = np.sqrt(sum(points[f"{axis}_std_mm"] ** 2 for axis in "xyz") + 1e-12)
    offs = []
    for vertices, times in lights_of(world):
        light = np.column_stack(
            [np.interp(points["event_time_ps"], times, axis) for axis in vertices.T]
        )
        offs.append(np.linalg.norm(place - light, axis=1))
    off = np.where(world.view.inside(place), np.min(offs, axis=0), 0.0)
    worst = int(np.argmax(np.minimum(off / FAR_MM, off / std / FAR_STDS)))
    return float(off[worst]), float(off[worst] / std[worst])


def result_of(kind: str, seed: int, n_legs: int, method: str) -> Row:
    world = world_of(kind, seed, n_legs)
    path, row = path_of(world, method, seed)
    if path is not None:
        row["mm"], row["stds"] = farthest(path, world)
    return row


def is_far(row: Row) -> bool:
    return "mm" in row and row["mm"] > FAR_MM and row["stds"] > FAR_STDS


def print_table(rows: list[Row]) -> None:
    print(f"{'':20s}   n refused right trust check contr.  far trusted")
    for kind, method in dict.fromkeys((row["kind"], row["method"]) for row in rows):
        own = [row for row in rows if (row["kind"], row["method"]) == (kind, method)]
        levels = [
            sum(row.get("level") == level for row in own)
            for level in ("trust", "check", "contradicted")
        ]
        far = [row for row in own if is_far(row)]
        print(
            f"{kind:12s} {method:7s} {len(own):3d} {sum('says' in row for row in own):7d} "
            f"{sum(row.get('legs_found') == row['n_legs'] for row in own):5d} "
            f"{levels[0]:5d} {levels[1]:5d} {levels[2]:6d} {len(far):4d} "
            f"{sum(row['level'] == 'trust' for row in far):7d}"
        )
    wrong = [row for row in rows if is_far(row) and row["level"] == "trust"]
    for row in wrong:
        print(
            f"trusted and far: {row['kind']} {row['seed']} {row['method']}, {row['n_legs']} legs, "
            f"{row['legs_found']} found: {row['mm']:.1f} mm, {row['stds']:.1f} stated errors"
        )
    n = len(rows)
    low, high = interval(len(wrong), n)
    print(f"trusted and far: {len(wrong)} of {n}, [{100 * low:.1f}, {100 * high:.1f}] %")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--methods", default="joint,photon")
    parser.add_argument("--runs", type=int, default=20, help="recordings of each kind")
    parser.add_argument("--first", type=int, default=FIRST, help="first seed")
    parser.add_argument("--seed", type=int, help="this recording alone")
    parser.add_argument("--json", type=Path, help="one line for each recording; goes on from there")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    done: dict[str, Row] = {}
    if given.json is not None and given.json.exists():
        for line in given.json.read_text("utf-8").splitlines():
            row = json.loads(line)
            done[json.dumps([row["kind"], row["seed"], row["n_legs"], row["method"]])] = row
    seeds = range(given.first, given.first + given.runs) if given.seed is None else [given.seed]
    rows = []
    # Kind by kind within a seed, so that a run that is stopped is a fair sample.
    for seed, kind, method in product(seeds, given.kinds.split(","), given.methods.split(",")):
        n_legs = 1 if seed % 2 else 3
        key = json.dumps([kind, seed, n_legs, method])
        row = done.get(key)
        if row is None:
            cell = {"kind": kind, "seed": seed, "n_legs": n_legs, "method": method}
            row = cell | result_of(kind, seed, n_legs, method)
            if given.json is not None:
                with given.json.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(row) + "\n")
        rows.append(row)
    print_table(rows)


if __name__ == "__main__":
    main()
