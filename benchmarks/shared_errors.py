"""Pulls of paths whose camera, medium and clock are drawn from what is told of them.

    python benchmarks/shared_errors.py                            # 24 recordings, joint and photon
    python benchmarks/shared_errors.py --runs 1000 --methods joint
    python benchmarks/shared_errors.py --prior known              # the same with everything exact
    python benchmarks/shared_errors.py --only position_mm index   # these errors alone
    python benchmarks/shared_errors.py --methods start            # from a path 3 mm off, no search
    python benchmarks/shared_errors.py --prior known --uneven 0.2 # light uneven by 20 % on 10 mm
    python benchmarks/shared_errors.py --prior known --uneven 0.2 --bound   # and against the bound

Recordings are those of the tests' independent forward model: three legs, 40,000 photons in the
brightest pixel, 24 cameras in turn, light even unless told. Pose, focal length, distortion, group
index, clock offset and code length are off by one draw from the stated prior, each time. Printed
are the rms pull of the corners' coordinates one by one, of all of a recording together (whitened:
directions known to 3 um count as much as those known to 90), their 95 % intervals (bootstrap over
recordings: the coordinates of one go along with each other), the rms in mm, and the recordings that
were refused. `--bound`: the same errors over those that the oracle's Fisher
information allows, with all that is told as uncertain free and the light's nodes every 5 mm.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import lightflight as lf
from lightflight.errors import GeometryError, NothingFoundError

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.fisher import fisher
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import PRIORS, Prior, World

Row = dict[str, Any]

START_OFF_MM = 3.0
"""Rms by which a path that is given to start from misses the truth, each coordinate."""


def pulls(seed: int, method: str, n_legs: int, prior: Prior, uneven: float, bound: bool) -> Row:
    """Pulls of x, y, z of each corner; mean squares of all together, over what is stated and over
    the bound (nan: not asked); mean squares in mm of the errors, of those stated and of the bound.
    """
    world = random_world(seed, n_legs, prior=prior, uneven=uneven)
    told = what_the_user_tells(world) | {"n_legs": n_legs}
    if method == "start":
        off = np.random.default_rng([seed, 1]).normal(0.0, START_OFF_MM, world.vertices.shape)
        told |= {"start": world.vertices + off, "n_legs": None}
    method = "joint" if method == "start" else method
    path = lf.reconstruct(record(world, seed), method=method, **told)
    if path.n_legs != n_legs:
        raise NothingFoundError(f"{path.n_legs} legs")
    own = [4 * k + axis for k in range(1, n_legs) for axis in range(3)]
    off = (path.vertices_mm - world.vertices)[1:-1].ravel()
    covariance = path.covariance[np.ix_(own, own)]
    least = corners_bound(world) if bound else np.full_like(covariance, np.nan)
    together, over_bound = (
        float(off @ np.linalg.solve(stated, off)) / len(off) for stated in (covariance, least)
    )
    return {
        "pulls": (off / np.sqrt(np.diag(covariance))).tolist(),
        "together": together,
        "over_bound": over_bound,
        "mm2": [float(np.mean(each)) for each in (off**2, np.diag(covariance), np.diag(least))],
    }


def corners_bound(world: World) -> np.ndarray:
    """(n, n) covariance of the corners' coordinates that the oracle's Fisher information allows."""
    known = fisher(world)
    names = [f"{axis}{k}" for k in range(1, world.n_legs) for axis in "xyz"]
    at = [known.names.index(name) for name in names]
    return known.covariance[np.ix_(at, at)]


def rms_in_words(squares: np.ndarray) -> str:
    """Root of the mean of (n,) with its 95 % interval."""
    n = len(squares)
    drawn = squares[np.random.default_rng(0).integers(0, n, (2000, n))].mean(axis=1)
    low, high = np.sqrt(np.quantile(drawn, [0.025, 0.975]))
    return f"{np.sqrt(squares.mean()):.3f} [{low:.3f}, {high:.3f}]"


def prior_of(name: str, only: list[str]) -> Prior:
    """The prior of that name, or those of its errors alone that are named."""
    whole = PRIORS[name]
    return Prior(**{key: getattr(whole, key) for key in only}) if only else whole


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--legs", type=int, default=3)
    parser.add_argument("--prior", choices=("known", "honest"), default="honest")
    parser.add_argument("--uneven", type=float, default=0.0, help="rms of the light, share")
    parser.add_argument("--only", nargs="+", default=[], help="fields of the tests' Prior")
    parser.add_argument("--bound", action="store_true", help="against the oracle's Fisher bound")
    parser.add_argument("--methods", nargs="+", default=["joint", "photon"])
    parser.add_argument("--json", type=Path, help="one line for each recording; goes on from there")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    prior = prior_of(given.prior, given.only)
    done = {}
    if given.json is not None and given.json.exists():
        rows = map(json.loads, given.json.read_text("utf-8").splitlines())
        done = {json.dumps(row["cell"]): row for row in rows}
    for method in given.methods:
        rows = []
        for seed in range(given.first, given.first + given.runs):
            cell = {
                "method": method, "seed": seed, "legs": given.legs, "prior": given.prior,
                "only": given.only, "uneven": given.uneven, "bound": given.bound,
            }  # fmt: skip
            rows.append(done.get(json.dumps(cell)) or kept(cell, prior, given.json))
        print_pulls(method, rows, bound=given.bound)


def kept(cell: Row, prior: Prior, file: Path | None) -> Row:
    """The row of one recording, added to the file."""
    row = {"cell": cell}
    try:
        row |= pulls(
            cell["seed"], cell["method"], cell["legs"], prior, cell["uneven"], cell["bound"]
        )
    except (GeometryError, NothingFoundError) as reason:
        row["says"] = str(reason)
    if file is not None:
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(row) + "\n")
    return row


def print_pulls(method: str, rows: list[Row], *, bound: bool) -> None:
    refused = [row for row in rows if "says" in row]
    for row in refused:
        print(f"{method} {row['cell']['seed']}: {row['says']}")
    found = [row for row in rows if "says" not in row]
    squares = np.square([row["pulls"] for row in found])
    over_bound = np.array([row["over_bound"] for row in found])
    error, stated, least = np.sqrt(np.mean([row["mm2"] for row in found], axis=0))
    in_mm = f"; rms error {error:.4f} mm, stated {stated:.4f}"
    if bound:
        in_mm += f", bound {least:.4f}: error / bound {error / least:.2f}"
    print(
        f"{method}: {len(found)} recordings, {len(refused)} refused; rms pull "
        f"{rms_in_words(squares.mean(axis=1))}, above 3: {100 * np.mean(squares > 9):.2f} %; "
        f"whitened {rms_in_words(np.array([row['together'] for row in found]))}"
        + (f"; whitened by the bound {rms_in_words(over_bound)}" if bound else "")
        + in_mm
    )


if __name__ == "__main__":
    main()
