"""One flight before one, two and three cameras, against the bound of a forward model of its own.

    python benchmarks/several_cameras.py                       # 12 recordings a cell
    python benchmarks/several_cameras.py --runs 200 --photons 40 --methods photon
    python benchmarks/several_cameras.py --rows rows.jsonl     # keep rows, and go on from there
    python benchmarks/several_cameras.py --scenes parted beside --cameras 2      # legs seen by one
    python benchmarks/several_cameras.py --offset-std-ps 50 inf --cameras 2      # clocks apart

Recordings are those of `tests/oracles/refracted.py` with nothing before the cameras: the paper's
three legs, source known, emission time known or fitted, ideal codes of 55 ps, a stated number of
photons in the brightest pixel of each camera. `parted`: the first of two cameras sees legs 1 and 2,
the other 2 and 3; `beside`: the first sees nothing of leg 2; `_turned`: the cameras the other way
round. With `--offset-std-ps` each further camera's clock is off by a draw of that size, or by one
of 500 ps where nothing is told of it (inf). Printed: recordings with three legs (untold), rms
error of the position in the first camera's view over the bound of all cameras with its 95 %
interval (bootstrap), rms pull of that position, verdicts, and the CPU seconds of the middle one.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.refraction import Row, errors_in_view, interval
from tests.oracles.refracted import RefractedScene
from tests.oracles.refracted_bound import bound, emission_freedom
from tests.oracles.several_views import (
    beside,
    late,
    late_freedom,
    parted,
    recorded,
    told,
    views,
)

KEYS = ("scene", "cameras", "photons", "emission_known", "offset_std_ps", "method", "seed")
UNKNOWN_PS = 500.0
"""Of what clocks are drawn to be apart where nothing is told of it."""
SCENES: dict[str, Callable[[int, float], list[RefractedScene]]] = {
    "paper": lambda cameras, photons: views(cameras, photons=photons),
    "parted": lambda _, photons: parted(photons=photons),
    "parted_turned": lambda _, photons: parted(photons=photons, turned=True),
    "beside": lambda _, photons: beside(photons=photons),
    "beside_turned": lambda _, photons: beside(photons=photons, turned=True),
}


@cache
def bound_mm(
    scene: str, cameras: int, photons: float, emission_known: bool, offset_std_ps: float
) -> float:
    """Least rms error of the position in the first camera's view."""
    first, *others = SCENES[scene](cameras, photons)
    free = [] if emission_known else [emission_freedom()]
    if offset_std_ps > 0.0:
        free += [late_freedom(other.camera, offset_std_ps) for other in others]
    return bound(first, others=others, also=free).position_rms_mm


def result_of(
    scene: str,
    cameras: int,
    photons: float,
    emission_known: bool,
    offset_std_ps: float,
    method: str,
    seed: int,
) -> Row:
    """One flight before all cameras."""
    key = (scene, cameras, photons, emission_known, offset_std_ps, method, seed)
    scenes = SCENES[scene](cameras, photons)
    drawn = np.random.default_rng(seed).normal(size=len(scenes)) * (np.arange(len(scenes)) > 0)
    offsets = drawn * min(offset_std_ps, UNKNOWN_PS)
    recordings = recorded(late(scenes, offsets), seed)
    call = told(scenes, recordings, emission_known=emission_known, offset_std_ps=offset_std_ps)
    row: Row = dict(zip(KEYS, key, strict=True))
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
    cells = [first["scene"], str(first["cameras"]), f"{first['photons']:g}", first["method"]]
    cells += [f"{first['offset_std_ps']:g}"]
    cells += ["known" if first["emission_known"] else "fitted", f"{len(right)}/{len(own)}"]
    if right:
        error2, stated2 = (np.array([row[key] for row in right]) for key in ("error2", "stated2"))
        least = bound_mm(*(first[name] for name in KEYS[:5]))
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
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=["paper"])
    parser.add_argument("--offset-std-ps", type=float, nargs="+", default=[0.0])
    parser.add_argument("--rows", type=Path, help="JSON lines to keep, and to go on from")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    done: list[Row] = []
    if args.rows and args.rows.exists():
        done = [json.loads(line) for line in args.rows.read_text().splitlines()]
    kept = {tuple(row[name] for name in KEYS): row for row in done}
    print("| scene | cameras | photons | method | offset std, ps | emission | right | rms, mm "
          "| / bound | pull | t/c/c | CPU, s |")  # fmt: skip
    print("|---|---:|---:|---|---:|---|---:|---:|---:|---:|---:|---:|", flush=True)
    cells = [
        (scene, cameras, photons, emission == "known", offset, method)
        for scene in args.scenes
        for offset in args.offset_std_ps
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
