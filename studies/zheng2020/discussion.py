"""What the paper's discussion hopes for: steep angles, larger arrays, media, bends, cavities.

Not covered: single-shot recordings by gated sensors of 10 ns (the paper's reference 29), which
see the whole flight in one frame and have no arrival time per photon.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.camera.model import Camera
from lightflight.demo import PHOTONS_PER_PIXEL, known_source
from lightflight.flight import Medium
from lightflight.path.error import path_error
from lightflight.reconstruct.limits.bounds import bounds
from lightflight.recording.histograms import Histograms
from lightflight.simulate import Mirror, Scene, simulate, vertices_from_mirrors
from lightflight.simulate.presets import angle_scene, paper_scene, spad256
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.clock.calibration import TimingCalibration
from studies.zheng2020.bending import measure_bend
from studies.zheng2020.cases import Case, case_from_values, case_of
from studies.zheng2020.laboratory import (
    calibrated_clock,
    elevation_deg,
    path_of_recording,
    recorded,
)
from studies.zheng2020.work import Unit

Floats = NDArray[np.float64]

ESTIMATORS = ("paper", "joint", "photon")
RECORDINGS, QUICK_RECORDINGS = 4, 1
"""Of each leg at a steep angle or in a medium."""

STEEP_DEG = (-75.0, -60.0, -45.0, -30.0, 30.0, 45.0, 60.0)
"""Steeper towards the camera, the leg passes beside the picture of this set-up."""
MEDIA: Mapping[str, Medium] = {
    "air": Medium(),
    "water": Medium(1.345, 1.345),
    "fibre, seen through air": Medium(1.468, 1.00027),
}
"""Group indices at 637 nm, out and back."""

FLATS_OF_ARRAY_PS = (1000.0, 17000.0)
"""Arrival times of the two flats of the larger array's calibration, within its gate of 19 ns."""

NOT_COVERED = (
    "Single-shot recordings by gated silicon sensors (10 ns frames) are not covered: they have no "
    "arrival time per photon."
)


@dataclass(frozen=True, eq=False)
class Discussion:
    """Everything tried."""

    cases: tuple[Case, ...]
    """In the order of the paper's discussion."""


def units(quick: bool) -> tuple[Unit, ...]:
    """One unit per thing tried."""
    steep = STEEP_DEG[2:6:3] if quick else STEEP_DEG
    recordings = QUICK_RECORDINGS if quick else RECORDINGS
    array: dict[str, Any] = {"pixels": 256, "methods": list(ESTIMATORS)}
    if quick:
        array = {"pixels": 64, "methods": ["paper", "joint"]}
    return (
        *(
            Unit(
                f"steep{a:+04.0f}x{recordings}",
                measure_steep,
                {"angle_deg": a, "recordings": recordings},
            )
            for a in steep
        ),
        Unit(f"array-{array['pixels']}", measure_array, array),
        *(
            Unit(
                f"medium-{k}x{recordings}",
                measure_medium,
                {"name": name, "recordings": recordings},
            )
            for k, name in enumerate(MEDIA)
        ),
        Unit("airy", measure_bend, {"bend_mm": 25.0, "pieces": 8}),
        Unit("cavity", measure_cavity, {"passes": 5 if quick else 7}),
    )


def record_from_results(results: Sequence[Mapping[str, Any]]) -> Discussion:
    """The discussion from the results of `units`."""
    return Discussion(
        tuple(case_from_values(case) for result in results for case in result["cases"])
    )


def _tried(methods: Sequence[str], measure: Callable[[str], float]) -> tuple[dict[str, float], str]:
    """Error by method, NaN where one finds nothing, and what it said then."""
    errors, said = {}, []
    for method in methods:
        try:
            errors[method] = measure(method)
        except (ValueError, RuntimeError) as problem:
            errors[method] = float("nan")
            said.append(f"{method}: {problem}")
    return errors, "; ".join(said)


def _angle_errors_deg(
    methods: Sequence[str],
    scene: Scene,
    hists: Sequence[Histograms],
    timing: TimingCalibration,
    *,
    medium: Medium | None = None,
) -> tuple[dict[str, float], str]:
    """Error of the angle of one leg, rms over recordings, deg; as `_tried`.

    Parameters
    ----------
    medium : what the medium is taken for; None: what it is.
    """
    (true,) = [elevation_deg(step) for step in np.diff(np.asarray(scene.vertices_mm), axis=0)]

    def error(method: str) -> float:
        paths = [
            path_of_recording(hist, scene, timing, method, medium=medium, n_legs=1)
            for hist in hists
        ]
        return float(np.sqrt(np.mean([(path.legs[0].angle_deg - true) ** 2 for path in paths])))

    return _tried(methods, error)


def measure_steep(*, angle_deg: float, recordings: int, seed: int) -> dict[str, Any]:
    """One leg at a steep angle: error of the angle by every estimator."""
    scene = angle_scene(angle_deg)
    first = 3_000_000 * (seed + 1) + round(angle_deg + 90)
    hists = [recorded(scene, seed=first + 1000 * k) for k in range(recordings)]
    timing = calibrated_clock("codes", seed=seed)
    errors, said = _angle_errors_deg(ESTIMATORS, scene, hists, timing)
    bound = bounds(scene, source=known_source(scene), photons_per_pixel=PHOTONS_PER_PIXEL)
    return {
        "cases": [
            case_of(
                "steep angles",
                f"{angle_deg:+.0f}°",
                "angle (deg)",
                errors,
                bound=float(bound.angle_std_deg[0]),
                note=said,
            )
        ]
    }


def measure_array(*, pixels: int, methods: Sequence[str], seed: int) -> dict[str, Any]:
    """The three legs seen by a square array with 61 % fill factor and a clock of 38 ps.

    The same field, laser and time: a pixel's light goes with its active area, so 256 x 256 pixels
    of 61 % get 0.64 times the photons of a pixel of 32 x 32 with 1.5 %. Smaller arrays of such
    pixels are stopped at the paper's 40,000.
    """
    camera = Camera.facing_plane(
        (pixels, pixels),
        distance_mm=535.0,
        field_of_view_mm=(245.0, 245.0),
        center_mm=(187.5, 37.5),
    )
    scene = paper_scene(spad256(), camera=camera)
    photons = min(PHOTONS_PER_PIXEL, PHOTONS_PER_PIXEL * (0.61 / 0.0149) * (32.0 / pixels) ** 2)
    counts = 1e6
    first = 4_000_000 * (seed + 1)
    timing = _clock_of_array(scene, counts, first)
    hist = simulate(scene, photons_per_pixel=photons, seed=first + 2)

    def error(method: str) -> float:
        path = path_of_recording(hist, scene, timing, method, n_legs=scene.n_legs)
        return path_error(path, scene, camera).position_rms_mm

    errors, said = _tried(methods, error)
    bound = bounds(scene, source=known_source(scene), photons_per_pixel=photons)
    note = f"{photons:,.0f} photons in the brightest pixel; bound of a perfect clock"
    return {
        "cases": [
            case_of(
                "larger array",
                f"{pixels} × {pixels}, 61 % fill factor",
                "position (mm)",
                errors,
                bound=bound.position_rms_mm,
                note=f"{note}; {said}" if said else note,
            )
        ]
    }


def _clock_of_array(scene: Scene, counts: float, first: int) -> TimingCalibration:
    """Clock from a code density and flats at both ends of the gate.

    The gate is shorter than the laser period, so the codes alone do not show a pixel's gain: one
    flat would leave 6.5 ps for every ns between it and the light.
    """
    density = simulate(scene, photons_per_pixel=counts, seed=first, kind="code_density")
    flats = [
        simulate(
            scene,
            photons_per_pixel=0.1 * counts,
            seed=first + 1 + 10 * k,
            kind="flat",
            flat_arrival_ps=arrival,
        )
        for k, arrival in enumerate(FLATS_OF_ARRAY_PS)
    ]
    return calibrate_timing(density, flat=flats, flat_arrival_ps=FLATS_OF_ARRAY_PS)


def measure_medium(*, name: str, recordings: int, seed: int) -> dict[str, Any]:
    """One leg at 3 degrees in a medium: with its indices known, and taken for air."""
    scene = angle_scene(3.0, medium=MEDIA[name])
    first = 5_000_000 * (seed + 1) + list(MEDIA).index(name)
    hists = [recorded(scene, seed=first + 1000 * k) for k in range(recordings)]
    timing = calibrated_clock("codes", seed=seed)
    errors, said = _angle_errors_deg(ESTIMATORS, scene, hists, timing)
    if name != "air":
        wrong, told = _angle_errors_deg(("joint",), scene, hists, timing, medium=Medium())
        told = told or f"{wrong['joint']:.2g}° off"
        said = "; ".join(filter(None, (said, f"taken for air: {told}")))
    bound = bounds(scene, source=known_source(scene), photons_per_pixel=PHOTONS_PER_PIXEL)
    return {
        "cases": [
            case_of(
                "refractive indices",
                name,
                "angle (deg)",
                errors,
                bound=float(bound.angle_std_deg[0]),
                note=said,
            )
        ]
    }


@cache
def cavity_scene(passes: int) -> Scene:
    """A pulse between two parallel mirrors, seen from the side; one leg per pass."""
    mirrors = (Mirror((375.0, 0.0, 0.0), (1.0, 0.0, 0.0)), Mirror((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    step = np.array([375.0, 25.0, 12.0])
    vertices = vertices_from_mirrors(
        (0.0, 0.0, 0.0),
        direction=step,
        mirrors=mirrors,
        exit_length_mm=float(np.linalg.norm(step)),
        most_reflections=passes - 1,
    )
    camera = Camera.facing_plane(
        (32, 32),
        distance_mm=535.0,
        field_of_view_mm=(245.0, 245.0),
        center_mm=(187.5, 12.5 * passes),
    )
    return paper_scene(camera=camera, vertices_mm=vertices)


def measure_cavity(*, passes: int, seed: int) -> dict[str, Any]:
    """Position and round-trip time of a pulse in a cavity; the number of legs is found."""
    scene = cavity_scene(passes)
    hist = recorded(scene, seed=6_000_000 * (seed + 1))
    timing = calibrated_clock("codes", seed=seed, three_legs=True)
    true_trip = float(scene.vertex_times_ps[2] - scene.vertex_times_ps[0])
    trips, legs = {}, {}

    def error(method: str) -> float:
        path = path_of_recording(hist, scene, timing, method)
        times = path.vertex_times_ps
        inner = times[2:-1] - times[:-3]
        trips[method] = abs(float(np.mean(inner)) - true_trip)
        legs[method] = path.n_legs
        return path_error(path, scene, scene.camera).position_rms_mm

    errors, said = _tried(ESTIMATORS, error)
    bound = bounds(scene, source=known_source(scene), photons_per_pixel=PHOTONS_PER_PIXEL)
    found = ", ".join(f"{method} {n}" for method, n in legs.items())
    note = f"{passes} passes; legs found: {found}"
    return {
        "cases": [
            case_of(
                "cavity",
                f"{passes} passes",
                "position (mm)",
                errors,
                bound=bound.position_rms_mm,
                note=f"{note}; {said}" if said else note,
            ),
            case_of(
                "cavity",
                f"round trip of {true_trip:.1f} ps",
                "round-trip time (ps)",
                {method: trips.get(method, float("nan")) for method in errors},
            ),
        ]
    }
