"""From recordings to sightings: pulses on the clock, folded to where light can come from."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from lightflight import flags
from lightflight.errors import (
    CalibrationError,
    NothingFoundError,
    SuspectDataWarning,
    UncalibratedWarning,
)
from lightflight.reconstruct.legs.find import unwrapped_arrivals
from lightflight.reconstruct.model.glass import looks_at_blocks
from lightflight.reconstruct.model.setting import Setting, earliest_arrival_ps
from lightflight.reconstruct.model.sighting import Sighting, blind_pixels, without_pixels
from lightflight.reconstruct.other_light.tail import shape_with_tail
from lightflight.reconstruct.steep_pulses import with_steep_pulses
from lightflight.timing.clock.calibration import ASSUMED_GAIN_STD, TimingCalibration
from lightflight.timing.pulses.arrivals import find_arrivals
from lightflight.timing.pulses.background import without_background_pulses
from lightflight.timing.pulses.pulses import MOST_PULSES
from lightflight.timing.pulses.same_camera import check_same_camera

if TYPE_CHECKING:
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.code_clock import CodeClock
    from lightflight.timing.pulses.arrivals import Arrivals

_MOST_PERIODS = 2.0
"""Codes that cover more laser periods than this are worth a question."""


def unwrapped_sighting(sighting: Sighting, setting: Setting, *, literal: bool = False) -> Sighting:
    """The sighting with arrivals folded to where light can come from.

    Pixels that look at a block of glass in the beam are masked; pulses that flight through their
    pixels makes wide are taken, unless the paper is followed to the letter.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    setting : Setting
        Camera, source, medium and waypoints.
    literal : bool, optional
        Whether what is too wide for the array's pulse stays left out, as in the paper.

    Returns
    -------
    Sighting
        The same recording, `arrival_ps` shifted by whole laser periods.

    Raises
    ------
    CalibrationError
        Where the clock is another camera's.
    """
    check_same_camera(sighting.arrivals, sighting.timing)
    times = unwrapped_arrivals(
        sighting.arrivals.arrival_ps,
        period_ps=sighting.arrivals.laser_period_ps,
        earliest_ps=earliest_arrival_ps(setting),
    )
    seen = replace(
        sighting, arrivals=replace(sighting.arrivals, arrival_ps=times), arrival_ps=times
    )
    if not literal:
        seen = with_steep_pulses(seen)
    if not setting.medium.blocks:
        return seen
    return without_pixels(seen, looks_at_blocks(setting.camera, setting.medium.blocks))


def sighting_from_histograms(
    hist: Histograms,
    setting: Setting,
    *,
    timing: CodeClock | None,
    background: Histograms | None,
    exclude_mask: ArrayLike | None,
    least_squares: bool,
    view: int = 0,
) -> Sighting:
    """Pulses of one recording on the clock, unwrapped.

    Parameters
    ----------
    hist : Histograms
        The recording.
    setting : Setting
        Camera, source, medium and waypoints.
    timing : TimingCalibration or None
        Its calibrated clock; None: nominal codes.
    background : Histograms or None
        Recording without the flight, same clock; codes in which it holds pulses take no part.
    exclude_mask : array_like, shape (rows, cols) or None
        True for pixels that take no part.
    least_squares : bool
        One Gaussian per pixel by least squares, as the paper does; else by likelihood.
    view : int, optional
        Which of the setting's cameras recorded it.

    Returns
    -------
    Sighting
        Pulses on the clock, folded to where light can come from.

    Raises
    ------
    CalibrationError
        Where the calibration is of another recording, or the codes cover more laser periods than
        one and no pixel shows a pulse.
    NothingFoundError
        Where no pixel shows a pulse, but for those of the background.
    """
    clock, without = clock_or_nominal(hist, timing), None
    if background is not None and hist.poisson and not least_squares:
        without = without_background_pulses(hist, background, clock, response=clock.response)
        if without is not None:
            hist, background, clock = without.emptied(hist), without.emptied(background), without
    find = partial(
        find_arrivals,
        hist,
        timing=clock,
        background=background,
        exclude_mask=exclude_mask,
        response="clock",  # late light has a place of its own, below
    )
    # The paper fits one Gaussian per pixel and discards what is too wide for one.
    # A pixel that light crosses again and again shows a pulse each time: the counts say how many.
    arrivals = (
        find(method="least_squares", max_pulses=1)
        if least_squares
        else find(max_pulses=MOST_PULSES)
    )
    _check_period(hist, arrivals)
    if without is not None and not flags.is_usable(arrivals.flags).any():
        raise NothingFoundError(
            "no pixel shows a pulse where the background shows none: was the flight blocked while "
            "the background was recorded?"
        )
    seen = Sighting(hist, clock, arrivals, arrivals.arrival_ps, blind_pixels(arrivals, clock), view)
    if not least_squares:
        seen = _with_late_light(seen, find, nominal=timing is None)
    return unwrapped_sighting(seen, setting, literal=least_squares)


def _with_late_light(seen: Sighting, find: Callable[..., Arrivals], *, nominal: bool) -> Sighting:
    """The recording with its pulses found anew where much of their light is late."""
    tail = shape_with_tail(seen, nominal=nominal)
    if tail is None:
        return seen
    shape, core_std_ps = tail
    try:
        arrivals = find(response=shape, max_pulses=MOST_PULSES)
    except NothingFoundError:
        # In fog each pixel has its own share of late light, and pulses have no shape in common.
        return seen
    # Widths are those of the light that is not late, as everywhere else.
    narrower = core_std_ps / shape.std_ps
    arrivals = replace(
        arrivals,
        std_ps=narrower * arrivals.std_ps,
        std_error_ps=narrower * arrivals.std_error_ps,
    )
    return replace(seen, arrivals=arrivals, arrival_ps=arrivals.arrival_ps)


def _check_period(hist: Histograms, arrivals: Arrivals) -> None:
    """Ask about a laser period that the codes go far beyond.

    One that the pulses fill is refused where they are fitted (`timing.pulses.checks`).
    """
    period_ps = hist.laser_period_ps
    if period_ps is None or hist.bin_width_ps is None:
        return
    covered = hist.n_codes * hist.bin_width_ps / period_ps
    if covered <= _MOST_PERIODS:
        return
    doubt = (
        f"the codes cover {covered:.1f} laser periods of {period_ps:g} ps: check "
        "laser_period_ps and bin_width_ps"
    )
    # With no pulse at all the doubt is the reason; with some it is a question.
    if not flags.is_usable(arrivals.flags).any():
        raise CalibrationError(f"no pixel shows a pulse, and {doubt}")
    warnings.warn(doubt, SuspectDataWarning, stacklevel=4)


def clock_or_nominal(hist: Histograms, timing: CodeClock | None) -> CodeClock:
    """The calibration, if it fits the recording; else the nominal clock, with a warning.

    Parameters
    ----------
    hist : Histograms
        The recording.
    timing : TimingCalibration or None
        Its calibrated clock; None: nominal codes.

    Returns
    -------
    TimingCalibration
        `timing` where it is given, else codes of equal width without delays.

    Raises
    ------
    CalibrationError
        Where the calibration does not match the recording.
    """
    if timing is not None:
        timing.check_matches(hist)
        return timing
    clock = TimingCalibration.nominal(hist)
    span_ps = clock.laser_period_ps or hist.n_codes * clock.bin_width_ps
    warnings.warn(
        "no timing calibration: nominal codes are used. Unequal codes cost 3-6 ps per pixel, "
        f"unequal gains {100 * ASSUMED_GAIN_STD:.2g} % of the delay (up to "
        f"{ASSUMED_GAIN_STD * span_ps:.0f} ps), and the delays between pixels, often hundreds of "
        "ps, go unseen; give timing=",
        UncalibratedWarning,
        stacklevel=4,
    )
    return clock
