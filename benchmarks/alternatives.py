"""Recordings that two paths explain: how often the true one is told, and another beside it.

    python benchmarks/alternatives.py                      # 40 recordings a row
    python benchmarks/alternatives.py --runs 100 --only fibre
    python benchmarks/alternatives.py --first 5000

Rows: one leg in fibre (index 1.47) across a picture of 60 mm, source told and emission time fitted,
by elevation and photons in the brightest pixel; two straight legs that meet at a shallow corner in
the middle of the view, turned in the picture or in depth, all told but their number; and clean
straight recordings in air. Printed: recordings answered rightly (the elevation within four
stated errors; the corner within chi-square 21.1 of three), answered rightly or told among the
alternatives, with alternatives, and wrong without a word ("trust", the truth nowhere); in brackets
the 95 % interval (Clopper and Pearson); CPU seconds of the middle one.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.labs import Lab, corner_in_view, one_leg, three_legs
from tests.oracles.other_answers import cornered_scene, fibre_scene
from tests.oracles.refracted import AIR, RefractedScene
from tests.oracles.refracted_border import histograms, what_the_user_tells

Told = tuple[lf.Histograms, dict[str, Any]]


@dataclass(frozen=True)
class Row:
    """A world: its recordings by seed with what is told of them, and what is right."""

    name: str
    recording: Callable[[int], Told]
    is_right: Callable[[lf.LightPath], bool]


def of_scene(scene: RefractedScene, seed: int) -> Told:
    """A recording of an oracle's scene; of fibre the emission time is not told."""
    hist = histograms(scene, seed)
    known = scene.path_group_index == AIR
    return hist, what_the_user_tells(scene, hist, emission_known=known)


def of_lab(lab: Lab, photons: float, blind: bool, seed: int) -> Told:
    """A clean recording of straight legs; `blind`: nothing is told of the source."""
    source = lf.Source() if blind else lab.timed
    told = {"camera": lab.camera, "source": source, "timing": lab.timing}
    return lab.recording(seed, photons), told


def rises_as(scene: RefractedScene, path: lf.LightPath) -> bool:
    """Whether the first leg's elevation is the true one."""
    step = np.diff(scene.vertices_mm, axis=0)[0]
    true = np.rad2deg(np.arcsin(step[2] / np.linalg.norm(step)))
    leg = path.legs[0]
    return bool(abs(leg.angle_deg - true) < 4.0 * leg.angle_std_deg)


def has_corner(scene: RefractedScene, path: lf.LightPath) -> bool:
    """Whether it is two straight legs with the true corner."""
    if path.n_legs != 2 or path.bends:
        return False
    off = path.vertices_mm[1] - scene.vertices_mm[1]
    return bool(off @ np.linalg.solve(path.covariance[4:7, 4:7], off) < 21.1)


def has_legs(n_legs: int, path: lf.LightPath) -> bool:
    """Whether it has as many legs, all straight."""
    return path.n_legs == n_legs and not path.bends


def rows() -> list[Row]:
    """All worlds."""
    found = []
    for photons in (100.0, 400.0):
        for elevation in (30.0, 50.0, 57.0):
            scene = fibre_scene(elevation, photons)
            name = f"fibre, {elevation:g} deg, {photons:g} photons"
            found.append(Row(name, partial(of_scene, scene), partial(rises_as, scene)))
    for way, turn, photons in (("picture", 10.0, 1000.0), ("depth", 10.0, 1000.0)):
        scene = cornered_scene(turn, way, photons)
        name = f"corner, {turn:g} deg in {'the ' * (way == 'picture')}{way}, {photons:g} photons"
        found.append(Row(name, partial(of_scene, scene), partial(has_corner, scene)))
    for name, lab, n_legs in (
        ("one leg", one_leg(), 1), ("three legs", three_legs(), 3), ("two", corner_in_view(), 2),
    ):  # fmt: skip
        for photons, blind in ((40_000.0, False), (400.0, False), (40_000.0, True)):
            told = f"clean, {name}, {photons:g} photons{', blind' * blind}"
            found.append(Row(told, partial(of_lab, lab, photons, blind), partial(has_legs, n_legs)))
    return found


def share(k: int, n: int) -> str:
    """K of n, with its 95 % interval."""
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return f"{k} [{n * low:.0f}, {n * high:.0f}]"


def main() -> None:
    """Print a row for each world."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--first", type=int, default=2000)
    parser.add_argument("--only", default="")
    told = parser.parse_args()
    print("| world | n | right | right or listed | others listed | wrong, trusted | CPU, s |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for row in (one for one in rows() if told.only in one.name):
        right = either = listed = silent = 0
        seconds = []
        for seed in range(told.first, told.first + told.runs):
            hist, call = row.recording(seed)
            begun = time.process_time()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                path = lf.reconstruct(hist, **call)
            seconds.append(time.process_time() - begun)
            own = row.is_right(path)
            any_of = own or any(row.is_right(other.path) for other in path.alternatives)
            right, either = right + own, either + any_of
            listed += bool(path.alternatives)
            silent += path.verdict.level == "trust" and not own
        counts = " | ".join(share(k, told.runs) for k in (right, either, listed, silent))
        middle = float(np.median(seconds))
        print(f"| {row.name} | {told.runs} | {counts} | {middle:.2f} |", flush=True)


if __name__ == "__main__":
    main()
