"""Pulses: where the light pulse stands in the histogram of each pixel, with errors and reasons.

Takes `Histograms` and the calibrated clock's code intervals, gives a flat table `Pulses` that
`timing.arrivals` puts on the clock. The model of a pixel is a Gaussian pulse integrated over the
true interval of each code plus a constant background per ps, modulo the laser period; it is fitted
by Poisson maximum likelihood (kernels in `_kernels.pulse`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags as fl
from lightflight._kernels.pulse import CHI2, CHI2_BINS, N_PULSES
from lightflight.arguments import check_kinds, mask_of_pixels, one_of, whole_number
from lightflight.display import Card
from lightflight.recording.histograms import Histograms
from lightflight.recording.stored import check_photons
from lightflight.timing.clock.code_clock import ClockWithoutCodes
from lightflight.timing.pulses.background import without_background_pulses
from lightflight.timing.pulses.checks import check_fits, flags_of, warn_of_cut_counts
from lightflight.timing.pulses.common_shape import common_shape, evenly_among, explained_better
from lightflight.timing.pulses.fits import (
    Clock,
    Fits,
    clock_of,
    fit_all,
    widen_delays,
    zero_for_nan,
)
from lightflight.timing.pulses.pile_up import HIGH_RATE, PileUp, pile_up_of
from lightflight.timing.pulses.pulse_table import PulseTable
from lightflight.timing.pulses.sync import check_sync

if TYPE_CHECKING:
    from lightflight.timing.clock.code_clock import CodeClock
    from lightflight.timing.clock.response import Response

_FEW_PULSES = 0.1
"""Share of usable pulses below which a missing sync is looked for."""
MOST_PULSES = 100
"""Of a pixel: in a laser period of 50 ns so many of 150 ps overlap, and no more can be told."""

METHODS = ("likelihood", "least_squares")


@dataclass(frozen=True, eq=False, repr=False)
class Pulses(PulseTable):
    """Fitted pulses, one row per pulse; a pixel without one has one row of NaN and the reason.

    Attributes
    ----------
    row : array of int
        (n,), pixel row.
    col : array of int
        (n,), pixel column.
    delay_ps : array of float
        (n,), centre of the pulse after the laser sync, before the pixel's own delay is taken off,
        ps; in [0, P) where there is a laser period. In codes where the width of a code is unknown.
    std_ps : array of float
        (n,), standard deviation of the pulse as recorded (laser, response and transit), ps.
    photons : array of float
        (n,), photons in the pulse, counts; those that fell into dead codes included.
    background_per_ps : array of float
        (n,), constant background of the pixel, counts per ps.
    covariance : array of float
        (n, 4, 4), of delay_ps, std_ps, photons, background_per_ps (photon errors only). Inverse
        information at the fit; delays of few photons are wider by what that misses of their errors.
    chi2 : array of float
        (n,), Pearson chi2 of the pixel over codes with expected counts.
    dof : array of int
        (n,), degrees of freedom of `chi2`.
    flags : array of uint32
        (n,), what is wrong (`lightflight.flags`).
    pulse_index : array of int
        (n,), 0 for the earliest pulse of its pixel (in the recorded sweep), then 1, 2 ...
    shape : (int, int)
        (rows, cols) of the camera.
    laser_period_ps : float or None
        Period of the laser, ps.
    method : str
        How it was fitted: "likelihood" or "least_squares".
    """

    row: NDArray[np.int32]

    col: NDArray[np.int32]

    delay_ps: NDArray[np.float64]

    std_ps: NDArray[np.float64]

    photons: NDArray[np.float64]

    background_per_ps: NDArray[np.float64]

    covariance: NDArray[np.float64]

    chi2: NDArray[np.float64]

    dof: NDArray[np.int64]

    flags: NDArray[np.uint32]

    pulse_index: NDArray[np.int32]

    shape: tuple[int, int]

    laser_period_ps: float | None

    method: str

    def _card(self) -> Card:
        return self.card_of("delay_ps", "delay", np.sqrt(self.covariance[:, 0, 0]))


def fit_pulses(
    hist: Histograms,
    *,
    timing: CodeClock | None = None,
    method: str = "likelihood",
    max_pulses: int = 3,
    background: Histograms | None = None,
    response: Response | ArrayLike | None = None,
    exclude_mask: ArrayLike | None = None,
    threads: int = 1,
) -> Pulses:
    """Pulse centre, width, photons and background of every pixel, with errors and reasons.

    Parameters
    ----------
    hist
        Counts per pixel and code.
    timing
        Calibrated clock; None: nominal codes (or codes as the unit of time, where the width of
        a code is unknown).
    method
        "likelihood": Poisson maximum likelihood, Gaussian integrated over each code.
        "least_squares": unweighted least squares of a Gaussian sampled at the codes' middles, as
        in the paper, with sandwich errors. Scaled intensities (`hist.poisson` False) are always
        fitted by least squares, of the integrated Gaussian.
    max_pulses
        Most pulses to look for in one pixel.
    background
        A recording of the same scene without the flight (laser blocked, or its beam). Its level
        joins the likelihood of each pixel with its own Poisson error, scaled by the frames of
        both; nothing is subtracted. Where it holds pulses itself (a leak, a reflection), codes
        that these reach take no part. Used by "likelihood" only.
    response
        Shape of the pulse: a `Response` (`lightflight.timing.clock.response`), or the counts of a
        measured one, (codes,), on the nominal codes; "clock": that of `timing`, where its flat was
        fitted with one, else a Gaussian. None: the same, and where no flat told anything (without
        `timing`, or by a nominal one) with the tail that all pulses have in common, if they explain
        the counts better by it (`common_shape`). `std_ps` is the standard deviation of the shape,
        stretched about its place to fit; `delay_ps` that place (the mean, unless the calibration
        found a better one, see `Response.anchored`).
    exclude_mask
        (rows, cols), True where a pixel is not to be used.
    threads
        Threads to share the pixels among; results do not depend on it.

    Where the recording says how many frames it holds and how many laser periods are in one, each
    frame is taken to show its first photon only: `photons` and `background_per_ps` are those that
    came, -log(1 - occupancy) per frame, and times are corrected for the late photons of a period
    that an early one hid (see `lightflight.timing.pulses.pile_up`).

    Raises
    ------
    NothingFoundError
        No photons anywhere, or nothing but hot or saturated pixels.
    ValueError
        A wrong `method`, `max_pulses`, `threads`, or shape of `exclude_mask`; a background
        recording of another shape, or with unknown frames; counts that something multiplied.
    CalibrationError
        The calibration does not fit the recording, or the camera ran without sync.

    Warns
    -----
    SuspectDataWarning
        Where the background holds pulses.
    """
    check_kinds("hist", hist=hist, timing=timing, background=background)
    _check_options(method, max_pulses, response, threads)
    todo = _mask_to_fit(hist, exclude_mask)
    # First: a comb has as many pulses as teeth, and to try them all takes minutes.
    if hist.poisson:
        check_sync(hist, everywhere=True)
        check_photons(hist)
    asked = _response_for(hist, timing, response)
    is_cut = isinstance(timing, ClockWithoutCodes)
    if background is not None and method == "likelihood" and hist.poisson and not is_cut:
        without = without_background_pulses(
            hist, background, timing, response=asked, threads=threads
        )
        if without is not None:
            hist, background, timing = without.emptied(hist), without.emptied(background), without

    def fitted(shape: Response | None, some: NDArray[np.bool_] | None = None) -> Pulses:
        own, checked = (todo, True) if some is None else (some, False)
        return _fitted(
            hist, timing, own, method, max_pulses, background, shape, threads, checked=checked
        )

    pulses = fitted(asked)
    told = response is not None or (timing is not None and timing.has_flat)
    if told or pulses.method != "likelihood":
        return pulses
    shape = common_shape(hist, timing, pulses)
    if shape is None:
        return pulses
    # A shape takes thirty times as long as a Gaussian: some pixels say whether it is worth it.
    some = evenly_among(pulses)
    return fitted(shape) if explained_better(fitted(shape, some), pulses, some) else pulses


def _fitted(
    hist: Histograms,
    timing: CodeClock | None,
    todo: NDArray[np.bool_],
    method: str,
    max_pulses: int,
    background: Histograms | None,
    response: Response | None,
    threads: int,
    *,
    checked: bool,
) -> Pulses:
    """Pulses of one shape, None: Gaussians; parameters and errors as in `fit_pulses`."""
    clock, pile_up = clock_of(hist, timing), pile_up_of(hist)
    fits = fit_all(
        hist, clock, todo, method=method, max_pulses=max_pulses, background=background,
        pile_up=pile_up, response=response, threads=threads,
    )  # fmt: skip
    flags = flags_of(fits, hist, todo, clock.period)
    flags[(pile_up.rate > HIGH_RATE)[fits.pixel]] |= fl.PILE_UP
    if timing is not None:
        flags |= timing.flags.ravel()[fits.pixel]
    if checked:
        if not fl.is_usable(flags).mean() > _FEW_PULSES:
            check_sync(hist)
        check_fits(fits, flags, clock.period)
        warn_of_cut_counts(fits, flags, hist)
    return _pulses_from_fits(fits, flags, hist, clock, pile_up, method)


def _check_options(
    method: str,
    max_pulses: int,
    response: Response | ArrayLike | None,
    threads: int,
) -> None:
    one_of("method", method, METHODS)
    if whole_number("max_pulses", max_pulses) < 1:
        raise ValueError(f"max_pulses must be at least 1, got {max_pulses}")
    if max_pulses > MOST_PULSES:
        raise ValueError(f"max_pulses must be at most {MOST_PULSES}, got {max_pulses}")
    if whole_number("threads", threads) < 1:
        raise ValueError(f"threads must be at least 1, got {threads}")
    if isinstance(response, str):
        one_of("response", response, ("clock",))
    elif response is not None and method == "least_squares":
        raise ValueError(
            "the least squares of the paper fit Gaussians: leave response out, or take "
            'method="likelihood"'
        )


def _response_for(
    hist: Histograms, timing: CodeClock | None, response: Response | ArrayLike | None
) -> Response | None:
    """Shape to fit: the one asked for, else the one of the flat; None: a Gaussian."""
    from lightflight.timing.clock.response import Response
    from lightflight.timing.pulses.measured_response import response_from_counts

    if response is None or isinstance(response, str):
        return None if timing is None else timing.response
    return response if isinstance(response, Response) else response_from_counts(response, hist)


def _mask_to_fit(hist: Histograms, exclude_mask: ArrayLike | None) -> NDArray[np.bool_]:
    if exclude_mask is None:
        return np.ones(hist.shape, dtype=bool)
    return ~mask_of_pixels("exclude_mask", exclude_mask, hist.shape)


def _pulses_from_fits(
    fits: Fits,
    flags: NDArray[np.uint32],
    hist: Histograms,
    clock: Clock,
    pile_up: PileUp,
    method: str,
) -> Pulses:
    """The table of pulses: photons that came, not only those counted; delays in one period."""
    rows = fits.pixel // hist.shape[1]
    cols = fits.pixel - rows * hist.shape[1]
    values, covariance = fits.values, fits.covariance
    if (pile_up.rate > 0).any():
        scale = np.ones((len(fits.pixel), 4))
        scale[:, 2:] = pile_up.scale[fits.pixel, None]
        values, covariance = values * scale, covariance * scale[:, :, None] * scale[:, None, :]
    if method == "likelihood" and hist.poisson:
        widen_delays(values, covariance)
    delay = values[:, 0]
    if math.isfinite(clock.period):
        delay = np.mod(delay, clock.period)
        # The modulus of a tiny negative delay rounds up to the period itself.
        delay = np.where(delay >= clock.period, 0.0, delay)
    number = np.zeros(len(fits.pixel), dtype=np.int32)
    if not fits.one_per_pixel:
        # Rows of a pixel stand together, the earliest pulse first: counted from its first row.
        number += np.arange(len(fits.pixel)) - np.searchsorted(fits.pixel, fits.pixel)
    dof = zero_for_nan(fits.column(CHI2_BINS) - (2 * fits.column(N_PULSES) + 2))
    return Pulses(
        row=rows.astype(np.int32),
        col=cols.astype(np.int32),
        delay_ps=delay,
        std_ps=values[:, 1],
        photons=values[:, 2],
        background_per_ps=values[:, 3],
        covariance=covariance,
        chi2=fits.column(CHI2).copy(),
        dof=np.maximum(dof, 0).astype(np.int64),
        flags=flags,
        pulse_index=number,
        shape=hist.shape,
        laser_period_ps=clock.period if math.isfinite(clock.period) else None,
        method=method if hist.poisson else "least_squares",
    )
