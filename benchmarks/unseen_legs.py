"""Flights that leave the picture and come back over mirrors nobody sees, against their bound.

    python benchmarks/unseen_legs.py                              # 50 scenes, joint
    python benchmarks/unseen_legs.py --photons 40000 --methods joint photon
    python benchmarks/unseen_legs.py --rows rows.jsonl            # keep rows, and go on from there

Scenes are those of `tests/oracles/unseen_ways.py`, each drawn by its own seed: a roof mirror or a
corner cube beside the picture, two or three legs in it, source and emission time known, ideal codes
of 55 ps. Printed: scenes whose seen legs came in the right order with one stretch unseen; rms error
of the position in view over the Cramér-Rao bound of the broken path (each scene over its own, rms)
with its 95 % interval (bootstrap over scenes); rms pull of the unseen delay; verdicts ("trust" is
always wrong here); CPU seconds of the middle one.
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
from benchmarks.refraction import Row, interval
from lightflight.path.gaps import Gap
from tests.oracles.refracted import in_picture, positions_at
from tests.oracles.refracted_border import camera_told, histograms
from tests.oracles.refracted_bound import bound
from tests.oracles.unseen_ways import UnseenWay, roof_or_cube

KEYS = ("photons", "method", "seed")


@cache
def bound_mm(photons: float, seed: int) -> float:
    """Least rms error of the position in view, all mirrors unknown."""
    return bound(roof_or_cube(seed, photons=photons).scene).position_rms_mm


def found_its_gap(path: lf.LightPath, way: UnseenWay) -> bool:
    """Whether the seen legs are there in their order, and one stretch between the right two."""
    if len(path.unseen_legs) != 1 or path.n_legs - 1 != len(way.seen):
        return False
    if path.unseen_legs[0] != way.unseen[0]:
        return False
    seen = [leg for leg in path.legs if leg.seen]
    true = [np.diff(way.scene.vertices_mm, axis=0)[k] for k in way.seen]
    # A leg that flies another way is another leg; 5 degrees are many errors.
    turns = [
        leg.direction @ step / np.linalg.norm(step) for leg, step in zip(seen, true, strict=True)
    ]
    return bool(min(turns) > np.cos(np.deg2rad(5.0)))


def true_delay_ps(gap: Gap, way: UnseenWay) -> float:
    """Between the two places that a path names, on the true light's clock."""
    vertices, times = way.scene.vertices_mm, way.scene.vertex_times_ps

    def when(place_mm: np.ndarray, leg: int) -> float:
        step = vertices[leg + 1] - vertices[leg]
        # Seen from the camera: the point of the leg on the ray through the place.
        away = place_mm - way.scene.camera.center
        ray = away / np.linalg.norm(away)
        across = step - (step @ ray) * ray
        offset = way.scene.camera.center - vertices[leg]
        share = float(offset @ across) / float(step @ across)
        return float(times[leg] + share * (times[leg + 1] - times[leg]))

    again = when(gap.seen_again_mm, way.unseen[-1] + 1)
    return again - when(gap.last_seen_mm, way.unseen[0] - 1)


def error2_in_view(path: lf.LightPath, way: UnseenWay) -> tuple[float, float]:
    """Mean squared error of the position in view, and as stated; mm^2."""
    scene = way.scene
    times = np.linspace(scene.vertex_times_ps[0], scene.vertex_times_ps[-1], 1000)
    true = positions_at(scene, times)
    # Where an end of the path cuts the light off the last hair is not compared.
    told = path.position_at(times)
    both = in_picture(scene, true) & np.isfinite(told[:, 0])
    stated = np.trace(path.position_covariance_at(times[both]), axis1=1, axis2=2)
    return float(np.sum((told - true)[both] ** 2, axis=1).mean()), float(stated.mean())


def result_of(photons: float, method: str, seed: int) -> Row:
    """One scene."""
    way = roof_or_cube(seed, photons=photons)
    scene, hist = way.scene, histograms(way.scene, seed)
    source = lf.Source(tuple(scene.vertices_mm[0]), emission_time_ps=scene.emission_time_ps)
    row: Row = dict(zip(KEYS, (photons, method, seed), strict=True))
    start = time.process_time()
    try:
        path = lf.reconstruct(
            hist, camera=camera_told(scene), source=source,
            timing=lf.TimingCalibration.nominal(hist), method=method,
        )  # fmt: skip
    except (ValueError, RuntimeError) as refused:
        return row | {"says": f"{type(refused).__name__}: {refused}"}
    row |= {"cpu_s": time.process_time() - start, "level": str(path.verdict.level)}
    row |= {"named": [str(one.name) for one in path.verdict.findings]}
    row |= {"found": found_its_gap(path, way)}
    if not row["found"]:
        return row
    gap = path.gaps[0]
    error2, stated2 = error2_in_view(path, way)
    least = bound_mm(photons, seed)
    delay = {"delay_ps": gap.delay_ps, "delay_std_ps": gap.delay_std_ps}
    pull = (gap.delay_ps - true_delay_ps(gap, way)) / gap.delay_std_ps
    return row | delay | {"error2": error2, "stated2": stated2, "bound": least, "pull": pull}


def line_of(own: list[Row]) -> str:
    """A row of the table."""
    right = [row for row in own if "error2" in row]
    cells = [f"{own[0]['photons']:g}", own[0]["method"], f"{len(right)}/{len(own)}"]
    if right:
        error2, stated2, least, pull = (
            np.array([row[key] for row in right]) for key in ("error2", "stated2", "bound", "pull")
        )
        cells += [interval(error2 / least**2, 1.0), interval(stated2 / least**2, 1.0)]
        cells += [interval(pull**2, 1.0)]
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
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--first", type=int, default=26_000, help="first seed")
    parser.add_argument("--photons", type=float, nargs="+", default=[4_000.0])
    parser.add_argument("--methods", nargs="+", default=["joint"])
    parser.add_argument("--rows", type=Path, help="JSON lines to keep, and to go on from")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    done: list[Row] = []
    if args.rows and args.rows.exists():
        done = [json.loads(line) for line in args.rows.read_text().splitlines()]
    kept = {tuple(row[name] for name in KEYS): row for row in done}
    print("| photons | method | found | error / bound | stated / bound | pull of the delay "
          "| t/c/c | CPU, s |")  # fmt: skip
    print("|---:|---|---:|---:|---:|---:|---:|---:|", flush=True)
    for photons in args.photons:
        for method in args.methods:
            own = []
            for seed in range(args.first, args.first + args.runs):
                key = (photons, method, seed)
                if key not in kept:
                    kept[key] = result_of(*key)
                    if args.rows:
                        with args.rows.open("a") as file:
                            file.write(json.dumps(kept[key]) + "\n")
                own.append(kept[key])
            print(line_of(own), flush=True)


if __name__ == "__main__":
    main()
