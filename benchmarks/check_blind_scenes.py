"""Random scenes nobody tuned for, drawn by the brute-force oracle, put through `reconstruct`.

    python benchmarks/check_blind_scenes.py --scenes 40
    python benchmarks/check_blind_scenes.py --seed 17 --only known      # one scene again
    python benchmarks/check_blind_scenes.py --legs 6 --only blind       # harder

The photons come from `tests/oracles/brute_force.py`, which shares no line with the package (nor
with its twin): a wrong sign, factor or convention cannot cancel here. Every seed is one scene:
1-4 legs, corners outside the picture (one in five inside), uneven brightness, a camera that
faces the scene or looks on obliquely and rolled, Gaussian or tailed response, codes forward or
reversed, 2,000 photons in the brightest pixel. The clock is calibrated from a code-density and a
flat recording of the same oracle.

Printed per scene: legs true and found, rms position error in view, the package's own bound
beside it, pull of the stated errors (rms over points in view; 1 is right), seconds of CPU, the
verdict. No scene is left out of median and 95 %: one that was refused, or has another number of
legs, counts as infinitely far off. At the end: how often each verdict was given to a right and to
a wrong path (wrong: number of legs, or a corner more than five stated errors off), and what went
wrong, by class, with seeds.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
import traceback
import warnings
from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import lightflight as lf
from tests.oracles.brute_force import (
    BruteCamera,
    BruteClock,
    BruteScene,
    camera_looking_at,
    camera_over_plane,
    expected_counts,
    gaussian_share,
    tailed_share,
)

PHOTONS = 2_000.0
BACKGROUND_PER_PIXEL = 20.0
N_CODES, CODE_PS, PERIOD_PS = 1024, 55.0, 50_000.0
PULSE_STD_PS = float(np.hypot(68.0, 150.0)) / 2.3548200450309493
TAIL_PS = 60.0
FLAT_PS = 5_000.0
PRIORS = ("known", "emission fitted", "ruler", "blind")
LEAST_PIXELS, LEAST_TURN_DEG = 6.0, 10.0
CENTER_PX = 15.5


@dataclass(frozen=True)
class Case:
    """One scene with everything that was drawn for it."""

    seed: int
    scene: BruteScene
    facing: bool
    corner_inside: bool

    @property
    def n_legs(self) -> int:
        """True number of legs."""
        return len(self.scene.vertices) - 1

    def words(self) -> str:
        """What kind of scene this is."""
        clock = "reversed" if self.scene.clock.reversed else "forward"
        shape = "tailed" if self.scene.tail else "gaussian"
        pose = "facing" if self.facing else "oblique"
        return f"{pose:8s}{clock:9s}{shape:9s}{'inside' if self.corner_inside else '':7s}"


# ---- the generator ---------------------------------------------------------------------------


def drawn_camera(rng: np.random.Generator, facing: bool) -> BruteCamera:
    """The paper's camera, or one 450-650 mm away, up to 50 degrees off and rolled at will."""
    if facing:
        return camera_over_plane(center=(187.5, 37.5))
    target = np.array([187.5, 37.5, 20.0])
    off, around = np.deg2rad(rng.uniform(10.0, 50.0)), rng.uniform(0.0, 2.0 * np.pi)
    away = [np.sin(off) * np.cos(around), np.sin(off) * np.sin(around), np.cos(off)]
    return camera_looking_at(
        (target + rng.uniform(450.0, 650.0) * np.array(away)).tolist(),
        target.tolist(),
        roll=rng.uniform(-np.pi, np.pi),
        px_per_slope=32.0 / (245.0 / 535.0),
    )


def point_in_space(camera: BruteCamera, row: float, col: float, depth: float) -> np.ndarray:
    """World point that the pixel (row, col) sees at a depth along the optical axis."""
    down = (row - camera.row_of_axis) / camera.px_per_slope_row
    across = (col - camera.col_of_axis) / camera.px_per_slope_col
    return camera.center + depth * (camera.forward + down * camera.down + across * camera.right)


def pixels_crossed(camera: BruteCamera, start: np.ndarray, end: np.ndarray) -> float:
    """Length of a leg's image inside the picture, px."""
    seen = np.array([camera.image(start + f * (end - start)) for f in np.linspace(0.0, 1.0, 200)])
    inside = np.asarray(((seen > -0.5) & (seen < 31.5)).all(axis=1))
    steps = np.linalg.norm(np.diff(seen, axis=0), axis=1)
    return float(steps[inside[1:] & inside[:-1]].sum())


def drawn_vertices(
    rng: np.random.Generator, camera: BruteCamera, n_legs: int, corner_inside: bool
) -> np.ndarray:
    """Corners on a ring around the picture; legs that cross it by 6 px or more and turn by 10
    degrees or more; depths within 120 mm of the scene's middle.
    """
    middle = float(camera.forward @ (np.array([187.5, 37.5, 20.0]) - camera.center))
    for _ in range(10_000):
        vertices = []
        for k in range(n_legs + 1):
            around, ring = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(18.0, 30.0)
            if corner_inside and k == 1 and n_legs > 1:
                ring = rng.uniform(0.0, 10.0)
            row, col = CENTER_PX + ring * np.sin(around), CENTER_PX + ring * np.cos(around)
            vertices.append(point_in_space(camera, row, col, middle + rng.uniform(-120.0, 120.0)))
        points = np.array(vertices)
        steps = np.diff(points, axis=0)
        units = steps / np.linalg.norm(steps, axis=1, keepdims=True)
        turns = np.degrees(np.arccos(np.clip(np.sum(units[1:] * units[:-1], axis=1), -1, 1)))
        # Turning back by nearly 180 degrees is a mirror hit head on: two legs in one line.
        if ((turns < LEAST_TURN_DEG) | (turns > 170.0)).any():
            continue
        crossed = [pixels_crossed(camera, a, b) for a, b in itertools.pairwise(points)]
        if min(crossed) >= LEAST_PIXELS:
            return points
    raise RuntimeError("no scene found: the generator's wishes exclude each other")


def drawn_case(seed: int, most_legs: int = 4) -> Case:
    """The scene of a seed, with 1 to `most_legs` legs."""
    rng = np.random.default_rng([2020, seed])
    n_legs, facing = int(rng.integers(1, most_legs + 1)), bool(rng.random() < 0.4)
    corner_inside = bool(rng.random() < 0.2) and n_legs > 1
    camera = drawn_camera(rng, facing)
    vertices = drawn_vertices(rng, camera, n_legs, corner_inside)
    whole = float(np.sum(np.linalg.norm(np.diff(vertices, axis=0), axis=1)))
    places = np.linspace(0.0, whole, 3 * n_legs + 2)
    # Brightness varies by a factor e or so within a leg: smoke is never even.
    levels = rng.normal(0.0, 0.5, len(places))
    scene = BruteScene(
        vertices=vertices,
        camera=camera,
        clock=BruteClock(
            N_CODES,
            CODE_PS,
            PERIOD_PS,
            reversed=bool(rng.random() < 0.5),
            ends_with_period=True,
        ),
        emission_time=float(rng.uniform(500.0, 4_000.0)),
        pulse_std=PULSE_STD_PS,
        tail=TAIL_PS if rng.random() < 0.5 else 0.0,
        blur_std_px=float(rng.uniform(0.25, 0.45)),
        background_per_ps=BACKGROUND_PER_PIXEL / PERIOD_PS,
        brightness=lambda s: float(np.exp(np.interp(s, places, levels))),
    )
    return Case(seed, scene, facing, corner_inside)


# ---- recordings ------------------------------------------------------------------------------


def histograms(counts: np.ndarray, clock: BruteClock) -> lf.Histograms:
    return lf.Histograms(
        counts,
        bin_width_ps=clock.width,
        laser_period_ps=clock.period,
        reversed_codes=clock.reversed,
    )


@cache
def calibration(clock: BruteClock, tail: float) -> lf.TimingCalibration:
    """Clock from even light (1 M counts) and a collimated flash at FLAT_PS (400,000)."""
    rng = np.random.default_rng([7, clock.reversed, tail > 0.0])
    ends = np.array([clock.interval(code) for code in range(clock.n_codes)])
    width = ends[:, 1] - ends[:, 0]
    density = rng.poisson(1e6 * width / width.sum(), (32, 32, clock.n_codes))
    flash = np.zeros(clock.n_codes)
    for turn in (-1, 0, 1):
        delay = ends + turn * clock.period - FLAT_PS
        if tail > 0.0:
            flash += np.subtract(*(tailed_share(d, PULSE_STD_PS, tail) for d in delay.T[::-1]))
        else:
            flash += np.subtract(*(gaussian_share(d, PULSE_STD_PS) for d in delay.T[::-1]))
    flat = rng.poisson(4e5 * np.maximum(flash, 0.0), (32, 32, clock.n_codes))
    return lf.calibrate_timing(
        histograms(density, clock),
        flat=histograms(flat, clock),
        flat_arrival_ps=FLAT_PS,
        dead_codes="absorbed",
    )


def package_camera(brute: BruteCamera) -> lf.Camera:
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([brute.right, brute.down, brute.forward])
    pose[:3, 3] = brute.center
    matrix = [
        [brute.px_per_slope_col, 0.0, brute.col_of_axis],
        [0.0, brute.px_per_slope_row, brute.row_of_axis],
        [0.0, 0.0, 1.0],
    ]
    return lf.Camera(np.array(matrix), np.empty(0), pose, (brute.rows, brute.cols))


# ---- outcome ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Outcome:
    """What came out of one scene under one prior."""

    found_legs: int = 0
    rms_mm: float = float("nan")
    bound_mm: float = float("nan")
    pull: float = float("nan")
    seconds: float = 0.0
    failure: str = ""
    level: str = "refused"
    named: tuple[str, ...] = ()
    off_stds: float = 0.0
    """How far the worst corner is off, in its stated errors; inf where legs are too many or few."""

    @property
    def wrong(self) -> bool:
        """Wrong number of legs, or a corner more than five stated errors off."""
        return self.off_stds > 5.0


def true_times(scene: BruteScene) -> np.ndarray:
    steps = np.linalg.norm(np.diff(scene.vertices, axis=0), axis=1)
    return scene.emission_time + scene.path_index * np.append(0.0, np.cumsum(steps)) / 0.299792458


def compared(case: Case, path: lf.LightPath) -> tuple[float, float]:
    """(rms position error in view at equal event times, rms pull of the stated errors)."""
    scene, times = case.scene, true_times(case.scene)
    events = np.linspace(times[0], times[-1], 500)
    truth = np.stack([np.interp(events, times, scene.vertices[:, i]) for i in range(3)], axis=1)
    seen = np.array([scene.camera.image(x) for x in truth])
    seen_in = ((seen > -0.5) & (seen < 31.5)).all(axis=1)
    leg = np.clip(np.searchsorted(path.vertex_times_ps, events, "right") - 1, 0, path.n_legs - 1)
    t0, t1 = path.vertex_times_ps[leg], path.vertex_times_ps[leg + 1]
    part = ((events - t0) / (t1 - t0))[:, None]
    found = (1.0 - part) * path.vertices_mm[leg] + part * path.vertices_mm[leg + 1]
    offset = (found - truth)[seen_in]
    rms = float(np.sqrt(np.mean(np.sum(offset**2, axis=1))))
    within = seen_in & (events > path.vertex_times_ps[0]) & (events < path.vertex_times_ps[-1])
    # Near a corner a point may lie on either leg: errors are not Gaussian there.
    corner = np.abs(events[:, None] - path.vertex_times_ps[1:-1]).min(axis=1, initial=np.inf)
    within &= corner > 15.0
    if not within.any():
        return rms, float("nan")
    covariance = path.position_covariance_at(events[within])
    pulls = []
    for delta, matrix in zip((found - truth)[within], covariance, strict=True):
        values, vectors = np.linalg.eigh(matrix)
        # The direction the data know least: along the line of sight as a rule.
        pulls.append((vectors[:, -1] @ delta) / np.sqrt(max(values[-1], 1e-12)))
    return rms, float(np.sqrt(np.mean(np.square(pulls))))


def judged(
    case: Case,
    counts: np.ndarray,
    source: lf.Source,
    timing: lf.TimingCalibration,
    method: str,
    photons: float,
) -> Outcome:
    """Reconstruct one scene and hold it against the truth."""
    scene = case.scene
    camera = package_camera(scene.camera)
    began = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            path = lf.reconstruct(
                histograms(counts, scene.clock),
                camera=camera,
                source=source,
                medium=lf.Medium(),
                timing=timing,
                method=method,
            )
    except Exception as error:  # noqa: BLE001 - every failure is a finding here
        if isinstance(error, ValueError | RuntimeError) and type(error).__module__ != "builtins":
            failure = f"{type(error).__name__}: {error}"
        else:
            failure = f"CRASH {type(error).__name__}: {error} at {_place(error)}"
        return Outcome(seconds=time.process_time() - began, failure=failure)
    seconds = time.process_time() - began
    rms, pull = compared(case, path)
    bound = _bound(case, source, camera, photons)
    failure = ""
    if path.n_legs != case.n_legs:
        failure = f"legs: {path.n_legs} for {case.n_legs}"
    elif not path.goodness.converged:
        failure = "not converged"
    elif not rms < 5.0 * bound:
        failure = f"far from the bound: {rms:.2f} mm for {bound:.2f}"
    elif not pull < 4.0:
        failure = f"errors understated: pull {pull:.1f}"
    off = float("inf")
    if path.n_legs == case.n_legs:
        corners = np.abs(path.vertices_mm - scene.vertices)[1:-1]
        off = float(np.max(corners / np.maximum(path.vertex_std[1:-1, :3], 1e-9), initial=0.0))
    named = tuple(str(finding.name) for finding in path.verdict.findings)
    level = str(path.verdict.level)
    return Outcome(path.n_legs, rms, bound, pull, seconds, failure, level, named, off)


def _bound(case: Case, source: lf.Source, camera: lf.Camera, photons: float) -> float:
    """The package's bound of the rms position error in view, mm."""
    scene, brightness = case.scene, case.scene.brightness
    assert brightness is not None
    spot = float(np.hypot(scene.blur_std_px, scene.active_side_px / np.sqrt(12.0)))
    subject = SimpleNamespace(
        vertices_mm=scene.vertices, camera=camera, source=source, medium=lf.Medium(),
        emission_time_ps=scene.emission_time, vertex_times_ps=true_times(scene),
        strength=lambda along, _leg: np.array([brightness(s) for s in along]),
    )  # fmt: skip
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            limit = lf.bounds(
                subject,
                photons_per_pixel=photons,
                spot_std_px=spot,
                pulse_std_ps=float(np.hypot(PULSE_STD_PS, scene.tail)),
                code_width_ps=CODE_PS,
                background_per_code=BACKGROUND_PER_PIXEL * CODE_PS / PERIOD_PS,
            )
        return float(limit.position_rms_mm)
    except Exception as error:  # noqa: BLE001 - the bound is a help, not the subject
        print(f"  (no bound: {type(error).__name__}: {error})")
        return float("inf")


def _place(error: BaseException) -> str:
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{Path(frame.filename).name}:{frame.lineno}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--seed", type=int, help="this scene alone, with its truth")
    parser.add_argument("--method", default="joint", choices=("joint", "photon", "paper"))
    parser.add_argument("--only", choices=PRIORS, help="one prior alone")
    parser.add_argument("--legs", type=int, default=4, help="most legs of a scene")
    parser.add_argument("--photons", type=float, default=PHOTONS, help="in the brightest pixel")
    options = parser.parse_args()
    seeds = (
        [options.seed]
        if options.seed is not None
        else range(options.first, options.first + options.scenes)
    )
    clocks: dict[tuple[bool, float], lf.TimingCalibration] = {}
    failures: dict[str, list[str]] = defaultdict(list)
    every: dict[str, list[Outcome]] = defaultdict(list)
    print(f"{'seed':>5} {'scene':33s}{'prior':17s}legs  rms mm  bound   pull   s  verdict")
    for seed in seeds:
        case = drawn_case(seed, options.legs)
        expected = expected_counts(case.scene, brightest=options.photons)
        counts = np.random.default_rng([case.seed, 99]).poisson(expected)
        key = (case.scene.clock.reversed, case.scene.tail)
        if key not in clocks:
            clocks[key] = calibration(case.scene.clock, case.scene.tail)
        known = lf.Source(
            case.scene.vertices[0], emission_time_ps=case.scene.emission_time, pulse_fwhm_ps=68.0
        )
        timeless = replace(known, emission_time_ps=None)
        sources = (
            known,
            timeless,
            replace(
                timeless,
                position_mm=case.scene.vertices[0]
                + np.random.default_rng([seed, 1]).normal(size=3),
                position_std_mm=1.0,
            ),
            lf.Source(pulse_fwhm_ps=68.0),
        )
        for prior, source in zip(PRIORS, sources, strict=True):
            if prior != options.only and (options.only or prior not in PRIORS[:2]):
                continue
            outcome = judged(case, counts, source, clocks[key], options.method, options.photons)
            print(
                f"{seed:5d} {case.words()}{prior:17s}{case.n_legs}/{outcome.found_legs} "
                f"{outcome.rms_mm:8.3f}{outcome.bound_mm:7.3f}{outcome.pull:7.2f}"
                f"{outcome.seconds:5.1f}  {outcome.level} {' '.join(outcome.named)}"
                f"{'; ' * bool(outcome.failure)}{outcome.failure}",
                flush=True,
            )
            every[prior].append(outcome)
            if outcome.failure:
                failures[outcome.failure.split(":")[0]].append(f"{seed} ({prior})")
        if options.seed is not None:
            print(np.round(case.scene.vertices, 2).tolist(), true_times(case.scene).round(1))
    for prior, outcomes in every.items():
        right = [o for o in outcomes if np.isfinite(o.off_stds) and np.isfinite(o.rms_mm)]
        # Whatever came out: a scene that was refused or has other legs is infinitely far off.
        ratio = np.full(len(outcomes), np.inf)
        ratio[: len(right)] = [o.rms_mm / o.bound_mm for o in right]
        median, most = np.quantile(ratio, (0.5, 0.95), method="inverted_cdf")
        pull = np.sqrt(np.mean([o.pull**2 for o in right if np.isfinite(o.pull)]))
        print(
            f"{prior}: {len(right)} of {len(outcomes)} with the right number of legs; "
            f"rms / bound of all: median {median:.2f}, 95 % {most:.2f}; pull {pull:.2f}"
        )
    for prior, outcomes in every.items():
        levels = [(o.level, "wrong" if o.wrong else "right") for o in outcomes]
        words = ", ".join(f"{n} {level} and {held}" for (level, held), n in Counter(levels).items())
        print(f"{prior}, verdict and path: {words}")
    for kind, where in sorted(failures.items()):
        print(f"FAILED {kind}: {len(where)}: {', '.join(where)}")


if __name__ == "__main__":
    main()
