"""Lenses out of focus and pixels that count unequally, by a forward model of its own.

    python benchmarks/lens_and_pixels.py                        # 12 recordings a cell, both methods
    python benchmarks/lens_and_pixels.py --runs 100 --methods joint --only even tilted

Light of a path in steps of 0.4 mm, seen by the paper's camera with a Gaussian spot on the middle of
each pixel and a Gaussian pulse of 64 ps, in ideal codes of 55 ps; 40,000 photons in the brightest
pixel. Source and emission time are told, the number of legs is not. Printed: recordings with the
right number of legs, rms error of the corners (of the end, with one leg) and rms pull of what their
covariance leaves independent, with its 95 % interval (bootstrap), and verdicts.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.refraction import interval

Floats = NDArray[np.float64]

SPEED, INDEX = 0.299792458, 1.00027
CODES, CODE_PS, PULSE_PS, EMISSION_PS = 909, 55.0, 64.0, 1000.0
CAMERA = lf.Camera.facing_plane(center_mm=(187.5, 37.5), distance_mm=535.0)
EYE = np.array([187.5, 37.5, 535.0])
PX_PER_UNIT = 32 / (245 / 535.0)
STEP_MM, HALF_ACTIVE_PX, REACH_PX, REACH_CODES = 0.4, 0.06, 6, 9
PATHS = {
    1: np.array([[0, 20, 0], [375, 60, 40]], dtype=float),
    3: np.array([[0, 0, 0], [375, 25, 50], [0, 50, 10], [375, 75, 50]], dtype=float),
}


def sharp(points: Floats) -> Floats:
    return np.full(len(points), 0.5)


def tilted(points: Floats) -> Floats:
    """A quarter wider at the right edge of the picture, as much narrower at the left."""
    spot: Floats = 0.5 * np.exp(0.25 * (points[:, 0] - EYE[0]) / 122)
    return spot


def defocused(points: Floats) -> Floats:
    """In focus 10 mm before the board; light 40 mm away is spread by 0.7 px."""
    spot: Floats = np.hypot(0.4, 0.015 * (points[:, 2] - 10.0))
    return spot


def soft_at_the_edge(points: Floats) -> Floats:
    spot: Floats = 0.45 + 0.1 * np.abs(points[:, 0] - EYE[0]) / 122
    return spot


@dataclass(frozen=True)
class World:
    """Spot, scatter of the pixels' efficiencies, unevenness of the light, photons."""

    spot: Callable[[Floats], Floats] = sharp
    unequal: float = 0.0
    uneven: float = 0.0
    photons: float = 40_000.0


WORLDS = {
    "even": World(),
    "tilted": World(tilted),
    "defocused": World(defocused),
    "soft at the edge": World(soft_at_the_edge),
    "unequal 3.5 %": World(unequal=0.035),
    "unequal 8 %": World(unequal=0.08),
    "uneven light 30 %": World(uneven=0.3),
    "unequal and uneven": World(unequal=0.035, uneven=0.2),
    "dim": World(photons=400.0),
    "dim and defocused": World(defocused, photons=400.0),
}


def recording(vertices: Floats, world: World, seed: int) -> lf.Histograms:
    """Counts drawn from what each pixel and code expects."""
    counts, start_ps = np.zeros((32, 32, CODES)), EMISSION_PS
    for first, last in pairwise(vertices):
        length = float(np.linalg.norm(last - first))
        share = (np.arange(int(length / STEP_MM)) + 0.5) / int(length / STEP_MM)
        points = first + share[:, np.newaxis] * (last - first)
        away = np.linalg.norm(EYE - points, axis=1)
        arrival = start_ps + INDEX * (share * length + away) / SPEED
        start_ps += INDEX * length / SPEED
        light = (1 + world.uneven * np.sin(points[:, 0] / 6 + seed)) / away**2 * length / len(share)
        depth = EYE[2] - points[:, 2]
        col = 15.5 + PX_PER_UNIT * (points[:, 0] - EYE[0]) / depth
        row = 15.5 - PX_PER_UNIT * (points[:, 1] - EYE[1]) / depth
        for at in zip(row, col, world.spot(points), light, arrival, strict=True):
            _add(counts, *at)
    efficiency = np.exp(world.unequal * np.random.default_rng(seed + 100).normal(size=(32, 32)))
    counts *= efficiency[..., np.newaxis]
    counts *= world.photons / counts.sum(axis=2).max()
    drawn = np.random.default_rng(seed).poisson(counts + 0.2).astype(np.uint32)
    return lf.Histograms(drawn, bin_width_ps=CODE_PS, laser_period_ps=CODE_PS * CODES)


def _add(
    counts: Floats, row: float, col: float, spot: float, light: float, arrival_ps: float
) -> None:
    """The light of one step, in the pixels and codes about it."""

    def near(place: float) -> NDArray[np.int64]:
        return np.arange(max(0, round(place) - REACH_PX), min(32, round(place) + REACH_PX + 1))

    def shares(pixels: NDArray[np.int64], place: float) -> Floats:
        edges = [ndtr((pixels + side * HALF_ACTIVE_PX - place) / spot) for side in (1, -1)]
        return (edges[0] - edges[1]) / (2 * HALF_ACTIVE_PX)

    rows, cols = near(row), near(col)
    if not len(rows) or not len(cols):
        return
    code = int(arrival_ps // CODE_PS)
    codes = np.arange(max(0, code - REACH_CODES), min(CODES, code + REACH_CODES + 1))
    edges = ndtr((np.append(codes, codes[-1] + 1) * CODE_PS - arrival_ps) / PULSE_PS)
    seen = light * np.outer(shares(rows, row), shares(cols, col))
    counts[np.ix_(rows, cols, codes)] += seen[..., np.newaxis] * np.diff(edges)


def errors_of(path: lf.LightPath, vertices: Floats) -> tuple[float, float]:
    """Mean squares of error, mm^2, and of what the covariance leaves independent of it."""
    if path.n_legs > 1:
        inner = slice(4, 4 * path.n_legs)
        kept = [k for k in range(inner.start, inner.stop) if k % 4 != 3]
        off = (path.vertices_mm - vertices)[1:-1].ravel()
        covariance = path.covariance[np.ix_(kept, kept)]
    else:
        # Where the light crosses the plane of the true end: along the leg nothing is told.
        way = path.vertices_mm[1] - path.vertices_mm[0]
        scale = (vertices[1] - vertices[0])[0] / way[0]
        off = (path.vertices_mm[0] + scale * way - vertices[1])[1:]
        along = way / way[0]
        to_plane = scale * np.array([[-along[1], 1, 0], [-along[2], 0, 1]])
        covariance = to_plane @ path.covariance[4:7, 4:7] @ to_plane.T
    values, vectors = np.linalg.eigh(covariance)
    told = values > 1e-10 * values.max()
    return float(np.mean(off**2)), float(np.mean((vectors.T @ off)[told] ** 2 / values[told]))


def line_of(name: str, n_legs: int, method: str, seeds: range) -> str:
    """A row of the table."""
    squares, levels, vertices = [], [], PATHS[n_legs]
    for seed in seeds:
        hist = recording(vertices, WORLDS[name], seed)
        source = lf.Source(tuple(vertices[0]), emission_time_ps=EMISSION_PS)
        timing = lf.TimingCalibration.nominal(hist)
        path = lf.reconstruct(hist, camera=CAMERA, source=source, timing=timing, method=method)
        levels.append(str(path.verdict.level))
        if path.n_legs == n_legs:
            squares.append(errors_of(path, vertices))
    found = "/".join(str(levels.count(level)) for level in ("trust", "check", "contradicted"))
    cells = [name, str(n_legs), method, f"{len(squares)}/{len(seeds)}"]
    if squares:
        error2, pull2 = np.array(squares).T
        cells += [f"{np.sqrt(error2.mean()):.4f}", interval(pull2, 1.0)]
    return "| " + " | ".join([*cells, found]) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--only", nargs="+", choices=WORLDS, default=list(WORLDS))
    parser.add_argument("--methods", nargs="+", default=["joint", "photon"])
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| world | legs | method | right | rms, mm | pull | t/c/c |")
    print("|---|---:|---|---:|---:|---:|---:|", flush=True)
    for name in args.only:
        for n_legs in PATHS:
            for method in args.methods:
                seeds = range(args.first, args.first + args.runs)
                print(line_of(name, n_legs, method, seeds), flush=True)


if __name__ == "__main__":
    main()
