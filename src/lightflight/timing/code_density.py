"""Widths of TDC codes from a code-density recording (light that ignores the laser).

Uncorrelated light fills a code in proportion to the time the code covers. Free widths for 900
codes would be 900 noisy numbers per pixel; a real clock needs few (a ring oscillator repeats):

    counts[p, k] ~ Poisson(flux[p] * phases[p, k % n] * code_widths[k] * live(end_code[p] - k))

- `phases`: one pattern of n codes per pixel, its length n found from the recording
- `code_widths`: shared by all pixels: a smooth low-order term, 0 for dead codes, own widths for
  the first live codes, which take up some of the dead ones' time
- `end_code`: where the laser period ends. The fill of the last code places it to a small part of
  one code, hence the gain: counts / plateau alone carries as much noise as the gains differ
- numbers that pixels share up to a spread are drawn towards the array's mean as far as their own
  noise demands (empirical Bayes), which matters only in short recordings

Takes `Histograms`, gives a `CodeDensityFit`; `calibration.py` turns that into picoseconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight.errors import CalibrationError
from lightflight.histogram import Histograms
from lightflight.timing.period_end import FullCodes, fit_period_end

SCREAMING_OCCUPANCY = 0.6
"""A pixel that fires in more frames than this, and 3 times as fast as its peers, screams."""

_FEWEST_PHOTONS = 200
_LONGEST_PATTERN = 64
_MOST_SPECIAL_CODES = 16
_SMOOTH_DEGREE = 4
_BLOCK = 2048

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CodeDensityFit:
    """Relative code widths of every pixel; the unit is the width of a plateau code of the pixel.

    Pixels whose own counts do not suffice hold what is typical for the array, with its spread as
    error, and the flag `uncalibrated`.
    """

    flux: Floats
    """(rows, cols), counts in a plateau code."""

    phases: Floats
    """(rows, cols, n_phases), relative widths of codes k = 0 .. n_phases - 1, mean 1."""

    phase_std: Floats
    """(rows, cols, n_phases), their standard errors."""

    phase_spread: float
    """True spread (rms) between pixels of each of `phases`, the noise taken off."""

    code_widths: Floats
    """(codes,), relative widths all pixels share; 0 for dead codes."""

    regular_widths: Floats
    """(codes,), the same without the first live codes' extra time and without dead codes."""

    first_live_code: int
    """The first code that is not dead."""

    first_live_width: Floats
    """(rows, cols), relative width of that code in each pixel; NaN where not its own."""

    end_code: Floats
    """(rows, cols), fractional code at which the laser period ends."""

    end_code_std: Floats
    """(rows, cols), its standard error, codes."""

    end_blur_codes: float
    """Standard deviation of the clock's own jitter, as it blurs the end, codes."""

    period_end_seen: bool
    """False where the codes stop before the laser period does: no gain can be had."""

    codes_absorbed: Floats
    """(rows, cols), plateau codes in a period if live codes absorb the dead ones' time."""

    codes_lost: Floats
    """(rows, cols), the same if that time is lost."""

    codes_std: Floats
    """(rows, cols), standard error of both."""

    misfit_std: Floats
    """(rows, cols), rms of relative widths beyond the model and the Poisson noise."""

    chi2: Floats
    """(rows, cols), Pearson's chi-square of the plateau codes."""

    dof: int
    """Degrees of freedom of `chi2`."""

    structured: bool
    """False: the pattern does not suffice and every code of every pixel has its own width."""

    flags: NDArray[np.uint32]
    """(rows, cols), dead, screaming, uncalibrated."""

    photons: Floats
    """(rows, cols), counts used."""

    @property
    def n_phases(self) -> int:
        """Length of the pattern, codes."""
        return self.phases.shape[2]

    @property
    def dead_codes(self) -> tuple[int, ...]:
        """Codes below the first live one that hold no light."""
        return tuple(range(self.first_live_code))


@dataclass(frozen=True)
class _Plateau:
    """Codes between the first live ones and the first end of a period in any pixel."""

    first_live: int
    start: int
    stop: int
    end_seen: bool

    @property
    def codes(self) -> NDArray[np.intp]:
        return np.arange(self.start, self.stop)


def fit_code_density(hist: Histograms, *, free_widths: bool | None = None) -> CodeDensityFit:
    """Relative code widths of every pixel from light that ignores the laser.

    Parameters
    ----------
    hist : counts of a code-density recording, (rows, cols, codes).
    free_widths : True gives every code of every pixel its own width, False insists on the
        pattern; None takes the pattern unless it leaves out more than a free width's noise.

    Raises
    ------
    CalibrationError
        If no pixel holds enough photons, every pixel screams, or the counts hold a pulse.
    """
    counts = hist.counts.reshape(-1, hist.n_codes)
    if hist.no_photon_code is not None:
        counts = counts.copy()
        counts[:, hist.no_photon_code] = 0
    photons = counts.sum(axis=1, dtype=np.float64)
    words = pixel_flags(photons, n_frames=hist.n_frames)
    good = words == 0
    if not good.any():
        raise CalibrationError(
            f"no pixel of the code-density recording is usable: {flags.count_flags(words)}; "
            "record longer, or with less light"
        )
    summed = counts[good].sum(axis=0, dtype=np.float64)
    plateau = _find_plateau(summed)
    if free_widths:
        n_phases = hist.n_codes
    else:
        n_phases = find_pattern_length(counts[good], start=plateau.start, stop=plateau.stop)
    fit = _fit(counts, hist, words, plateau, n_phases)
    if free_widths is None and fit.structured and _pattern_fails(fit, good.reshape(hist.shape)):
        fit = _fit(counts, hist, words, plateau, hist.n_codes)
    return fit


def pixel_flags(photons: Floats, *, n_frames: int | None) -> NDArray[np.uint32]:
    """Flags of pixels that cannot speak for the array: dead, too few photons, screaming.

    Parameters
    ----------
    photons : (n,), counts of each pixel.
    n_frames : frames recorded, at most one photon each; None leaves the outlier test alone.

    Returns
    -------
    (n,) uint32.
    """
    words = np.zeros(photons.shape, dtype=np.uint32)
    alive = photons > 0
    words[~alive] |= flags.NO_PHOTONS | flags.DEAD
    if not alive.any():
        return words
    if n_frames is not None:
        rate = -np.log1p(-np.minimum(photons / n_frames, 1.0 - 0.5 / n_frames))
        screams = (photons > SCREAMING_OCCUPANCY * n_frames) & (rate > 3 * np.median(rate[alive]))
    else:
        rate = photons
        level = np.log(photons[alive])
        spread = 1.4826 * np.median(np.abs(level - np.median(level)))
        screams = photons > np.exp(np.median(level) + max(6.0 * spread, np.log(3.0)))
    words[screams] |= flags.SCREAMING
    typical = np.median(photons[alive & ~screams]) if (alive & ~screams).any() else 0.0
    blind = alive & (photons < 0.01 * typical)
    words[blind] |= flags.DEAD
    words[alive & ~blind & (photons < _FEWEST_PHOTONS)] |= flags.TOO_FEW
    return words


def _find_plateau(summed: Floats) -> _Plateau:
    """Where the counts of the whole array begin, are flat, and begin to fall."""
    filled = np.flatnonzero(summed > 0)
    level = float(np.median(summed[filled[0] : filled[-1] + 1]))
    alive = np.flatnonzero(summed > 0.3 * level)
    first_live = int(alive[0])
    last = int(alive[-1])
    end_seen = last < len(summed) - 1
    stop = len(summed)
    if end_seen:
        # Pixels end at different codes: the fall of the sum shows how far apart.
        smooth = np.convolve(summed, np.ones(9) / 9.0, mode="same")
        above = np.flatnonzero(smooth > 0.9 * level)[-1]
        below = np.flatnonzero(smooth > 0.1 * level)[-1]
        stop = int(max(above - 2 * (below - above) - 8, first_live + 1))
    start = min(first_live + _MOST_SPECIAL_CODES, (first_live + stop) // 2)
    if stop - start < 8:
        raise CalibrationError(
            f"the code-density recording has only {stop - start} codes of even height: "
            "it holds a pulse, or its light is not uncorrelated with the laser"
        )
    return _Plateau(first_live, start, stop, end_seen)


def find_pattern_length(counts: NDArray[np.unsignedinteger], *, start: int, stop: int) -> int:
    """Length of the repeating pattern of code widths, 1 where there is none.

    For each length n, chi-square of the counts summed by (code modulo n), beyond its
    expectation, over pixels, and over the array's sum (which sees patterns that all pixels
    share in recordings too short for one pixel). The length with the largest excess, less ten
    times its noise, wins: multiples of the true length explain no more and cost more.

    Parameters
    ----------
    counts : (n, codes) of usable pixels.
    start, stop : range of codes to look at.
    """
    sample = counts[:: max(1, len(counts) // 1024), start:stop].astype(np.float64)
    summed = counts[:, start:stop].sum(axis=0, dtype=np.float64)[None]
    lengths = np.arange(2, min(_LONGEST_PATTERN, (stop - start) // 8) + 1)
    for table in (sample, summed):
        gains = [_pattern_excess(table, int(n)) for n in lengths]
        best = int(np.argmax(gains)) if gains else 0
        if gains and gains[best] > 0:
            return int(lengths[best])
    return 1


def _pattern_excess(table: Floats, n_phases: int) -> float:
    """Chi-square that a pattern of this length explains, less chance and ten times its noise."""
    n_pixels, n_codes = table.shape
    flux = table.mean(axis=1)
    chi2 = 0.0
    for phase in range(n_phases):
        part = table[:, phase::n_phases]
        expected = flux * part.shape[1]
        chi2 += float(np.sum((part.sum(axis=1) - expected) ** 2 / np.maximum(expected, 1e-9)))
    dof = n_pixels * (n_phases - 1)
    return chi2 - dof - 10.0 * float(np.sqrt(2.0 * dof))


@dataclass(frozen=True)
class _Model:
    """Shared and per-pixel parts of the structured model, pixels along the first axis."""

    flux: Floats  # (n,)
    raw_phases: Floats  # (n, n_phases), before they are drawn towards the mean
    phases: Floats  # (n, n_phases)
    phase_std: Floats  # (n, n_phases)
    phase_spread: float
    regular: Floats  # (codes,)
    widths: Floats  # (codes,)
    start_excess: float = 0.0  # free widths: time of the first live codes beyond the plateau's


def _fit(
    counts: NDArray[np.unsignedinteger],
    hist: Histograms,
    words: NDArray[np.uint32],
    plateau: _Plateau,
    n_phases: int,
) -> CodeDensityFit:
    """Fit the pattern, then the ends of the period, then the first live codes."""
    good = words == 0
    structured = n_phases < hist.n_codes
    model = (_fit_pattern if structured else _fit_free_widths)(counts, good, plateau, n_phases)
    chi2, z_score, misfit = _goodness(counts, model, good, plateau)
    n_pixels = len(counts)
    first = np.full(n_pixels, np.nan)
    first_std = np.zeros(n_pixels)
    end, end_std, blur = np.full(n_pixels, float(hist.n_codes)), np.zeros(n_pixels), 0.0
    if structured:
        if model.widths[plateau.first_live] != model.regular[plateau.first_live]:
            first, first_std = _first_live_widths(counts[:, plateau.first_live], model.flux, good)
        if plateau.end_seen:
            full = FullCodes(model.flux, model.phases, model.regular)
            found = fit_period_end(counts, full, good=good, start=plateau.stop)
            end, end_std, blur = found.end_code, found.end_code_std, found.blur_codes
    words = words.copy()
    words[good & (z_score > 6.0)] |= flags.POOR_FIT
    absorbed, lost, codes_std = _codes_per_period(
        model, plateau.first_live, first, first_std, end, end_std
    )
    image = hist.shape
    fit = CodeDensityFit(
        flux=model.flux.reshape(image), phases=model.phases.reshape(*image, -1),
        phase_std=model.phase_std.reshape(*image, -1), phase_spread=model.phase_spread,
        code_widths=model.widths, regular_widths=model.regular,
        first_live_code=plateau.first_live, first_live_width=first.reshape(image),
        end_code=end.reshape(image), end_code_std=end_std.reshape(image), end_blur_codes=blur,
        period_end_seen=plateau.end_seen, codes_absorbed=absorbed.reshape(image),
        codes_lost=lost.reshape(image), codes_std=codes_std.reshape(image),
        misfit_std=misfit.reshape(image), chi2=chi2.reshape(image),
        dof=plateau.stop - plateau.start - n_phases, structured=structured,
        flags=words.reshape(image), photons=counts.sum(axis=1, dtype=np.float64).reshape(image),
    )  # fmt: skip
    return _typical_where_unusable(fit)


def _fit_pattern(
    counts: NDArray[np.unsignedinteger], good: NDArray[np.bool_], plateau: _Plateau, n_phases: int
) -> _Model:
    """Phases per pixel and shared widths, in turn until they agree (each step is convex)."""
    n_codes = counts.shape[1]
    summed = counts[good].sum(axis=0, dtype=np.float64)
    phase_of_code = np.arange(n_codes) % n_phases
    regular, widths = np.ones(n_codes), np.ones(n_codes)
    phase_counts = np.stack(
        [
            counts[:, k : plateau.stop : n_phases].sum(axis=1, dtype=np.float64)
            for k in range(plateau.start, plateau.start + n_phases)
        ],
        axis=1,
    )
    phase_counts = np.roll(phase_counts, plateau.start % n_phases, axis=1)
    for _ in range(4):
        time = np.bincount(
            phase_of_code[plateau.codes], weights=widths[plateau.codes], minlength=n_phases
        )
        level = phase_counts / time
        regular, widths = _shared_widths(summed, level[good].sum(axis=0)[phase_of_code], plateau)
    flux = level.mean(axis=1)
    safe = np.maximum(flux, 1e-12)[:, None]
    raw = level / safe
    std = np.sqrt(np.maximum(phase_counts, 1.0)) / time / safe
    variance = std**2 * (1.0 - 2.0 * raw / n_phases) + (raw / n_phases) ** 2 * np.sum(
        std**2, axis=1, keepdims=True
    )
    phases, phase_std, spread = _drawn_to_mean(raw, np.sqrt(variance), good)
    mean = phases.mean(axis=1, keepdims=True)
    flux = phase_counts.sum(axis=1) / np.maximum((phases / mean) @ time, 1e-12)
    return _Model(flux, raw, phases / mean, phase_std, spread, regular, widths)


def _fit_free_widths(
    counts: NDArray[np.unsignedinteger], good: NDArray[np.bool_], plateau: _Plateau, n_phases: int
) -> _Model:
    """Every code of every pixel by itself."""
    flux = counts[:, plateau.start : plateau.stop].mean(axis=1, dtype=np.float64)
    safe = np.maximum(flux, 1e-12)[:, None]
    raw = counts / safe
    std = np.sqrt(np.maximum(counts, 1.0)) / safe
    spread = float(np.sqrt(np.mean(np.var(raw[good][:, plateau.codes], axis=0))))
    regular = np.ones(n_phases)
    widths = np.where(np.arange(n_phases) < plateau.first_live, 0.0, 1.0)
    excess = raw[good][:, plateau.first_live : plateau.start].mean(axis=0) - 1.0
    wide = np.cumprod(excess > 0.05).astype(bool)
    return _Model(flux, raw, raw, std, spread, regular, widths, float(excess[wide].sum()))


def _shared_widths(summed: Floats, expected: Floats, plateau: _Plateau) -> tuple[Floats, Floats]:
    """Widths that all pixels share, from the counts of the whole array: regular, and all.

    A Legendre series in the code, as many terms as the counts demand, is the regular part; the
    first live codes, and single codes that stand out, have a width of their own. Where more
    than a tenth of all codes stands out, every code has.
    """
    code = np.arange(len(summed))
    place = 2.0 * (code - plateau.start) / (plateau.stop - 1 - plateau.start) - 1.0
    plain = (code >= plateau.start) & (code < plateau.stop)
    regular = _smooth_widths(summed, expected, place, plain)
    for _ in range(2):
        ratio = summed / np.maximum(expected * regular, 1e-9)
        z = (ratio - 1.0) * np.sqrt(np.maximum(expected * regular, 1e-9))
        odd = (np.abs(z) > 6.0) & (np.abs(ratio - 1.0) > 0.005)
        inside = (code >= plateau.start) & (code < plateau.stop)
        if np.mean(odd[inside]) > 0.1:
            odd[inside] = True
            break
        plain = inside & ~odd
        regular = _smooth_widths(summed, expected, place, plain)
    widths = regular.copy()
    widths[inside & odd] *= ratio[inside & odd]
    for k in range(plateau.first_live, plateau.start):
        if not odd[k]:
            break
        widths[k] = summed[k] / expected[k]
    widths[: plateau.first_live] = 0.0
    scale = np.sum(expected[inside] * widths[inside]) / np.sum(expected[inside])
    return regular / scale, widths / scale


def _smooth_widths(
    summed: Floats, expected: Floats, place: Floats, plain: NDArray[np.bool_]
) -> Floats:
    """exp(Legendre series) fitted to summed / expected by Poisson likelihood (Newton steps).

    A term stays if it lowers the deviance by more than 16 (one in 16,000 by chance).
    """
    best = np.full(len(summed), summed[plain].sum() / expected[plain].sum())
    best_deviance = _deviance(summed[plain], (expected * best)[plain])
    for degree in range(1, _SMOOTH_DEGREE + 1):
        basis = np.polynomial.legendre.legvander(place, degree)
        coefficients = np.zeros(degree + 1)
        coefficients[0] = np.log(summed[plain].sum() / expected[plain].sum())
        for _ in range(6):
            mean = expected[plain] * np.exp(basis[plain] @ coefficients)
            gradient = basis[plain].T @ (summed[plain] - mean)
            hessian = (basis[plain].T * mean) @ basis[plain]
            coefficients = coefficients + np.linalg.solve(hessian, gradient)
        trial = np.exp(basis @ coefficients)
        deviance = _deviance(summed[plain], (expected * trial)[plain])
        if deviance < best_deviance - 16.0:
            best, best_deviance = trial, deviance
    return best


def _deviance(observed: Floats, mean: Floats) -> float:
    """Twice the log-likelihood ratio of Poisson counts to a perfect fit."""
    filled = observed > 0
    terms = mean - observed
    terms[filled] += observed[filled] * np.log(observed[filled] / mean[filled])
    return 2.0 * float(terms.sum())


def _drawn_to_mean(
    value: Floats, std: Floats, good: NDArray[np.bool_]
) -> tuple[Floats, Floats, float]:
    """Draw noisy per-pixel values towards the array's mean: (values, errors, true spread).

    Best linear prediction with the spread taken from the array itself: a value keeps the part
    spread^2 / (spread^2 + std^2) of its distance from the mean. With fewer than 8 usable pixels
    nothing is known of the spread, and values stay as they are.

    Parameters
    ----------
    value, std : (n, k).
    good : (n,), pixels that define mean and spread.
    """
    weight = 1.0 / np.maximum(std[good], 1e-12) ** 2
    if np.count_nonzero(good) < 8:
        spread2 = float(np.mean(np.var(value[good], axis=0)))
        return value, std, float(np.sqrt(spread2))
    mean = np.sum(weight * value[good], axis=0) / weight.sum(axis=0)
    for _ in range(3):
        residual2 = (value[good] - mean) ** 2 - std[good] ** 2
        trust = 1.0 / (std[good] ** 2 + max(1e-12, float(np.mean(std[good] ** 2)))) ** 2
        spread2 = max(0.0, float(np.sum(trust * residual2) / np.sum(trust)))
        weight = 1.0 / (std[good] ** 2 + spread2 + 1e-30)
        mean = np.sum(weight * value[good], axis=0) / weight.sum(axis=0)
    kept = spread2 / (spread2 + std**2 + 1e-30)
    mean_variance = 1.0 / weight.sum(axis=0)
    variance = kept * std**2 + (1.0 - kept) ** 2 * mean_variance
    return mean + kept * (value - mean), np.sqrt(variance), float(np.sqrt(spread2))


def _first_live_widths(
    counts: NDArray[np.unsignedinteger], flux: Floats, good: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Relative width of the first live code in each pixel and its error: (n,), (n,)."""
    safe = np.maximum(flux, 1e-12)
    raw = counts / safe
    typical = counts[good].sum(dtype=np.float64) / flux[good].sum()
    std = np.sqrt(np.maximum(typical * safe, 1.0)) / safe
    width, width_std, _ = _drawn_to_mean(raw[:, None], std[:, None], good)
    return width[:, 0], width_std[:, 0]


def _goodness(
    counts: NDArray[np.unsignedinteger],
    model: _Model,
    good: NDArray[np.bool_],
    plateau: _Plateau,
) -> tuple[Floats, Floats, Floats]:
    """Pearson's chi-square of the plateau, its z-score, and the rms misfit: (n,) each."""
    n_phases = model.phases.shape[1]
    dof = plateau.stop - plateau.start - n_phases
    chi2, total, inverse = (np.zeros(len(counts)) for _ in range(3))
    if dof <= 0:
        return chi2, np.zeros(len(counts)), np.zeros(len(counts))
    for block in _blocks(len(counts)):
        mean = model.raw_phases[block][:, plateau.codes % n_phases] * model.widths[plateau.codes]
        mean = np.maximum(mean * model.flux[block][:, None], 1e-9)
        chi2[block] = np.sum((counts[block][:, plateau.codes] - mean) ** 2 / mean, axis=1)
        total[block], inverse[block] = mean.sum(axis=1), np.minimum(1.0 / mean, 1.0).sum(axis=1)
    noise2 = 2.0 * dof + inverse
    z_score = (chi2 - dof) / np.sqrt(noise2)
    excess = chi2 - dof
    misfit2 = np.where(z_score > 5.0, excess / np.maximum(total, 1.0), 0.0)
    if excess[good].sum() > 5.0 * np.sqrt(noise2[good].sum()):
        misfit2 = np.maximum(misfit2, excess[good].sum() / total[good].sum())
    return chi2, z_score, np.sqrt(np.maximum(misfit2, 0.0))


def _pattern_fails(fit: CodeDensityFit, good: NDArray[np.bool_]) -> bool:
    """Whether the pattern leaves out more than the noise of a free width (chi2 > 2 dof)."""
    return fit.dof > 0 and float(np.median(fit.chi2[good])) > 2.0 * fit.dof


def _blocks(n_pixels: int) -> Iterator[slice]:
    for start in range(0, n_pixels, _BLOCK):
        yield slice(start, min(start + _BLOCK, n_pixels))


def _codes_per_period(
    model: _Model,
    first_live: int,
    first: Floats,
    first_std: Floats,
    end: Floats,
    end_std: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Plateau widths in one period if dead codes' time is absorbed, or lost; error: (n,) each."""
    n_pixels, n_phases = model.phases.shape
    absorbed, lost, variance = (np.zeros(n_pixels) for _ in range(3))
    code = np.arange(len(model.widths))
    for block in _blocks(n_pixels):
        phases = model.phases[block][:, code % n_phases]
        live = np.clip(end[block][:, None] - code, 0.0, 1.0)
        regular = phases * model.regular * live
        widths = phases * model.widths * live
        own = np.isfinite(first[block])
        widths[own, first_live] = first[block][own]
        absorbed[block] = widths.sum(axis=1)
        lost[block] = regular.sum(axis=1)
        if n_phases == len(code):
            lost[block] = absorbed[block] + max(first_live - model.start_excess, 0.0)
            continue
        # The pattern's error counts for the codes of an unfinished cycle only.
        share = np.stack([live[:, j::n_phases].sum(axis=1) for j in range(n_phases)], axis=1)
        share = share - share.mean(axis=1, keepdims=True)
        variance[block] = np.sum((share * model.phase_std[block]) ** 2, axis=1)
    variance += end_std**2 + first_std**2
    return absorbed, lost, np.sqrt(variance)


def _typical_where_unusable(fit: CodeDensityFit) -> CodeDensityFit:
    """Replace numbers of pixels that could not be measured by the array's, with its spread."""
    unusable = (fit.flags & (flags.NO_PHOTONS | flags.DEAD | flags.TOO_FEW)) != 0
    if not unusable.any():
        return fit
    good = (fit.flags & flags.EXCLUDING) == 0
    words = fit.flags.copy()
    words[unusable] |= flags.UNCALIBRATED
    changed: dict[str, NDArray[np.generic]] = {"flags": words}
    for name in ("end_code", "codes_absorbed", "codes_lost", "first_live_width", "phases"):
        value = getattr(fit, name).copy()
        value[unusable] = value[good].mean(axis=0)
        changed[name] = value
    spread = float(np.std(fit.codes_absorbed[good])) if good.sum() > 1 else 0.0
    for name, std in (("codes_std", spread), ("phase_std", fit.phase_spread)):
        value = getattr(fit, name).copy()
        value[unusable] = std
        changed[name] = value
    return replace(fit, **changed)
