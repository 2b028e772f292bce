"""Twenty passes between two mirrors beside the picture: found, round trip, distance, seconds.

    python benchmarks/cavity.py                                   # 30 recordings, joint
    python benchmarks/cavity.py --methods joint photon --runs 10
    python benchmarks/cavity.py --walks 9 3 0.5                   # passes that nearly retrace too
    python benchmarks/cavity.py --scale 0.007                     # dead codes unknown
    python benchmarks/cavity.py --bounds 1                        # and against the oracle's bound
    python benchmarks/cavity.py --rows rows.jsonl                 # keep rows, and go on from there

Recordings are those of `tests/oracles/cavity.py`, drawn photon by photon, each by its own seed;
the photons told are those of the brightest pixel in the first pass, 4 % are lost with every one.
Source and emission time are known, codes of 55 ps ideal; the number of legs is not told. With
`--scale` the true codes are longer or shorter by one draw from that share, and the clock told has
it as its error. Printed: recordings in which as many legs came out as there are; rms error of the
mean time of a round trip in ps, over what was stated (pull) and, with `--bounds n`, over the bound
(rms of the first n seeds: one takes minutes), with 95 % intervals (bootstrap over recordings); the
same for the distance of the mirrors; verdicts trust/check/contradicted; CPU seconds, middle, most.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np

import lightflight as lf
from lightflight.timing.clock.shared_modes import with_shared_errors

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.refraction import Row, interval
from tests.oracles.brute_force import C
from tests.oracles.cavity import Cavity, cavity
from tests.oracles.refracted import AIR, light_scale
from tests.oracles.refracted_border import camera_told
from tests.oracles.refracted_bound import bound

KEYS = ("method", "walk", "photons", "scale", "seed")


def told_and_drawn(world: Cavity, scale: float, seed: int) -> tuple[lf.Histograms, object]:
    """A recording, and the clock told for it, whose scale is off by one draw."""
    clock = world.scene.clock
    off = 1.0 + scale * float(np.random.default_rng([seed, 7]).standard_normal())
    true = replace(world, scene=replace(world.scene, clock=replace(clock, width=clock.width * off)))
    hist = lf.Histograms(
        true.recording(seed), bin_width_ps=clock.width, laser_period_ps=clock.period
    )
    told = lf.TimingCalibration.nominal(hist)
    return hist, with_shared_errors(told, scale_std=scale) if scale else told


@cache
def least_ps(walk: float, photons: float, seed: int) -> float:
    """Least error of the mean time of a round trip; corners, light, spot and pulse unknown."""
    scene = cavity(seed, walk_mm=walk, photons=photons).scene
    first = replace(scene, vertices_mm=scene.vertices_mm[:2], brightness=scene.brightness[:1])
    # The bound's photons are those of the brightest pixel in all passes together.
    scene = replace(scene, photons=photons * light_scale(first) / light_scale(scene))
    names = [f"{axis}{k}" for k in range(1, scene.n_legs + 1) for axis in "xyz"]
    by_vertices = mean_trip_by_vertices(scene.vertices_mm)[1:].ravel()
    return float(np.sqrt(by_vertices @ bound(scene).block(names) @ by_vertices))


def mean_trip_by_vertices(vertices_mm: np.ndarray) -> np.ndarray:
    """(m, 3), ps per mm: how the mean time of a round trip follows places, light at its speed."""
    steps = np.diff(vertices_mm, axis=0)
    ahead = steps / np.linalg.norm(steps, axis=1)[:, None]
    n_trips = len(vertices_mm) - 4
    # The way from corner k to corner k + 2 is legs k and k + 1: how often each leg is in a trip.
    often = np.zeros(len(steps))
    for k in range(1, n_trips + 1):
        often[k : k + 2] += 1.0 / n_trips
    by = np.zeros_like(vertices_mm)
    by[1:] += often[:, None] * ahead
    by[:-1] -= often[:, None] * ahead
    return by * AIR / C


def result_of(method: str, walk: float, photons: float, scale: float, seed: int) -> Row:
    """One recording."""
    world = cavity(seed, walk_mm=walk, photons=photons)
    hist, clock = told_and_drawn(world, scale, seed)
    scene = world.scene
    source = lf.Source(tuple(scene.vertices_mm[0]), emission_time_ps=scene.emission_time_ps)
    row: Row = dict(zip(KEYS, (method, walk, photons, scale, seed), strict=True))
    start = time.process_time()
    try:
        path = lf.reconstruct(
            hist, camera=camera_told(scene), source=source, timing=clock, method=method
        )
    except (ValueError, RuntimeError) as refused:
        return row | {"says": f"{type(refused).__name__}: {refused}"}
    row |= {"cpu_s": time.process_time() - start, "level": str(path.verdict.level)}
    row |= {"named": [str(one.name) for one in path.verdict.findings], "legs": path.n_legs}
    trip = path.round_trip
    if path.n_legs != world.n_passes or trip is None:
        return row
    return row | {
        "off_ps": trip.time_ps - float(world.round_trips_ps.mean()),
        "std_ps": trip.time_std_ps,
        "off_mm": trip.distance_mm - world.distance_mm,
        "std_mm": trip.distance_std_mm,
    }


def line_of(own: list[Row], n_bounds: int) -> str:
    """A row of the table."""
    right = [row for row in own if "off_ps" in row]
    first = own[0]
    cells = [first["method"], *(f"{first[key]:g}" for key in ("walk", "photons", "scale"))]
    cells.append(f"{len(right)}/{len(own)}")
    if right:
        ps, ps_std, mm, mm_std = (
            np.array([row[key] for row in right])
            for key in ("off_ps", "std_ps", "off_mm", "std_mm")
        )
        cells += [interval(ps**2, 1.0), f"{np.sqrt(np.mean(ps_std**2)):.3f}"]
        cells.append(interval((ps / ps_std) ** 2, 1.0))
        if n_bounds:
            seeds = [row["seed"] for row in right[:n_bounds]]
            least2 = [least_ps(first["walk"], first["photons"], seed) ** 2 for seed in seeds]
            cells.append(interval(ps**2 / np.mean(least2), 1.0))
        else:
            cells.append("")
        cells += [interval(mm**2, 1.0), interval((mm / mm_std) ** 2, 1.0)]
    else:
        cells += [""] * 6
    levels = [sum(row.get("level") == level for row in own)
              for level in ("trust", "check", "contradicted")]  # fmt: skip
    cpu = [row["cpu_s"] for row in own if "cpu_s" in row] or [np.nan]
    cells += ["/".join(map(str, levels)), f"{np.median(cpu):.0f}, {max(cpu):.0f}"]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--photons", type=float, nargs="+", default=[4_000.0])
    parser.add_argument("--walks", type=float, nargs="+", default=[9.0], help="mm per pass")
    parser.add_argument("--scale", type=float, default=0.0, help="error of the clock's scale")
    parser.add_argument("--methods", nargs="+", default=["joint"])
    parser.add_argument("--bounds", type=int, default=0, help="seeds whose bound is worked out")
    parser.add_argument("--rows", type=Path, help="JSON lines to keep, and to go on from")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    done: list[Row] = []
    if args.rows and args.rows.exists():
        done = [json.loads(line) for line in args.rows.read_text().splitlines()]
    kept = {tuple(row[name] for name in KEYS): row for row in done}
    print("| method | walk, mm | photons | scale | found | error, ps | stated, ps | pull "
          "| error / bound | distance, mm | its pull | t/c/c | CPU, s |")  # fmt: skip
    print("|---|" + "---:|" * 12, flush=True)
    for method, walk, photons in product(args.methods, args.walks, args.photons):
        own = []
        for seed in range(args.first, args.first + args.runs):
            key = (method, walk, photons, args.scale, seed)
            if key not in kept:
                kept[key] = result_of(*key)
                if args.rows:
                    with args.rows.open("a") as file:
                        file.write(json.dumps(kept[key]) + "\n")
            own.append(kept[key])
        print(line_of(own, args.bounds), flush=True)


if __name__ == "__main__":
    main()
