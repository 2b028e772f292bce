"""The paper's laboratory, as the twin stands in for it: clocks, priors, and the literal chain.

Every experiment of this study records with the same camera (a PF32 with its defects), takes its
clock from here, and runs the paper's chain through `chain_of_recording`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from lightflight.demo import (
    CODE_DENSITY_PER_PIXEL,
    FLAT_PER_PIXEL,
    PHOTONS_PER_PIXEL,
    known_source,
)
from lightflight.errors import UncalibratedWarning
from lightflight.flight import Medium
from lightflight.path.light_path import LightPath
from lightflight.reconstruct import reconstruct
from lightflight.reconstruct.fit.paper import (
    angles_from_arrivals,
    path_from_projections,
    plane_axes,
)
from lightflight.reconstruct.fit.paper_projection import Projection, projection_of_leg
from lightflight.reconstruct.legs.find import find_legs
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.sightings import sighting_from_histograms
from lightflight.recording.histograms import Histograms
from lightflight.simulate import Scene, simulate
from lightflight.simulate.presets import angle_scene, paper_scene
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.clock.calibration import TimingCalibration

Floats = NDArray[np.float64]

CLOCKS = ("delays", "codes")
"""How well the camera's clock is calibrated: "delays" is what the paper does, one offset per
pixel from a flat recording and nominal codes; "codes" adds the code widths of every pixel."""

_CALIBRATION_SEED = 900
"""Added to an experiment's seed: its calibration recordings have photons of their own."""


@cache
def calibrated_clock(kind: str, *, seed: int, three_legs: bool = False) -> TimingCalibration:
    """`clock_of_scene` of this study's camera, made once in a process.

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


@dataclass(frozen=True, eq=False)
class Chain:
    """The paper's chain on one recording, with what it found on the way."""

    path: LightPath
    """The path."""
    projections: list[Projection]
    """Per leg: one point and time per position along it."""
    sighting: Sighting
    """Pulses as the paper fits them."""
    setting: Setting
    """What the chain was told."""


def chain_of_recording(
    hist: Histograms,
    scene: Scene,
    timing: TimingCalibration | None,
    *,
    change: Callable[[list[Projection]], list[Projection]] = lambda projections: projections,
) -> Chain:
    """The paper's estimator step by step.

    Parameters
    ----------
    timing : None: the recording's own clock, which then must be clean.
    change : what becomes of the projections before the chain goes on (to find what limits it).
    """
    setting = _setting_of(scene)
    sighting = sighting_of(hist, scene, timing)
    legs = find_legs(sighting.arrivals, camera=scene.camera, n_legs=scene.n_legs, convex=True)
    projections = change([projection_of_leg(leg, sighting, scene.camera) for leg in legs])
    path = path_from_projections(projections, [sighting], setting)
    return Chain(path, projections, sighting, setting)


def sighting_of(hist: Histograms, scene: Scene, timing: TimingCalibration | None) -> Sighting:
    """Pulses of a recording as the paper fits them; arguments as in `chain_of_recording`."""
    return sighting_from_histograms(
        hist,
        _setting_of(scene),
        timing=TimingCalibration.nominal(hist) if timing is None else timing,
        background=None,
        exclude_mask=None,
        least_squares=True,
    )


def _setting_of(scene: Scene) -> Setting:
    return Setting(scene.camera, known_source(scene), scene.medium)


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


def path_of_recording(
    hist: Histograms,
    scene: Scene,
    timing: TimingCalibration,
    method: str,
    *,
    emission_known: bool = True,
    medium: Medium | None = None,
    n_legs: int | None = None,
) -> LightPath:
    """`reconstruct` with what is known in this laboratory.

    Parameters
    ----------
    method, n_legs : as in `reconstruct`.
    medium : what the medium is taken for; None: what it is.
    """
    return reconstruct(
        hist,
        camera=scene.camera,
        source=known_source(scene, emission_known=emission_known),
        medium=medium or scene.medium,
        timing=timing,
        method=method,
        n_legs=n_legs,
    )


def recorded(scene: Scene, *, seed: int) -> Histograms:
    """One recording of a scene, in the paper's light."""
    return simulate(scene, photons_per_pixel=PHOTONS_PER_PIXEL, seed=seed)


def elevation_deg(step: Floats) -> float:
    """Angle of a leg above the x-y plane, towards the camera, deg."""
    return float(np.rad2deg(np.arcsin(step[2] / np.linalg.norm(step))))
