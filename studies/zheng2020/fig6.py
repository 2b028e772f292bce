"""Fig. 6: three legs by way of two mirrors, recorded several times, by every estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightflight.demo import PHOTONS_PER_PIXEL, known_source
from lightflight.flight import arrival_time_from_event
from lightflight.path.error import path_error
from lightflight.path.light_path import LightPath
from lightflight.reconstruct.limits.bounds import bounds
from lightflight.reconstruct.limits.conditions import spot_std_of
from lightflight.simulate import Scene
from lightflight.simulate.presets import paper_scene
from studies.zheng2020.laboratory import (
    calibrated_clock,
    chain_of_recording,
    path_of_recording,
    recorded,
)
from studies.zheng2020.pulse_width import width_of_pixels
from studies.zheng2020.reported import BIN_WIDTH_PS
from studies.zheng2020.work import Unit

Floats = NDArray[np.float64]


class Way(NamedTuple):
    """One way to reconstruct."""

    method: str
    """Estimator."""
    clock: str
    """How the clock is calibrated (`laboratory.CLOCKS`)."""
    emission_known: bool
    """Whether the time of emission is."""

    @property
    def name(self) -> str:
        """As tables say it."""
        prior = "emission time known" if self.emission_known else "emission time fitted"
        return f"{self.method}, {self.clock}, {prior}"


WAYS = (
    Way("paper", "delays", True),
    Way("paper", "codes", True),
    Way("paper", "codes", False),
    Way("joint", "codes", True),
    Way("joint", "codes", False),
    Way("photon", "codes", True),
    Way("photon", "codes", False),
)
"""Every estimator; the source's place is known in all of them."""

DRAWN = {"paper": WAYS[1], "joint": WAYS[4]}
"""Paths of the first recording that are kept, by short name."""

RECORDINGS, QUICK_RECORDINGS = 10, 1


@dataclass(frozen=True, eq=False)
class Fig6:
    """Errors of every way, and the paths of one recording."""

    scene: Scene
    """The experiment as it truly is."""
    ways: tuple[Way, ...]
    """As `WAYS`."""
    position_rms_mm: Floats
    """(w,), in view, rms over the recordings."""
    event_time_rms_ps: Floats
    """(w,), in view, rms over the recordings."""
    whole_position_rms_mm: Floats
    """(w,), from source to exit."""
    bound_mm: Mapping[bool, float]
    """Cramér-Rao bound of the position by `emission_known`."""
    chance_mm: Mapping[bool, tuple[float, float]]
    """Where the rms of these recordings falls 19 times in 20 if its estimator is at the bound."""
    bound_ps: Mapping[bool, float]
    """Cramér-Rao bound of the event time."""
    recordings: int
    """How many."""
    width_ps: float
    """FWHM of the laser pulse from the pixels' histograms, deconvolved."""
    before_ps: float
    """rms of arrival time against event time at every frame, both from zero."""
    frames_event_ps: Floats
    """(n,), true event time at frames of 55 ps, from zero."""
    frames_arrival_ps: Floats
    """(n,), arrival time there, from zero."""
    paths: Mapping[str, LightPath]
    """Of the first recording, by the names of `DRAWN`."""


def units(quick: bool) -> tuple[Unit, ...]:
    """One unit per recording."""
    recordings = QUICK_RECORDINGS if quick else RECORDINGS
    return tuple(Unit(f"legs-{run:02d}", measure_legs, {"run": run}) for run in range(recordings))


def measure_legs(*, run: int, seed: int) -> dict[str, Any]:
    """Record the three legs once and reconstruct them every way."""
    scene = paper_scene()
    hist = recorded(scene, seed=2_000_000 * (seed + 1) + run)
    errors, paths = {}, {}
    for way in WAYS:
        timing = calibrated_clock(way.clock, seed=seed, three_legs=True)
        path = path_of_recording(hist, scene, timing, way.method, emission_known=way.emission_known)
        seen = path_error(path, scene, scene.camera)
        whole = path_error(path, scene, scene.camera, whole=True)
        errors[way.name] = [seen.position_rms_mm, seen.event_time_rms_ps, whole.position_rms_mm]
        if run == 0 and way in DRAWN.values():
            paths.update({name: path for name, drawn in DRAWN.items() if drawn == way})
    chain = chain_of_recording(hist, scene, calibrated_clock("codes", seed=seed, three_legs=True))
    width = width_of_pixels(chain.sighting, spot_ps=_transit_ps(chain.path, scene))
    return {"errors": errors, "width_ps": width, "paths": paths}


def _transit_ps(path: LightPath, scene: Scene) -> float:
    """Standard deviation of the arrival time over a pixel's footprint, ps."""
    table = path.residuals
    steps = []
    for leg in range(path.n_legs):
        here = table[table["leg"] == leg]
        order = np.argsort(here["col"])
        steps.append(np.abs(np.diff(here["arrival_ps"][order])))
    return spot_std_of(scene) * float(np.median(np.concatenate(steps)))


def record_from_results(results: Sequence[Mapping[str, Any]]) -> Fig6:
    """The figure from the results of `units`."""
    scene = paper_scene()
    errors = np.array([[one["errors"][way.name] for way in WAYS] for one in results])
    rms = np.sqrt(np.mean(errors**2, axis=0))
    limit = {
        known: bounds(
            scene,
            source=known_source(scene, emission_known=known),
            photons_per_pixel=PHOTONS_PER_PIXEL,
        )
        for known in (True, False)
    }
    event, arrival = frames_of_scene(scene)
    return Fig6(
        scene=scene,
        ways=WAYS,
        position_rms_mm=rms[:, 0],
        event_time_rms_ps=rms[:, 1],
        whole_position_rms_mm=rms[:, 2],
        bound_mm={known: limit[known].position_rms_mm for known in limit},
        chance_mm={known: chance_of_rms(limit[known].path, len(results)) for known in limit},
        bound_ps={known: limit[known].event_time_rms_ps for known in limit},
        recordings=len(results),
        width_ps=float(np.mean([one["width_ps"] for one in results])),
        before_ps=float(np.sqrt(np.mean((arrival - event) ** 2))),
        frames_event_ps=event,
        frames_arrival_ps=arrival,
        paths=results[0]["paths"],
    )


def chance_of_rms(path: LightPath, recordings: int, *, draws: int = 2000) -> tuple[float, float]:
    """Between which two values the rms position error of some recordings falls by chance, mm.

    Three legs have few degrees of freedom: one recording may lie far below the bound, which is of
    the mean over many.

    Parameters
    ----------
    path : LightPath
        With the errors that each recording has (`Bounds.path`).
    recordings : int
        How many the rms is of.
    draws : int
        From the covariance.

    Returns
    -------
    (float, float)
        2.5 and 97.5 %, in view.
    """
    sampled = path.sample(300)
    seen = sampled[sampled["in_view"]]
    at = seen["event_time_ps"]
    true = np.column_stack([seen[name] for name in ("x_mm", "y_mm", "z_mm")])
    vertices = np.column_stack([path.vertices_mm, path.vertex_times_ps])
    rng = np.random.default_rng(0)
    wrong = rng.multivariate_normal(vertices.ravel(), path.covariance, size=draws, method="svd")
    squared = np.empty(draws)
    for k, (*axes, times) in enumerate(np.swapaxes(wrong.reshape(draws, -1, 4), 1, 2)):
        drawn = np.column_stack([np.interp(at, times, axis) for axis in axes])
        squared[k] = np.mean(np.sum((drawn - true) ** 2, axis=1))
    rms = np.sqrt(rng.choice(squared, (draws, recordings)).mean(axis=1))
    low, high = np.percentile(rms, (2.5, 97.5))
    return float(low), float(high)


def frames_of_scene(scene: Scene) -> tuple[Floats, Floats]:
    """(event, arrival) time at frames of 55 ps of event time, both from zero; whole path."""
    vertices, times = np.asarray(scene.vertices_mm, dtype=float), scene.vertex_times_ps
    event = np.arange(times[0], times[-1], BIN_WIDTH_PS)
    points = np.column_stack([np.interp(event, times, vertices[:, k]) for k in range(3)])
    arrival = arrival_time_from_event(
        points,
        event,
        camera_center_mm=scene.camera.center_mm,
        return_group_index=scene.medium.return_group_index,
    )
    return event - event[0], arrival - arrival[0]
