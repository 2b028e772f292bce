"""Arrivals: pulse times on the calibrated clock, with the errors of photons, pixels and all.

Takes `Pulses` and a `TimingCalibration`, gives what `reconstruct` fits a path to. A pulse's
delay minus its pixel's skew is the arrival time at the camera; the calibration says how well it
is known for each pixel by itself and which errors all pixels share.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags as fl
from lightflight.histogram import Histograms
from lightflight.timing.pulses import Pulses, fit_pulses, image_of_strongest

if TYPE_CHECKING:
    from lightflight.timing.calibration import TimingCalibration
    from lightflight.timing.response import Response


@dataclass(frozen=True, eq=False)
class Arrivals:
    """Arrival times on the clock, one row per pulse, in the order of the `Pulses` they are from.

    Errors come in three classes: independent per pulse (photon), independent per pixel but the
    same in every recording (pixel), and shared by all (columns of `shared_modes_ps`).
    """

    row: NDArray[np.int32]
    """(n,), pixel row."""

    col: NDArray[np.int32]
    """(n,), pixel column."""

    arrival_ps: NDArray[np.float64]
    """(n,), arrival time at the camera, ps on the clock (delay minus the pixel's skew), known up
    to whole laser periods. In codes where the width of a code is unknown. NaN without a pulse."""

    photon_std_ps: NDArray[np.float64]
    """(n,), standard error from the photons of this recording, ps."""

    pixel_std_ps: NDArray[np.float64]
    """(n,), standard error of the pixel's calibration, ps."""

    shared_modes_ps: NDArray[np.float64]
    """(n, k), one sigma of each error that all pixels share, ps."""

    shared_names: tuple[str, ...]
    """(k), what each shared error is."""

    std_ps: NDArray[np.float64]
    """(n,), standard deviation of the pulse as recorded, ps."""

    std_error_ps: NDArray[np.float64]
    """(n,), standard error of `std_ps`, ps."""

    photons: NDArray[np.float64]
    """(n,), photons in the pulse, counts."""

    photons_std: NDArray[np.float64]
    """(n,), standard error of `photons`, counts."""

    background_per_ps: NDArray[np.float64]
    """(n,), constant background of the pixel, counts per ps."""

    chi2: NDArray[np.float64]
    """(n,), Pearson chi2 of the pixel's fit."""

    dof: NDArray[np.int64]
    """(n,), its degrees of freedom."""

    flags: NDArray[np.uint32]
    """(n,), what is wrong (`lightflight.flags`): the pulse's and the calibration's."""

    pulse_index: NDArray[np.int32]
    """(n,), 0 for the earliest pulse of its pixel, then 1, 2 ..."""

    shape: tuple[int, int]
    """(rows, cols) of the camera."""

    laser_period_ps: float | None
    """Period of the laser, ps."""

    method: str
    """How the pulses were fitted."""

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from lightflight.display import html_from_record

        return html_from_record(self)

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(n,), True where no flag keeps the pulse out of a reconstruction."""
        return fl.is_usable(self.flags)

    @property
    def independent_std_ps(self) -> NDArray[np.float64]:
        """(n,), photon and pixel errors together: what does not move with other pixels, ps."""
        return np.hypot(self.photon_std_ps, self.pixel_std_ps)

    def image(self, name: str) -> NDArray[Any]:
        """One column as a picture (rows, cols), of the strongest pulse of each pixel.

        See `Pulses.image`.
        """
        return image_of_strongest(self, name)


def arrivals_from_pulses(pulses: Pulses, *, timing: TimingCalibration | None) -> Arrivals:
    """Arrival times from fitted pulses: t_a = delay - skew of the pixel, and its errors.

    Parameters
    ----------
    pulses
        From `fit_pulses` with the same `timing`.
    timing
        The clock; None: no skews, and no errors but those of the photons.

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
    timing: TimingCalibration | None = None,
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
    """
    pulses = fit_pulses(
        hist, timing=timing, method=method, max_pulses=max_pulses, background=background,
        response=response, exclude_mask=exclude_mask, threads=threads,
    )  # fmt: skip
    return arrivals_from_pulses(pulses, timing=timing)
