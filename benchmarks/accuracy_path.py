"""Accuracy of the whole chain on the twin, every clock defect on and calibrated.

    python benchmarks/accuracy_path.py --runs 5
    python benchmarks/accuracy_path.py --runs 48 --clocks 8 --methods joint photon

Prints, for the paper's three-leg scene and for one leg at -10 ... 10 degrees, the error of each
estimator, the Cramér-Rao bound of a perfect clock, and the pull of the stated errors (distance
from the truth in stated errors, rms; 1 is right). Seeds are fixed, so the table is reproducible.
Recordings take turns among `--clocks` cameras, each with its own defects and calibration: what one
calibration got wrong is the same in all its recordings, and one alone says little of the next.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import dataclass

import numpy as np

import lightflight as lf
from lightflight.simulate.presets import angle_scene, paper_scene, pf32

CODE_DENSITY_COUNTS = 4e6
FLAT_COUNTS = 4e5


@dataclass(frozen=True)
class Prior:
    """What is known of the source in one row of the table."""

    name: str
    position: bool = True
    position_std_mm: float = 0.0
    emission: bool = True

    def source(self, scene: lf.Scene, *, measured: int | None = None) -> lf.Source:
        """The source as the estimator is told it; `measured`: with that seed's error of a ruler."""
        place = scene.vertices_mm[0]
        if measured is not None:
            place = place + np.random.default_rng([3, measured]).normal(
                scale=self.position_std_mm, size=3
            )
        return lf.Source(
            place if self.position else None,
            position_std_mm=self.position_std_mm,
            emission_time_ps=scene.emission_time_ps if self.emission else None,
            pulse_fwhm_ps=68.0,
        )


KNOWN = Prior("source and emission time known")
EMISSION_FITTED = Prior("source known, emission time fitted", emission=False)
RULER = Prior("source +- 1 mm, emission time fitted", position_std_mm=1.0, emission=False)
BLIND = Prior("nothing known", position=False, emission=False)


def calibration(scene: lf.Scene, *, seed: int) -> lf.TimingCalibration:
    """Clock of the scene's camera from a code-density and a flat recording."""
    density = lf.simulate(
        scene, photons_per_pixel=CODE_DENSITY_COUNTS, seed=seed, kind="code_density"
    )
    flat = lf.simulate(scene, photons_per_pixel=FLAT_COUNTS, seed=seed + 1, kind="flat")
    return lf.calibrate_timing(
        density, flat=flat, flat_arrival_ps=flat.truth.flat_arrival_ps, dead_codes="absorbed"
    )


def pull_of_path(path: lf.LightPath, scene: lf.Scene) -> float:
    """Return the rms distance of the position in view from the truth, in stated errors."""
    times = np.linspace(path.vertex_times_ps[0], path.vertex_times_ps[-1], 40)[1:-1]
    truth = lf.LightPath.position_at(_true_path(path, scene), times)
    offset = path.position_at(times) - truth
    covariance = path.position_covariance_at(times)
    pulls = []
    for delta, matrix in zip(offset, covariance, strict=True):
        # Depth along the camera's ray is what the clock measures: pull of the worst direction.
        _, vectors = np.linalg.eigh(matrix)
        worst = vectors[:, -1]
        pulls.append(float(worst @ delta) / np.sqrt(float(worst @ matrix @ worst)))
    return float(np.sqrt(np.nanmean(np.square(pulls))))


def _true_path(path: lf.LightPath, scene: lf.Scene) -> lf.LightPath:
    from dataclasses import replace

    m = len(scene.vertex_times_ps)
    return replace(
        path,
        vertices_mm=scene.vertices_mm,
        vertex_times_ps=scene.vertex_times_ps,
        covariance=np.zeros((4 * m, 4 * m)),
    )


def three_legs(runs: int, photons: float, methods: tuple[str, ...], n_clocks: int) -> None:
    """The paper's scene under each prior."""
    scenes = [paper_scene(detector=pf32(seed=k)) for k in range(min(n_clocks, runs))]
    clocks = [calibration(scene, seed=100 + 10 * k) for k, scene in enumerate(scenes)]
    print(
        f"\nThree legs, {photons:g} photons in the brightest pixel, {runs} recordings of "
        f"{len(clocks)} cameras"
    )
    print(
        f"{'prior':38s} {'estimator':9s} {'mm':>8s} {'ps':>8s} {'bound mm':>9s} {'ratio':>6s} pull"
    )
    for prior in (KNOWN, EMISSION_FITTED, RULER, BLIND):
        bound = lf.bounds(scenes[0], source=prior.source(scenes[0]), photons_per_pixel=photons)
        for method in methods:
            if method == "paper" and not prior.position:
                continue
            errors, pulls = [], []
            for run in range(runs):
                scene, clock = scenes[run % len(scenes)], clocks[run % len(clocks)]
                hist = lf.simulate(scene, photons_per_pixel=photons, seed=1000 + run)
                source = prior.source(scene, measured=run)
                try:
                    path = lf.reconstruct(
                        hist, camera=scene.camera, source=source, timing=clock, method=method
                    )
                except (ValueError, RuntimeError) as problem:
                    print(f"    run {run}: {problem}")
                    continue
                errors.append(lf.path_error(path, hist.truth, scene.camera))
                pulls.append(pull_of_path(path, scene))
            position, time = np.sqrt(np.mean(np.square(errors), axis=0))
            pull = np.sqrt(np.mean(np.square(pulls)))
            print(
                f"{prior.name:38s} {method:9s} {position:8.3f} {time:8.3f} "
                f"{bound.position_rms_mm:9.3f} {position / bound.position_rms_mm:6.2f} {pull:5.2f}",
                flush=True,
            )


def one_leg(photons: float, methods: tuple[str, ...], step_deg: float) -> None:
    """One leg at every angle, as in the paper's Fig. 5."""
    print(f"\nOne leg, -10 ... 10 deg in {step_deg:g} deg steps, {photons:g} photons per pixel")
    print(f"{'prior':38s} {'estimator':9s} {'mean |d alpha| deg':>19s} {'rms/bound':>10s} pull")
    angles = np.arange(-10.0, 10.0 + 1e-9, step_deg)
    timing = calibration(angle_scene(0.0, detector=pf32(seed=0)), seed=100)
    for prior in (KNOWN, EMISSION_FITTED):
        for method in methods:
            errors, ratios, pulls = [], [], []
            for k, angle in enumerate(angles):
                scene = angle_scene(float(angle), detector=pf32(seed=0))
                source = prior.source(scene)
                hist = lf.simulate(scene, photons_per_pixel=photons, seed=2000 + k)
                path = lf.reconstruct(
                    hist, camera=scene.camera, source=source, timing=timing, method=method
                )
                error = path.legs[0].angle_deg - angle
                bound = lf.bounds(scene, source=source, photons_per_pixel=photons)
                errors.append(error)
                ratios.append(error / bound.angle_std_deg[0])
                pulls.append(error / path.legs[0].angle_std_deg)
            print(
                f"{prior.name:38s} {method:9s} {np.mean(np.abs(errors)):19.4f} "
                f"{np.sqrt(np.mean(np.square(ratios))):10.2f} "
                f"{np.sqrt(np.mean(np.square(pulls))):5.2f}",
                flush=True,
            )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5, help="recordings per row")
    parser.add_argument("--clocks", type=int, default=4, help="cameras that record in turn")
    parser.add_argument("--photons", type=float, nargs="+", default=[40_000.0, 400.0, 40.0])
    parser.add_argument("--methods", nargs="+", default=["paper", "joint", "photon"])
    parser.add_argument("--step-deg", type=float, default=1.0)
    parser.add_argument("--skip-legs", action="store_true", help="only the one-leg table")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    for photons in [] if args.skip_legs else args.photons:
        three_legs(args.runs, photons, tuple(args.methods), args.clocks)
    one_leg(args.photons[0], tuple(args.methods), args.step_deg)


if __name__ == "__main__":
    main()
