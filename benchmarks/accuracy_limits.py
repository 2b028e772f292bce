"""Errors of `joint` and `photon` against the Cramér-Rao bound, wherever a lab may work.

    python benchmarks/accuracy_limits.py                         # every table, small
    python benchmarks/accuracy_limits.py --only legs --runs 1000
    python benchmarks/accuracy_limits.py --only coverage --runs 2000

legs      one leg at -10 ... 10 degrees, clean clock, 40,000 photons in the brightest pixel
starved   the same at 40, 10 and 3 photons
steep     one leg of 300 mm about the middle at +-30, +-60, +-80 degrees, 4,000 photons
coverage  how often the stated 68 % and 95 % intervals of angle, end points and end times hold the
          truth, by light, with a perfect clock and with a calibrated one
cost      CPU time in calls of `scipy.optimize.curve_fit`, measured in the same process

Every table prints the rms of (error / bound), where 1 is the limit; its own uncertainty (one
sigma); and the pull of the stated errors. Seeds are fixed. The bound is `lf.bounds` for the same
scene and prior. `--json` keeps the rows, and `tools/update_limits_page.py` puts them on
docs/explanation/limits.md. `benchmarks/accuracy_path.py` holds three legs and the camera's
defects, `benchmarks/check_blind_scenes.py` the random scenes.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import curve_fit

import lightflight as lf
from lightflight.flight import elevation_from_direction
from lightflight.simulate.presets import angle_scene, ideal, paper_scene, pf32

METHODS = ("joint", "photon")
PRIORS = ("known", "emission fitted")
ANGLES_DEG = np.arange(-10.0, 10.1, 0.5)


def clean(**changes: float) -> lf.Detector:
    """The paper's camera with a perfect clock."""
    return ideal(psf_std_px=0.3, active_width_px=0.12, **changes)


def source_of(scene: lf.Scene, prior: str) -> lf.Source:
    """What an experimenter knows under a prior."""
    return lf.Source(
        scene.vertices_mm[0],
        emission_time_ps=scene.emission_time_ps if prior == "known" else None,
        pulse_fwhm_ps=68.0,
    )


def perfect_clock(scene: lf.Scene) -> lf.TimingCalibration:
    """The clock of a detector without defects, as it truly is."""
    hist = lf.simulate(scene, photons_per_pixel=10.0, seed=0, threads=1)
    return lf.TimingCalibration.nominal(hist)


def steep_scene(angle_deg: float) -> lf.Scene:
    """One leg of 300 mm about the middle of the field."""
    from dataclasses import replace

    scene = angle_scene(0.0, detector=clean())
    direction = np.array([np.cos(np.radians(angle_deg)), 0.0, np.sin(np.radians(angle_deg))])
    middle = np.array([*scene.camera.center_mm[:2], 0.0])
    return replace(
        scene, vertices_mm=np.array([middle - 150.0 * direction, middle + 150.0 * direction])
    )


@dataclass
class Tally:
    """Errors of one row, in bounds and in stated errors."""

    in_bounds: list[float] = field(default_factory=list)
    pulls: list[float] = field(default_factory=list)
    degrees: list[float] = field(default_factory=list)
    failed: int = 0

    def add(self, path: lf.LightPath, angle_deg: float, bound_deg: float) -> None:
        """Count one path of one leg."""
        error = path.legs[0].angle_deg - angle_deg
        self.degrees.append(error)
        self.in_bounds.append(error / bound_deg)
        self.pulls.append(error / path.legs[0].angle_std_deg)

    def row(self) -> dict[str, float | None]:
        """Mean |error|, rms in bounds with its own error, pull, failures."""
        if not self.degrees:
            return {**dict.fromkeys(("degrees", "in_bounds", "own", "pull")), "failed": self.failed}
        ratio = float(np.sqrt(np.mean(np.square(self.in_bounds))))
        return {
            "degrees": float(np.mean(np.abs(self.degrees))),
            "in_bounds": ratio,
            "own": ratio / np.sqrt(2.0 * len(self.in_bounds)),
            "pull": float(np.sqrt(np.mean(np.square(self.pulls)))),
            "failed": self.failed,
        }


Rows = list[dict[str, Any]]
"""One table: plain numbers and words by name."""

HEAD = f"{'mean |d|':>10s} {'/bound':>8s} {'+-':>6s} {'pull':>6s} {'failed':>6s}"


def one_leg_rows(
    scenes: Callable[[int], tuple[float, lf.Scene]],
    runs: int,
    photons: float,
    priors: Iterable[str],
    *,
    seed: int,
) -> Rows:
    """A row for each prior and estimator, the same recordings for all."""
    tallies = {(prior, method): Tally() for prior in priors for method in METHODS}
    clock = None
    bounds: dict[tuple[float, str], float] = {}
    for run in range(runs):
        angle, scene = scenes(run)
        clock = clock or perfect_clock(scene)
        hist = lf.simulate(scene, photons_per_pixel=photons, seed=seed + run, threads=1)
        for (prior, method), tally in tallies.items():
            source = source_of(scene, prior)
            if (angle, prior) not in bounds:
                limit = lf.bounds(scene, source=source, photons_per_pixel=photons)
                bounds[angle, prior] = float(limit.angle_std_deg[0])
            try:
                path = lf.reconstruct(
                    hist, camera=scene.camera, source=source, timing=clock, method=method, n_legs=1
                )
            except (ValueError, RuntimeError):
                tally.failed += 1
                continue
            tally.add(path, angle, bounds[angle, prior])
    rows = [
        {"photons": photons, "prior": prior, "method": method, **tally.row()}
        for (prior, method), tally in tallies.items()
    ]
    for row in rows:
        print(f"{photons:8g} {row['prior']:16s} {row['method']:8s} {_numbers(row)}", flush=True)
    return rows


def _numbers(row: dict[str, Any]) -> str:
    if row["degrees"] is None:
        return f"{'-':>10s} {'-':>8s} {'-':>6s} {'-':>6s} {row['failed']:6d}"
    return (
        f"{row['degrees']:10.4f} {row['in_bounds']:8.3f} {row['own']:6.3f} {row['pull']:6.2f} "
        f"{row['failed']:6d}"
    )


def legs(runs: int) -> Rows:
    """One leg at the paper's angles, in full light."""
    print(
        f"\nOne leg, -10 ... 10 deg, clean clock, {runs} recordings\n"
        f"{'photons':>8s} {'':25s} {HEAD}"
    )
    return one_leg_rows(_paper_angles, runs, 40_000.0, PRIORS, seed=10_000)


def _paper_angles(run: int) -> tuple[float, lf.Scene]:
    angle = float(ANGLES_DEG[run % len(ANGLES_DEG)])
    return angle, angle_scene(angle, detector=clean())


def starved(runs: int) -> Rows:
    """One leg in hardly any light."""
    print(f"\nOne leg in starved light, {runs} recordings\n{'photons':>8s} {'':25s} {HEAD}")
    return [
        row
        for photons in (40.0, 10.0, 3.0)
        for row in one_leg_rows(_paper_angles, runs, photons, ("known",), seed=20_000)
    ]


def steep(runs: int) -> Rows:
    """Steep legs, away from the camera (negative) and towards it."""
    print(f"\nSteep legs, 4,000 photons, {runs} recordings each\n{'photons':>8s} {'':25s} {HEAD}")
    rows: Rows = []
    for angle in (-80.0, -60.0, -30.0, 30.0, 60.0, 80.0):
        print(f"  {angle:+.0f} deg")
        scene = steep_scene(angle)
        own = one_leg_rows(
            lambda _run, a=angle, s=scene: (a, s), runs, 4_000.0, PRIORS, seed=30_000
        )
        rows += [{"elevation_deg": angle, **row} for row in own]
    return rows


# --- intervals ------------------------------------------------------------------------------


def coverage(runs: int) -> Rows:
    """How often stated intervals hold the truth."""
    print(f"\nIntervals, three legs, {runs} recordings in all; 64-72 % and 93-97 % are wanted")
    print(
        f"{'clock':12s} {'photons':>8s} {'quantity':14s} {'in 68 %':>8s} {'in 95 %':>8s} {'n':>6s}"
    )
    levels = (100.0, 1_000.0, 40_000.0)
    each = max(1, runs // (2 * len(levels)))
    rows: Rows = []
    for name in ("perfect", "calibrated"):
        for photons in levels:
            for quantity, values in _scaled_errors(name, photons, each).items():
                pulls = np.abs(np.concatenate(values)) if values else np.array([])
                in_68, in_95 = float(np.mean(pulls < 0.9945)), float(np.mean(pulls < 1.96))
                print(
                    f"{name:12s} {photons:8g} {quantity:14s} {in_68:8.1%} {in_95:8.1%} "
                    f"{len(pulls):6d}",
                    flush=True,
                )
                rows.append(
                    {"clock": name, "photons": photons, "quantity": quantity, "in_68": in_68,
                     "in_95": in_95, "n": len(pulls)}
                )  # fmt: skip
    return rows


def _scaled_errors(clock: str, photons: float, runs: int) -> dict[str, list[np.ndarray]]:
    """Errors over stated errors, by quantity; another camera and calibration every eight runs."""
    values: dict[str, list[np.ndarray]] = {"angles": [], "corners x y z": [], "corners t": []}
    for run in range(runs):
        if run == 0 or (clock == "calibrated" and run % 8 == 0):
            scene = paper_scene(clean() if clock == "perfect" else pf32(seed=run))
            timing = perfect_clock(scene) if clock == "perfect" else calibrated(scene, seed=run)
        hist = lf.simulate(scene, photons_per_pixel=photons, seed=40_000 + run, threads=1)
        try:
            path = lf.reconstruct(
                hist, camera=scene.camera, source=source_of(scene, "emission fitted"),
                timing=timing, n_legs=3,
            )  # fmt: skip
        except (ValueError, RuntimeError) as problem:
            print(f"  (run {run}: {problem})")
            continue
        true = elevation_from_direction(
            np.diff(scene.vertices_mm, axis=0)
            / np.linalg.norm(np.diff(scene.vertices_mm, axis=0), axis=1, keepdims=True),
            scene.camera.backward_axis,
        )
        angles = np.array([(leg.angle_deg, leg.angle_std_deg) for leg in path.legs])
        values["angles"].append((angles[:, 0] - np.degrees(true)) / angles[:, 1])
        inner = slice(1, path.n_legs)
        std = path.vertex_std[inner]
        place = path.vertices_mm[inner] - scene.vertices_mm[inner]
        values["corners x y z"].append((place / std[:, :3]).ravel())
        when = path.vertex_times_ps[inner] - scene.vertex_times_ps[inner]
        values["corners t"].append(when / std[:, 3])
    return values


def calibrated(scene: lf.Scene, *, seed: int) -> lf.TimingCalibration:
    """Clock from 4 M code-density and 400 k flat counts per pixel."""
    density = lf.simulate(scene, photons_per_pixel=4e6, seed=seed + 1, kind="code_density")
    flat = lf.simulate(scene, photons_per_pixel=4e5, seed=seed + 2, kind="flat")
    return lf.calibrate_timing(
        density, flat=flat, flat_arrival_ps=flat.truth.flat_arrival_ps, dead_codes="absorbed"
    )


# --- cost -----------------------------------------------------------------------------------


def cost(runs: int) -> Rows:
    """CPU time of whole reconstructions, warm, against `curve_fit` of single pixels."""
    rounds = min(runs, 9)
    print(f"\nCost in curve_fit calls, timed in turn with them, median of {rounds} rounds")
    print(f"{'camera':>12s} {'method':8s} {'calls':>8s} {'allowed':>8s} {'ms':>8s}")
    jobs = (
        ("32 x 32", paper_scene(pf32(seed=0)), "joint", 500),
        ("32 x 32", paper_scene(pf32(seed=0)), "photon", 5_000),
        ("256 x 256", _fine_scene(), "joint", 20_000),
    )
    rows: Rows = []
    for name, scene, method, allowed in jobs:
        timing = calibrated(scene, seed=1) if name == "32 x 32" else perfect_clock(scene)
        hist = lf.simulate(scene, photons_per_pixel=40_000.0, seed=5)
        spent, calls = [], []
        for _ in range(rounds + 1):
            unit, began = _seconds_of_curve_fit(), time.process_time()
            lf.reconstruct(
                hist, camera=scene.camera, source=source_of(scene, "known"), timing=timing,
                method=method,
            )  # fmt: skip
            spent.append(time.process_time() - began)
            calls.append(spent[-1] / unit)
        many, ms = np.median(calls[1:]), 1e3 * np.median(spent[1:])  # the first compiles
        print(f"{name:>12s} {method:8s} {many:8.0f} {allowed:8d} {ms:8.0f}", flush=True)
        rows.append({"camera": name, "method": method, "calls": float(many), "allowed": allowed})
    return rows


def _fine_scene() -> lf.Scene:
    """The three legs on 256 x 256 pixels."""
    camera = lf.Camera.facing_plane((256, 256), center_mm=(187.5, 37.5))
    return paper_scene(ideal(psf_std_px=0.5, active_width_px=0.8), camera=camera)


def _seconds_of_curve_fit() -> float:
    """CPU time of one fit of a sampled Gaussian and a constant to a pulse of 64 codes."""
    code = np.arange(64.0)

    def model(k: np.ndarray, a: float, mu: float, std: float, b: float) -> np.ndarray:
        return a * np.exp(-0.5 * ((k - mu) / std) ** 2) + b

    rng = np.random.default_rng(0)
    pulses = rng.poisson(model(code, 300.0, 31.3, 1.3, 5.0), (200, 64)).astype(float)
    began = time.process_time()
    for pulse in pulses:
        curve_fit(model, code, pulse, p0=(250.0, 30.0, 1.5, 4.0))
    return (time.process_time() - began) / len(pulses)


def main() -> None:
    """Print the tables, and keep them where --json says."""
    tables: dict[str, Callable[[int], Rows]] = {
        f.__name__: f for f in (legs, starved, steep, coverage, cost)
    }
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=82, help="recordings per row")
    parser.add_argument("--only", nargs="+", choices=sorted(tables), default=list(tables))
    parser.add_argument("--json", type=Path, help="file for the rows of all tables")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    done = {name: tables[name](arguments.runs) for name in arguments.only}
    if arguments.json:
        about = {
            "lightflight": lf.__version__,
            "runs": arguments.runs,
            "made_utc": datetime.now(UTC).date().isoformat(),
        }
        arguments.json.write_text(json.dumps({**about, "tables": done}, indent=1))


if __name__ == "__main__":
    main()
