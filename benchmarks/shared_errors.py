"""Pulls of paths whose camera, medium and clock are drawn from what is told of them.

    python benchmarks/shared_errors.py                            # 24 recordings, joint and photon
    python benchmarks/shared_errors.py --runs 1000 --methods joint

Recordings are those of the tests' independent forward model: three legs, 40,000 photons in the
brightest pixel, 24 cameras in turn, light even. Pose, focal length, distortion, group index, clock
offset and code length are off by one draw from the stated prior. Printed are the rms pull of the
corners' coordinates one by one, and of all of a recording together (whitened), which is the sharper
figure because the coordinates go along with each other; and the recordings that were refused.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

import numpy as np

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import HONEST


def pulls(seed: int, method: str, n_legs: int) -> tuple[np.ndarray, float]:
    """Of x, y, z of each corner, and the mean square of all together."""
    world = random_world(seed, n_legs, prior=HONEST, uneven=0.0)
    told = what_the_user_tells(world) | {"n_legs": n_legs}
    path = lf.reconstruct(record(world, seed), method=method, **told)
    own = [4 * k + axis for k in range(1, n_legs) for axis in range(3)]
    off = (path.vertices_mm - world.vertices)[1:-1].ravel()
    covariance = path.covariance[np.ix_(own, own)]
    together = float(off @ np.linalg.solve(covariance, off)) / len(off)
    return off / np.sqrt(np.diag(covariance)), together


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--legs", type=int, default=3)
    parser.add_argument("--methods", nargs="+", default=["joint", "photon"])
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    for method in given.methods:
        single, together, refused = [], [], 0
        for seed in range(given.runs):
            try:
                one, mean_square = pulls(seed, method, given.legs)
            except (lf.GeometryError, lf.NothingFoundError) as reason:
                refused += 1
                print(f"{method} {seed}: {reason}")
                continue
            single.append(one)
            together.append(mean_square)
        rms, worst = np.sqrt(np.mean(np.square(single))), np.abs(single).max()
        whole = np.sqrt(np.mean(together))
        error = 1 / np.sqrt(2 * len(together) * 3 * (given.legs - 1))
        print(
            f"{method}: {len(together)} recordings, {refused} refused; rms pull {rms:.3f}, "
            f"largest {worst:.1f}; whitened {whole:.3f} ± {error:.3f}"
        )


if __name__ == "__main__":
    main()
