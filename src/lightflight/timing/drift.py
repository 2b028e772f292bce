"""Whether a clock still holds: an old calibration against a new recording, or time slices.

A camera that warms up moves its delays (offset) and its code width (scale). Both are read off
pulses that should not have moved: a flat, or the same scene in slices of one long recording.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags
from lightflight.errors import CalibrationError, SuspectDataWarning
from lightflight.recording.histograms import Histograms
from lightflight.timing.calibrate.delays import checked_arrivals_ps, delays_from_flat, wrapped_ps

if TYPE_CHECKING:
    from lightflight.timing.clock.calibration import TimingCalibration

Floats = NDArray[np.float64]

_MOVED = 5.0
"""Standard errors that count as movement."""


@dataclass(frozen=True, eq=False)
class Drift:
    """How pulses moved, for each recording or slice: later by `offset + scale * distance`.

    Distances are from the array's mean delay.

    Attributes
    ----------
    offset_ps : array of float, shape (k,)
        Common shift of all pixels, ps; positive: later than before.
    offset_std_ps : array of float, shape (k,)
        Its standard error, ps.
    scale : array of float, shape (k,)
        Relative change of times; NaN where all pulses sit at one delay.
    scale_std : array of float, shape (k,)
        Its standard error.
    chi2 : array of float, shape (k,)
        What shift and scale leave of the pixels' own movement, in standard errors squared.
    dof : array of int, shape (k,)
        Degrees of freedom of `chi2`.
    """

    offset_ps: Floats

    offset_std_ps: Floats

    scale: Floats

    scale_std: Floats

    chi2: Floats

    dof: NDArray[np.int64]

    @property
    def moved(self) -> NDArray[np.bool_]:
        """(k,), True where offset or scale is off by more than five standard errors."""
        scale = np.abs(self.scale) > _MOVED * self.scale_std
        return (np.abs(self.offset_ps) > _MOVED * self.offset_std_ps) | scale

    def sentence(self, index: int = 0) -> str:
        """The figures of one recording or slice, in words.

        Parameters
        ----------
        index : int, optional
            Which recording or slice.

        Returns
        -------
        str
            Without capital and full stop: it goes into other sentences.
        """
        text = f"delays moved by {self.offset_ps[index]:+.2f} +- {self.offset_std_ps[index]:.2f} ps"
        if np.isfinite(self.scale[index]):
            percent, std = 100.0 * self.scale[index], 100.0 * self.scale_std[index]
            text += f", the scale by {percent:+.3f} +- {std:.3f} %"
        return text


def drift_from_flat(
    timing: TimingCalibration, flat: Histograms, *, flat_arrival_ps: ArrayLike = 0.0
) -> Drift:
    """Movement of a clock since it was calibrated, by a new flat at the same arrival time.

    Gives SuspectDataWarning with the figures where it moved by more than its errors.

    Parameters
    ----------
    timing : TimingCalibration
        The old calibration; it must hold delays.
    flat : Histograms
        The new recording.
    flat_arrival_ps : array-like, optional
        As when the clock was calibrated, scalar or (rows, cols), ps.

    Returns
    -------
    Drift
        Of one recording (k = 1).

    Raises
    ------
    CalibrationError
        If the calibration has no delays, or is of another camera.
    """
    if not timing.has_flat:
        raise CalibrationError("the calibration has no delays to compare with: it had no flat")
    found = delays_from_flat(flat, timing=timing, flat_arrival_ps=flat_arrival_ps)
    arrival = checked_arrivals_ps(flat_arrival_ps, flat.shape)
    moved = found.pulse_delay_ps - arrival - timing.skew_ps
    if timing.laser_period_ps is not None:
        moved = wrapped_ps(moved, timing.laser_period_ps)
    rows, cols = (grid.ravel() for grid in np.indices(timing.shape))
    own, _, _ = timing.arrival_errors_ps(rows, cols, found.pulse_delay_ps.ravel())
    std = np.hypot(found.skew_std_ps, own.reshape(timing.shape))
    # A pixel without a flat holds the array's typical delay, which says nothing of movement.
    known = flags.is_usable(timing.flags) & np.isfinite(timing.anchor_delay_ps)
    std = np.where(known, std, np.nan)
    drift = _line_through(found.pulse_delay_ps[None], moved[None], std[None])
    if drift.moved[0]:
        warnings.warn(
            f"the clock drifted since it was calibrated: {drift.sentence()}; calibrate again",
            SuspectDataWarning,
            stacklevel=2,
        )
    return drift


def drift_in_slices(slices: Sequence[Histograms], *, timing: TimingCalibration | None) -> Drift:
    """Movement of the pulses of one scene from slice to slice of a long recording.

    Each slice is compared with the mean of the others. Gives SuspectDataWarning with the largest
    figure where pulses moved by more than their errors.

    Parameters
    ----------
    slices : sequence of Histograms
        Histograms of equal stretches of the recording, in the order of time.
    timing : TimingCalibration or None
        The clock; None: nominal codes.

    Returns
    -------
    Drift
        Of each slice against all the others.

    Raises
    ------
    ValueError
        For fewer than two slices.
    CalibrationError
        If too few pixels show a pulse in two slices.
    """
    from lightflight.timing.pulses.pulses import fit_pulses

    if len(slices) < 2:
        raise ValueError(f"drift needs at least two slices, got {len(slices)}")
    pulses = [fit_pulses(part, timing=timing, max_pulses=1, response="clock") for part in slices]
    usable = np.stack([part.usable for part in pulses])
    delay = np.where(usable, np.stack([part.delay_ps for part in pulses]), np.nan)
    std = np.sqrt(np.stack([part.covariance[:, 0, 0] for part in pulses]))
    period = pulses[0].laser_period_ps
    # Any delay of the pixel will do to tell periods: the slices' own differ by far less than one.
    first = np.nanmax(np.where(np.isfinite(delay), delay, -np.inf), axis=0)
    if period is not None:
        delay = first + wrapped_ps(delay - first, period)
    weight = np.where(np.isfinite(delay) & (std > 0), std, np.inf) ** -2.0
    filled = np.nan_to_num(delay)
    # Against the mean of the others: a mean with the slice itself in it would hide part of
    # its move.
    others = weight.sum(axis=0) - weight
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = ((weight * filled).sum(axis=0) - weight * filled) / others
        noise = np.sqrt(std**2 + 1.0 / others)
    drift = _line_through(mean, delay - mean, np.where(weight > 0, noise, np.nan))
    if drift.moved.any():
        pulls = np.abs(drift.offset_ps) / drift.offset_std_ps
        worst = int(np.argmax(np.where(drift.moved, pulls, -1.0)))
        warnings.warn(
            f"the pulses move within the recording: in slice {worst + 1} of {len(slices)}, "
            f"{drift.sentence(worst)} against the others; let the camera warm up, or calibrate "
            "and reconstruct the slices one by one",
            SuspectDataWarning,
            stacklevel=2,
        )
    return drift


def _line_through(delay_ps: Floats, moved_ps: Floats, std_ps: Floats) -> Drift:
    """Weighted line moved = offset + scale (delay - mean delay) over the pixels of each row."""
    columns: list[list[float]] = []
    for delay, moved, std in zip(delay_ps, moved_ps, std_ps, strict=True):
        use = np.isfinite(delay) & np.isfinite(moved) & np.isfinite(std) & (std > 0)
        if np.count_nonzero(use) < 3:
            raise CalibrationError(
                f"only {np.count_nonzero(use)} pixels show a usable pulse in both recordings: "
                "too few to measure a drift"
            )
        weight, place, value = std[use] ** -2.0, delay[use], moved[use]
        total = weight.sum()
        place = place - np.sum(weight * place) / total
        # About the mean delay, offset and scale are independent of each other.
        offset = np.sum(weight * value) / total
        spread = np.sum(weight * place**2)
        scale, scale_std = np.nan, np.nan
        # Delays within 1 ps of each other have no lever to tell a scale from.
        if spread > 0 and np.sqrt(spread / total) > 1.0:
            scale, scale_std = np.sum(weight * place * value) / spread, spread**-0.5
        left = value - offset - np.nan_to_num(scale) * place
        n_fitted = 1 + int(np.isfinite(scale))
        chi2 = float(np.sum(weight * left**2))
        columns.append([offset, total**-0.5, scale, scale_std, chi2, use.sum() - n_fitted])
    table = np.array(columns, dtype=np.float64).T
    return Drift(table[0], table[1], table[2], table[3], table[4], table[5].astype(np.int64))
