"""One flight before one, two and three cameras, against the bound of a forward model of its own.

    python benchmarks/several_cameras.py                       # 12 recordings a cell
    python benchmarks/several_cameras.py --runs 200 --photons 40 --methods photon
    python benchmarks/several_cameras.py --rows rows.jsonl     # keep rows, and go on from there

Recordings are those of `tests/oracles/refracted.py` with nothing before the cameras: the paper's
three legs, source known, emission time known or fitted, ideal codes of 55 ps, a stated number of
photons in the brightest pixel of each camera. Printed: recordings with three legs (untold), rms
error of the position in the first camera's view over the bound of all cameras with its 95 %
interval (bootstrap), rms pull of that position, verdicts, and the CPU seconds of the middle one.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from functools import cache
from pathlib import Path

import numpy as np

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.refraction import Row, errors_in_view, interval
from tests.oracles.refracted_bound import bound, emission_freedom
from tests.oracles.several_views import recorded, told, views

KEYS = ("cameras", "photons", "emission_known", "method", "seed")


@cache
def bound_mm(cameras: int, photons: float, emission_known: bool) -> float:
    """Least rms error of the position in the first camera's view."""
    first, *others = views(cameras, photons=photons)
    free = () if emission_known else (emission_freedom(),)
    return bound(first, others=others, also=free).position_rms_mm


def result_of(cameras: int, photons: float, emission_known: bool, method: str, seed: int) -> Row:
    """One flight before all cameras."""
    scenes = views(cameras, photons=photons)
    recordings = recorded(scenes, seed)
    call = told(scenes, recordings, emission_known=emission_known)
    row: Row = dict(zip(KEYS, (cameras, photons, emission_known, method, seed), strict=True))
    start = time.process_time()
    try:
        path = lf.reconstruct(recordings, method=method, **call)
    except (ValueError, RuntimeError) as refused:
        return row | {"says": f"{type(refused).__name__}: {refused}"}
    row |= {"cpu_s": time.process_time() - start, "level": str(path.verdict.level)}
    row |= {"legs": path.n_legs, "named": [str(one.name) for one in path.verdict.findings]}
    return row | errors_in_view(path, scenes[0]) if path.n_legs == scenes[0].n_legs else row


def line_of(own: list[Row]) -> str:
    """A row of the table."""
    first = own[0]
    right = [row for row in own if "error2" in row]
    cells = [str(first["cameras"]), f"{first['photons']:g}", first["method"]]
    cells += ["known" if first["emission_known"] else "fitted", f"{len(right)}/{len(own)}"]
    if right:
        error2, stated2 = (np.array([row[key] for row in right]) for key in ("error2", "stated2"))
        least = bound_mm(first["cameras"], first["photons"], first["emission_known"])
        cells += [f"{np.sqrt(error2.mean()):.4f}", interval(error2, least)]
        cells += [interval(error2 / stated2, 1.0)]
    else:
        cells += ["", "", ""]
    levels = [sum(row.get("level") == level for row in own)
              for level in ("trust", "check", "contradicted")]  # fmt: skip
    cpu = np.median([row.get("cpu_s", np.nan) for row in own])
    return "| " + " | ".join([*cells, "/".join(map(str, levels)), f"{cpu:.1f}"]) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--first", type=int, default=23_000, help="first seed")
    parser.add_argument("--cameras", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--photons", type=float, nargs="+", default=[40.0, 40_000.0])
    parser.add_argument("--methods", nargs="+", default=["joint", "photon"])
    parser.add_argument("--emission", nargs="+", choices=["known", "fitted"], default=["fitted"])
    parser.add_argument("--rows", type=Path, help="JSON lines to keep, and to go on from")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    done: list[Row] = []
    if args.rows and args.rows.exists():
        done = [json.loads(line) for line in args.rows.read_text().splitlines()]
    kept = {tuple(row[name] for name in KEYS): row for row in done}
    print("| cameras | photons | method | emission | right | rms, mm | / bound | pull "
          "| t/c/c | CPU, s |")  # fmt: skip
    print("|---:|---:|---|---|---:|---:|---:|---:|---:|---:|", flush=True)
    cells = [
        (cameras, photons, emission == "known", method)
        for photons in args.photons
        for emission in args.emission
        for cameras in args.cameras
        for method in args.methods
    ]
    for cell in cells:
        own = []
        for seed in range(args.first, args.first + args.runs):
            key = (*cell, seed)
            if key not in kept:
                kept[key] = result_of(*key)
                if args.rows:
                    with args.rows.open("a") as file:
                        file.write(json.dumps(kept[key]) + "\n")
            own.append(kept[key])
        print(line_of(own), flush=True)


if __name__ == "__main__":
    main()
