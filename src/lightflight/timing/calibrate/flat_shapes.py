"""Shapes that a flat's pulse may have, by name: the one place where one more is made known.

Light to import, for the command line and the set-up ask for the names alone: what a shape needs
is loaded when a flat is calibrated by it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from lightflight.recording.histograms import Histograms
    from lightflight.timing.calibrate.delays import FlatDelays
    from lightflight.timing.clock.calibration import TimingCalibration
    from lightflight.timing.clock.response import Response

    FlatPulse = str | Response | ArrayLike
    """Shape of a flat's pulse: its name, itself, or the counts of one."""


def delays_of_pulses(
    flat: Histograms, clock: TimingCalibration, arrival_ps: ArrayLike
) -> FlatDelays:
    """Delays of the flat's fitted pulses: Gaussians, or of the clock's own response.

    Parameters
    ----------
    flat : Histograms
        Recording of a pulse that reaches every pixel.
    clock : TimingCalibration
        Clock whose codes are calibrated, or nominal.
    arrival_ps : array_like
        Arrival time of the flat, one number or (rows, cols), ps.

    Returns
    -------
    FlatDelays
        Of the mean of each pulse.
    """
    from lightflight.timing.calibrate.delays import delays_from_flat

    return delays_from_flat(flat, timing=clock, flat_arrival_ps=arrival_ps)


@dataclass(frozen=True, eq=False)
class FlatShape:
    """How a clock's delays, and its response, follow from a flat whose pulse has this shape.

    Attributes
    ----------
    name : str
        For `flat_pulse=`; empty where the user gave the shape itself.
    summary : str
        What it is, in the words of `lightflight calibrate --help`.
    response : Callable[[Histograms, TimingCalibration], Response or None] or None
        The shape, from the first flat, by which the pulses of flats and recordings on the clock
        are fitted. None, or none found: Gaussians of each pixel's own width.
    delays : Callable[[Histograms, TimingCalibration, ArrayLike], FlatDelays]
        Delays by one flat alone: the flat, the clock with that response, the arrival time (ps).
    """

    name: str
    summary: str
    response: Callable[[Histograms, TimingCalibration], Response | None] | None = None
    delays: Callable[[Histograms, TimingCalibration, ArrayLike], FlatDelays] = delays_of_pulses


def _tail_if_any(flat: Histograms, clock: TimingCalibration) -> Response | None:
    from lightflight.timing.calibrate.flat_response import tail_of_flat_if_any

    return tail_of_flat_if_any(flat, timing=clock)


def _tail(flat: Histograms, clock: TimingCalibration) -> Response:
    from lightflight.timing.calibrate.flat_response import tail_of_flat

    return tail_of_flat(flat, timing=clock)


def _mean(flat: Histograms, clock: TimingCalibration, arrival_ps: ArrayLike) -> FlatDelays:
    from lightflight.timing.calibrate.shaped_flat import delays_from_shaped_flat

    return delays_from_shaped_flat(flat, timing=clock, flat_arrival_ps=arrival_ps)


FLAT_SHAPES = (
    FlatShape("auto", "a Gaussian unless the flat shows that it has a tail", response=_tail_if_any),
    FlatShape("gaussian", "a Gaussian"),
    FlatShape(
        "tail", "one with an exponential tail (then used for the recordings too)", response=_tail
    ),
    FlatShape(
        "mean",
        "whatever the array's mean pulse is (fluorescence; delays are those of its onset)",
        delays=_mean,
    ),
)
"""The usual one first."""

FLAT_SHAPE_NAMES = tuple(shape.name for shape in FLAT_SHAPES)


def shapes_in_words() -> str:
    """What the named shapes are, as one list for a sentence."""
    *others, last = (shape.summary for shape in FLAT_SHAPES)
    return f"{', '.join(others)}, or {last}"


def flat_shape(flat_pulse: FlatPulse) -> FlatShape:
    """The shape that a user named, or gave.

    Parameters
    ----------
    flat_pulse : str, Response or array_like
        What `calibrate_timing` was given: a name, a curve, or the counts of a response.

    Returns
    -------
    FlatShape
        From `FLAT_SHAPES`, or made of the curve or the counts.

    Raises
    ------
    ValueError
        Where no shape has this name.
    """
    from lightflight.timing.clock.response import Response

    if isinstance(flat_pulse, str):
        for shape in FLAT_SHAPES:
            if shape.name == flat_pulse:
                return shape
        names = ", ".join(f'"{name}"' for name in FLAT_SHAPE_NAMES)
        raise ValueError(
            f"flat_pulse must be {names}, a Response, or counts of a response, got "
            f"{flat_pulse!r:.60}"
        )
    if isinstance(flat_pulse, Response):
        return FlatShape("", "a curve", response=lambda flat, clock: flat_pulse)
    counts = flat_pulse

    def reconvolved(
        flat: Histograms, clock: TimingCalibration, arrival_ps: ArrayLike
    ) -> FlatDelays:
        from lightflight.timing.calibrate.shaped_flat import delays_from_shaped_flat

        return delays_from_shaped_flat(
            flat, timing=clock, flat_arrival_ps=arrival_ps, response=counts
        )

    return FlatShape("", "a response convolved with a decay", delays=reconvolved)
