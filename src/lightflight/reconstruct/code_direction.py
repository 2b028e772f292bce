"""Legs in the picture, and whether their times run the way that straight light's must.

Takes the pulses of one recording; a clock that runs backwards is noticed here, before any path
is fitted, and where nothing tells its direction the user is asked.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import TYPE_CHECKING

from lightflight.errors import CalibrationError, NothingFoundError, SuspectDataWarning
from lightflight.flight import Medium
from lightflight.reconstruct.bend import bend_significance
from lightflight.reconstruct.legs import ImageLeg, find_legs
from lightflight.reconstruct.observation import Observation
from lightflight.reconstruct.setting import Setting, earliest_arrival_ps

if TYPE_CHECKING:
    from lightflight.camera import Camera
    from lightflight.timing.arrivals import Arrivals
    from lightflight.timing.calibration import TimingCalibration


def _one_medium(medium: Medium) -> bool:
    """True where the half-angle law bends every arrival curve upwards."""
    return abs(medium.path_group_index / medium.return_group_index - 1) < 0.02


def search_legs(
    arrivals: Arrivals,
    observation: Observation,
    setting: Setting,
    n_legs: int | None,
    *,
    convex: bool | None = None,
) -> tuple[ImageLeg, ...]:
    """Legs in the picture of one table of arrivals; `convex` None: as the media ask for."""
    folded = arrivals.laser_period_ps is not None
    return find_legs(
        arrivals,
        camera=setting.camera,
        n_legs=n_legs,
        earliest_ps=earliest_arrival_ps(setting) if folded else None,
        convex=_one_medium(setting.medium) if convex is None else convex,
        computed_cube=not observation.histograms.poisson,
    )


def legs_of_straight_light(
    observation: Observation, setting: Setting, n_legs: int | None
) -> tuple[ImageLeg, ...]:
    """Legs in the picture; a clock that runs backwards is noticed here.

    Straight light gives d^2 t_a / d psi^2 > 0 (half-angle law); a clock read backwards turns that
    round. Where the legs found bend the wrong way beyond chance, or hardly any are found, the
    search is made on the clock run backwards too, and the clearer picture decides.
    """
    try:
        legs = search_legs(observation.arrivals, observation, setting, n_legs)
    except NothingFoundError:
        refuse_if_clearer_backwards((), observation, setting, n_legs)
        raise
    if bend_significance(legs, observation, setting.camera) < -6.0:
        refuse_if_clearer_backwards(legs, observation, setting, n_legs)
    return legs


def refuse_if_clearer_backwards(
    legs: tuple[ImageLeg, ...],
    observation: Observation,
    setting: Setting,
    n_legs: int | None,
) -> None:
    """Raise CalibrationError where the clock run backwards shows legs as clear, rightly bent."""
    if not _one_medium(setting.medium):
        return
    backwards = replace(
        observation.arrivals, arrival_ps=-observation.arrival_ps, laser_period_ps=None
    )
    try:
        mirrored = search_legs(backwards, observation, setting, n_legs)
    except NothingFoundError:
        return

    def clarity(found: tuple[ImageLeg, ...]) -> float:
        return float(sum(leg.n_pixels**2 for leg in found))

    turned = replace(observation, arrivals=backwards, arrival_ps=backwards.arrival_ps)
    bend = bend_significance(mirrored, turned, setting.camera)
    if clarity(mirrored) >= clarity(legs) and bend > 3.0:
        now = observation.histograms.reversed_codes
        raise CalibrationError(
            "the arrival times bend the wrong way for straight light, so the codes run backwards: "
            f"read the recording with reversed_codes={not now} (it says {now})"
        )


def ask_which_way(
    legs: tuple[ImageLeg, ...],
    observation: Observation,
    camera: Camera,
    timing: TimingCalibration | None,
    problem: Exception,
) -> None:
    """Where no path fits on a clock nobody calibrated and its direction does not show, ask."""
    if timing is not None or bend_significance(legs, observation, camera) > 6.0:
        return
    now = observation.histograms.reversed_codes
    raise CalibrationError(
        "no path fits these arrival times, and without a calibration they do not show which way "
        f"the codes run: give timing=, or try reversed_codes={not now} (the recording says {now})"
    ) from problem


def warn_of_scatter(
    floor_ps: float, legs: tuple[ImageLeg, ...], observation: Observation, camera: Camera
) -> None:
    """Say that an uncalibrated clock ruins the times, and that its direction may be wrong too."""
    now = observation.histograms.reversed_codes
    either_way = bend_significance(legs, observation, camera) < 6.0
    doubt = (
        f", and do not show which way the codes run (the recording says reversed_codes={now}; if "
        f"in doubt try reversed_codes={not now})"
        if either_way
        else ""
    )
    warnings.warn(
        f"the times scatter by {floor_ps:.0f} ps about the path: calibrate the clock{doubt}",
        SuspectDataWarning,
        stacklevel=3,
    )
