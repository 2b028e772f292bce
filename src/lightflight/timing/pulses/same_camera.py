"""Whether a calibration is of the camera that recorded: it must order the times of neighbours.

Light in flight reaches neighbouring pixels in turn, so the second difference of the arrival times
of three pixels in a row is small. On equal codes it holds the gains and delays of the pixels;
those of another camera, taken off, scatter it more instead of less.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import CalibrationError
from lightflight.units import std_from_mad

if TYPE_CHECKING:
    from lightflight.timing.clock.code_clock import CodeClock
    from lightflight.timing.pulses.arrivals import Arrivals

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_FEWEST_TRIPLES = 30
"""Fewer second differences than this have no median that could be held against another."""
_MOST_TRIPLES = 500
"""More would tell no more, and their code edges would fill the memory."""
_BEYOND_NOISE = 5.0
"""Times must scatter by more than this many of their errors: else photons hide the clock."""
_WORSE = 1.2
"""Another camera's calibration scatters times by 1.41 of what equal codes do, the right one by
far less than 1 or, where all pixels are alike, by 1."""
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Along rows, columns and both diagonals, px."""


def check_same_camera(arrivals: Arrivals, clock: CodeClock) -> None:
    """Refuse a calibration on which the times of a recording scatter more than on equal codes.

    Parameters
    ----------
    arrivals : Arrivals
        Pulses of the recording on that clock.
    clock : TimingCalibration
        The calibration.

    Raises
    ------
    CalibrationError
        Where it is not that of the camera that recorded, or what came is no light.
    """
    scatter = scatter_of_neighbours(arrivals, clock)
    if scatter is None:
        return
    calibrated_ps, equal_ps, error_ps = scatter
    if calibrated_ps > max(_WORSE * equal_ps, _BEYOND_NOISE * error_ps):
        same, lit = _at_one_code(arrivals, clock)
        if same > 0.5 * lit:
            raise CalibrationError(
                f"pulses of {same} of {lit} pixels come at the same code, whatever the delays of "
                "their pixels: no light but a signal of the camera or its trigger; find where it "
                "comes from, or keep the codes before it or after it (codes=)"
            )
        raise CalibrationError(
            f"the times of neighbouring pixels scatter by {calibrated_ps:.0f} ps on this "
            f"calibration and by {equal_ps:.0f} ps without: it is of another camera, or of another "
            "setting of its clock; calibrate the camera that recorded this"
        )


def scatter_of_neighbours(
    arrivals: Arrivals, clock: CodeClock
) -> tuple[float, float, float] | None:
    """How far neighbouring pixels are from arriving in turn.

    Parameters
    ----------
    arrivals : Arrivals
        Pulses on the clock.
    clock : TimingCalibration
        The clock.

    Returns
    -------
    (float, float, float) or None
        Scatter of one pixel on this clock, on codes all alike, and by the errors of the times,
        one sigma each, ps. None where there are too few neighbours, or all pixels are alike.
    """
    if tuple(clock.skew_ps.shape) != tuple(arrivals.shape):
        return None
    rows, cols = _triples(np.asarray(arrivals.image("usable")))
    if len(rows) < _FEWEST_TRIPLES:
        return None
    time = arrivals.image("arrival_ps")[rows, cols]
    error = arrivals.image("independent_std_ps")[rows, cols]
    place = _place_among_codes(clock, rows.ravel(), cols.ravel(), time.ravel())
    equal = clock.bin_width_ps * place.reshape(time.shape)
    period = clock.laser_period_ps
    return (
        _scatter(time, period),
        _scatter(equal, period),
        float(np.median(error)),
    )


def _triples(lit: NDArray[np.bool_]) -> tuple[Indices, Indices]:
    """Rows and columns, (n, 3) each, of three pixels in a row that all hold a pulse."""
    found = []
    inner = np.argwhere(lit)
    for step in np.array(_STEPS):
        places = np.stack([inner - step, inner, inner + step], axis=1)
        inside = np.all((places >= 0) & (places < lit.shape), axis=(1, 2))
        places = places[inside]
        found.append(places[np.all(lit[places[..., 0], places[..., 1]], axis=1)])
    every = np.concatenate(found)
    some = every[:: max(1, len(every) // _MOST_TRIPLES)]
    return some[..., 0], some[..., 1]


def _at_one_code(arrivals: Arrivals, clock: CodeClock) -> tuple[int, int]:
    """How many pixels' pulses come at one code, within half a pulse, and how many there are."""
    rows, cols = np.nonzero(np.asarray(arrivals.image("usable")))
    time = arrivals.image("arrival_ps")[rows, cols]
    place = _place_among_codes(clock, rows, cols, time)
    within = max(0.5, 0.5 * float(np.median(arrivals.std_ps)) / clock.bin_width_ps)
    return int(np.sum(np.abs(place - np.median(place)) < within)), len(place)


def _place_among_codes(clock: CodeClock, rows: Indices, cols: Indices, time_ps: Floats) -> Floats:
    """(n,), where each time lies, counted in codes of its pixel from the earliest on."""
    delay_ps = time_ps + np.asarray(clock.skew_ps)[rows, cols]
    lower, upper = clock.code_intervals_ps(rows, cols)
    if lower[0, 0] > lower[0, -1]:
        lower, upper = lower[:, ::-1], upper[:, ::-1]
    if clock.laser_period_ps is not None:
        delay_ps = lower[:, 0] + np.mod(delay_ps - lower[:, 0], clock.laser_period_ps)
    code = np.sum(upper <= delay_ps[:, np.newaxis], axis=1)
    code = np.minimum(code, lower.shape[1] - 1)
    pixel = np.arange(len(code))
    start, width = lower[pixel, code], (upper - lower)[pixel, code]
    part = np.divide(delay_ps - start, width, out=np.zeros_like(start), where=width > 0)
    return np.asarray(code + np.clip(part, 0.0, 1.0))


def _scatter(times_ps: Floats, period_ps: float | None) -> float:
    """One sigma of a pixel behind the second differences (variance 1 + 4 + 1 of its own), ps."""
    bent = times_ps[:, 0] - 2.0 * times_ps[:, 1] + times_ps[:, 2]
    if period_ps is not None:
        bent = np.mod(bent + 0.5 * period_ps, period_ps) - 0.5 * period_ps
    return std_from_mad(float(np.median(np.abs(bent)))) / float(np.sqrt(6.0))
