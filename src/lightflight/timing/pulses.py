"""Pulses: where the light pulse stands in the histogram of each pixel, with errors and reasons.

Takes `Histograms` and the calibrated clock's code intervals, gives a flat table `Pulses` that
`timing.arrivals` puts on the clock. The model of a pixel is a Gaussian pulse integrated over the
true interval of each code plus a constant background per ps, modulo the laser period; it is fitted
by Poisson maximum likelihood (kernels in `_kernels.pulse`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags as fl
from lightflight._kernels import pulse as kernel
from lightflight.errors import NothingFoundError
from lightflight.histogram import Histograms

if TYPE_CHECKING:
    from lightflight.timing.calibration import TimingCalibration

METHODS = ("likelihood", "least_squares")
FALSE_PULSES = 1e-4
"""Chance that a pixel without light shows a pulse."""

TILE_CODES = 1 << 19
"""Pixels times codes in work at once, per thread: some 20 MB."""

POOR_FIT_STD = 5.0
"""Excess of chi2, in its own standard deviations, from which a fit is called poor."""

WIDTH_FACTOR = 1.6
"""A pulse this much wider or narrower than the array's typical one is not the array's pulse."""

HELD_SHARE = 0.9
"""Least share of a pulse that live codes must cover."""


@dataclass(frozen=True, eq=False)
class Pulses:
    """Fitted pulses, one row per pulse; a pixel without one has one row of NaN and the reason."""

    row: NDArray[np.int32]
    """(n,), pixel row."""

    col: NDArray[np.int32]
    """(n,), pixel column."""

    delay_ps: NDArray[np.float64]
    """(n,), centre of the pulse after the laser sync, before the pixel's own delay is taken off,
    ps; in [0, P) where there is a laser period. In codes where the width of a code is unknown."""

    std_ps: NDArray[np.float64]
    """(n,), standard deviation of the pulse as recorded (laser, response and transit), ps."""

    photons: NDArray[np.float64]
    """(n,), photons in the pulse, counts; those that fell into dead codes included."""

    background_per_ps: NDArray[np.float64]
    """(n,), constant background of the pixel, counts per ps."""

    covariance: NDArray[np.float64]
    """(n, 4, 4), of delay_ps, std_ps, photons, background_per_ps (photon errors only)."""

    chi2: NDArray[np.float64]
    """(n,), Pearson chi2 of the pixel over codes with expected counts."""

    dof: NDArray[np.int64]
    """(n,), degrees of freedom of `chi2`."""

    flags: NDArray[np.uint32]
    """(n,), what is wrong (`lightflight.flags`)."""

    pulse_index: NDArray[np.int32]
    """(n,), 0 for the earliest pulse of its pixel (in the recorded sweep), then 1, 2 ..."""

    shape: tuple[int, int]
    """(rows, cols) of the camera."""

    laser_period_ps: float | None
    """Period of the laser, ps."""

    method: str
    """How it was fitted: "likelihood" or "least_squares"."""

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(n,), True where no flag keeps the pulse out of a reconstruction."""
        return fl.is_usable(self.flags)

    def image(self, name: str) -> NDArray[Any]:
        """One column as a picture (rows, cols): of the strongest pulse of each pixel.

        `name` is a column ("delay_ps", "photons", "flags" ...), or "n_pulses". NaN (flags: 0)
        where a pixel has no row.
        """
        return image_of_strongest(self, name)


def image_of_strongest(table: Any, name: str) -> NDArray[Any]:
    """Column `name` of a pulse table as (rows, cols), of the strongest pulse of each pixel."""
    pixel = table.row.astype(np.int64) * table.shape[1] + table.col
    size = table.shape[0] * table.shape[1]
    if name == "n_pulses":
        return np.bincount(pixel[np.isfinite(table.photons)], minlength=size).reshape(table.shape)
    column = getattr(table, name, None)
    if not isinstance(column, np.ndarray) or column.shape != pixel.shape:
        raise ValueError(f"there is no column {name!r} to draw: use one of the table's columns")
    weakest_first = np.argsort(np.nan_to_num(table.photons, nan=-np.inf), kind="stable")
    if column.dtype.kind == "f":
        image = np.full(size, np.nan)
    else:
        image = np.zeros(size, dtype=column.dtype)
    image[pixel[weakest_first]] = column[weakest_first]
    return image.reshape(table.shape)


@dataclass(frozen=True)
class _Clock:
    """Where the codes of each pixel lie: shared intervals, or those of a calibration."""

    timing: TimingCalibration | None
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    period: float

    def intervals(
        self, rows: NDArray[Any], cols: NDArray[Any]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(lower, upper), each (n or 1, codes), in the unit of the table."""
        if self.timing is None:
            return self.lower, self.upper
        lower, upper = self.timing.code_intervals_ps(rows, cols)
        return (
            np.ascontiguousarray(lower, dtype=np.float64),
            np.ascontiguousarray(upper, dtype=np.float64),
        )


def clock_of(hist: Histograms, timing: TimingCalibration | None) -> _Clock:
    """The clock to fit on: the calibration's, else the nominal codes, else codes as the unit."""
    none = np.empty((0, 0))
    if timing is not None:
        timing.check_matches(hist)
        return _Clock(timing, none, none, timing.laser_period_ps or math.inf)
    if hist.bin_width_ps is not None:
        lower, upper = hist.code_intervals_ps()
        period = hist.laser_period_ps or math.inf
    else:
        code = np.arange(hist.n_codes, dtype=np.float64)
        lower, upper = (-code - 1.0, -code) if hist.reversed_codes else (code, code + 1.0)
        upper = np.where(hist.photon_codes, upper, lower)
        period = math.inf
    return _Clock(None, lower[None, :].copy(), upper[None, :].copy(), period)


def fit_pulses(
    hist: Histograms,
    *,
    timing: TimingCalibration | None = None,
    method: str = "likelihood",
    max_pulses: int = 3,
    background: Histograms | None = None,
    response: Any = None,
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
        A recording without pulses; not supported yet.
    response
        Response shape other than a Gaussian; not supported yet.
    exclude_mask
        (rows, cols), True where a pixel is not to be used.
    threads
        Threads to share the pixels among; results do not depend on it.

    Raises
    ------
    NothingFoundError
        No photons anywhere, or nothing but hot or saturated pixels.
    ValueError
        A wrong `method`, `max_pulses`, `threads`, or shape of `exclude_mask`.
    CalibrationError
        The calibration does not fit the recording.
    """
    _check_options(hist, method, max_pulses, background, response, threads)
    todo = _mask_to_fit(hist, exclude_mask)
    clock = clock_of(hist, timing)
    result = _fit_all(hist, clock, todo, method, threads)
    return _table(hist, timing, clock, todo, method, result)


def _check_options(
    hist: Histograms,
    method: str,
    max_pulses: int,
    background: Histograms | None,
    response: Any,
    threads: int,
) -> None:
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if max_pulses < 1:
        raise ValueError(f"max_pulses must be at least 1, got {max_pulses}")
    if threads < 1:
        raise ValueError(f"threads must be at least 1, got {threads}")
    if background is not None:
        raise NotImplementedError("fit_pulses cannot use a background recording yet")
    if response is not None:
        raise NotImplementedError("fit_pulses knows only Gaussian pulses yet: leave response out")
    if not hist.photons.any():
        raise NothingFoundError(
            "the recording holds no photons: every count is zero or in the no-photon code"
        )


def _mask_to_fit(hist: Histograms, exclude_mask: ArrayLike | None) -> NDArray[np.bool_]:
    if exclude_mask is None:
        return np.ones(hist.shape, dtype=bool)
    mask = np.asarray(exclude_mask)
    if mask.shape != hist.shape:
        raise ValueError(
            f"exclude_mask must have the shape of the camera, {hist.shape}, got {mask.shape}"
        )
    return ~mask.astype(bool)


@dataclass(frozen=True)
class _Fits:
    """Raw results of the kernel, one row per pixel in row-major order."""

    thetas: NDArray[np.float64]  # (n, 4) centre, photons, std, background
    covariances: NDArray[np.float64]  # (n, 4, 4) in that order
    table: NDArray[np.float64]  # (n, 12), see `kernel.fit_tile`


def _tiles(n_pixels: int, n_codes: int) -> Iterator[slice]:
    step = max(1, TILE_CODES // n_codes)
    for first in range(0, n_pixels, step):
        yield slice(first, min(first + step, n_pixels))


def _fit_all(
    hist: Histograms, clock: _Clock, todo: NDArray[np.bool_], method: str, threads: int
) -> _Fits:
    n_pixels = todo.size
    counts = hist.counts.reshape(n_pixels, hist.n_codes)
    rows, cols = np.divmod(np.arange(n_pixels), hist.shape[1])
    wanted = todo.ravel()
    double_code = np.full(n_pixels, 1.0 if clock.timing is None else 0.1)
    if clock.timing is not None:
        double_code[(clock.timing.flags.ravel() & fl.UNCALIBRATED) != 0] = 1.0
    likelihood = method == "likelihood" and hist.poisson
    model = (likelihood, method == "least_squares" and hist.poisson, hist.poisson)
    fits = _Fits(np.empty((n_pixels, 4)), np.empty((n_pixels, 4, 4)), np.empty((n_pixels, 12)))

    def fit(tile: slice) -> None:
        lower, upper = clock.intervals(rows[tile], cols[tile])
        kernel.fit_tile(
            counts[tile].astype(np.float64), lower, upper, clock.period, wanted[tile],
            double_code[tile], -math.log(FALSE_PULSES), model,
            fits.thetas[tile], fits.covariances[tile], fits.table[tile],
        )  # fmt: skip

    tiles = _tiles(n_pixels, hist.n_codes)
    if threads == 1:
        for tile in tiles:
            fit(tile)
    else:
        with ThreadPoolExecutor(threads) as pool:
            for _ in pool.map(fit, tiles):
                pass
    return fits


def _table(
    hist: Histograms,
    timing: TimingCalibration | None,
    clock: _Clock,
    todo: NDArray[np.bool_],
    method: str,
    fits: _Fits,
) -> Pulses:
    """Rows and flags from the kernel's results."""
    n_pixels = todo.size
    rows, cols = np.divmod(np.arange(n_pixels, dtype=np.int32), np.int32(hist.shape[1]))
    order = [0, 2, 1, 3]
    values = fits.thetas[:, order]
    covariance = fits.covariances[:, order][:, :, order]
    flags = _pixel_flags(hist, timing, todo.ravel(), values, covariance, fits.table)
    nothing = (flags & (fl.NO_PULSE | fl.TOO_FEW | fl.NO_PHOTONS | fl.MASKED)) != 0
    values[nothing, :3] = np.nan
    covariance[nothing] = np.nan
    delay = values[:, 0]
    if math.isfinite(clock.period):
        delay = np.mod(delay, clock.period)
        delay = np.where(delay >= clock.period, 0.0, delay)
    n_bins = np.nan_to_num(fits.table[:, 9])
    in_codes = hist.bin_width_ps is None and timing is None
    return Pulses(
        row=rows,
        col=cols,
        delay_ps=delay,
        std_ps=values[:, 1],
        photons=values[:, 2],
        background_per_ps=values[:, 3],
        covariance=covariance,
        chi2=fits.table[:, 8],
        dof=np.maximum(n_bins - 4, 0).astype(np.int64),
        flags=flags,
        pulse_index=np.zeros(n_pixels, dtype=np.int32),
        shape=hist.shape,
        laser_period_ps=None if in_codes else hist.laser_period_ps,
        method=method if hist.poisson else "least_squares",
    )


def _pixel_flags(
    hist: Histograms,
    timing: TimingCalibration | None,
    todo: NDArray[np.bool_],
    values: NDArray[np.float64],
    covariance: NDArray[np.float64],
    table: NDArray[np.float64],
) -> NDArray[np.uint32]:
    """What is wrong with each pixel and its pulse, (n,)."""
    flags = np.zeros(len(values), dtype=np.uint32)
    if timing is not None:
        flags |= timing.flags.ravel().astype(np.uint32)
    flags[~todo] |= fl.MASKED
    with np.errstate(invalid="ignore"):
        found = table[:, 3] > 0
        std_of = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        unsure = found & ~((values[:, 2] > 3.0 * std_of[:, 2]) & (std_of[:, 0] < values[:, 1]))
        counts = table[:, 0]
        flags[todo & (hist.photons.ravel() == 0)] |= fl.NO_PHOTONS
        flags[todo & ~found & (counts > 0) & (counts < 8)] |= fl.TOO_FEW
        flags[todo & ~found & ~(counts < 8)] |= fl.NO_PULSE
        flags[found & (table[:, 5] == 0)] |= fl.NOT_CONVERGED
        flags[found & ~np.isfinite(std_of).all(axis=1)] |= fl.NO_COVARIANCE
        flags[unsure & np.isfinite(std_of).all(axis=1)] |= fl.TOO_FEW
        flags[found & (table[:, 10] > POOR_FIT_STD)] |= fl.POOR_FIT
        flags[found & (table[:, 11] < HELD_SHARE)] |= fl.NEAR_GATE_EDGE
    return flags
