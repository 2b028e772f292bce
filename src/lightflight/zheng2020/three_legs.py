"""The demo: Fig. 6 once, recorded, calibrated, reconstructed under several priors, compared.

The paper does not publish its coordinates or its photon counts; the scene here is ours, of the
stated size, and gives the stated difference between arrival and propagation time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

from lightflight.histogram import Histograms
from lightflight.path import LightPath
from lightflight.path_error import PathError, path_error
from lightflight.reconstruct import reconstruct
from lightflight.simulate import Scene, simulate
from lightflight.simulate.presets import paper_scene
from lightflight.timing.calibration import TimingCalibration, calibrate_timing
from lightflight.zheng2020.laboratory import (
    CODE_DENSITY_PER_PIXEL,
    FLAT_PER_PIXEL,
    PHOTONS_PER_PIXEL,
    known_source,
)

Step = Callable[[str], AbstractContextManager[Any]]
"""Makes a context in which one named piece of work is done; the command line shows it."""

PRIORS: Mapping[str, str] = {
    "known": "source and emission time known",
    "fitted": "source known, emission time fitted",
    "unsure": "the same, the clock's scale not known",
}
"""What is taken as known, by short name. The clock's scale is known where it is known what became
of the time of the camera's dead codes; otherwise it is uncertain by 0.36 %, one sigma."""

COMBINATIONS = (
    ("paper", "known"),
    ("joint", "known"),
    ("paper", "fitted"),
    ("joint", "fitted"),
    ("joint", "unsure"),
)
"""(method, prior) of the comparison with the paper, in its order."""


@dataclass(frozen=True, eq=False)
class Recordings:
    """What was recorded, and the truth behind it."""

    scene: Scene
    """The experiment as it truly is."""
    hist: Histograms
    """The pulse on its way."""
    code_density: Histograms
    """Light that knows nothing of the laser."""
    flat: Histograms
    """Pulses that reach all pixels at one known time."""
    photons_per_pixel: float
    """Expected signal counts in the brightest pixel of `hist`."""
    seed: int
    """Seed of the photons."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """One reconstruction and how far it is from the truth."""

    method: str
    """Estimator."""
    prior: str
    """A key of `PRIORS`."""
    path: LightPath
    """What it found."""
    error: PathError
    """In view of the camera."""
    whole_error: PathError
    """Position from source to exit."""


def record_three_legs(
    *, photons_per_pixel: float = PHOTONS_PER_PIXEL, seed: int = 1, step: Step = nullcontext
) -> Recordings:
    """Simulate the experiment and its two calibration recordings, clock defects and all.

    Parameters
    ----------
    photons_per_pixel : expected signal counts in the brightest pixel.
    seed : of the photons; the calibration recordings use the two that follow.
    """
    scene = paper_scene()
    with step("simulating the experiment"):
        hist = simulate(scene, photons_per_pixel=photons_per_pixel, seed=seed)
    with step("simulating the code density (4 M counts per pixel)"):
        code_density = simulate(
            scene, photons_per_pixel=CODE_DENSITY_PER_PIXEL, seed=seed + 1, kind="code_density"
        )
    with step("simulating the flat (0.4 M counts per pixel)"):
        flat = simulate(scene, photons_per_pixel=FLAT_PER_PIXEL, seed=seed + 2, kind="flat")
    return Recordings(scene, hist, code_density, flat, photons_per_pixel, seed)


def calibrate_three_legs(
    recordings: Recordings, *, step: Step = nullcontext
) -> dict[str, TimingCalibration]:
    """Calibrate the clock from the two calibration recordings; one clock for every prior."""

    def calibrated(dead_codes: str | None) -> TimingCalibration:
        return calibrate_timing(
            code_density=recordings.code_density,
            flat=recordings.flat,
            flat_arrival_ps=recordings.flat.truth.flat_arrival_ps,
            dead_codes=dead_codes,
        )

    with step("calibrating the clock"):
        sure = calibrated("lost" if recordings.scene.detector.dead_time_is_lost else "absorbed")
    with step("calibrating it again, the dead codes unknown"):
        unsure = calibrated(None)
    return {prior: unsure if prior == "unsure" else sure for prior in PRIORS}


def estimate_three_legs(
    recordings: Recordings,
    timings: Mapping[str, TimingCalibration],
    *,
    combinations: Sequence[tuple[str, str]] = COMBINATIONS,
    step: Step = nullcontext,
) -> list[Estimate]:
    """Reconstruct by each (method, prior), and compare with the truth.

    Parameters
    ----------
    timings : clock by prior, from `calibrate_three_legs`.
    """
    scene = recordings.scene
    estimates = []
    for method, prior in combinations:
        with step(f"reconstructing: {method}, {_SHORT[prior]}"):
            path = reconstruct(
                recordings.hist,
                camera=scene.camera,
                source=known_source(scene, emission_known=prior == "known"),
                medium=scene.medium,
                timing=timings[prior],
                method=method,
            )
        estimates.append(
            Estimate(
                method,
                prior,
                path,
                path_error(path, scene, scene.camera),
                path_error(path, scene, scene.camera, whole=True),
            )
        )
    return estimates


_SHORT = {
    "known": "emission time known",
    "fitted": "emission time fitted",
    "unsure": "clock's scale unknown",
}
