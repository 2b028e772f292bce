"""What limits the paper's chain on the three legs, by leaving one thing out at a time.

Every variant is the same experiment with one thing changed: the clock, the spot, or one of the
two things the chain takes from a leg (its line in the picture, its arrival times) put right from
the truth. What error remains tells what the error was made of.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.path.error import path_error
from lightflight.reconstruct.fit.paper_projection import Projection, projection_of_leg
from lightflight.reconstruct.legs.find import find_legs
from lightflight.reconstruct.model.geometry import PathState, footprints
from lightflight.simulate import Detector, Scene
from lightflight.simulate.presets import ideal, paper_scene, pf32
from lightflight.timing.clock.calibration import TimingCalibration
from studies.zheng2020.laboratory import (
    calibrated_clock,
    chain_of_recording,
    clock_of_scene,
    elevation_deg,
    recorded,
    sighting_of,
)
from studies.zheng2020.work import Unit

Floats = NDArray[np.float64]

Change = Callable[[list[Projection], Scene], list[Projection]]


def _nothing(projections: list[Projection], _scene: Scene) -> list[Projection]:
    return projections


def _from_truth(
    projections: list[Projection], scene: Scene, *, lines: bool, times: bool
) -> list[Projection]:
    """Lines in the picture, arrival times, or both, put right from the truth."""
    state = PathState(np.asarray(scene.vertices_mm, dtype=float), scene.emission_time_ps)
    corrected = []
    for leg, seen in enumerate(projections):
        foot = footprints(
            state,
            camera=scene.camera,
            medium=scene.medium,
            legs=leg,
            rows=seen.rows,
            cols=seen.cols,
        )
        step = state.vertices_mm[leg + 1] - state.vertices_mm[leg]
        points = state.vertices_mm[leg] + foot.fraction[:, np.newaxis] * step
        if lines:
            rows, cols = scene.camera.pixels_from_points(points)
            seen = replace(seen, rows=rows, cols=cols)
        corrected.append(replace(seen, arrival_ps=foot.arrival_ps) if times else seen)
    return corrected


@dataclass(frozen=True)
class Variant:
    """One change to the experiment."""

    words: str
    """What is changed, as tables say it."""
    detector: Callable[[], Detector] = pf32
    """The camera."""
    clock: str | None = "codes"
    """Its calibration; None: nominal, for clean clocks."""
    change: Change = _nothing
    """What is put right from the truth."""
    alone: bool = False
    """True: each leg's line is taken from a recording in which it alone shines."""


VARIANTS: Mapping[str, Variant] = {
    "as-is": Variant("the camera as it is, code widths and delays calibrated"),
    "delays": Variant("as the paper calibrates: delays only", clock="delays"),
    "clean": Variant("a clean clock", ideal, None),
    "quiet": Variant("no screaming pixels", lambda: pf32(screaming_fraction=0.0)),
    "times": Variant(
        "arrival times exact, lines as found",
        change=lambda seen, scene: _from_truth(seen, scene, lines=False, times=True),
    ),
    "lines": Variant(
        "lines in the picture exact, times as measured",
        change=lambda seen, scene: _from_truth(seen, scene, lines=True, times=False),
    ),
    "lines-delays": Variant(
        "lines exact, delays only",
        clock="delays",
        change=lambda seen, scene: _from_truth(seen, scene, lines=True, times=False),
    ),
    "both": Variant(
        "lines and times exact",
        change=lambda seen, scene: _from_truth(seen, scene, lines=True, times=True),
    ),
    "spot-0.25": Variant(
        "clean clock, lens blur 0.25 px instead of 0.35", lambda: ideal(psf_std_px=0.25), None
    ),
    "spot-0.50": Variant("clean clock, lens blur 0.50 px", lambda: ideal(psf_std_px=0.5), None),
    "alone": Variant(
        "clean clock, each leg's line from a recording of that leg alone", ideal, None, alone=True
    ),
    "alone-0.50": Variant(
        "the same, lens blur 0.50 px", lambda: ideal(psf_std_px=0.5), None, alone=True
    ),
    "filled": Variant(
        "clean clock, 61 % fill factor", lambda: ideal(active_width_px=0.61**0.5), None
    ),
}
"""What is left out, by short name."""

QUICK = ("as-is", "clean", "lines")
RECORDINGS, QUICK_RECORDINGS = 4, 1


@dataclass(frozen=True, eq=False)
class Contributions:
    """Error of the paper's chain under every variant, three legs, emission time known."""

    names: tuple[str, ...]
    """Keys of `VARIANTS`."""
    words: tuple[str, ...]
    """What was changed."""
    position_rms_mm: Floats
    """(v,), in view."""
    event_time_rms_ps: Floats
    """(v,), in view."""
    angle_error_deg: Floats
    """(v, 3), mean error of each leg's elevation."""


def units(quick: bool) -> tuple[Unit, ...]:
    """One unit per variant."""
    names = QUICK if quick else tuple(VARIANTS)
    recordings = QUICK_RECORDINGS if quick else RECORDINGS
    return tuple(
        Unit(
            f"limit-{name}x{recordings}",
            measure_variant,
            {"name": name, "recordings": recordings},
        )
        for name in names
    )


def measure_variant(*, name: str, recordings: int, seed: int) -> dict[str, Any]:
    """The paper's chain under one variant; errors of each recording."""
    variant = VARIANTS[name]
    scene = paper_scene(variant.detector())
    timing = _clock_of(variant, scene, seed)
    truth = [elevation_deg(step) for step in np.diff(np.asarray(scene.vertices_mm), axis=0)]
    errors, angles = [], []
    for run in range(recordings):
        hist = recorded(scene, seed=2_000_000 * (seed + 1) + run)
        path = chain_of_recording(
            hist,
            scene,
            timing,
            change=_lines_alone(scene, timing, run, seed)
            if variant.alone
            else lambda projections: variant.change(projections, scene),
        ).path
        errors.append(list(path_error(path, scene, scene.camera)))
        angles.append([leg.angle_deg - t for leg, t in zip(path.legs, truth, strict=True)])
    return {"name": name, "errors": errors, "angle_error_deg": angles}


def _lines_alone(
    scene: Scene, timing: TimingCalibration | None, run: int, seed: int
) -> Callable[[list[Projection]], list[Projection]]:
    """Projections of legs that shine one at a time: no leg's light falls on another's pixels."""
    alone = []
    for leg in range(scene.n_legs):
        only = replace(scene, brightness=[float(k == leg) for k in range(scene.n_legs)])
        hist = recorded(only, seed=9_000_000 * (seed + 1) + 10 * run + leg)
        sighting = sighting_of(hist, only, timing)
        (found,) = find_legs(sighting.arrivals, camera=scene.camera, n_legs=1, convex=True)
        alone.append(projection_of_leg(found, sighting, scene.camera))
    return lambda _projections: alone


def _clock_of(variant: Variant, scene: Scene, seed: int) -> TimingCalibration | None:
    if variant.clock is None:
        return None
    if variant.detector is pf32:
        return calibrated_clock(variant.clock, seed=seed, three_legs=True)
    return clock_of_scene(variant.clock, scene, seed=seed)


def record_from_results(results: Sequence[Mapping[str, Any]]) -> Contributions:
    """The comparison from the results of `units`."""
    names = tuple(str(one["name"]) for one in results)
    rms = np.array([np.sqrt(np.mean(np.square(one["errors"]), axis=0)) for one in results])
    return Contributions(
        names=names,
        words=tuple(VARIANTS[name].words for name in names),
        position_rms_mm=rms[:, 0],
        event_time_rms_ps=rms[:, 1],
        angle_error_deg=np.array([np.mean(one["angle_error_deg"], axis=0) for one in results]),
    )
