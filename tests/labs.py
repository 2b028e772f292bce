"""Laboratories drawn by the brute-force oracle: many recordings of one scene at little cost.

The expected counts come from `oracles/brute_force.py`, which shares no line with the package; a
recording is one Poisson draw of them.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from lightflight.camera.model import Camera
from lightflight.flight import Medium, Source
from lightflight.path.light_path import LightPath
from lightflight.reconstruct.chain import reconstruct
from lightflight.reconstruct.fit.joint import JointFit, fit_joint
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.sightings import sighting_from_histograms
from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.calibration import TimingCalibration
from tests.oracles.brute_force import BruteClock, BruteScene, camera_over_plane, expected_counts
from tests.path_fakes import PAPER_VERTICES, Truth, truth_of

if TYPE_CHECKING:
    import pytest

START_PS = 2000.0
PERIOD_PS = 50_000.0
CODE_PS = 55.0


@dataclass(frozen=True, eq=False)
class Lab:
    """One scene: what a photon in the brightest pixel's worth of light gives, and the truth."""

    signal: np.ndarray
    """(rows, cols, codes), expected counts for one photon in the brightest pixel."""
    background_per_code: float
    vertices_mm: np.ndarray
    camera: Camera
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def truth(self) -> Truth:
        return truth_of(self.vertices_mm, start=START_PS)

    @property
    def known(self) -> Source:
        """Place and emission time of the source, exactly."""
        return Source(self.vertices_mm[0], emission_time_ps=START_PS)

    @property
    def timed(self) -> Source:
        """The place alone."""
        return Source(self.vertices_mm[0])

    def mean(self, photons: float = 40_000.0) -> np.ndarray:
        return np.asarray(photons * self.signal + self.background_per_code)

    def recording(self, seed: int, photons: float = 40_000.0, **changes: Any) -> Histograms:
        counts = np.random.default_rng(seed).poisson(self.mean(photons))
        return self.histograms(counts, **changes)

    def histograms(self, counts: np.ndarray, **changes: Any) -> Histograms:
        given = {"bin_width_ps": CODE_PS, "laser_period_ps": PERIOD_PS, **self.settings}
        return Histograms(counts, **(given | changes))

    @property
    def timing(self) -> TimingCalibration:
        """The true clock: even codes, no delays."""
        return TimingCalibration.nominal(self.histograms(np.ones(self.signal.shape, dtype=int)))

    def doubtful_timing(
        self,
        rng: np.random.Generator,
        *,
        pixel_std_ps: float = 0.0,
        scale_std: float = 0.0,
        scale_sigmas: float | None = None,
    ) -> TimingCalibration:
        """A clock that is wrong by as much as it says: pixel delays, and one scale for all."""
        wrong = pixel_std_ps * rng.normal(size=self.camera.shape)
        scale = 1.0 + scale_std * (rng.normal() if scale_sigmas is None else scale_sigmas)
        true = self.timing
        return replace(
            true,
            bin_width_ps=true.bin_width_ps * scale,
            end_code=true.end_code / scale,  # the sync stays where it is
            skew_ps=wrong,
            skew_std_ps=np.full(self.camera.shape, pixel_std_ps),
            scale_std=scale_std,
        )


def lab_of(
    vertices: Any,
    *,
    center: tuple[float, float] = (0.0, 0.0),
    brightness: Callable[[float], float] | None = None,
    background_per_pixel: float = 18.0,
    blur_px: float = 0.3,
    n_codes: int = 128,
    reverse: bool = False,
) -> Lab:
    """A lab with the paper's camera over the plane z = 0."""
    vertices = np.array(vertices, dtype=float)
    scene = BruteScene(
        vertices=vertices,
        camera=camera_over_plane(center=center),
        clock=BruteClock(n_codes=n_codes, width=CODE_PS, period=PERIOD_PS, reversed=reverse),
        emission_time=START_PS,
        pulse_std=70.0,
        blur_std_px=blur_px,
        brightness=brightness,
    )
    signal = expected_counts(scene, brightest=1.0, stride=0.5, fine=1.0)
    return Lab(
        signal,
        background_per_pixel / 909.0,
        vertices,
        Camera.facing_plane((32, 32), center_mm=center),
        {"reversed_codes": True} if reverse else {},
    )


def without_verdict(patch: pytest.MonkeyPatch) -> None:
    """What the fixture `unexamined` does, for fixtures of a module."""
    answer = importlib.import_module("lightflight.reconstruct.answer")
    patch.setattr(answer, "examined", lambda path, *_, **__: path)


def without_second_light(patch: pytest.MonkeyPatch) -> None:
    """What the fixture `nothing_twice` does, for fixtures of a module."""
    diffuse = importlib.import_module("lightflight.reconstruct.other_light.diffuse")
    patch.setattr(diffuse, "with_second", lambda asked, *_, **__: asked.strengths())


@cache
def known_path(lab: Lab, method: str) -> LightPath:
    """Of a lab's recording 1, all else told exactly: made once, for tests that only read it."""
    path = reconstruct(
        lab.recording(1), camera=lab.camera, source=lab.known, timing=lab.timing, method=method
    )
    assert path.verdict.n_tests, "made without a verdict, which others read"
    return path


def fit_from_truth(lab: Lab, hist: Histograms) -> tuple[JointFit, Sighting, Setting]:
    """Joint fit of a recording that begins with the true path, source known; and what it is of."""
    setting = Setting(lab.camera, lab.known, Medium())
    sighting = sighting_from_histograms(
        hist, setting, timing=lab.timing, background=None, exclude_mask=None, least_squares=False
    )
    start = PathState(lab.vertices_mm, START_PS)
    return fit_joint([sighting], start, setting, legs=None), sighting, setting


@cache
def one_leg(angle_deg: float = 5.0) -> Lab:
    """65 mm before the field to 65 mm beyond it, at an elevation."""
    run = 375.0
    end = (-187.5 + run, 3.0, run * np.tan(np.deg2rad(angle_deg)))
    return lab_of([(-187.5, 3.0, 0.0), end])


@cache
def blurred_leg() -> Lab:
    """Out of focus: the light of each place is spread over some twenty pixels."""
    return lab_of([(-187.5, 3.0, 0.0), (187.5, 3.0, 33.0)], blur_px=1.5)


@cache
def three_legs() -> Lab:
    """The paper's source, two mirrors and exit."""
    return lab_of(PAPER_VERTICES, center=(187.5, 37.5))


@cache
def corner_in_view() -> Lab:
    return lab_of([(-180.0, -60.0, 0.0), (40.0, -40.0, 20.0), (-60.0, 160.0, -30.0)])


@cache
def uneven_leg() -> Lab:
    """Dust: the light along the leg changes by up to 30 % per pixel."""
    return lab_of(
        [(-187.5, 3.0, 0.0), (187.5, 3.0, 33.0)],
        brightness=lambda s: float(np.exp(0.35 * np.sin(2 * np.pi * s / 55.0) - s / 150.0)),
    )
