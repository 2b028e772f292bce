"""Arrivals: pulse times on the calibrated clock, with the errors of photons, pixels and all.

Takes `Pulses` and a `TimingCalibration`, gives what `reconstruct` fits a path to. A pulse's
delay minus its pixel's skew is the arrival time at the camera; the calibration says how well it
is known for each pixel by itself and which errors all pixels share.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags as fl
from lightflight.display import Card, Drawn
from lightflight.recording.histograms import Histograms
from lightflight.timing.pulses.pulse_table import PulseTable
from lightflight.timing.pulses.pulses import Pulses, fit_pulses

if TYPE_CHECKING:
    from lightflight.timing.clock.code_clock import CodeClock
    from lightflight.timing.clock.response import Response


@dataclass(frozen=True, eq=False, repr=False)
class Arrivals(PulseTable, Drawn):
    """Arrival times on the clock, one row per pulse, in the order of the `Pulses` they are from.

    Errors come in three classes: independent per pulse (photon), independent per pixel but the
    same in every recording (pixel), and shared by all (columns of `shared_modes_ps`).

    Attributes
    ----------
    row : array of int, shape (n,)
        Pixel row.
    col : array of int, shape (n,)
        Pixel column.
    arrival_ps : array of float, shape (n,)
        Arrival time at the camera, ps on the clock (delay minus the pixel's skew), known up to
        whole laser periods. In codes where the width of a code is unknown. NaN without a pulse.
    photon_std_ps : array of float, shape (n,)
        Standard error from the photons of this recording, ps.
    pixel_std_ps : array of float, shape (n,)
        Standard error of the pixel's calibration, ps.
    shared_modes_ps : array of float, shape (n, k)
        One sigma of each error that all pixels share, ps.
    shared_names : tuple of str
        (k), what each shared error is.
    std_ps : array of float, shape (n,)
        Standard deviation of the pulse as recorded, ps.
    std_error_ps : array of float, shape (n,)
        Standard error of `std_ps`, ps.
    photons : array of float, shape (n,)
        Photons in the pulse, counts.
    photons_std : array of float, shape (n,)
        Standard error of `photons`, counts.
    background_per_ps : array of float, shape (n,)
        Constant background of the pixel, counts per ps.
    chi2 : array of float, shape (n,)
        Pearson chi2 of the pixel's fit.
    dof : array of int, shape (n,)
        Its degrees of freedom.
    flags : array of uint32, shape (n,)
        What is wrong (`lightflight.flags`): the pulse's and the calibration's.
    pulse_index : array of int, shape (n,)
        0 for the earliest pulse of its pixel, then 1, 2 ...
    shape : (int, int)
        (rows, cols) of the camera.
    laser_period_ps : float or None
        Period of the laser, ps.
    method : str
        How the pulses were fitted.
    """

    row: NDArray[np.int32]

    col: NDArray[np.int32]

    arrival_ps: NDArray[np.float64]

    photon_std_ps: NDArray[np.float64]

    pixel_std_ps: NDArray[np.float64]

    shared_modes_ps: NDArray[np.float64]

    shared_names: tuple[str, ...]

    std_ps: NDArray[np.float64]

    std_error_ps: NDArray[np.float64]

    photons: NDArray[np.float64]

    photons_std: NDArray[np.float64]

    background_per_ps: NDArray[np.float64]

    chi2: NDArray[np.float64]

    dof: NDArray[np.int64]

    flags: NDArray[np.uint32]

    pulse_index: NDArray[np.int32]

    shape: tuple[int, int]

    laser_period_ps: float | None

    method: str

    def _card(self) -> Card:
        return self.card_of("arrival_ps", "arrival time", self.independent_std_ps)

    @property
    def independent_std_ps(self) -> NDArray[np.float64]:
        """(n,), photon and pixel errors together: what does not move with other pixels, ps."""
        return np.hypot(self.photon_std_ps, self.pixel_std_ps)


def arrivals_from_pulses(pulses: Pulses, *, timing: CodeClock | None) -> Arrivals:
    """Arrival times from fitted pulses: t_a = delay - skew of the pixel, and its errors.

    Parameters
    ----------
    pulses : Pulses
        From `fit_pulses` with the same `timing`.
    timing : TimingCalibration or None
        The clock; None: no skews, and no errors but those of the photons.

    Returns
    -------
    Arrivals
        One row for each of the pulses, in their order.

    Raises
    ------
    ValueError
        `timing` is of a camera with another number of pixels.
    """
    n = len(pulses.row)
    with np.errstate(invalid="ignore"):  # a variance that came out negative is unknown: NaN
        std_of = np.sqrt(np.diagonal(pulses.covariance, axis1=1, axis2=2))
    if timing is None:
        skew, flags = np.zeros(n), pulses.flags | np.uint32(fl.UNCALIBRATED)
        pixel_std = np.where(np.isnan(pulses.delay_ps), np.nan, 0.0)
        modes, names = np.zeros((n, 0)), tuple[str, ...]()
    else:
        if tuple(timing.shape) != tuple(pulses.shape):
            raise ValueError(
                f"the calibration is of {timing.shape} pixels, the pulses are of {pulses.shape}: "
                "use the calibration of the same camera"
            )
        skew = timing.skew_ps[pulses.row, pulses.col]
        flags = pulses.flags | timing.flags[pulses.row, pulses.col].astype(np.uint32)
        pixel_std, modes, names = timing.arrival_errors_ps(pulses.row, pulses.col, pulses.delay_ps)
    return Arrivals(
        row=pulses.row,
        col=pulses.col,
        arrival_ps=pulses.delay_ps - skew,
        photon_std_ps=std_of[:, 0],
        pixel_std_ps=pixel_std,
        shared_modes_ps=modes,
        shared_names=names,
        std_ps=pulses.std_ps,
        std_error_ps=std_of[:, 1],
        photons=pulses.photons,
        photons_std=std_of[:, 2],
        background_per_ps=pulses.background_per_ps,
        chi2=pulses.chi2,
        dof=pulses.dof,
        flags=flags,
        pulse_index=pulses.pulse_index,
        shape=pulses.shape,
        laser_period_ps=pulses.laser_period_ps,
        method=pulses.method,
    )


def find_arrivals(
    hist: Histograms,
    *,
    timing: CodeClock | None = None,
    method: str = "likelihood",
    max_pulses: int = 3,
    background: Histograms | None = None,
    response: Response | ArrayLike | None = None,
    exclude_mask: ArrayLike | None = None,
    threads: int = 1,
) -> Arrivals:
    """Arrival times of all pulses of a recording: `fit_pulses`, then `arrivals_from_pulses`.

    Parameters are those of `fit_pulses`. Without `timing` the nominal codes are used and every
    row is flagged `uncalibrated`.

    Returns
    -------
    Arrivals
        One row per pulse, see `arrivals_from_pulses`.
    """
    pulses = fit_pulses(
        hist, timing=timing, method=method, max_pulses=max_pulses, background=background,
        response=response, exclude_mask=exclude_mask, threads=threads,
    )  # fmt: skip
    return arrivals_from_pulses(pulses, timing=timing)
