"""Bent legs, found untold or begun from a rough start, against the bound of a marched curve.

    python benchmarks/bends.py                            # 10 recordings a cell, joint, untold
    python benchmarks/bends.py --told start --methods joint photon
    python benchmarks/bends.py --only 3_picture --sagitta 1
    python benchmarks/bends.py --straight 400             # straight legs: how many are called bent
    python benchmarks/bends.py --airy 10                  # the paper's self-bending beam, in depth
    python benchmarks/bends.py --drawn 20                 # a drawn fibre, and the index along it
    python benchmarks/bends.py --lengths 20               # legs of told length, and the index
    python benchmarks/bends.py --rows rows.jsonl          # keep rows, and go on from there

Scenes are those of `tests/oracles/bent.py`: one leg, or the paper's three whose first is bent, by
1, 5 or 20 mm over the field of view of 245 mm, in the picture or in depth; 40,000 photons in the
brightest pixel, ideal codes of 55 ps, source and emission time known. Printed: recordings whose
right leg came out bent and no other; rms error of the position in view over the Cramér-Rao bound
of the true curve (an independent forward model, differentiated; the plausible sagitta as prior)
with its 95 % interval (bootstrap over recordings); stated error over the bound; rms pull of the
place in the middle of the bent leg's view; verdicts; CPU seconds of the middle one. `--told start`
begins at 0.85 of the true sagitta and 2 mm beside the true vertices, `--told "may bend"` says so.
`--drawn` tells the curve by 21 measured places, and an index of 1.44 +- 0.05 for one of 1.47;
`--lengths` that legs may bend, the same index, and how long one leg is, to 0.2 mm, or not.
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
from numpy.typing import NDArray

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.refraction import Row, interval
from lightflight.path.bends import Bend
from lightflight.path.tables import Goodness
from lightflight.reconstruct.model.geometry import PathState
from tests.oracles.bent import (
    BentScene,
    arc_scene,
    axes_of_leg,
    bent_scene,
    bow_freedoms,
    fibre_in_view,
    measured_places,
)
from tests.oracles.refracted import RefractedScene, in_picture, paper_scene, positions_at
from tests.oracles.refracted_border import histograms, what_the_user_tells
from tests.oracles.refracted_bound import bound

CELLS = {f"{legs}_{way}": (legs, way) for legs in (1, 3) for way in ("picture", "depth")}
SAGITTAS_MM = (1.0, 5.0, 20.0)
KEYS = ("cell", "sagitta", "photons", "method", "told", "seed")


@cache
def scene_of(cell: str, sagitta: float, photons: float) -> BentScene:
    legs, way = CELLS[cell]
    return bent_scene(legs=legs, sagitta_mm=sagitta, way=way, photons=photons)


@cache
def bound_mm(cell: str, sagitta: float, photons: float) -> float:
    """Least rms error of the position in view, one shape of the bend free in both directions."""
    scene = scene_of(cell, sagitta, photons)
    return bound(scene, also=bow_freedoms(scene)).position_rms_mm


def rough_start(scene: BentScene, call: Row, seed: int) -> lf.LightPath:
    """The true path with its vertices off by 2 mm and its bends by 15 %."""
    rng = np.random.default_rng([seed, 29])
    vertices = np.array(scene.vertices_mm)
    vertices[1:] += rng.normal(0.0, 2.0, vertices[1:].shape)
    bends = []
    for leg, vectors in scene.bows_mm.items():
        axes = np.stack(axes_of_leg(scene, leg))
        bends.append(Bend(leg, axes, 0.85 * axes @ vectors.T))
    state = PathState(vertices, scene.emission_time_ps, bends=tuple(bends))
    n = 4 * len(vertices)
    return lf.LightPath(
        vertices, state.vertex_times_ps(call["medium"]), np.zeros((n, n)), camera=call["camera"],
        source=call["source"], medium=call["medium"], bends=tuple(bends),
        goodness=Goodness(0.0, 0, 0, 0, 0.0, 0.0, False),
    )  # fmt: skip


def errors_of(path: lf.LightPath, scene: BentScene) -> Row:
    """Mean squared error of the position in view and as stated, mm^2, and a squared pull."""
    ends = scene.vertex_times_ps
    times = np.linspace(ends[0], ends[-1], 1000)
    true, told = positions_at(scene, times), path.position_at(times)
    seen = in_picture(scene, true) & np.isfinite(told[:, 0])
    off, covariance = (told - true)[seen], path.position_covariance_at(times[seen])
    bent = np.flatnonzero(times[seen] < ends[1])
    middle = bent[len(bent) // 2]
    variance, axes = np.linalg.eigh(covariance[middle])
    # Along the beam a known source and time leave all but nothing open.
    open_ = variance > 1e-6 * variance.max()
    pull2 = np.mean((axes.T @ off[middle])[open_] ** 2 / variance[open_])
    stated = np.trace(covariance, axis1=1, axis2=2)
    return {
        "error2": float(np.sum(off**2, axis=1).mean()),
        "stated2": float(stated.mean()),
        "pull2": float(pull2),
    }


def result_of(cell: str, sagitta: float, photons: float, method: str, told: str, seed: int) -> Row:
    """One recording."""
    scene = scene_of(cell, sagitta, photons)
    hist = histograms(scene, seed)
    call = what_the_user_tells(scene, hist)
    if told == "start":
        call["start"] = rough_start(scene, call, seed)
    if told == "may bend":
        call["free"] = ("bend",)
    row: Row = dict(zip(KEYS, (cell, sagitta, photons, method, told, seed), strict=True))
    begun = time.process_time()
    try:
        path = lf.reconstruct(hist, method=method, **call)
    except (ValueError, RuntimeError) as refused:
        return row | {"says": f"{type(refused).__name__}: {refused}"}
    row |= {"cpu_s": time.process_time() - begun, "level": str(path.verdict.level)}
    row |= {"named": [str(one.name) for one in path.verdict.findings]}
    row |= {"legs": path.n_legs, "bent": [bend.leg for bend in path.bends]}
    row["found"] = path.n_legs == scene.n_legs and row["bent"] == [0]
    if not row["found"]:
        return row
    return row | errors_of(path, scene) | {"bound": bound_mm(cell, sagitta, photons)}


def line_of(own: list[Row]) -> str:
    """A row of the table."""
    right = [row for row in own if "error2" in row]
    cells = [own[0]["cell"], f"{own[0]['sagitta']:g}", own[0]["method"], f"{len(right)}/{len(own)}"]
    if right:
        error2, stated2, least, pull2 = (
            np.array([row[key] for row in right]) for key in ("error2", "stated2", "bound", "pull2")
        )
        cells += [interval(error2 / least**2, 1.0), interval(stated2 / least**2, 1.0)]
        cells += [interval(pull2, 1.0)]
    else:
        cells += ["", "", ""]
    levels = [
        str(sum(row.get("level") == level for row in own))
        for level in ("trust", "check", "contradicted")
    ]
    cpu = np.median([row.get("cpu_s", np.nan) for row in own])
    return "| " + " | ".join([*cells, "/".join(levels), f"{cpu:.1f}"]) + " |"


def straight(n: int, photons: float) -> None:
    """Print how many recordings of the paper's three straight legs are called bent."""
    scene, bent = replace(paper_scene(), photons=photons), 0
    levels: dict[str, int] = {}
    for seed in range(1000, 1000 + n):
        hist = histograms(scene, seed)
        path = lf.reconstruct(hist, **what_the_user_tells(scene, hist))
        bent += bool(path.bends)
        levels[str(path.verdict.level)] = levels.get(str(path.verdict.level), 0) + 1
    # Nothing in n: with 95 % no more than 3 in n.
    most = f", at most {3.0 / n:.2%} (95 %)" if bent == 0 else ""
    print(f"{bent} of {n} recordings of straight legs called bent{most}; verdicts {levels}")


def airy(n: int, bend_mm: float) -> None:
    """Print the error of the paper's self-bending beam, one bent leg, over its bound."""
    from lightflight.demo import known_source
    from lightflight.path.on_bends import drawn
    from studies.zheng2020.bending import bent_scene as airy_scene, curve_error_mm
    from studies.zheng2020.laboratory import calibrated_clock, recorded

    scene = airy_scene(bend_mm)
    places = np.asarray(scene.vertices_mm, dtype=float)
    base = bent_scene(legs=1, sagitta_mm=1.0, way="depth")
    # z = b (x / 245)^2 is the line from end to end less a dome of a quarter of its height.
    bow = np.array([[0.0, 0.0, -0.25 * (places[-1, 2] - places[0, 2])]])
    center = np.asarray(scene.camera.center_mm)
    eye = replace(base.camera, center=center)
    true = replace(base, vertices_mm=places[[0, -1]], bows_mm={0: bow}, camera=eye)
    least = bound(true, also=bow_freedoms(true)).position_rms_mm
    errors, bent = [], 0
    for seed in range(n):
        path = lf.reconstruct(
            recorded(scene, seed=7_000_000 * (seed + 1)), camera=scene.camera,
            source=known_source(scene), medium=scene.medium,
            timing=calibrated_clock("codes", seed=seed), free=("bend",),
        )  # fmt: skip
        bent += path.n_legs == 1 and len(path.bends) == 1
        errors.append(curve_error_mm(drawn(path)[0], scene))
        print(f"{seed}: {path.n_legs} leg, {errors[-1]:.4f} mm, {path.verdict.level}", flush=True)
    rms, ratio = np.sqrt(np.mean(np.square(errors))), interval(np.square(errors), least)
    print(f"{bent} of {n} one bent leg; rms {rms:.4f} mm; bound {least:.4f} mm (ideal clock)")
    print(f"error / bound {ratio}")


DRAWN: dict[str, tuple[Row, str]] = {
    "0.3": ({"std_mm": 0.3}, "exact"),
    "0.3, source unknown": ({"std_mm": 0.3}, "unknown"),
    "0.3, of a whole 2 mm and 3 deg off": (
        {"std_mm": 0.3, "shift_mm": 2.0, "turn_deg": 3.0}, "unknown",
    ),
    "0.001": ({"std_mm": 0.001}, "exact"),
}  # fmt: skip
"""Errors of measured places, mm, and what is known of the source."""


INDEX = 1.47
"""Of all fibres."""


def told_of_fibre(scene: RefractedScene, hist: lf.Histograms) -> Row:
    """What is told of a fibre whose index is known to 0.05, beside how it lies."""
    call = what_the_user_tells(scene, hist)
    back = call["medium"].return_group_index
    medium = lf.Medium(1.44, back, path_group_index_std=0.05, index_correlation=0.0)
    return call | {"medium": medium}


def index_of(path: lf.LightPath) -> Row:
    """What is said of the index, and how far it is off."""
    off = path.medium.path_group_index - INDEX
    return {
        "index2": (off / path.group_index_std) ** 2,
        "std": path.group_index_std,
        "level": str(path.verdict.level),
    }


def column(rows: list[Row], key: str) -> NDArray[np.float64]:
    """One key of all rows."""
    return np.array([row[key] for row in rows], dtype=float)


def levels_of(rows: list[Row]) -> str:
    """How many are trusted, to be checked, contradicted."""
    each = ("trust", "check", "contradicted")
    return "/".join(str(sum(row["level"] == one for row in rows)) for one in each)


def lengths(n: int, photons: float, methods: list[str]) -> None:
    """Print what a told length, 0.2 mm uncertain, says of legs and of their index."""
    three = replace(paper_scene(), path_group_index=INDEX, photons=photons)
    fibres = {way: fibre_in_view(way, photons=photons) for way in ("picture", "depth")}
    print("| scene | length | method | n | error / stated of the index | stated | pull of a corner "
          "or end | error, mm | trust/check/contradicted |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    for name, scene in {"three legs": three, **fibres}.items():
        leg = 1 if scene is three else 0
        more: Row = {} if scene is three else {"free": ("bend",), "n_legs": 1}
        true = np.asarray(scene.vertices_mm[1], dtype=float)
        for told, method in product((False, True), methods):
            rows = []
            for seed in range(4000, 4000 + n):
                hist = histograms(scene, seed)
                measured = scene.leg_lengths_mm[leg] + 0.2 * np.random.default_rng(seed).normal()
                length = [(leg, measured, 0.2)] if told else []
                path = lf.reconstruct(
                    hist, method=method, lengths=length, **told_of_fibre(scene, hist), **more
                )
                off = path.vertices_mm[1] - true
                pull2 = off @ np.linalg.solve(path.covariance[4:7, 4:7], off) / 3.0
                rows.append(index_of(path) | {"pull2": pull2, "error2": off @ off})
            cells = [
                name, "± 0.2 mm" if told else "not told", method, str(n),
                interval(column(rows, "index2"), 1.0), f"{np.median(column(rows, 'std')):.4f}",
                interval(column(rows, "pull2"), 1.0),
                f"{np.sqrt(column(rows, 'error2').mean()):.2f}", levels_of(rows),
            ]  # fmt: skip
            print("| " + " | ".join(cells) + " |", flush=True)


def drawn(n: int) -> None:
    """Print what is found of a fibre on a circle, drawn from 21 places, its index told +- 0.05."""
    print("| places, mm | curve | n | error / stated of the index | stated | rms error in view, mm "
          "| stated | pull | trust/check/contradicted |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    for name, (errors, source) in DRAWN.items():
        for way in ("depth", "picture"):
            scene, rows = arc_scene(sagitta_mm=20.0, way=way, index=INDEX), []
            for seed in range(2000, 2000 + n):
                hist = histograms(scene, seed)
                call = told_of_fibre(scene, hist)
                if source == "unknown":
                    call["source"] = lf.Source()
                curve = lf.DrawnCurve(
                    measured_places(scene, 0, seed, **errors), point_std_mm=errors["std_mm"],
                    position_std_mm=errors.get("shift_mm", 0.0),
                    turn_std_deg=errors.get("turn_deg", 0.0),
                )  # fmt: skip
                path = lf.reconstruct(hist, curves=[curve], **call)
                rows.append(errors_of(path, scene) | index_of(path))
            rms = {key: np.sqrt(column(rows, key).mean()) for key in ("error2", "stated2")}
            cells = [
                name, way, str(n), interval(column(rows, "index2"), 1.0),
                f"{np.median(column(rows, 'std')):.5f}", f"{rms['error2']:.3f}",
                f"{rms['stated2']:.3f}", interval(column(rows, "pull2"), 1.0), levels_of(rows),
            ]  # fmt: skip
            print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--only", nargs="+", choices=CELLS, default=list(CELLS))
    parser.add_argument("--sagitta", nargs="+", type=float, default=list(SAGITTAS_MM))
    parser.add_argument("--photons", type=float, default=40_000.0)
    parser.add_argument("--methods", nargs="+", default=["joint"])
    parser.add_argument("--told", choices=("nothing", "may bend", "start"), default="nothing")
    parser.add_argument("--straight", type=int, metavar="N", help="N recordings of straight legs")
    parser.add_argument("--airy", type=int, metavar="N", help="N recordings of the Airy beam")
    parser.add_argument("--drawn", type=int, metavar="N", help="N recordings of a drawn fibre")
    parser.add_argument("--lengths", type=int, metavar="N", help="N recordings of told lengths")
    parser.add_argument("--rows", type=Path)
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    if chosen.straight:
        straight(chosen.straight, chosen.photons)
        return
    if chosen.drawn:
        drawn(chosen.drawn)
        return
    if chosen.lengths:
        lengths(chosen.lengths, chosen.photons, chosen.methods)
        return
    if chosen.airy:
        airy(chosen.airy, 5.0)
        return
    kept = chosen.rows.read_text().splitlines() if chosen.rows and chosen.rows.exists() else []
    rows = {tuple(row[key] for key in KEYS): row for row in map(json.loads, kept)}
    print("| scene | sagitta, mm | method | found | error / bound | stated / bound | pull | "
          "trust/check/contradicted | CPU, s |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    for cell in chosen.only:
        for sagitta in chosen.sagitta:
            for method in chosen.methods:
                own = []
                for seed in range(chosen.runs):
                    case = (cell, sagitta, chosen.photons, method, chosen.told, seed)
                    if case not in rows:
                        rows[case] = result_of(*case)
                        if chosen.rows:
                            with chosen.rows.open("a") as file:
                                file.write(json.dumps(rows[case]) + "\n")
                    own.append(rows[case])
                print(line_of(own), flush=True)


if __name__ == "__main__":
    main()
