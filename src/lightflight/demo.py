"""The paper's three legs (Fig. 6) once: recorded, calibrated, reconstructed, compared.

The paper does not publish its coordinates or its photon counts; the scene here is ours, of the
stated size, and gives the stated difference between arrival and propagation time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

import numpy as np

from lightflight.flight import Source
from lightflight.path.error import PathError, path_error
from lightflight.path.light_path import LightPath
from lightflight.reconstruct import reconstruct
from lightflight.recording.histograms import Histograms
from lightflight.simulate import Scene, simulate
from lightflight.simulate.presets import paper_scene
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.clock.calibration import TimingCalibration

POSITION_RMS_MM = 1.75
"""The paper's error of the reconstructed positions, three legs (Fig. 6a, abstract)."""

EVENT_TIME_RMS_PS = 3.84
"""The paper's error of the propagation times, three legs (Fig. 6b, abstract)."""

PHOTONS_PER_PIXEL = 40_000.0
"""1e-5 photons per pulse and pixel, 20 MHz, 200 s: the paper's light."""

CODE_DENSITY_PER_PIXEL = 4e6
"""Mean counts per pixel of the code-density recording (22 minutes at 60 % occupancy)."""

FLAT_PER_PIXEL = 4e5
"""Mean counts per pixel of the flat recording."""

Step = Callable[[str], AbstractContextManager[object]]
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
    """What was recorded, and the truth behind it.

    Attributes
    ----------
    scene : Scene
        The experiment as it truly is.
    hist : Histograms
        The pulse on its way.
    code_density : Histograms
        Light that knows nothing of the laser.
    flat : Histograms
        Pulses that reach all pixels at one known time.
    photons_per_pixel : float
        Expected signal counts in the brightest pixel of `hist`.
    seed : int
        Seed of the photons.
    """

    scene: Scene
    hist: Histograms
    code_density: Histograms
    flat: Histograms
    photons_per_pixel: float
    seed: int


@dataclass(frozen=True, eq=False)
class Estimate:
    """One reconstruction and how far it is from the truth.

    Attributes
    ----------
    method : str
        Estimator.
    prior : str
        A key of `PRIORS`.
    path : LightPath
        What it found.
    error : PathError
        In view of the camera.
    whole_error : PathError
        Position from source to exit.
    """

    method: str
    prior: str
    path: LightPath
    error: PathError
    whole_error: PathError


def known_source(scene: Scene, *, emission_known: bool = True) -> Source:
    """What the experimenter knows of the source: its place, and maybe when it fires.

    Parameters
    ----------
    scene : Scene
        The experiment as it truly is.
    emission_known : bool, optional
        Whether the emission time is known, exactly.

    Returns
    -------
    Source
        At the first vertex, with the pulse's width.
    """
    known = Source(np.asarray(scene.vertices_mm)[0], pulse_fwhm_ps=scene.pulse_fwhm_ps)
    return replace(known, emission_time_ps=scene.emission_time_ps) if emission_known else known


def record_three_legs(
    *, photons_per_pixel: float = PHOTONS_PER_PIXEL, seed: int = 1, step: Step = nullcontext
) -> Recordings:
    """Simulate the experiment and its two calibration recordings, clock defects and all.

    Parameters
    ----------
    photons_per_pixel : float, optional
        Expected signal counts in the brightest pixel.
    seed : int, optional
        Of the photons; the calibration recordings use the two that follow.
    step : callable, optional
        As `Step`.

    Returns
    -------
    Recordings
        Three recordings, and the truth behind them.
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
    """Calibrate the clock from the two calibration recordings.

    Parameters
    ----------
    recordings : Recordings
        From `record_three_legs`.
    step : callable, optional
        As `Step`.

    Returns
    -------
    dict of str to TimingCalibration
        Clock by prior (`PRIORS`); those that do not concern the clock share one.
    """

    # Whether it is known where the dead codes' time went decides how well the scale is known.
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
    recordings : Recordings
        From `record_three_legs`.
    timings : mapping of str to TimingCalibration
        Clock by prior, from `calibrate_three_legs`.
    combinations : sequence of (str, str), optional
        Methods and priors.
    step : callable, optional
        As `Step`.

    Returns
    -------
    list of Estimate
        In the order of `combinations`.
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
