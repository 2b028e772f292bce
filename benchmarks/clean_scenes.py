"""Clean recordings of scenes drawn at random: how many are trusted, and how true the errors are.

    python benchmarks/clean_scenes.py                               # 60 scenes a row
    python benchmarks/clean_scenes.py --scenes 20 --only "in view, 0.7 px" --methods joint photon

Nothing is wrong with these recordings. Two legs that begin in the picture, or three that come into
it, with corners wherever they fall: legs fold back on each other, run in depth, end in view. The
forward model, camera and clock are those of `lens_and_pixels`, of even light and a Gaussian spot,
with 40,000 photons in the brightest pixel. Source and emission time are told, the number of legs is
not. Printed: recordings with the right number of legs, rms pull of what the covariance of the
corners leaves independent with its 95 % interval (bootstrap), corners more than five stated errors
off, and verdicts.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import lightflight as lf
from lightflight.errors import GeometryError, NothingFoundError

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.lens_and_pixels import (
    CAMERA,
    EMISSION_PS,
    EYE,
    PX_PER_UNIT,
    World,
    errors_of,
    recording,
)
from benchmarks.refraction import interval

Floats = NDArray[np.float64]

FAR_STDS = 5.0
WITHIN_PX = 2.0
"""Corners lie so far within the picture at least."""


@dataclass(frozen=True)
class Kind:
    """Scenes of one row: legs, whether the source is in view, and what legs must be at least."""

    n_legs: int
    in_view: bool
    spot_px: float
    least_px: float = 6.0
    least_deg: float = 30.0
    """Between a leg and the line of sight."""


KINDS = {
    "in view, 0.5 px": Kind(2, True, 0.5),
    "in view, 0.7 px": Kind(2, True, 0.7),
    "in view, short and steep": Kind(2, True, 0.5, least_px=3.0, least_deg=15.0),
    "from beside": Kind(3, False, 0.5),
}


def in_pixels(points: Floats) -> Floats:
    """(n, 2), (row, col) of points in mm (n, 3)."""
    depth = EYE[2] - points[:, 2]
    row = 15.5 - PX_PER_UNIT * (points[:, 1] - EYE[1]) / depth
    col = 15.5 + PX_PER_UNIT * (points[:, 0] - EYE[0]) / depth
    return np.column_stack((row, col))


def _within(points: Floats, margin_px: float = 0.0) -> NDArray[np.bool_]:
    pixels = in_pixels(np.atleast_2d(points))
    low, high = margin_px - 0.5, 31.5 - margin_px
    inside: NDArray[np.bool_] = np.all((pixels > low) & (pixels < high), axis=1)
    return inside


def drawn_scene(seed: int, kind: Kind) -> Floats:
    """Vertices in mm, (n_legs + 1, 3): the first scene of a seed that the camera can see."""
    rng = np.random.default_rng(seed)
    while True:
        vertices = _drawn(rng, kind)
        if vertices is not None:
            return vertices


def _drawn(rng: np.random.Generator, kind: Kind) -> Floats | None:
    middle = np.array([EYE[0], EYE[1], 0.0])
    if kind.in_view:
        places = [[*rng.uniform(-100, 100, size=2), rng.uniform(-60, 60)]]
    else:
        places = [[rng.choice([-1, 1]) * 190.0, rng.uniform(-80, 80), rng.uniform(-60, 60)]]
    for _ in range(kind.n_legs - 1):
        places.append([*rng.uniform(-105, 105, size=2), rng.uniform(-90, 90)])
    away = rng.normal(size=3) * (1.0, 1.0, 0.5)
    places.append(list(places[-1] + 400.0 * away / np.linalg.norm(away)))
    vertices = np.array(places) + middle
    seen = vertices[0 if kind.in_view else 1 : -1]
    if vertices[-1, 2] > 400.0 or not _within(seen, WITHIN_PX).all():
        return None
    flights = np.diff(vertices, axis=0)
    flights /= np.linalg.norm(flights, axis=1, keepdims=True)
    straight = np.einsum("ij,ij->i", flights[1:], flights[:-1]) > np.cos(np.radians(15.0))
    clear = all(_is_clear(*ends, kind) for ends in pairwise(vertices))
    return vertices if clear and not straight.any() else None


def _is_clear(start: Floats, end: Floats, kind: Kind) -> bool:
    """Whether a leg is long enough in the picture, and does not run along the line of sight."""
    points = start + np.linspace(0, 1, 400)[:, np.newaxis] * (end - start)
    seen = points[_within(points)]
    if len(seen) < 8:
        return False
    first, last = in_pixels(seen[[0, -1]])
    flight, sight = end - start, seen.mean(axis=0) - EYE
    cos = abs(flight @ sight) / np.linalg.norm(flight) / np.linalg.norm(sight)
    steep = np.degrees(np.arccos(cos)) < kind.least_deg
    return bool(np.hypot(*(last - first)) >= kind.least_px and not steep)


def path_of(seed: int, kind: Kind, method: str, photons: float) -> tuple[lf.LightPath, Floats]:
    """The path of the scene of a seed, and the true vertices, mm."""
    vertices = drawn_scene(seed, kind)
    world = World(lambda points: np.full(len(points), kind.spot_px), photons=photons)
    hist = recording(vertices, world, seed)
    source = lf.Source(tuple(vertices[0]), emission_time_ps=EMISSION_PS)
    timing = lf.TimingCalibration.nominal(hist)
    return lf.reconstruct(
        hist, camera=CAMERA, source=source, timing=timing, method=method
    ), vertices


def farthest_off(path: lf.LightPath, vertices: Floats) -> float:
    """How far a corner lies off, in its stated errors."""
    most = 0.0
    for k in range(1, len(vertices) - 1):
        own = slice(4 * k, 4 * k + 3)
        off = path.vertices_mm[k] - vertices[k]
        most = max(most, float(off @ np.linalg.pinv(path.covariance[own, own]) @ off))
    return float(np.sqrt(most))


def line_of(name: str, method: str, seeds: range, photons: float) -> str:
    """A row of the table."""
    kind, levels, far = KINDS[name], Counter[str](), 0
    pulls: list[float] = []
    for seed in seeds:
        try:
            path, vertices = path_of(seed, kind, method, photons)
        except (GeometryError, NothingFoundError):
            levels["none"] += 1
            continue
        levels[str(path.verdict.level)] += 1
        if path.n_legs == kind.n_legs:
            pulls.append(errors_of(path, vertices)[1])
            far += farthest_off(path, vertices) > FAR_STDS
    found = "/".join(str(levels[level]) for level in ("trust", "check", "contradicted", "none"))
    pull = interval(np.array(pulls), 1.0) if pulls else "–"
    cells = [name, str(kind.n_legs), method, f"{len(pulls)}/{len(seeds)}", pull, str(far), found]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--only", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--methods", nargs="+", default=["joint"])
    parser.add_argument("--photons", type=float, default=40_000.0)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| scenes | legs | method | right | pull | > 5 stated | t/c/c/none |")
    print("|---|---:|---|---:|---:|---:|---:|", flush=True)
    for name in args.only:
        for method in args.methods:
            seeds = range(args.first, args.first + args.scenes)
            print(line_of(name, method, seeds, args.photons), flush=True)


if __name__ == "__main__":
    main()
