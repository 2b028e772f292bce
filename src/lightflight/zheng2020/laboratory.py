"""The paper's laboratory, as the twin stands in for it: clocks, priors, and the literal chain.

Every experiment of this package records with the same camera (a PF32 with its defects), takes its
clock from here, and runs the paper's chain through `chain_of_recording`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import UncalibratedWarning
from lightflight.flight import Source
from lightflight.histogram import Histograms
from lightflight.path import LightPath
from lightflight.reconstruct.api import observe
from lightflight.reconstruct.legs import find_legs
from lightflight.reconstruct.observation import Observation
from lightflight.reconstruct.paper import (
    Projection,
    angles_from_arrivals,
    path_from_projections,
    plane_axes,
    projection_of_leg,
)
from lightflight.reconstruct.setting import Setting
from lightflight.simulate import Scene, simulate
from lightflight.simulate.presets import angle_scene, paper_scene, pf32
from lightflight.timing.calibration import TimingCalibration, calibrate_timing

Floats = NDArray[np.float64]

PHOTONS_PER_PIXEL = 40_000.0
"""1e-5 photons per pulse and pixel, 20 MHz, 200 s: the paper's light."""

CODE_DENSITY_PER_PIXEL = 4e6
"""Mean counts per pixel of the code-density recording (22 minutes at 60 % occupancy)."""

FLAT_PER_PIXEL = 4e5
"""Mean counts per pixel of the flat recording."""

CLOCKS = ("delays", "codes")
"""How well the camera's clock is calibrated: "delays" is what the paper does, one offset per
pixel from a flat recording and nominal codes; "codes" adds the code widths of every pixel."""

_CALIBRATION_SEED = 900
"""Added to an experiment's seed: its calibration recordings have photons of their own."""


@cache
def calibrated_clock(kind: str, *, seed: int, three_legs: bool = False) -> TimingCalibration:
    """`clock_of_scene` of this package's camera, made once in a process.

    Parameters
    ----------
    three_legs : the flat is recorded for the three-leg scene, else for a single leg at 0 deg: its
        light arrives when the experiment's does.
    """
    return clock_of_scene(kind, paper_scene() if three_legs else angle_scene(0.0), seed=seed)


def clock_of_scene(kind: str, scene: Scene, *, seed: int) -> TimingCalibration:
    """Clock of a scene's camera, one of `CLOCKS`, from recordings simulated for it.

    Parameters
    ----------
    seed : of the experiment.
    """
    first = seed + _CALIBRATION_SEED
    flat = simulate(scene, photons_per_pixel=FLAT_PER_PIXEL, seed=first + 1, kind="flat")
    density = None
    if kind == "codes":
        density = simulate(
            scene, photons_per_pixel=CODE_DENSITY_PER_PIXEL, seed=first, kind="code_density"
        )
    with warnings.catch_warnings():
        # "delays" leaves the code widths out on purpose, as the paper does
        warnings.simplefilter("ignore", UncalibratedWarning)
        return calibrate_timing(
            density, flat=flat, flat_arrival_ps=flat.truth.flat_arrival_ps, dead_codes="absorbed"
        )


def known_source(scene: Scene, *, emission_known: bool = True) -> Source:
    """What the experimenter knows of the source: its place, and maybe when it fires."""
    known = Source(np.asarray(scene.vertices_mm)[0], pulse_fwhm_ps=scene.pulse_fwhm_ps)
    return replace(known, emission_time_ps=scene.emission_time_ps) if emission_known else known


@dataclass(frozen=True, eq=False)
class Chain:
    """The paper's chain on one recording, with what it found on the way."""

    path: LightPath
    """The path."""
    projections: list[Projection]
    """Per leg: one point and time per position along it."""
    observation: Observation
    """Pulses as the paper fits them."""
    setting: Setting
    """What the chain was told."""


def chain_of_recording(
    hist: Histograms,
    scene: Scene,
    timing: TimingCalibration | None,
    *,
    source: Source | None = None,
    change: Callable[[list[Projection]], list[Projection]] = lambda projections: projections,
) -> Chain:
    """The paper's estimator step by step.

    Parameters
    ----------
    timing : None: the recording's own clock, which then must be clean.
    source : None: place and emission time known.
    change : what becomes of the projections before the chain goes on (to find what limits it).
    """
    setting = Setting(scene.camera, source or known_source(scene), scene.medium)
    observation = observation_of(hist, scene, timing, source=source)
    legs = find_legs(observation.arrivals, camera=scene.camera, n_legs=scene.n_legs, convex=True)
    projections = change([projection_of_leg(leg, observation, scene.camera) for leg in legs])
    path = path_from_projections(projections, [observation], setting)
    return Chain(path, projections, observation, setting)


def observation_of(
    hist: Histograms,
    scene: Scene,
    timing: TimingCalibration | None,
    *,
    source: Source | None = None,
) -> Observation:
    """Pulses of a recording as the paper fits them; arguments as in `chain_of_recording`."""
    setting = Setting(scene.camera, source or known_source(scene), scene.medium)
    clock = TimingCalibration.nominal(hist) if timing is None else timing
    return observe(
        hist, setting, timing=clock, background=None, exclude_mask=None, least_squares=True
    )


def angles_of_first_leg(chain: Chain) -> Floats:
    """alpha_i of the first leg in the order of flight, deg; the source's time must be known."""
    camera, source = chain.setting.camera, chain.setting.source
    seen = chain.projections[0]
    assert source.emission_time_ps is not None
    start = np.asarray(source.position_mm, dtype=float)
    rays = camera.rays_from_pixels(seen.rows, seen.cols)
    along, upright = plane_axes(rays, start, camera)
    return np.rad2deg(
        angles_from_arrivals(
            rays,
            seen.arrival_ps,
            start_mm=start,
            start_time_ps=source.emission_time_ps,
            along=along,
            upright=upright,
            camera_center_mm=camera.center_mm,
            medium=chain.setting.medium,
        )
    )


def recorded(scene: Scene, *, seed: int, photons: float = PHOTONS_PER_PIXEL) -> Histograms:
    """One recording of a scene."""
    return simulate(scene, photons_per_pixel=photons, seed=seed)


def one_leg(angle_deg: float) -> Scene:
    """The paper's first experiment: one leg at an angle, seen by its camera, defects on."""
    return angle_scene(angle_deg, pf32())
