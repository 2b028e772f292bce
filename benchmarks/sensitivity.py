"""What each named number of finding, fitting and judging does where it is 30 % larger or smaller.

    python benchmarks/sensitivity.py                      # 24 scenes, all numbers, 200 for some
    python benchmarks/sensitivity.py --only legs/ --scenes 24       # those of files with this word
    python benchmarks/sensitivity.py --table              # of what was run so far; runs nothing
    python benchmarks/sensitivity.py --list               # numbers and their groups; runs nothing

A number is a constant of a module, or a field of a record, in the rooms of `tools/deciding.py`; the
entries of a table, and what `TOGETHER` names, are of one origin and move together. Whole numbers
move by one at least, shares near 1 by their distance from 1. Each move has a process of its own, in
which the text of the module is read with the other number: copies by `from x import NAME`, defaults
and what is worked out from it at import follow. Half of the scenes have nothing wrong (1 to 6 legs,
40,000 to 400 photons), half are worlds of `tests/oracles/worlds` that the user does not tell of.
They are used for no figure (seeds from 90,000 on). Numbers that moved anything are tried again on
200 scenes. Errors are whitened by the Cramer-Rao bound, as in `other_light.py`.

legs            scenes with the right number of legs, before and after
error / bound   median over the scenes with the right number both times, before and after
moved           scenes whose error changed by more than a tenth of the bound
verdict         scenes whose verdict has another level

Everything is kept in `--folder`; a run that was cut short goes on from there, as long as the code
is the same.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import importlib.abc
import importlib.machinery
import json
import os
import pickle
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from deciding import ROOMS, Number, literals_in, numbers_of  # noqa: E402

from benchmarks import reached  # noqa: E402

FACTORS = (0.7, 1.3)
N_FIRST, N_SECOND = 24, 200
FIRST_SEED = 90_000
MOVED_AT = 0.1
"""Of the bound: what moves an error by less does not move it."""

TOGETHER = {
    "how far a leg's light reaches": (
        "membership.CLAIM_REACH_PX", "counts.LIKELIHOOD_REACH_PX", "picture.PICTURE_REACH_PX",
        "unclaimed.EXPLAINED_REACH_PX", "unclaimed.EXPLAINED_REACH_SPOTS",
    ),
    "how clear of corners and tips": (
        "thick_beam.CLEAR_OF_CORNER_PX", "thick_beam._CLEAR_STDS", "leg_in_picture._BEYOND_PX",
        "membership._TIP_PX", "counts._AT_TIP_PX", "bend.BEND_FROM_CORNER_PX",
        "curves._KINK_FROM_END_PX",
    ),
    "where a fit ends": (
        "information._TOLERANCE", "information._TINY", "climb._LEVEL", "joint._STILL",
        "strengths._STILL", "prices._SETTLED",
    ),
    "steps and rounds at most": (
        "least_squares._MOST_PATH_STEPS", "climb._MOST_CLIMB_STEPS", "lateral._MOST_LINE_STEPS",
        "strengths.MOST_ROUNDS", "revise._MOST_ROUNDS", "prices._ROUNDS", "joint._PASSES",
        "photon._PASSES", "counted._STEPS", "counted._CLIPS", "amplitudes._STEPS",
        "batch.MAX_STEPS",
    ),
    "outliers": ("least_squares.OUTLIER", "joint._ROUGH_OUTLIER"),
    "chances of a false alarm": (
        "evidence.CHECK_AT", "judge.CONTRADICTED_AT", "evidence.SELDOM", "judge._TAIL",
    ),
}  # fmt: skip
"""Numbers of one origin: `file.NAME` by what they stand for. Names that are gone are told of."""

NOT_MOVED = {
    "how much is done at once": (
        "_BLOCK_PULSES", "_BLOCK_NUMBERS", "_PLACES_AT_ONCE", "_AT_ONCE", "_BATCH_BINS",
        "TILE_CODES", "BATCH_CODES", "SAMPLE",
    ),
    "steps of derivatives, guards against rounding": (
        "NUDGE", "_PROBE", "_STEP", "_AHEAD", "_GAUGE", "GAUGE", "_LEAST_P", "_GAP_PS", "_HELD",
        "_DAMPING", "_LEAST_DAMPING", "_MOST_DAMPING",
    ),
    "shapes, orders and numbers of columns": (
        "GAUSSIAN", "_ORDER", "_NUMBERS", "_FREED", "SearchSettings.seed", "_MOST_NAMED",
        "CodeCounts.shape", "WIDE_PX", "LABELS", "_TURNS", "MEDIUM",
        "same_camera._STEPS",
    ),
    "grids of tables": (
        "_FINE_PS", "_AROUND_PS", "_COARSE_PS", "_COARSE_FOR_PS", "_STEPS_OF_TIME", "_TABLE",
        "_FINE", "_GRID",
        "(_NODES, _NODE_WEIGHTS)",
    ),
}  # fmt: skip
"""Names, in any file or in one, that decide nothing by their size, by why."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Origin:
    """Numbers that move together: what they are called, and where they stand."""

    name: str
    numbers: tuple[Number, ...]

    @property
    def words(self) -> set[str]:
        """Names by which the package's functions read the numbers."""
        return {
            word
            for one in self.numbers
            for word in re.findall(r"\w+", one.owner.rpartition(".")[2])
        }


def origins() -> list[Origin]:
    """All that is moved, in the order of the rooms."""
    by_name: dict[str, list[Number]] = {}
    still = {name for names in NOT_MOVED.values() for name in names}
    for room in ROOMS:
        for one in numbers_of(ROOT, room, literals_in):
            # Whole 0, 1 and 2 are places and counts of columns.
            counts = one.value == 0 or (isinstance(one.value, int) and one.value < 3)
            name = f"{Path(one.file).stem}.{one.owner}"
            if one.named and not counts and not {one.owner, name} & still:
                by_name.setdefault(name, []).append(one)
    group_of = {name: group for group, names in TOGETHER.items() for name in names}
    if gone := sorted(group_of.keys() - by_name.keys()):
        print(f"TOGETHER names what is gone: {', '.join(gone)}", file=sys.stderr)
    grouped: dict[str, list[Number]] = {}
    for name, numbers in by_name.items():
        grouped.setdefault(group_of.get(name, name), []).extend(numbers)
    return [Origin(name, tuple(numbers)) for name, numbers in grouped.items()]


def moved(value: float, factor: float) -> float:
    """The number, larger or smaller by that factor."""
    if isinstance(value, int):
        by = max(1, round(value * abs(factor - 1.0)))
        return value + by if factor > 1.0 else value - by
    if 0.75 < value < 1.0:
        return 1.0 - (1.0 - value) / factor
    return value * factor


# --- in the child: another text for a module -----------------------------------------------


class _Rewrite(ast.NodeTransformer):
    def __init__(self, numbers: list[Number], factor: float) -> None:
        self.at = {(one.line, one.column): one.value for one in numbers}
        self.factor, self.done = factor, 0

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        place = node.lineno, node.col_offset
        if place in self.at and type(node.value) is type(self.at[place]):
            self.done += 1
            return ast.copy_location(ast.Constant(moved(node.value, self.factor)), node)
        return node


class _Loader(importlib.machinery.SourceFileLoader):
    """Compiles a module's text with other numbers in it, whatever is cached."""

    numbers: list[Number]
    factor: float

    def get_code(self, fullname: str) -> Any:
        rewrite = _Rewrite(self.numbers, self.factor)
        tree = rewrite.visit(ast.parse(Path(self.path).read_text("utf-8")))
        assert rewrite.done == len(self.numbers), fullname
        return compile(tree, self.path, "exec", dont_inherit=True)


class _Finder(importlib.abc.MetaPathFinder):
    def __init__(self, origin: Origin, factor: float) -> None:
        self.factor = factor
        self.by_module: dict[str, list[Number]] = {}
        for one in origin.numbers:
            module = ".".join(("lightflight", *Path(one.file).with_suffix("").parts))
            self.by_module.setdefault(module, []).append(one)

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        if fullname not in self.by_module:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path)
        assert spec is not None
        loader = _Loader(fullname, str(spec.origin))
        loader.numbers, loader.factor = self.by_module[fullname], self.factor
        spec.loader = loader
        return spec


# --- scenes --------------------------------------------------------------------------------

WORLDS = (
    "haze_500ps:0.2", "wall_60mm:0.1", "focal_length_longer:0.02", "veiling_glare:0.05",
    "clock_early:-10", "barrel:-1", "haze_150ps:0.2", "prompt_halo_8px:0.2", "camera_turned:0.5",
    "index:0.01", "codes_shorter:-0.001", "pulse_echo_300ps:0.1",
)  # fmt: skip


def scene_of(number: int) -> Row:
    """Recording, what is told, and truth and bound (k, k) of what is compared.

    Numbers divisible by four are worlds with nothing wrong, those that leave two are blind scenes,
    odd ones have something wrong.
    """
    seed = FIRST_SEED + number
    return _blind_scene(seed) if number % 4 == 2 else _world(seed, number)


def _world(seed: int, number: int) -> Row:
    from benchmarks.other_light import bound_of
    from tests.oracles.worlds.border import record, what_the_user_tells
    from tests.oracles.worlds.defects import DEFECTS
    from tests.oracles.worlds.random_worlds import random_world

    if number % 2:
        name, n_legs = WORLDS[number // 2 % len(WORLDS)], (1, 3)[number // 2 % 2]
        defect, _, strength = name.partition(":")
        world = DEFECTS[defect].applied(random_world(seed, n_legs), float(strength))
    else:
        name, n_legs = "none", (1, 3, 2, 4)[number // 4 % 4]
        world = random_world(seed, n_legs, (40_000.0, 400.0)[number // 8 % 2])
    hist, told = record(world, seed), what_the_user_tells(world)
    return {"name": name, "n_legs": n_legs, "hist": hist, "told": told, "world": world,
            "bound": bound_of(world, name)}  # fmt: skip


def _blind_scene(seed: int) -> Row:
    from benchmarks import check_blind_scenes as blind
    from lightflight import Medium, Source
    from tests.oracles.brute_force import expected_counts

    case = blind.drawn_case(seed, 6)
    scene = case.scene
    expected = expected_counts(scene, brightest=blind.PHOTONS)
    hist = blind.histograms(np.random.default_rng([seed, 1]).poisson(expected), scene.clock)
    told = {
        "camera": blind.package_camera(scene.camera),
        "source": Source(scene.vertices[0], emission_time_ps=scene.emission_time),
        "medium": Medium(scene.path_index, scene.return_index),
        "timing": blind.calibration(scene.clock, scene.tail),
    }
    bound = blind._bound(case, told["source"], told["camera"], blind.PHOTONS)
    return {"name": "blind scene", "n_legs": case.n_legs, "hist": hist, "told": told,
            "truth": scene.vertices, "bound": bound}  # fmt: skip


def scene_in(folder: Path, number: int) -> Row:
    """The scene as it was made by the code as it stands, kept in the folder."""
    file = folder / f"scene_{number}.pickle"
    if not file.exists():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            made = scene_of(number)
        fresh = file.with_suffix(".part")
        fresh.write_bytes(pickle.dumps(made))
        fresh.rename(file)
    scene: Row = pickle.loads(file.read_bytes())
    return scene


def result_of(scene: Row) -> Row:
    """What `reconstruct` makes of a scene; `off`: error in bounds, (k,)."""
    import lightflight as lf

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            path = lf.reconstruct(scene["hist"], **scene["told"])
        except Exception as refused:  # noqa: BLE001 (a crash is a finding here)
            return {"says": f"{type(refused).__name__}: {refused}"[:200], "level": "refused"}
    row: Row = {"legs": path.n_legs, "level": str(path.verdict.level)}
    if path.n_legs == scene["n_legs"]:
        row["off"] = _off(path, scene).tolist()
    return row


def _off(path: Any, scene: Row) -> np.ndarray:
    from tests.oracles.miss import error_and_covariance

    if "world" in scene:
        error, _ = error_and_covariance(path, scene["world"].vertices)
        off = np.linalg.solve(np.linalg.cholesky(scene["bound"]), error)
        return np.asarray(off / np.sqrt(len(error)))
    corners = (path.vertices_mm - scene["truth"])[1:-1]
    if not len(corners):
        ahead, truth = np.diff(path.vertices_mm, axis=0)[0], np.diff(scene["truth"], axis=0)[0]
        corners = truth @ truth / (ahead @ truth) * ahead - truth
    return np.asarray(corners).ravel() / scene["bound"] / np.sqrt(np.asarray(corners).size)


# --- running -------------------------------------------------------------------------------


def child(name: str, factor: float, folder: Path, numbers: list[int]) -> None:
    """In a process of its own: one move, these scenes, a line of JSON for each.

    Where nothing is moved, a line holds what ran: one scene a process, since what is kept from one
    to the next does not run again.
    """
    key = {"code": code_digest(), "origin": name, "factor": factor}
    if not name:
        (number,) = numbers
        scene = scene_in(folder, number)
        row, ran = reached.running(lambda: result_of(scene))
        print(json.dumps(key | {"scene": number} | row | {"ran": sorted(ran)}), flush=True)
        return
    origin = next(one for one in origins() if one.name == name)
    sys.meta_path.insert(0, _Finder(origin, factor))
    for number in numbers:
        row = result_of(scene_in(folder, number))
        print(json.dumps(key | {"scene": number} | row), flush=True)


@cache
def code_digest() -> str:
    """Of the package's text: what was run with another is no base to compare with."""
    whole = hashlib.blake2b(digest_size=8)
    for path in sorted((ROOT / "src" / "lightflight").rglob("*.py")):
        whole.update(path.read_bytes())
    return whole.hexdigest()


def rows_in(file: Path) -> dict[tuple[str, float, int], Row]:
    """What was run so far with the code as it is, by origin, factor and scene."""
    lines = file.read_text("utf-8").splitlines() if file.exists() else []
    rows = [json.loads(line) for line in lines if line.endswith("}")]
    own = [row for row in rows if row["code"] == code_digest()]
    return {(row["origin"], row["factor"], row["scene"]): row for row in own}


def run(name: str, factor: float, folder: Path, scenes: list[int]) -> None:
    """One move on the scenes that it has not been tried on, in one process."""
    file = folder / "results.jsonl"
    done = rows_in(file)
    left = [k for k in scenes if (name, factor, k) not in done]
    if not left:
        return
    command = [sys.executable, __file__, "--child", name, str(factor), ",".join(map(str, left))]
    threads = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    with subprocess.Popen(
        [*command, "--folder", str(folder)], stdout=subprocess.PIPE, text=True,
        env={**os.environ, **threads, "PYTHONDONTWRITEBYTECODE": "1"},
    ) as process, file.open("a", encoding="utf-8") as out:  # fmt: skip
        assert process.stdout is not None
        for line in process.stdout:
            out.write(line)
            out.flush()
    if process.returncode:
        # Numbers that let nothing be imported, a wall of memory: said in the table.
        print(f"{name} x {factor}: exit code {process.returncode}", file=sys.stderr)


def run_all(wanted: list[Origin], folder: Path, scenes: range, jobs: int, whole: bool) -> None:
    """All moves, so many at a time; the numbers as they are before all others."""
    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(lambda k: run("", 1.0, folder, [k]), scenes))
        rows = rows_in(folder / "results.jsonl")
        moves = [
            (one.name, factor, [k for k in scenes if whole or changeable(one, rows, k)])
            for one in wanted
            for factor in FACTORS
        ]
        done = pool.map(lambda move: run(move[0], move[1], folder, move[2]), moves)
        for k, (name, factor, tried) in enumerate(moves, start=1):
            next(done)
            print(f"{k}/{len(moves)} {name} x {factor}: {len(tried)} scenes", file=sys.stderr)


def changeable(origin: Origin, rows: dict[Any, Row], scene: int) -> bool:
    """Whether anything that reads the numbers runs in the scene as it is."""
    before = rows.get(("", 1.0, scene))
    return before is None or reached.may_change(origin.words, set(map(tuple, before["ran"])))


def compared(origin: Origin, factor: float, rows: dict[Any, Row], scenes: range) -> Row | None:
    """The table's figures of one move; None: it has not been tried on all that it may change."""
    both = []
    for k in scenes:
        before = rows.get(("", 1.0, k))
        after = rows.get((origin.name, factor, k))
        if before and not after and not changeable(origin, rows, k):
            after = before
        if not before or not after:
            return None
        both.append((before, after))
    right = [(np.array(b["off"]), np.array(a["off"])) for b, a in both if "off" in b and "off" in a]
    errors = [[float(np.linalg.norm(off)) for off in pair] for pair in right]
    before, after = np.median(errors, axis=0) if errors else (np.nan, np.nan)
    return {
        "legs": (sum("off" in b for b, _ in both), sum("off" in a for _, a in both)),
        "legs_changed": sum(("off" in b) != ("off" in a) for b, a in both),
        "error": (float(before), float(after)),
        "moved": sum(float(np.linalg.norm(a - b)) > MOVED_AT for b, a in right),
        "verdict": sum(b["level"] != a["level"] for b, a in both),
    }


def changes(figures: Row | None) -> bool:
    """Whether a move did anything."""
    return figures is not None and any(figures[k] for k in ("legs_changed", "moved", "verdict"))


def values_of(origin: Origin) -> str:
    """The numbers as they are, for the table."""
    return ", ".join(dict.fromkeys(f"{one.value:g}" for one in origin.numbers))


def table(wanted: list[Origin], rows: dict[Any, Row], scenes: range) -> Iterator[str]:
    """Markdown of what was tried on these scenes; what changes nothing is listed below."""
    yield "| numbers | now | by | legs | error / bound | moved | verdict |"
    yield "|---|---:|---:|---:|---:|---:|---:|"
    still, missing = [], []
    for origin in wanted:
        found = {factor: compared(origin, factor, rows, scenes) for factor in FACTORS}
        if None in found.values():
            missing.append(origin.name)
        elif not any(changes(figures) for figures in found.values()):
            still.append(f"`{origin.name}` ({values_of(origin)})")
        else:
            for factor, of in found.items():
                assert of is not None
                legs, error = of["legs"], of["error"]
                yield (
                    f"| {origin.name} | {values_of(origin)} | {100 * factor - 100:+.0f} % "
                    f"| {legs[0]} → {legs[1]} | {error[0]:.2f} → {error[1]:.2f} "
                    f"| {of['moved']} | {of['verdict']} |"
                )
    yield ""
    yield f"On these {len(scenes)} scenes nothing changes with: {', '.join(still) or 'none'}."
    if missing:
        yield f"\nNot tried on all of them: {', '.join(missing)}."


def main() -> None:
    """Run what is left to run, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=ROOT / "out" / "sensitivity")
    parser.add_argument("--only", default="", help="a word of the file or the name")
    parser.add_argument("--scenes", type=int, default=N_FIRST, help=f"of round one ({N_FIRST})")
    parser.add_argument("--more", type=int, default=N_SECOND, help="of the second; 0: none")
    parser.add_argument("--jobs", type=int, default=2, help="moves at a time (2)")
    parser.add_argument("--all", action="store_true", help="scenes that cannot change, too")
    parser.add_argument("--table", action="store_true", help="run nothing")
    parser.add_argument("--list", action="store_true", help="numbers and groups; run nothing")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        name, factor, numbers = args.child
        child(name, float(factor), args.folder, [int(k) for k in numbers.split(",")])
        return
    every = origins()
    wanted = [o for o in every if any(args.only in f"{n.file} {o.name}" for n in o.numbers)]
    if args.list:
        for one in wanted:
            print(f"{one.name}: {values_of(one)}")
        print(f"{len(wanted)} origins of {sum(len(one.numbers) for one in wanted)} numbers")
        return
    args.folder.mkdir(parents=True, exist_ok=True)
    first, second = range(args.scenes), range(args.more)
    if not args.table:
        run_all(wanted, args.folder, first, args.jobs, args.all)
    rows = rows_in(args.folder / "results.jsonl")
    print("\n".join(table(wanted, rows, first)))
    if not args.more:
        return
    again = [one for one in wanted if any(changes(compared(one, f, rows, first)) for f in FACTORS)]
    if not args.table:
        run_all(again, args.folder, second, args.jobs, args.all)
    print("\n".join(table(again, rows_in(args.folder / "results.jsonl"), second)))


if __name__ == "__main__":
    main()
