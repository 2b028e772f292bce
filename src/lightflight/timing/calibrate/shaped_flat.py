"""Delays from a flat whose pulse is no Gaussian: fluorescence, or any shape all pixels share.

The shape is the instrument's response convolved with an exponential decay (reconvolution), or,
with no response given, the array's own mean pulse, found by aligning all pixels in turn with
fitting them. Each pixel then has three unknowns, onset, photons and background, by Poisson
likelihood in its own code edges. Takes the same recordings as `delays`, gives `FlatDelays`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from lightflight import flags
from lightflight.errors import CalibrationError
from lightflight.recording.histograms import Histograms
from lightflight.timing.calibrate.delays import FlatDelays, checked_arrivals_ps, skews_near_median

if TYPE_CHECKING:
    from lightflight.timing.clock.calibration import TimingCalibration

Floats = NDArray[np.float64]

_BLOCK = 1024
_FEWEST_PHOTONS = 30
_ALIGNMENTS = 4
_STEPS = 30
_DECAY_SAMPLE = 200
"""Pixels that decide the decay time, which is common to all."""

_SHAPE_SAMPLE = 3000
"""Pixels, at most, whose mean is the array's own shape."""

_LEAST_GAIN = 15.0
"""Log-likelihood that a pulse must gain over even light; less (1e-6 by chance) is no pulse."""

_FOOT = 2e-3
"""Share of the peak below which the rising edge of the array's own shape is taken as nothing."""

_EARLY_CODES = 20.0
"""Codes before the onset that hold background alone."""


@dataclass(frozen=True, eq=False)
class PulseShape:
    """Cumulated shape of a pulse; time zero is its onset, half its height on the rising edge.

    Attributes
    ----------
    time_ps : array of float
        (m,), ascending and evenly spaced, ps.
    cumulated : array of float
        (m,), from 0 to 1.
    rate_per_ps : array of float
        (m,), slope of `cumulated`, 1/ps.
    """

    time_ps: Floats

    cumulated: Floats

    rate_per_ps: Floats

    def at(self, time_ps: Floats) -> tuple[Floats, Floats]:
        """Share that has come by a time after the onset, and share per ps then; same shape."""
        step = self.time_ps[1] - self.time_ps[0]
        place = (time_ps - self.time_ps[0]) / step
        place = np.clip(place, 0.0, len(self.time_ps) - 1.000001)
        low = place.astype(np.intp)
        part = place - low
        cumulated = self.cumulated[low]
        rate = self.rate_per_ps[low]
        return (
            cumulated + part * (self.cumulated[low + 1] - cumulated),
            rate + part * (self.rate_per_ps[low + 1] - rate),
        )


@dataclass(frozen=True, eq=False)
class ShapedFits:
    """Onset, photons and background of every pixel; NaN where there was nothing to fit.

    Attributes
    ----------
    onset_ps : array of float
        (n,), delay of the onset, ps.
    onset_std_ps : array of float
        (n,), its photon error, ps.
    photons : array of float
        (n,), photons of the pulse.
    likelihood : array of float
        (n,), log-likelihood, without the terms that only the counts decide.
    chi2 : array of float
        (n,), Pearson's chi-square.
    dof : int
        Degrees of freedom of `chi2`.
    converged : array of bool
        (n,), False where the last step was not small.
    """

    onset_ps: Floats

    onset_std_ps: Floats

    photons: Floats

    likelihood: Floats

    chi2: Floats

    dof: int

    converged: NDArray[np.bool_]


def shape_from_response(
    response: Floats, lower_ps: Floats, upper_ps: Floats, *, decay_ps: float
) -> PulseShape:
    """Response convolved with an exponential decay.

    Parameters
    ----------
    response : (codes,), counts of the response; a constant part is its background and left out.
    lower_ps, upper_ps : (codes,), time of each code, ps; codes of zero width are left out.
    decay_ps : time in which the light falls to 1/e, ps; 0: the response itself.
    """
    live = upper_ps > lower_ps
    order = np.argsort(lower_ps[live])
    edges = np.append(lower_ps[live][order], upper_ps[live].max())
    counts = np.asarray(response, dtype=np.float64)[live][order]
    counts = np.maximum(counts - np.median(counts[: max(1, int(np.argmax(counts)) // 2)]), 0.0)
    step = np.median(np.diff(edges)) / 8.0
    time = np.arange(edges[0], edges[-1] + 12.0 * decay_ps + step, step)
    cumulated = np.interp(time, edges, np.append(0.0, np.cumsum(counts)))
    rate = np.diff(cumulated, prepend=0.0)
    if decay_ps > 0:
        fall = np.exp(-step / decay_ps)
        # Exact for a response that is even within a step: a first-order recursive filter.
        rate = _recursive_filter(rate, fall)
    return _from_onset(time, np.cumsum(rate))


def _recursive_filter(rate: Floats, fall: float) -> Floats:
    """y[i] = fall y[i - 1] + (1 - fall) x[i]."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0 - fall], [1.0, -fall], rate))


def _from_onset(time_ps: Floats, cumulated: Floats) -> PulseShape:
    """A shape with total 1 whose time starts at half height of the rising edge."""
    cumulated = (cumulated - cumulated[0]) / (cumulated[-1] - cumulated[0])
    rate = np.gradient(cumulated)
    peak = int(np.argmax(rate))
    rise = np.flatnonzero(rate[: peak + 1] < 0.5 * rate[peak])
    i = int(rise[-1]) if len(rise) else 0
    step = time_ps[1] - time_ps[0]
    part = (0.5 * rate[peak] - rate[i]) / max(rate[min(i + 1, peak)] - rate[i], 1e-300)
    time_ps = time_ps - (time_ps[i] + np.clip(part, 0.0, 1.0) * step)
    rate = rate / step
    rate[[0, -1]] = 0.0
    return PulseShape(time_ps, cumulated, rate)


def fit_shape(
    counts: NDArray[np.generic], edges_ps: Floats, shape: PulseShape, start_ps: Floats
) -> ShapedFits:
    """Onset, photons and background of pixels by Poisson likelihood (damped Fisher scoring).

    mean[k] = photons (S(edge[k + 1] - onset) - S(edge[k] - onset)) + background width[k]

    Parameters
    ----------
    counts : (n, codes), in the order of time.
    edges_ps : (n, codes + 1), ascending.
    shape : of the pulse, see `PulseShape`.
    start_ps : (n,), onsets to start from.
    """
    observed = counts.astype(np.float64)
    total, span = observed.sum(axis=1), edges_ps[:, -1] - edges_ps[:, 0]
    theta = np.stack([start_ps, 0.95 * total + 1e-3, 0.05 * total / span], axis=1)
    state = _score(observed, edges_ps, shape, theta)
    limit = np.full(len(theta), 8.0 * float(np.median(span)) / observed.shape[1])
    converged = np.zeros(len(theta), dtype=bool)
    active = np.arange(len(theta))
    for _ in range(_STEPS):
        step = np.linalg.solve(state.fisher[active], state.gradient[active][..., None])[..., 0]
        step[:, 0] = np.clip(step[:, 0], -limit[active], limit[active])
        trial = theta[active] + step
        trial[:, 1:] = np.maximum(trial[:, 1:], 0.1 * theta[active, 1:])
        new = _score(observed[active], edges_ps[active], shape, trial)
        better = new.likelihood >= state.likelihood[active] - 1e-9 * np.abs(new.likelihood)
        moved = np.abs(trial[:, 0] - theta[active, 0])
        information = np.maximum(state.fisher[active, 0, 0], 1e-30)
        # Where the shape has a kink no step may help: a small step that does not is the end too.
        small = np.where(better, 0.01, 0.05) / np.sqrt(information)
        converged[active] = moved < small
        accepted = active[better]
        theta[accepted] = trial[better]
        for old, fresh in zip(state, new, strict=True):
            old[accepted] = fresh[better]
        limit[active] = np.where(better, limit[active], 0.3 * moved)
        active = active[~converged[active] & (limit[active] > 1e-6)]
        if not len(active):
            break
    std = np.sqrt(np.linalg.inv(state.fisher)[:, 0, 0])
    dof = observed.shape[1] - 3
    return ShapedFits(theta[:, 0], std, theta[:, 1], state.likelihood, state.chi2, dof, converged)


class _Score(NamedTuple):
    """Log-likelihood (n,), gradient (n, 3), Fisher's matrix (n, 3, 3), chi-square (n,)."""

    likelihood: Floats
    gradient: Floats
    fisher: Floats
    chi2: Floats


def _score(observed: Floats, edges: Floats, shape: PulseShape, theta: Floats) -> _Score:
    """Likelihood of onset, photons and background, and its derivatives."""
    photons, background = theta[:, 1, None], theta[:, 2, None]
    cumulated, rate = shape.at(edges - theta[:, 0, None])
    share, slope, width = np.diff(cumulated), np.diff(rate), np.diff(edges)
    mean = np.maximum(photons * share + background * width, 1e-12)
    derivatives = (-photons * slope, share, width)
    ratio = observed / mean
    gradient = np.stack([np.sum((ratio - 1.0) * d, axis=1) for d in derivatives], axis=1)
    fisher = np.empty((len(theta), 3, 3))
    for i in range(3):
        weighted = derivatives[i] / mean
        for j in range(i, 3):
            fisher[:, i, j] = fisher[:, j, i] = np.sum(weighted * derivatives[j], axis=1)
    # A background of no counts has no information of its own: keep the matrix regular.
    fisher[:, 2, 2] += 1e-6 * np.sum(width, axis=1) ** 2
    fisher[:, [0, 1], [0, 1]] += 1e-12
    likelihood = np.sum(observed * np.log(mean) - mean, axis=1)
    return _Score(likelihood, gradient, fisher, np.sum((observed - mean) ** 2 / mean, axis=1))


def delays_from_shaped_flat(
    flat: Histograms,
    *,
    timing: TimingCalibration,
    flat_arrival_ps: ArrayLike = 0.0,
    response: ArrayLike | None = None,
) -> FlatDelays:
    """Delay of every live pixel of a flat whose pulse has a shape of its own.

    Parameters
    ----------
    flat : counts, (rows, cols, codes), of light that reaches all pixels alike.
    timing : clock whose codes are calibrated (or nominal).
    flat_arrival_ps : when the onset of the light reached each pixel, scalar or (rows, cols), ps.
    response : (codes,), counts of the instrument's response, convolved with a decay that is fitted,
        one for all pixels. None: the array's own mean pulse.

    Raises
    ------
    CalibrationError
        If no pixel holds enough photons.
    ValueError
        If the response is of the wrong length or empty.
    """
    timing.check_matches(flat)
    arrival = checked_arrivals_ps(flat_arrival_ps, flat.shape)
    photons = flat.photons.astype(np.float64)
    live = photons >= _FEWEST_PHOTONS
    if not live.any():
        raise CalibrationError(
            f"no pixel of the flat recording has {_FEWEST_PHOTONS} photons: record longer"
        )
    pixels = _Pixels.of(flat, timing, live)
    start = pixels.crossings_ps(0.1)
    if response is None:
        shape, fits = _fit_own_shape(pixels, start)
    else:
        shape = _reconvolved(flat, timing, pixels, _checked_response(response, flat))
        start = start - shape.time_ps[int(np.searchsorted(shape.cumulated, 0.1))]
        fits = _fit_blocks(pixels, shape, start)
    return _flat_delays(fits, pixels, photons, arrival, flat.laser_period_ps)


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Counts and code edges of the live pixels, on the codes that hold light."""

    rows: NDArray[np.intp]
    cols: NDArray[np.intp]
    counts: NDArray[np.generic]  # (n, k), codes in the order of time
    codes: NDArray[np.intp]  # (k,)
    timing: TimingCalibration

    @classmethod
    def of(cls, flat: Histograms, timing: TimingCalibration, live: NDArray[np.bool_]) -> _Pixels:
        rows, cols = np.nonzero(live)
        summed = flat.counts[live].sum(axis=0, dtype=np.float64)
        if flat.no_photon_code is not None:
            summed[flat.no_photon_code] = 0.0
        held = np.flatnonzero(summed > 0)
        codes = np.arange(held[0], held[-1] + 1)
        if timing.reversed_codes:
            codes = codes[::-1]
        return cls(rows, cols, flat.counts[live][:, codes], codes, timing)

    def edges_ps(self, block: slice | NDArray[np.intp]) -> Floats:
        """(n, k + 1), edges of the codes of some of the pixels, ascending, ps."""
        lower, upper = self.timing.code_intervals_ps(self.rows[block], self.cols[block])
        return np.append(lower[:, self.codes], upper[:, self.codes[-1:]], axis=1)

    def some(self, index: NDArray[np.intp]) -> _Pixels:
        """Some of the pixels."""
        return replace(
            self, rows=self.rows[index], cols=self.cols[index], counts=self.counts[index]
        )

    def blocks(self) -> list[slice]:
        """Ranges of pixels small enough to work on at once."""
        return [slice(i, i + _BLOCK) for i in range(0, len(self.rows), _BLOCK)]

    def crossings_ps(self, share: float) -> Floats:
        """(n,), delay by which a share of the photons of each pixel has come, ps."""
        crossing = np.zeros(len(self.rows))
        for block in self.blocks():
            cumulated = np.cumsum(self.counts[block], axis=1, dtype=np.float64)
            index = np.argmax(cumulated >= share * cumulated[:, -1:], axis=1)
            edges = self.edges_ps(block)
            pixel = np.arange(len(index))
            crossing[block] = 0.5 * (edges[pixel, index] + edges[pixel, index + 1])
        return crossing


def _fit_blocks(pixels: _Pixels, shape: PulseShape, start_ps: Floats) -> ShapedFits:
    """`fit_shape` of all pixels, some at a time."""
    parts = [
        fit_shape(pixels.counts[block], pixels.edges_ps(block), shape, start_ps[block])
        for block in pixels.blocks()
    ]

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(part, name) for part in parts])

    return ShapedFits(
        onset_ps=joined("onset_ps"), onset_std_ps=joined("onset_std_ps"),
        photons=joined("photons"), likelihood=joined("likelihood"), chi2=joined("chi2"),
        dof=parts[0].dof, converged=joined("converged"),
    )  # fmt: skip


def _fit_own_shape(pixels: _Pixels, start_ps: Floats) -> tuple[PulseShape, ShapedFits]:
    """The array's mean pulse and each pixel's onset, in turn.

    Counts are spread evenly over their code and added with the pixels' onsets taken off; as
    onsets fall anywhere within a code, the mean has finer steps than one code.
    """
    sample = pixels.some(np.arange(0, len(start_ps), -(-len(start_ps) // _SHAPE_SAMPLE)))
    start = onset = start_ps[:: -(-len(start_ps) // _SHAPE_SAMPLE)]
    for _ in range(_ALIGNMENTS):
        shape = _mean_shape(sample, onset)
        fits = _fit_blocks(sample, shape, onset)
        onset = np.where(fits.converged, fits.onset_ps, start)
    middle = float(np.median(onset - start))
    return shape, _fit_blocks(pixels, shape, start_ps + middle)


def _mean_shape(pixels: _Pixels, onset_ps: Floats) -> PulseShape:
    """Mean of all pixels' pulses with their onsets at zero; the background before it taken off."""
    edges = pixels.edges_ps(slice(None)) - onset_ps[:, None]
    step = float(np.median(np.diff(edges))) / 4.0
    time = np.arange(edges.min(), edges.max() + step, step)
    cumulated, exposure = np.zeros(len(time)), np.zeros(len(time))
    for counts, edge in zip(pixels.counts, edges, strict=True):
        sums = np.append(0.0, np.cumsum(counts, dtype=np.float64))
        cumulated += np.interp(time, edge, sums)
        exposure += (time >= edge[0]) & (time <= edge[-1])
    well_seen = exposure > 0.5 * len(edges)
    rate = np.where(well_seen, np.diff(cumulated, prepend=0.0) / np.maximum(exposure, 1.0), 0.0)
    early = well_seen & (time < -_EARLY_CODES * 4.0 * step)
    if early.any():
        rate = np.where(well_seen, np.maximum(rate - rate[early].mean(), 0.0), 0.0)
    # Noise of the shape would pass for edges that place a pulse: smooth over a code, cut the foot.
    kernel = np.hanning(11)
    rate = np.convolve(rate, kernel / kernel.sum(), mode="same")
    peak = int(np.argmax(rate))
    low = np.flatnonzero(rate[:peak] < _FOOT * rate[peak])
    if len(low):
        # A foot that ends at once would place pulses far too well: let it fade within a code.
        foot = low[-1] + 1
        rate[:foot] = rate[foot] * np.exp((np.arange(foot) - foot) / 4.0)
    return _from_onset(*_with_tail(time, np.cumsum(rate), int(np.flatnonzero(well_seen)[-1])))


def _with_tail(time_ps: Floats, cumulated: Floats, last: int) -> tuple[Floats, Floats]:
    """A shape that goes on falling beyond what was recorded, as fast as it fell before that.

    Otherwise a pulse that comes early would seem to end in the middle of the recorded range.
    """
    step = time_ps[1] - time_ps[0]
    n = max(2, (last - int(np.argmax(np.gradient(cumulated)))) // 4)
    late, before = (
        cumulated[last] - cumulated[last - n],
        cumulated[last - n] - cumulated[last - 2 * n],
    )
    if not 0.0 < late < before:
        return time_ps, cumulated
    fall = (late / before) ** (1.0 / n)
    more = np.arange(1, len(time_ps) + 1)
    # The last n steps hold `late`; continue their geometric series.
    tail = late * (1.0 - fall**more) * fall**n / (1.0 - fall**n)
    time = np.append(time_ps[: last + 1], time_ps[last] + step * more)
    return time, np.append(cumulated[: last + 1], cumulated[last] + tail)


def _checked_response(response: ArrayLike, flat: Histograms) -> Floats:
    try:
        values = np.asarray(response, dtype=np.float64).ravel()
    except (TypeError, ValueError) as problem:
        raise ValueError(f"the response must be counts, got {response!r}") from problem
    if values.shape != (flat.n_codes,):
        raise ValueError(
            f"the response must have one value per code ({flat.n_codes}), got {values.shape}"
        )
    if not np.isfinite(values).all() or (values < 0).any() or not values.any():
        raise ValueError("the response must be counts: finite, >= 0, and not all zero")
    return values


def _reconvolved(
    flat: Histograms,
    timing: TimingCalibration,
    pixels: _Pixels,
    response: Floats,
) -> PulseShape:
    """Response with the decay time that suits the brightest pixels best."""
    lower, upper = timing.code_intervals_ps(pixels.rows[:1], pixels.cols[:1])
    brightest = np.argsort(-pixels.counts.sum(axis=1, dtype=np.float64), kind="stable")
    sample = np.sort(brightest[:_DECAY_SAMPLE])
    counts, edges = pixels.counts[sample], pixels.edges_ps(sample)
    crossing = pixels.crossings_ps(0.1)[sample]

    def cost(log_decay: float) -> float:
        shape = shape_from_response(response, lower[0], upper[0], decay_ps=float(np.exp(log_decay)))
        start = crossing - shape.time_ps[int(np.searchsorted(shape.cumulated, 0.1))]
        return -float(np.sum(fit_shape(counts, edges, shape, start).likelihood))

    code = float(np.median((upper - lower)[0]))
    span = float(edges.max() - edges.min())
    found = minimize_scalar(
        cost, bounds=(np.log(0.3 * code), np.log(span)), method="bounded", options={"xatol": 2e-3}
    )
    return shape_from_response(response, lower[0], upper[0], decay_ps=float(np.exp(found.x)))


def _even_likelihood(pixels: _Pixels) -> Floats:
    """(n,), log-likelihood of the counts of each pixel if light came evenly at all times."""
    even = np.zeros(len(pixels.rows))
    for block in pixels.blocks():
        counts, width = pixels.counts[block].astype(np.float64), np.diff(pixels.edges_ps(block))
        total = counts.sum(axis=1)
        mean = np.maximum(total / width.sum(axis=1), 1e-300)[:, None] * width
        even[block] = np.sum(counts * np.log(np.maximum(mean, 1e-300)), axis=1) - total
    return even


def _flat_delays(
    fits: ShapedFits,
    pixels: _Pixels,
    photons: Floats,
    arrival_ps: Floats,
    period_ps: float | None,
) -> FlatDelays:
    """Fits as pictures, with the flags of pixels that hold no light."""
    shape = photons.shape

    words = np.zeros(shape, dtype=np.uint32)
    words[photons == 0] |= flags.NO_PHOTONS | flags.DEAD
    words[(photons > 0) & (photons < _FEWEST_PHOTONS)] |= flags.TOO_FEW
    good = fits.converged & np.isfinite(fits.onset_std_ps)
    words[pixels.rows[~good], pixels.cols[~good]] |= flags.NOT_CONVERGED
    dull = fits.likelihood - _even_likelihood(pixels) < _LEAST_GAIN
    words[pixels.rows[dull], pixels.cols[dull]] |= flags.NO_PULSE
    good &= ~dull

    def image(values: Floats) -> Floats:
        full = np.full(shape, np.nan)
        full[pixels.rows, pixels.cols] = np.where(good, values, np.nan)
        return full

    onset = image(fits.onset_ps)
    return FlatDelays(
        skew_ps=skews_near_median(onset - arrival_ps, period_ps),
        skew_std_ps=image(fits.onset_std_ps),
        pulse_delay_ps=onset,
        response_std_ps=np.full(shape, np.nan),
        photons=image(fits.photons),
        chi2_excess=float(
            np.sum((fits.chi2 - fits.dof)[good]) / max(fits.photons[good].sum(), 1.0)
        ),
        flags=words,
    )
