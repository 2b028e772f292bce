"""Fit all pixels: by the kernel, in tiles, on threads, then again where that or one pulse fails.

Pixels are independent, so neither tiles nor threads change a result. Everything here is in the
unit of the code intervals (ps, or codes).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightflight import flags as fl
from lightflight._kernels import pulse as kernel
from lightflight.news import listener
from lightflight.recording.histograms import Histograms, nominal_intervals
from lightflight.timing.pulses import split as splitting
from lightflight.timing.pulses.batch import Fit, Model, fit
from lightflight.timing.pulses.bins import Bins, bins_of
from lightflight.timing.pulses.pile_up import PileUp, pile_up_of

if TYPE_CHECKING:
    from lightflight.timing.clock.code_clock import CodeClock
    from lightflight.timing.clock.response import Response

Floats = NDArray[np.float64]

FALSE_PULSES = 1e-4
"""Share of pixels in which background alone passes the scan, at most (the scan's own bound is 7
times that; tests/recover/test_pulse_recovery.py counts)."""

LOG_FALSE_SECOND = math.log(1e3)
"""Threshold of a further pulse: one in 1,000 pixels that hold a single one."""

TILE_CODES = 1 << 20
"""Pixels times codes in work at once, per thread: some 20 MB."""

SAMPLE = 4096
"""Rows that suffice to find what is typical: a median of as many is known to 2 % of the spread."""

MIN_PIXELS = 8
"""Fewer good pulses than this say nothing about the array's typical width."""

MAX_SPREAD = 0.2
"""Relative spread (robust standard deviation) of widths beyond which none is typical."""

BRIGHT = 0.5
"""Of the photons of the brightest pulses (the `MIN_PIXELS`-th): more is bright."""

BATCH_CODES = 1 << 18
"""... and where NumPy works on them, which makes some twenty arrays of them."""

_ORDER = [0, 2, 1, 3]
"""Place in the theta of `_pulse_batch` (centre, photons, std ...) of each value of the table."""


@dataclass(frozen=True)
class Clock:
    """Where the codes of each pixel lie: shared intervals, or those of a calibration.

    Attributes
    ----------
    period : float
        Period of the ring, inf where nothing folds.
    """

    timing: CodeClock | None
    lower: Floats
    upper: Floats
    period: float

    def intervals(self, rows: NDArray[np.int64], cols: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """(lower, upper), each (n or 1, codes)."""
        if self.timing is None:
            return self.lower, self.upper
        lower, upper = self.timing.code_intervals_ps(rows, cols)
        return (
            np.ascontiguousarray(lower, dtype=np.float64),
            np.ascontiguousarray(upper, dtype=np.float64),
        )

    def double_code(self, n_pixels: int) -> Floats:
        """(pixels,), how many codes' worth of light a clock like this may misplace in a window.

        A nominal clock does not know of the first live code, which holds 1.8 codes of time.
        """
        if self.timing is None:
            return np.ones(n_pixels)
        unknown = (self.timing.flags.ravel() & fl.UNCALIBRATED) != 0
        nominal = bool(np.all(self.timing.phases == 1.0))
        return np.where(unknown | nominal, 1.0, 0.1)


def clock_of(hist: Histograms, timing: CodeClock | None) -> Clock:
    """The clock to fit on: the calibration's, else the nominal codes, else codes as the unit."""
    none = np.empty((0, 0))
    if timing is not None:
        timing.check_matches(hist)
        return Clock(timing, none, none, timing.laser_period_ps or math.inf)
    lower, upper, unit = nominal_intervals(hist)
    period = (hist.laser_period_ps if unit == "ps" else None) or math.inf
    return Clock(None, lower[None, :].copy(), upper[None, :].copy(), period)


@dataclass(frozen=True)
class Fits:
    """Fitted pulses, one row per pulse and at least one per pixel, and a table of the pixels.

    Attributes
    ----------
    pixel : array of int
        (n,), flat index, ascending; within a pixel in the order of the recorded sweep.
    values : array of float
        (n, 4), centre, std, photons, background per unit of time.
    covariance : array of float
        (n, 4, 4), in that order.
    table : array of float
        (pixels, N_COLUMNS), see `pulse_tile.fit_tile`.
    typical_std : float
        Typical std of the array's pulses; NaN where there are too few or no typical one.
    """

    pixel: NDArray[np.int64]

    values: Floats

    covariance: Floats

    table: Floats

    typical_std: float

    def column(self, name: int) -> Floats:
        """(n,), a column of the table for every row."""
        values: Floats = self.table[:, name]
        return values if self.one_per_pixel else values[self.pixel]

    def std_of(self, value: int) -> Floats:
        """(n,), standard error of one of the four values; NaN where it has none."""
        with np.errstate(invalid="ignore"):
            return np.asarray(np.sqrt(self.covariance[:, value, value]))

    @property
    def one_per_pixel(self) -> bool:
        """Whether row i is pixel i."""
        return len(self.pixel) == len(self.table)


def zero_for_nan(values: Floats) -> Floats:
    """The values, 0 where they have no meaning (a third of the time of `np.nan_to_num`)."""
    return np.where(np.isnan(values), 0.0, values)


def even_sample(n_rows: int) -> slice:
    """Every row, or of very many an even sample of SAMPLE or a few more."""
    return slice(None, None, max(1, n_rows // SAMPLE))


def exposure_ratio(background: Histograms, hist: Histograms) -> float:
    """Exposure of a background recording over the recording's: frames over frames.

    Raises ValueError where they cannot be compared.
    """
    if background.counts.shape != hist.counts.shape:
        raise ValueError(
            f"the background recording has shape {background.counts.shape}, the recording "
            f"{hist.counts.shape}: record both with the same camera settings"
        )
    if not (hist.poisson and background.poisson):
        raise ValueError("a background recording needs photon counts, not scaled intensities")
    there, here = background.bin_width_ps, hist.bin_width_ps
    if there is not None and here is not None and not math.isclose(there, here):
        raise ValueError(
            f"the background recording has codes of {there:g} ps, the recording {here:g}: record "
            "both with the same camera settings"
        )
    if background.n_frames is None or hist.n_frames is None:
        raise ValueError(
            "the background recording cannot be scaled: give n_frames of both recordings"
        )
    return background.n_frames / hist.n_frames


def scannable(counts: NDArray[np.generic]) -> NDArray[np.generic]:
    """Counts (pixels, codes) as uint32, which scans fastest, or float64 where that cannot hold.

    `fit_tile` notices sums that uint32 cannot hold. Read-only, as histograms are: every other
    kind of array would cost the compilation of a second kernel.
    """
    kind, size = counts.dtype.kind, counts.dtype.itemsize
    whole = kind != "f" and (size <= 4 or int(counts.max(initial=0)) < 2**32)
    counts = np.ascontiguousarray(counts, dtype=np.uint32 if whole else np.float64)
    counts.setflags(write=False)
    return counts


class _Job:
    """One recording on one clock: what every tile needs."""

    def __init__(
        self,
        hist: Histograms,
        clock: Clock,
        background: Histograms | None,
        pile_up: PileUp,
        threads: int,
        by_chance: float = FALSE_PULSES,
    ) -> None:
        self.clock, self.threads = clock, threads
        self.log_alarms = math.log(1.0 / by_chance) - 2.0
        self.trials = pile_up.trials
        self.dark_counts, self.dark_ratio = np.zeros((2, hist.shape[0] * hist.shape[1]))
        if background is not None:
            self.dark_counts = background.photons.astype(np.float64).ravel()
            # A count of either recording stands for as many photons as its pile-up says.
            ratio = exposure_ratio(background, hist)
            self.dark_ratio = ratio * pile_up.scale / pile_up_of(background).scale
        self.n_codes = hist.n_codes
        self.counts = hist.counts.reshape(-1, hist.n_codes)
        self.n_cols = hist.shape[1]
        self.double_code = clock.double_code(len(self.counts))

    def intervals(self, pixels: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Code intervals of pixels, see `Clock.intervals`."""
        rows = pixels // self.n_cols
        return self.clock.intervals(rows, pixels - rows * self.n_cols)

    def run(
        self,
        work: Callable[..., None],
        pixels: NDArray[np.int64] | None = None,
        most_codes: int | None = None,
    ) -> None:
        """Call work(slice, counts, lower, upper) for every tile of all (or the given) pixels."""
        n_pixels = len(self.counts) if pixels is None else len(pixels)
        step = max(1, (most_codes or TILE_CODES) // self.n_codes)

        def one(first: int) -> None:
            part = slice(first, min(first + step, n_pixels))
            tile = np.arange(part.start, part.stop) if pixels is None else pixels[part]
            counts = self.counts[part if pixels is None else tile]
            work(part, counts, *self.intervals(tile))

        starts, tell = range(0, n_pixels, step), listener()
        with ExitStack() as stack:
            each: Iterator[None] = map(one, starts)
            if self.threads > 1:
                each = stack.enter_context(ThreadPoolExecutor(self.threads)).map(one, starts)
            for first, _ in zip(starts, each, strict=True):
                tell(min(first + step, n_pixels), n_pixels)

    def bins(
        self,
        pixels: NDArray[np.int64],
        counts: NDArray[np.generic],
        lower: Floats,
        upper: Floats,
        exposure: Floats,
    ) -> Bins:
        """Bins of some pixels; exposure: of the pixels of the recording."""
        dark_exposure = self.dark_ratio[pixels] * exposure[pixels]
        dark = np.stack([self.dark_counts[pixels], dark_exposure], axis=1)
        return bins_of(counts, lower, upper, self.clock.period, self.trials[pixels], dark)


def fit_all(
    hist: Histograms,
    clock: Clock,
    todo: NDArray[np.bool_],
    *,
    method: str,
    max_pulses: int,
    background: Histograms | None,
    pile_up: PileUp,
    response: Response | None,
    threads: int,
    by_chance: float = FALSE_PULSES,
) -> Fits:
    """Every pixel's pulses: one each, then more where one does not explain the counts."""
    job = _Job(hist, clock, background, pile_up, threads, by_chance)
    model = Model(
        poisson=method == "likelihood" and hist.poisson,
        sampled=method == "least_squares" and hist.poisson,
        counted=hist.poisson,
        shape=np.empty((3, 0)) if response is None else response.table(),
    )
    values, covariance, table = _fit_singles(job, todo.ravel(), model)
    single = _rows(np.arange(todo.size), values, covariance, table)
    if max_pulses == 1 or not model.poisson:
        return single
    return _with_more_pulses(single, job, max_pulses, model)


def _fit_singles(
    job: _Job, wanted: NDArray[np.bool_], model: Model
) -> tuple[Floats, Floats, Floats]:
    """One pulse per pixel: values (n, 4), covariance (n, 4, 4) and table of `fit_tile`.

    Their columns are together in memory: from here on columns are looked at, not rows.
    """
    pixels, starts, results = _looked_through(job, wanted, model)

    def fit_left(part: slice, counts: NDArray[np.generic], lower: Floats, upper: Floats) -> None:
        some = pixels[part]
        bins = job.bins(some, counts, lower, upper, results[2][kernel.EXPOSURE])
        found = fit(bins, starts[some], model)
        _write_singles(found, some, results)
        if model.poisson:
            search = splitting.Search(bins, model, math.nan, 0.0, job.double_code[some])
            residual = splitting.residual_far_from_pulses(search, found.theta)
            results[2][kernel.RESIDUAL, some] = residual

    job.run(fit_left, pixels, BATCH_CODES)
    n = len(wanted)
    values, covariance, table = results
    return values[:, :n].T, covariance[..., :n].T, table[:, :n].T


def _looked_through(
    job: _Job, wanted: NDArray[np.bool_], model: Model
) -> tuple[NDArray[np.int64], Floats, tuple[Floats, Floats, Floats]]:
    """Pixels whose pulse was found and not fitted, where to start (n, 4), results of the others."""
    results = _room_for_results(len(wanted))
    starts, left = np.empty((len(wanted), 4)), np.zeros(len(wanted), dtype=bool)
    fits = model.poisson and model.shape.shape[1] == 0

    def find(part: slice, counts: NDArray[np.generic], lower: Floats, upper: Floats) -> None:
        rest = np.empty(len(counts), dtype=np.int64)
        search = (
            lower, upper, job.clock.period, wanted[part], job.double_code[part], job.trials[part],
            job.dark_counts[part], job.dark_ratio[part], job.log_alarms, model.counted, fits,
            int(part.start), starts, rest, *results,
        )  # fmt: skip
        counts = scannable(counts)
        n_left = kernel.fit_tile(counts, *search, *kernel.room_for(counts))
        if n_left < 0:
            counts = scannable(counts.astype(np.float64))
            n_left = kernel.fit_tile(counts, *search, *kernel.room_for(counts))
        left[rest[:n_left]] = True

    job.run(find)
    return np.flatnonzero(left), starts[:, _ORDER], results


class Misfit(NamedTuple):
    """How far fits of some pixels are from their counts; by batches of pixels, in order.

    Attributes
    ----------
    pixels : array of int, shape (m,)
        Those that show a pulse, all batches together: row times columns and column.
    chi2s : tuple of array of float, shape (n,)
        Pearson's, over the bins that expect enough: these may be others for another shape.
    deviances : tuple of array of float, shape (n,)
        Twice what the log-likelihood lacks, up to a constant.
    """

    pixels: NDArray[np.int64]
    chi2s: tuple[Floats, ...]
    deviances: tuple[Floats, ...]

    @property
    def chi2(self) -> float:
        """Of all pixels."""
        return sum(float(np.nansum(one)) for one in self.chi2s)

    @property
    def deviance(self) -> float:
        """Of all pixels."""
        return sum(float(np.nansum(one)) for one in self.deviances)


def misfit_of_shapes(
    hist: Histograms, timing: CodeClock | None, todo: NDArray[np.bool_]
) -> Callable[[Response], Misfit]:
    """Function that tells how well one pulse of a shape fits in each of some pixels, in all.

    As many calls of `fit_pulses` would, but pulses are looked for, and codes laid out, once; each
    shape is begun with where pulses stood for the last.

    Parameters
    ----------
    hist : Histograms
        Counts per pixel and code.
    timing : CodeClock or None
        Calibrated clock; None: nominal codes.
    todo : array of bool, shape (rows, cols)
        True where a pixel takes part.

    Returns
    -------
    callable
        Of a `Response`.
    """
    job = _Job(hist, clock_of(hist, timing), None, pile_up_of(hist), threads=1)

    def model_of(shape: Floats) -> Model:
        return Model(hist.poisson, sampled=False, counted=hist.poisson, shape=shape)

    # Any shape but the Gaussian: the kernel then finds pulses and fits none.
    pixels, starts, results = _looked_through(job, todo.ravel(), model_of(np.empty((3, 2))))
    parts: list[tuple[Bins, Floats]] = []

    def lay_out(part: slice, counts: NDArray[np.generic], lower: Floats, upper: Floats) -> None:
        some = pixels[part]
        bins = job.bins(some, counts, lower, upper, results[2][kernel.EXPOSURE])
        parts.append((bins, starts[some]))

    job.run(lay_out, pixels, BATCH_CODES)

    def misfit(response: Response) -> Misfit:
        model = model_of(response.table())
        fits = [fit(bins, start, model) for bins, start in parts]
        for k, ((bins, start), one) in enumerate(zip(parts, fits, strict=True)):
            # The next shape asked about is much like this one.
            parts[k] = bins, np.where(one.converged[:, np.newaxis], one.theta, start)
        return Misfit(
            pixels,
            tuple(one.chi2 for one in fits),
            tuple(-2.0 * one.objective for one in fits),
        )

    return misfit


def _write_singles(
    found: Fit, pixels: NDArray[np.int64], results: tuple[Floats, Floats, Floats]
) -> None:
    """Fits of one pulse into the columns of their pixels."""
    values, covariance, table = results
    values[:, pixels] = found.theta[:, _ORDER].T
    covariance[..., pixels] = found.covariance[:, _ORDER][:, :, _ORDER].T
    _write_table(found, table, pixels)
    table[kernel.RESIDUAL, pixels] = 0.0


def _write_table(found: Fit, table: Floats, pixels: NDArray[np.int64]) -> None:
    """How fits went into the columns of a table (N_COLUMNS, pixels)."""
    table[kernel.N_PULSES, pixels] = found.theta.shape[1] // 2 - 1
    table[kernel.CONVERGED, pixels] = found.converged
    table[kernel.STEPS_TAKEN, pixels] = found.steps
    table[kernel.CHI2, pixels], table[kernel.CHI2_BINS, pixels] = found.chi2, found.chi2_bins
    table[kernel.CHI2_DEVIATE, pixels] = found.deviate
    table[kernel.HELD_SHARE, pixels] = found.held
    table[kernel.STD_FREE, pixels] = found.std_free


def _room_for_results(n_pixels: int) -> tuple[Floats, Floats, Floats]:
    """Values (4, m), covariance (4, 4, m) and table (N_COLUMNS, m), for m >= n_pixels.

    Rows are an odd number of cache lines of 8 apart: a fit writes to one column of all, which
    must not compete for the same lines of the cache. The table is for itself: it is not kept.
    """
    apart = 8 * (-(-n_pixels // 8) | 1)
    kept, table = np.empty((20, apart)), np.empty((kernel.N_COLUMNS, apart))
    return kept[:4], kept[4:].reshape(4, 4, apart), table


def _rows(pixel: NDArray[np.int64], values: Floats, covariance: Floats, table: Floats) -> Fits:
    fits = Fits(pixel, values, covariance, table, math.nan)
    return replace(fits, typical_std=typical_std_of(fits))


def typical_std_of(fits: Fits) -> float:
    """Typical std of the array's pulses: what all of them share, or the brightest, if narrower.

    Light is widened on its way (fog, haze), never narrowed: of many pixels with scattered light
    and a few that see the beam, these few tell what the camera's pulses are. NaN where neither
    share a width. Of very many rows an even sample serves.
    """
    some = even_sample(len(fits.pixel))
    std, photons = fits.values[some, 1], fits.values[some, 2]
    with np.errstate(invalid="ignore"):
        std_error, photons_error = (np.sqrt(fits.covariance[some, i, i]) for i in (1, 2))
        good = (
            (fits.column(kernel.CONVERGED)[some] == 1)
            & (fits.column(kernel.HELD_SHARE)[some] > 0.9)
            & (std_error < 0.5 * std)
            & (photons > 3.0 * photons_error)
        )
    if np.count_nonzero(good) < MIN_PIXELS:
        return math.nan
    std, photons = std[good], photons[good]
    # Few hot pixels must not say what is bright.
    bright = photons > BRIGHT * np.partition(photons, -MIN_PIXELS)[-MIN_PIXELS]
    return float(np.fmin(_shared_std(std, photons), _shared_std(std[bright], photons[bright])))


def _shared_std(std: Floats, photons: Floats) -> float:
    """Median of widths (n,), weighted by photons; NaN where they scatter too much.

    No pixel weighs more than ten median ones.
    """
    width, weight = np.log(std), np.minimum(photons, 10.0 * np.median(photons))
    middle = _weighted_median(width, weight)
    spread = 1.4826 * _weighted_median(np.abs(width - middle), weight)
    return math.exp(middle) if spread < MAX_SPREAD else math.nan


def widen_delays(values: Floats, covariance: Floats) -> None:
    """Give covariances (n, 4, 4), in place, the errors of delays as few photons make them.

    The information at the fit takes its own width and photons for true: the variance of a delay,
    s^(2 + f) / A^(1 + f) times a constant (f: share of background under the pulse), then scatters
    by v, the variance of its logarithm. Where it comes out small the fit is no better than
    elsewhere, and the fit itself stays behind the bound by as much: the delay's variance is
    1 + v times that of the information (measured: benchmarks/accuracy_pulses.py).
    """
    std, photons, background = values[:, 1], values[:, 2], values[:, 3]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = 3.0 * std * np.maximum(background, 0.0)
        share = share / (share + photons)
        by_std, by_photons = (2.0 + share) / std, (1.0 + share) / photons
        scatter = by_std * (by_std * covariance[:, 1, 1] - 2.0 * by_photons * covariance[:, 1, 2])
        scatter += by_photons * by_photons * covariance[:, 2, 2]
    wider = np.sqrt(1.0 + np.where(scatter > 0.0, np.minimum(scatter, 1.0), 0.0))
    covariance[:, 0, :] *= wider[:, np.newaxis]
    covariance[:, :, 0] *= wider[:, np.newaxis]


def _weighted_median(values: Floats, weights: Floats) -> float:
    order = np.argsort(values)
    half = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(half, 0.5 * half[-1])]])


def pixels_to_split(fits: Fits) -> NDArray[np.int64]:
    """Pixels whose single pulse does not explain the counts, or is wider than the array's."""
    table, values = fits.table, fits.values
    with np.errstate(invalid="ignore", divide="ignore"):
        found = table[:, kernel.N_PULSES] == 1
        elsewhere = table[:, kernel.RESIDUAL] > LOG_FALSE_SECOND + splitting.DOUBTFUL
        widened = splitting.WIDER * fits.typical_std
        wide = values[:, 1] - 2.0 * fits.std_of(1) > widened
        deviate = table[:, kernel.CHI2_DEVIATE]
        misfit = (table[:, kernel.CHI2] - table[:, kernel.CHI2_BINS]) / values[:, 2]
        misshapen = (deviate > splitting.UNLIKELY) & (misfit > splitting.MISFIT)
        failed = table[:, kernel.CONVERGED] == 0
    return np.flatnonzero(found & (elsewhere | wide | misshapen | failed))


def _with_more_pulses(single: Fits, job: _Job, max_pulses: int, model: Model) -> Fits:
    """Fits with the pixels of `pixels_to_split` fitted by as many pulses as they need."""
    pixels = pixels_to_split(single)
    # One entry per pixel, as long as its pulses are many: room for the most costs their square.
    last: dict[int, tuple[Floats, Floats]] = {}
    table = single.table[pixels].T

    def split(part: slice, counts: NDArray[np.generic], lower: Floats, upper: Floats) -> None:
        some = pixels[part]
        bins = job.bins(some, counts, lower, upper, single.table[:, kernel.EXPOSURE])
        search = splitting.Search(
            bins, model, single.typical_std, LOG_FALSE_SECOND, job.double_code[some]
        )
        for at, found in splitting.split_pulses(search, single.values[some][:, _ORDER], max_pulses):
            rows = part.start + at
            last.update(
                (row, (theta, covariance))
                for row, theta, covariance in zip(
                    rows.tolist(), found.theta, found.covariance, strict=True
                )
            )
            _write_table(found, table, rows)

    job.run(split, pixels, BATCH_CODES)
    several = table[kernel.N_PULSES] > 1
    if not several.any():
        return single
    fitted = [last[row] for row in np.flatnonzero(several).tolist()]
    pixels = pixels[several]
    whole = single.table.copy(order="K")
    whole[pixels] = table[:, several].T
    kept = ~np.isin(single.pixel, pixels)
    parts = [(single.pixel[kept], single.values[kept], single.covariance[kept])]
    parts += _several_rows(pixels, fitted, job)
    pixel, values, covariance = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    order = np.argsort(pixel, kind="stable")
    return _rows(pixel[order], values[order], covariance[order], whole)


def _several_rows(
    pixels: NDArray[np.int64], fitted: list[tuple[Floats, Floats]], job: _Job
) -> list[tuple[NDArray[np.int64], Floats, Floats]]:
    """Rows of pixels with several pulses, each in the order of its sweep."""
    start = np.full(len(pixels), -math.inf)
    if math.isfinite(job.clock.period):
        for first in range(0, len(pixels), 1024):
            tile = pixels[first : first + 1024]
            lower, _ = job.intervals(tile)
            start[first : first + 1024] = np.nanmin(lower, axis=1)
    parts = []
    for i, (pixel, (theta, covariance)) in enumerate(zip(pixels, fitted, strict=True)):
        j = len(theta) // 2 - 1
        centre = theta[:j].copy()
        if math.isfinite(job.clock.period):
            centre = start[i] + np.mod(centre - start[i], job.clock.period)
        order = np.argsort(centre, kind="stable")
        columns = np.stack([order, np.full(j, 2 * j), j + order, np.full(j, 2 * j + 1)], axis=1)
        values = theta[columns]
        values[:, 0] = centre[order]
        own = covariance[columns[:, :, None], columns[:, None, :]]
        parts.append((np.full(j, pixel), values, own))
    return parts
