"""False alarms and detections of the verdict, on worlds of the tests' own forward model.

    python benchmarks/verdict.py                                   # both tables, small
    python benchmarks/verdict.py --only undisturbed --first 200 --runs 48 --json out/trust.jsonl
    python benchmarks/verdict.py --only defects --runs 10 --cells barrel,index --strength 1
    python benchmarks/verdict.py --only defects --held-out --apart --runs 1 --first 7000
                                                                   # the defects kept back
    python benchmarks/verdict.py --only turns --runs 6 --first 700  # light that turns by little

undisturbed  worlds with nothing wrong, by number of legs, photons, prior and estimator: share of
             "trust" with its 95 % interval (Clopper-Pearson), the chance (Kolmogorov-Smirnov) that
             the p-values are uniform, their median, and the median CPU of the verdict over that
             of the same `reconstruct` without it
defects      worlds with one thing wrong: share seen, share in which the cause is named first and
             among those that cannot be told apart, size of that group, and how many are wrong by
             more than three stated errors and 0.3 mm with "trust"; these one by one, with the
             sigma at which the oracle's Fisher information shows their defect, all that is told as
             uncertain free, and whether `blind_to` names it; and how many of the wrong ones that
             show at 6 sigma or more are trusted, with the 95 % interval of that share. Defects
             without a small part (another camera) are counted apart.

turns        worlds with nothing wrong whose light turns by a few degrees in the picture, by prior
             and estimator: number of legs right, "trust"

Seeds are fixed: run k of a cell is world `--first` + k; `--apart` gives each cell worlds of its own
and draws their order, so that a run that is stopped is a fair sample. `--json` holds one line for
each recording; a run that was cut short goes on from there.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta, kstest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import lightflight as lf
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS, defects
from tests.oracles.worlds.fisher import as_told, fisher
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import World

PRIORS = ("known", "lab")
TURNS_DEG = (3.0, 6.0, 12.0, 20.0)
WRONG_STDS, WRONG_MM = 3.0, 0.3
SHOWN_SIGMA = 6.0
"""Defects that the oracle's Fisher information shows as clearly as this are to be seen."""
SMALL = 0.002
"""Of a defect's strength: counts are straight in so much of it (not in a twentieth: light that is
even moves with a source, and codes that grow pass the end of the period)."""

Cell = dict[str, Any]


def undisturbed_cells(seeds: range, methods: list[str]) -> Iterator[Cell]:
    for method, n_legs, photons, prior in product(methods, (1, 3), (40_000.0, 400.0), PRIORS):
        for seed in seeds:
            yield {
                "table": "undisturbed", "defect": "", "strength": 0.0, "method": method,
                "n_legs": n_legs, "photons": photons, "prior": prior, "seed": seed,
            }  # fmt: skip


def defect_cells(
    seeds: range, names: list[str], strengths: list[int], legs: list[int], methods: list[str]
) -> Iterator[Cell]:
    for name, k, n_legs, prior, method in product(names, strengths, legs, PRIORS, methods):
        for seed in seeds:
            yield {
                "table": "defects", "defect": name, "strength": DEFECTS[name].strengths[k],
                "method": method, "n_legs": n_legs, "photons": 40_000.0, "prior": prior,
                "seed": seed,
            }  # fmt: skip


def turn_cells(seeds: range, methods: list[str]) -> Iterator[Cell]:
    for method, turn_deg, prior in product(methods, TURNS_DEG, PRIORS):
        for seed in seeds:
            yield {
                "table": "turns", "turn_deg": turn_deg, "defect": "", "method": method, "n_legs": 2,
                "photons": 40_000.0, "prior": prior, "seed": seed,
            }  # fmt: skip


def apart(cells: list[Cell]) -> list[Cell]:
    """Each cell in a world of its own, in an order drawn once."""
    own = [{**cell, "seed": cell["seed"] + number} for number, cell in enumerate(cells)]
    return [own[k] for k in np.random.default_rng(14).permutation(len(own))]


def world_of(cell: Cell) -> World:
    world = random_world(cell["seed"], cell["n_legs"], cell["photons"], cell["prior"])
    if cell["table"] == "turns":
        return turning(world, cell["turn_deg"], cell["seed"])
    if not cell["defect"]:
        return world
    return DEFECTS[cell["defect"]].applied(world, cell["strength"])


def turning(world: World, turn_deg: float, seed: int) -> World:
    """Its first leg with a corner in the middle, anywhere about it, and no more."""
    start, end = world.vertices[:2]
    length = float(np.linalg.norm(end - start))
    along, aside = (end - start) / length, np.random.default_rng(seed).normal(size=3)
    aside -= aside @ along * along
    aside *= np.tan(np.radians(turn_deg / 2)) * length / 2 / np.linalg.norm(aside)
    return world.but(vertices=np.array([start, (start + end) / 2 + aside, end]))


def result_of(cell: Cell) -> Cell:
    """One recording made, reconstructed and compared with its world."""
    world = world_of(cell)
    told = what_the_user_tells(world)
    hist = record(world, cell["seed"])
    start, spent = time.process_time(), VERDICTS.cpu_s
    try:
        path = lf.reconstruct(hist, method=cell["method"], **told)
    except (ValueError, RuntimeError) as refused:
        return {"outcome": "refused", "says": f"{type(refused).__name__}: {refused}"}
    cpu, verdict_cpu = time.process_time() - start, VERDICTS.cpu_s - spent
    error_mm, stds = worst_error(path, world)
    verdict = path.verdict
    return {
        "outcome": str(verdict.level),
        "named": [str(finding.name) for finding in verdict.findings],
        "blind_to": sorted({str(spot.name) for spot in verdict.blind_to}),
        "p_value": verdict.p_value,
        "n_legs_found": path.n_legs,
        "error_mm": error_mm,
        "stds": stds,
        "cpu_s": cpu,
        "verdict_share": verdict_cpu / max(cpu - verdict_cpu, 1e-9),
    }


class Timed:
    """A function, and the CPU seconds that all its calls have taken."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.cpu_s = function, 0.0

    def __call__(self, *given: Any, **named: Any) -> Any:
        """Call the function."""
        start = time.process_time()
        try:
            return self.function(*given, **named)
        finally:
            self.cpu_s += time.process_time() - start


CHAIN: Any = importlib.import_module("lightflight.reconstruct.answer")
CHAIN.examined = VERDICTS = Timed(CHAIN.examined)


def worst_error(path: lf.LightPath, world: World) -> tuple[float, float]:
    """Largest error of a corner, mm and in stated errors; of one leg: of its direction.

    Infinite where the number of legs is wrong. The ends lie where the view says.
    """
    if path.n_legs != world.n_legs:
        return float("inf"), float("inf")
    if world.n_legs == 1:
        step = world.vertices[1] - world.vertices[0]
        slope = np.degrees(np.arcsin(step @ path.camera.backward_axis / np.linalg.norm(step)))
        off = abs(path.legs[0].angle_deg - slope)
        in_mm = float(np.radians(off) * np.linalg.norm(step))
        return in_mm, float(off / max(path.legs[0].angle_std_deg, 1e-12))
    off = np.abs(path.vertices_mm - world.vertices)[1:-1]
    return float(off.max()), float((off / np.maximum(path.vertex_std[1:-1, :3], 1e-9)).max())


def wrong(row: Cell) -> bool:
    return bool(
        row["outcome"] != "refused" and row["stds"] > WRONG_STDS and row["error_mm"] > WRONG_MM
    )


def print_undisturbed(rows: list[Cell]) -> None:
    head = f"{'n':>5s} {'trust':>20s} {'contr.':>6s} {'KS p':>7s} {'median':>6s} {'cpu':>5s}"
    print(f"{'undisturbed':30s} {head}")
    for key in dict.fromkeys(key_of(row) for row in rows):
        print_trust(key, [row for row in rows if key_of(row) == key])
    print_trust("all", rows)


def print_turns(rows: list[Cell]) -> None:
    print(f"{'turns by':30s} {'n':>5s} {'legs right':>10s} {'trust':>6s}")
    for key in dict.fromkeys((row["turn_deg"], row["prior"], row["method"]) for row in rows):
        own = [row for row in rows if (row["turn_deg"], row["prior"], row["method"]) == key]
        right = sum(row.get("n_legs_found") == 2 for row in own)
        trusted = sum(row["outcome"] == "trust" for row in own)
        name = f"{key[0]:g} deg {key[1]} {key[2]}"
        print(f"{name:30s} {len(own):5d} {right:10d} {trusted:6d}")


def print_trust(key: str, rows: list[Cell]) -> None:
    p_values = [row["p_value"] for row in rows if np.isfinite(row.get("p_value", np.nan))]
    uniform = kstest(p_values, "uniform").pvalue if p_values else float("nan")
    n, trusted = len(rows), sum(row["outcome"] == "trust" for row in rows)
    low, high = interval(trusted, n)
    against = sum(row["outcome"] == "contradicted" for row in rows)
    cpu = np.nanmedian([row.get("verdict_share", np.nan) for row in rows])
    middle = np.median(p_values) if p_values else float("nan")
    print(
        f"{key:30s} {n:5d} {trusted / n:5.3f} [{low:.3f}, {high:.3f}] {against:6d} {uniform:7.2g} "
        f"{middle:6.2f} {cpu:5.2f}"
    )


def print_defects(rows: list[Cell]) -> None:
    head = ("n", "seen", "first", "group", "size", "silent")
    print(f"{'defect':58s} " + " ".join(f"{word:>6s}" for word in head))
    for key in dict.fromkeys(key_of(row) for row in rows):
        own = [row for row in rows if key_of(row) == key]
        finding = DEFECTS[own[0]["defect"]].finding
        named = [row.get("named", []) for row in own]
        seen = sum(row["outcome"] != "trust" for row in own)
        first = sum(names[:1] == [finding] for names in named)
        among = sum(finding in names for names in named)
        size = float(np.median([len(names) for names in named]))
        silent = sum(wrong(row) and row["outcome"] == "trust" for row in own)
        print(f"{key:58s} {len(own):6d} {seen:6d} {first:6d} {among:6d} {size:6.1f} {silent:6d}")


def print_silent(rows: list[Cell]) -> None:
    """How many of the wrong are trusted, and what the oracle says of these."""
    off = [row for row in rows if wrong(row)]
    sigmas = [row["sigma"] if "sigma" in row else sigma_of(row) for row in off]
    silent = [row["outcome"] == "trust" for row in off]
    print()
    print_share("wrong", silent)
    clear = [sigma >= SHOWN_SIGMA for sigma in sigmas]
    print_share(f"wrong at {SHOWN_SIGMA:g} sigma or more", np.compress(clear, silent).tolist())
    print_share("wrong, no small part", np.compress(np.isnan(sigmas), silent).tolist())
    for row, sigma in zip(off, sigmas, strict=True):
        if row["outcome"] != "trust":
            continue
        told = DEFECTS[row["defect"]].finding in row["blind_to"]
        print(
            f"{key_of(row):58s} {row['error_mm']:7.2f} mm {row['stds']:6.1f} stated errors, oracle "
            f"{sigma:5.1f} sigma, {'' if told else 'not '}in blind_to"
        )


def print_share(name: str, silent: Sequence[bool]) -> None:
    n, trusted = len(silent), int(np.sum(silent))
    if n:
        low, high = interval(trusted, n)
        print(f"{name}: {n}, trusted {trusted} = {trusted / n:.3f} [{low:.3f}, {high:.3f}]")


def interval(k: int, n: int) -> tuple[float, float]:
    """Clopper and Pearson's, 95 %, of a share of which k of n were seen."""
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return float(low), float(high)


def sigma_of(cell: Cell) -> float:
    """At how many sigma a recording shows the defect, to first order, all that is free fitted."""
    defect = DEFECTS[cell["defect"]]
    if set("|/") & set(defect.unit) or defect.unit in ("camera", "legs"):
        return float("nan")  # A place in a list or an exchange has no small part.
    base = as_told(random_world(cell["seed"], cell["n_legs"], cell["photons"], cell["prior"]))
    small = defect.applied(base, cell["strength"] * SMALL)
    return fisher(as_told(small, base)).seen_at(small) / SMALL


def key_of(row: Cell) -> str:
    defect = f"{row['defect']} {row['strength']:g} " if row["defect"] else ""
    return f"{defect}{row['n_legs']} legs {row['photons']:g} {row['prior']} {row['method']}"


def finished(file: Path | None) -> list[Cell]:
    if file is None or not file.exists():
        return []
    return [json.loads(line) for line in file.read_text("utf-8").splitlines() if line]


def run(cells: list[Cell], file: Path | None) -> list[Cell]:
    """Rows of all cells; those that the file holds are not done again."""
    done = {json.dumps([row[name] for name in cells[0]]): row for row in finished(file)}
    rows = []
    for cell in cells:
        row = done.get(json.dumps(list(cell.values())))
        if row is None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                row = {**cell, **result_of(cell)}
                if cell["defect"] and wrong(row):
                    row["sigma"] = sigma_of(row)
            if file is not None:
                with file.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(row) + "\n")
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", choices=("undisturbed", "defects", "turns"))
    parser.add_argument("--runs", type=int, default=3, help="recordings of each cell")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--methods", default="joint,photon")
    parser.add_argument("--cells", default="", help="names of defects, by comma; all")
    parser.add_argument("--strength", type=int, choices=(0, 1, 2), help="which of three; all")
    parser.add_argument("--legs", default="1,3")
    parser.add_argument("--held-out", action="store_true", help="the defects that are kept back")
    parser.add_argument("--apart", action="store_true", help="each cell in worlds of its own")
    parser.add_argument("--json", type=Path, help="one line for each recording; goes on from there")
    options = parser.parse_args()
    names = options.cells.split(",") if options.cells else []
    names = names or [defect.name for defect in defects(held_out=options.held_out)]
    strengths = [0, 1, 2] if options.strength is None else [options.strength]
    legs = [int(n) for n in options.legs.split(",")]
    methods = options.methods.split(",")
    seeds = range(options.first, options.first + options.runs)
    if options.only == "turns":
        print_turns(run(list(turn_cells(seeds, methods)), options.json))
        return
    if options.only != "defects":
        print_undisturbed(run(list(undisturbed_cells(seeds, methods)), options.json))
    if options.only != "undisturbed":
        cells = list(defect_cells(seeds, names, strengths, legs, methods))
        rows = run(apart(cells) if options.apart else cells, options.json)
        print_defects(rows)
        print_silent(rows)


if __name__ == "__main__":
    main()
