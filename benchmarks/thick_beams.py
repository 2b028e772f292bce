"""Beams turned by mirrors in view: thick ones, bright and hidden mirrors, by an oracle of its own.

    python benchmarks/thick_beams.py                        # 12 recordings a cell, both methods
    python benchmarks/thick_beams.py --runs 40 --methods joint --only "2 mm"

A path of two legs whose corner is in the picture (`tests/oracles/thick_beam.py`, which shares no
line with the package); beams by their standard deviation, seen by pixels of 8 mm. Source and
emission time are told, the number of legs is not. Printed: recordings with the right number of
legs, rms error of the corner, mm, rms pull of what its covariance leaves independent with its 95 %
interval (bootstrap), and verdicts.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

import numpy as np

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.lens_and_pixels import errors_of
from benchmarks.refraction import interval
from tests.oracles.thick_beam import CODE_PS, CODES, EMISSION_PS, PATHS, ThickBeam, counts_of

WORLDS = {
    "thin": ThickBeam(0.1, lens_px=0.4),
    "1 mm": ThickBeam(1.0),
    "2 mm": ThickBeam(2.0),
    "2 mm, dim": ThickBeam(2.0, photons=400.0),
    "disc, 2 mm": ThickBeam(2.0, shape="disc"),
    "ring, 2 mm": ThickBeam(2.0, shape="ring"),
    "1 mm, 64 x 64": ThickBeam(1.0, pixels=64, photons=10_000.0),
    "2 mm, 64 x 64": ThickBeam(2.0, pixels=64, photons=10_000.0),
    "4 mm": ThickBeam(4.0),
    "bright mirror, 10": ThickBeam(0.7, photons=10_000.0, glint=10.0),
    "bright mirror, 100": ThickBeam(0.7, photons=10_000.0, glint=100.0),
    "hidden mirror, 12 mm": ThickBeam(0.7, photons=10_000.0, hidden_mm=12.0),
}


def recording(path: str, beam: ThickBeam, seed: int) -> lf.Histograms:
    """What the camera of the oracle counts."""
    counts = counts_of(PATHS[path], beam, seed)
    return lf.Histograms(counts, bin_width_ps=CODE_PS, laser_period_ps=CODE_PS * CODES)


def path_of(path: str, beam: ThickBeam, hist: lf.Histograms, method: str) -> lf.LightPath:
    """The path of a recording of the oracle, source and emission time told."""
    camera = lf.Camera.facing_plane(
        center_mm=(187.5, 37.5), distance_mm=535.0, shape=(beam.pixels, beam.pixels)
    )
    source = lf.Source(tuple(PATHS[path][0]), emission_time_ps=EMISSION_PS)
    timing = lf.TimingCalibration.nominal(hist)
    return lf.reconstruct(hist, camera=camera, source=source, timing=timing, method=method)


def lines_of(name: str, path: str, methods: list[str], seeds: range) -> list[str]:
    """Rows of the table, a method each; all of them see the same recordings."""
    vertices, beam = PATHS[path], WORLDS[name]
    squares: dict[str, list[tuple[float, float]]] = {method: [] for method in methods}
    levels: dict[str, list[str]] = {method: [] for method in methods}
    for seed in seeds:
        hist = recording(path, beam, seed)
        for method in methods:
            one = path_of(path, beam, hist, method)
            levels[method].append(str(one.verdict.level))
            if one.n_legs == len(vertices) - 1:
                squares[method].append(errors_of(one, vertices))
    rows = []
    for method in methods:
        said = (str(levels[method].count(level)) for level in ("trust", "check", "contradicted"))
        cells = [name, path, method, f"{len(squares[method])}/{len(seeds)}"]
        if squares[method]:
            error2, pull2 = np.array(squares[method]).T
            cells += [f"{np.sqrt(error2.mean()):.4f}", interval(pull2, 1.0)]
        rows.append("| " + " | ".join([*cells, "/".join(said)]) + " |")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--only", nargs="+", choices=WORLDS, default=list(WORLDS))
    parser.add_argument("--paths", nargs="+", choices=PATHS, default=list(PATHS))
    parser.add_argument("--methods", nargs="+", default=["joint", "photon"])
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| beam | corner | method | right | rms, mm | pull | t/c/c |")
    print("|---|---|---|---:|---:|---:|---:|", flush=True)
    for name in args.only:
        for path in args.paths:
            seeds = range(args.first, args.first + args.runs)
            print("\n".join(lines_of(name, path, args.methods, seeds)), flush=True)


if __name__ == "__main__":
    main()
