"""Delay of every pixel from a flat recording: a pulse that reaches the whole array at known times.

delay = fitted pulse time (in the pixel's own code edges) - arrival time of the flat there. Takes
`Histograms` and a clock whose codes are calibrated, gives `FlatDelays`; `calibration.py` joins
the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags
from lightflight.arguments import real_numbers
from lightflight.errors import CalibrationError
from lightflight.recording.histograms import Histograms

if TYPE_CHECKING:
    from lightflight.timing.clock.calibration import TimingCalibration
    from lightflight.timing.pulses.pulses import Pulses

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FlatDelays:
    """What one flat recording says of each pixel; NaN where it holds no usable pulse.

    Attributes
    ----------
    skew_ps : array of float, shape (rows, cols)
        Delay of the pixel minus arrival time of the flat, ps; within half a laser period of the
        array's median.
    skew_std_ps : array of float, shape (rows, cols)
        Its photon error, ps.
    pulse_delay_ps : array of float, shape (rows, cols)
        Where the pulse sits after the sync, ps.
    response_std_ps : array of float, shape (rows, cols)
        Standard deviation of the pulse, ps.
    photons : array of float, shape (rows, cols)
        Photons in the pulse.
    chi2_excess : float
        Mean of (chi2 - dof) / counts over usable pixels: squared relative misfit of codes.
    flags : array of uint32, shape (rows, cols)
        Flags of the pulses.
    """

    skew_ps: Floats

    skew_std_ps: Floats

    pulse_delay_ps: Floats

    response_std_ps: Floats

    photons: Floats

    chi2_excess: float

    flags: NDArray[np.uint32]


def delays_from_flat(
    flat: Histograms,
    *,
    timing: TimingCalibration,
    flat_arrival_ps: ArrayLike = 0.0,
) -> FlatDelays:
    """Delay of every pixel that shows the flat's pulse.

    Parameters
    ----------
    flat : Histograms
        Counts, (rows, cols, codes).
    timing : TimingCalibration
        Clock whose codes are calibrated (or nominal); its delays are not used.
    flat_arrival_ps : array-like, optional
        Arrival time of the pulse at each pixel, scalar or (rows, cols), ps.

    Returns
    -------
    FlatDelays
        Delays, their photon errors and the pulses they are from.

    Raises
    ------
    CalibrationError
        If no pixel shows a pulse, or the clock is of another camera.
    ValueError
        If `flat_arrival_ps` is not finite or of a wrong shape.
    """
    from lightflight.timing.pulses.pulses import fit_pulses

    arrival = checked_arrivals_ps(flat_arrival_ps, flat.shape)
    pulses = fit_pulses(flat, timing=timing, response="clock")
    row = _strongest_rows(pulses)
    delay, photons = pulses.delay_ps[row], pulses.photons[row]
    std = np.sqrt(pulses.covariance[row, 0, 0])
    words = pulses.flags[row]
    usable = flags.is_usable(words) & np.isfinite(delay) & np.isfinite(std)
    if not usable.any():
        counted = ", ".join(f"{n} {name}" for name, n in flags.count_flags(words).items())
        raise CalibrationError(
            f"no pixel of the flat recording shows a usable pulse ({counted}): "
            "check that the laser reached the camera and that this is not the code-density file"
        )
    delay, std, photons = (np.where(usable, x, np.nan) for x in (delay, std, photons))
    excess = (pulses.chi2 - pulses.dof)[row][usable].sum() / photons[usable].sum()
    return FlatDelays(
        skew_ps=skews_near_median(delay - arrival, flat.laser_period_ps),
        skew_std_ps=std,
        pulse_delay_ps=delay,
        response_std_ps=np.where(usable, pulses.std_ps[row], np.nan),
        photons=photons,
        chi2_excess=float(excess),
        flags=words,
    )


def checked_arrivals_ps(flat_arrival_ps: ArrayLike, shape: tuple[int, int]) -> Floats:
    """Arrival times of the flat, one for every pixel.

    Parameters
    ----------
    flat_arrival_ps : array-like
        One time, or one per pixel, ps.
    shape : (int, int)
        (rows, cols) of the camera.

    Returns
    -------
    array of float, shape (rows, cols)
        ps; a view that cannot be written to where one time was given.

    Raises
    ------
    ValueError
        If the times are not finite or of a wrong shape.
    """
    arrival = real_numbers("flat_arrival_ps", flat_arrival_ps)
    if arrival.ndim not in (0, 2) or (arrival.ndim == 2 and arrival.shape != shape):
        raise ValueError(
            f"flat_arrival_ps must be a number or have shape {shape}, got shape {arrival.shape}"
        )
    if not np.isfinite(arrival).all():
        raise ValueError("flat_arrival_ps must be finite: give a time for every pixel")
    return np.broadcast_to(arrival, shape)


def skews_near_median(skew_ps: Floats, period_ps: float | None) -> Floats:
    """Delays moved by whole periods to within half a period of the (circular) middle.

    The middle itself is put within half a period of zero. NaN stays.

    Parameters
    ----------
    skew_ps : array of float, shape (...)
        Delays, ps; NaN where unknown.
    period_ps : float or None
        P of the laser, ps; None: delays are known as they are.

    Returns
    -------
    array of float, shape (...)
        ps, with middle P arg(sum exp(2 pi i skew / P)) / 2 pi.
    """
    if period_ps is None:
        return skew_ps
    # A mean on the circle: delays on both sides of the period's end must not meet half-way round.
    turns = np.exp(2j * np.pi * skew_ps[np.isfinite(skew_ps)] / period_ps)
    middle = period_ps * np.angle(turns.sum()) / (2.0 * np.pi)
    return np.asarray(middle + wrapped_ps(skew_ps - middle, period_ps))


def wrapped_ps(time_ps: Floats, period_ps: float) -> Floats:
    """Times moved by whole periods into [-P/2, P/2).

    Parameters
    ----------
    time_ps : array of float, shape (...)
        Times or differences of times, ps.
    period_ps : float
        P, ps.

    Returns
    -------
    array of float, shape (...)
        ps, the same times modulo P.

    Examples
    --------
    >>> wrapped_ps(np.array([-30.0, 10.0, 60.0]), 100.0)
    array([-30.,  10., -40.])
    """
    return np.asarray(np.mod(time_ps + 0.5 * period_ps, period_ps) - 0.5 * period_ps)


def _strongest_rows(pulses: Pulses) -> NDArray[np.intp]:
    """(rows, cols), index into the table of the strongest pulse of each pixel."""
    pixel = pulses.row.astype(np.intp) * pulses.shape[1] + pulses.col
    index = np.zeros(pulses.shape[0] * pulses.shape[1], dtype=np.intp)
    # Of several writes to one place NumPy keeps the last: the strongest pulse.
    weakest_first = np.argsort(np.nan_to_num(pulses.photons, nan=-np.inf), kind="stable")
    index[pixel[weakest_first]] = weakest_first
    return index.reshape(pulses.shape)
