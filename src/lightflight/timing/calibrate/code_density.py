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

import math
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight.errors import CalibrationError, SuspectDataWarning
from lightflight.recording.histograms import Histograms
from lightflight.timing.calibrate.code_pattern import (
    CodePattern,
    drawn_to_mean,
    find_pattern_length,
    fit_free_widths,
    fit_pattern,
    pattern_goodness,
    pixel_blocks,
)
from lightflight.timing.calibrate.period_end import FARTHEST_FROM_END, PeriodEnd, fit_period_end
from lightflight.timing.calibrate.shared_widths import Plateau
from lightflight.timing.clock.code_edges import edges_and_end, end_factor, relative_widths

_FEWEST_PHOTONS = 200
_MOST_SPECIAL_CODES = 16
_PULSE_HEIGHT = 1.6
_MOST_PHOTONS_PER_PERIOD = 0.02
_CLEAR = 1.0
"""Of a code: one that ends so far before the period, and three blurs, is whole."""
_ROUNDS = 200
"""Of expectation and maximisation; with 260 the same to 1e-4 where half of the array is unseen."""

Counts = NDArray[np.unsignedinteger]
Floats = NDArray[np.float64]
_NONE = np.zeros(0)


@dataclass(frozen=True, eq=False)
class CodeDensityFit:
    """Relative code widths of every pixel; the unit is the width of a plateau code of the pixel.

    Pixels whose own counts do not suffice hold what is typical for the array, with its spread as
    error, and the flag `uncalibrated`.

    Attributes
    ----------
    flux : array of float, shape (rows, cols)
        Counts in a plateau code.
    phases : array of float, shape (rows, cols, n_phases)
        Relative widths of codes k = 0 .. n_phases - 1, mean 1.
    phase_std : array of float, shape (rows, cols, n_phases)
        Their standard errors.
    phase_spread : float
        True spread (rms) between pixels of each of `phases`, the noise taken off.
    code_widths : array of float, shape (codes,)
        Relative widths all pixels share; 0 for dead codes.
    code_spread : float
        By how much they differ one by one from their smooth course, rms, the noise taken off.
    code_width_std : float
        Error of one of them, rms.
    first_live_code : int
        The first code that is not dead.
    first_live_width : array of float, shape (rows, cols)
        Relative width of that code in each pixel; NaN where not its own.
    end_code : array of float, shape (rows, cols)
        Fractional code at which the laser period ends.
    end_blur_codes : float
        Standard deviation of the clock's own jitter, as it blurs the end, codes.
    end_widths : array of float, shape (m,)
        Relative widths of the last codes, by whole codes from the end of the period; empty where
        the sync does not disturb the clock.
    period_end_seen : bool
        False where the codes stop before the laser period does: no gain can be had.
    codes_absorbed : array of float, shape (rows, cols)
        Plateau codes in a period if live codes absorb the dead ones' time.
    codes_lost : array of float, shape (rows, cols)
        The same if that time is lost.
    absorbed_std : array of float, shape (rows, cols)
        Standard error of `codes_absorbed`.
    lost_std : array of float, shape (rows, cols)
        Standard error of `codes_lost`.
    misfit_std : array of float, shape (rows, cols)
        Rms of relative widths beyond the model and the Poisson noise.
    chi2 : array of float, shape (rows, cols)
        Pearson's chi-square of the plateau codes.
    dof : int
        Degrees of freedom of `chi2`.
    structured : bool
        False: the pattern does not suffice and every code of every pixel has its own width.
    flags : array of uint32, shape (rows, cols)
        Dead, screaming, uncalibrated.
    photons : array of float, shape (rows, cols)
        Counts used.
    """

    flux: Floats

    phases: Floats

    phase_std: Floats

    phase_spread: float

    code_widths: Floats

    code_spread: float

    code_width_std: float

    first_live_code: int

    first_live_width: Floats

    end_code: Floats

    end_blur_codes: float

    end_widths: Floats

    period_end_seen: bool

    codes_absorbed: Floats

    codes_lost: Floats

    absorbed_std: Floats

    lost_std: Floats

    misfit_std: Floats

    chi2: Floats

    dof: int

    structured: bool

    flags: NDArray[np.uint32]

    photons: Floats

    @property
    def n_phases(self) -> int:
        """Length of the pattern, codes."""
        return int(self.phases.shape[2])

    @property
    def dead_codes(self) -> tuple[int, ...]:
        """Codes below the first live one that hold no light."""
        return tuple(range(self.first_live_code))


def fit_code_density(hist: Histograms) -> CodeDensityFit:
    """Relative code widths of every pixel from light that ignores the laser.

    Parameters
    ----------
    hist : Histograms
        Counts of a code-density recording, (rows, cols, codes).

    Returns
    -------
    CodeDensityFit
        Widths, ends of the period and flags of every pixel.

    Raises
    ------
    CalibrationError
        If no pixel holds enough photons, every pixel screams, or the counts hold a pulse.
    """
    counts = hist.counts.reshape(-1, hist.n_codes)
    if hist.no_photon_code is not None:
        counts = counts.copy()
        # Frames without a photon are no counts of light.
        counts[:, hist.no_photon_code] = 0
    photons = counts.sum(axis=1, dtype=np.float64)
    words = pixel_flags(photons, n_frames=hist.n_frames)
    _warn_of_pile_up(hist, photons)
    good = words == 0
    if not good.any():
        raise CalibrationError(
            f"no pixel of the code-density recording is usable: {flags.count_flags(words)}; "
            "record longer, or with less light"
        )
    summed = counts[good].sum(axis=0, dtype=np.float64)
    plateau = _find_plateau(summed)
    n_phases = find_pattern_length(counts[good], start=plateau.start, stop=plateau.stop)
    fit = _fit(counts, hist, words, plateau, n_phases)
    if fit.structured and _pattern_fails(fit, good.reshape(hist.shape)):
        fit = _fit(counts, hist, words, plateau, hist.n_codes)
    return fit


def _warn_of_pile_up(hist: Histograms, photons: Floats) -> None:
    """Say so where first photons of a frame crowd out later ones within one laser period."""
    if hist.n_frames is None or hist.periods_per_frame is None:
        return
    share = np.minimum(np.median(photons) / hist.n_frames, 1.0 - 1e-6)
    per_period = -np.log1p(-share) / hist.periods_per_frame
    if per_period > _MOST_PHOTONS_PER_PERIOD:
        warnings.warn(
            f"the code-density recording has {per_period:.2g} photons per pixel and laser period: "
            "only the first is recorded, so early codes look wider than they are; use less light",
            SuspectDataWarning,
            stacklevel=4,
        )


def pixel_flags(photons: Floats, *, n_frames: int | None) -> NDArray[np.uint32]:
    """Flags of pixels that cannot speak for the array: dead, too few photons, screaming.

    Parameters
    ----------
    photons : array of float, shape (n,)
        Counts of each pixel.
    n_frames : int or None
        Frames recorded, at most one photon each; None leaves the outlier test alone.

    Returns
    -------
    array of uint32, shape (n,)
        Uint32.
    """
    words = np.zeros(photons.shape, dtype=np.uint32)
    alive = photons > 0
    words[~alive] |= flags.NO_PHOTONS | flags.DEAD
    if not alive.any():
        return words
    screams = pixels_that_scream_under_even_light(photons, n_frames=n_frames)
    words[screams] |= flags.SCREAMING
    typical = np.median(photons[alive & ~screams]) if (alive & ~screams).any() else 0.0
    blind = alive & (photons < 0.01 * typical)
    words[blind] |= flags.DEAD
    words[alive & ~blind & (photons < _FEWEST_PHOTONS)] |= flags.TOO_FEW
    return words


def pixels_that_scream_under_even_light(
    photons: Floats, *, n_frames: int | None
) -> NDArray[np.bool_]:
    """Which pixels fire far more often than light that is the same for all can explain.

    Parameters
    ----------
    photons : array of float, shape (n,)
        Counts of each pixel; at least one is not zero.
    n_frames : int or None
        Frames recorded, at most one photon each; None: only how far a pixel stands out counts.

    Returns
    -------
    array of bool, shape (n,)
        True where more than `SCREAMING_OCCUPANCY` of the frames hold a photon, at more than three
        times the rate of the median live pixel.
    """
    alive = photons > 0
    if n_frames is not None:
        # Occupancy saturates; rates of photons do not, and can be compared.
        rate = -np.log1p(-np.minimum(photons / n_frames, 1.0 - 0.5 / n_frames))
        busy = photons > flags.SCREAMING_OCCUPANCY * n_frames
        return np.asarray(busy & (rate > 3 * np.median(rate[alive])))
    level = np.log(photons[alive])
    spread = 1.4826 * np.median(np.abs(level - np.median(level)))
    return np.asarray(photons > np.exp(np.median(level) + max(6.0 * spread, np.log(3.0))))


def _find_plateau(summed: Floats) -> Plateau:
    """Where the counts of the whole array begin, are flat, and begin to fall."""
    filled = np.flatnonzero(summed > 0)
    level = float(np.median(summed[filled[0] : filled[-1] + 1]))
    # Dead codes may hold stray counts.
    alive = np.flatnonzero(summed > 0.3 * level)
    first_live = int(alive[0])
    last = int(alive[-1])
    end_seen = last < len(summed) - 1 or bool(summed[-9:].mean() < 0.9 * level)
    fall = len(summed)
    if end_seen:
        # Pixels end at different codes: the fall of the sum shows how far apart.
        smooth = np.convolve(summed, np.ones(9) / 9.0, mode="same")
        above = np.flatnonzero(smooth > 0.9 * level)[-1]
        below = np.flatnonzero(smooth > 0.1 * level)[-1]
        fall = int(max(above - 2 * (below - above) - 8, first_live + 1))
    stop = fall - min(FARTHEST_FROM_END, (fall - first_live) // 4) if end_seen else fall
    start = min(first_live + _MOST_SPECIAL_CODES, (first_live + stop) // 2)
    if stop - start < 8:
        raise CalibrationError(
            f"the code-density recording has only {stop - start} codes of even height: "
            "it holds a pulse, or its light is not uncorrelated with the laser"
        )
    _check_no_pulse(summed, start, last)
    return Plateau(first_live, start, stop, fall, end_seen)


def _check_no_pulse(summed: Floats, start: int, stop: int) -> None:
    """Raise where neighbouring codes together hold far more counts than the rest."""
    size = min(9, stop - start)
    smooth = np.convolve(summed[start:stop], np.ones(size) / size, mode="valid")
    level = float(np.median(summed[start:stop]))
    high = float(smooth.max())
    if high > _PULSE_HEIGHT * level and high - level > 8.0 * np.sqrt(high / size):
        code = start + size // 2 + int(np.argmax(smooth))
        raise CalibrationError(
            f"the code-density recording holds a pulse near code {code}: its "
            "light must not know of the laser (is this the flat recording?)"
        )


def _fit(
    counts: Counts,
    hist: Histograms,
    words: NDArray[np.uint32],
    plateau: Plateau,
    n_phases: int,
) -> CodeDensityFit:
    """Fit the pattern, then the ends of the period, then the first live codes."""
    good = words == 0
    structured = n_phases < hist.n_codes
    pattern = (fit_pattern if structured else fit_free_widths)(counts, good, plateau, n_phases)
    chi2, z_score, misfit = pattern_goodness(counts, pattern, good, plateau)
    n_pixels = len(counts)
    # Until shown otherwise no code has a width of its own, and no end of a period is in sight.
    first, first_std = np.full(n_pixels, np.nan), np.zeros(n_pixels)
    end = PeriodEnd(np.full(n_pixels, float(hist.n_codes)), np.zeros(n_pixels), 0.0, 0.0, _NONE)
    if structured:
        if pattern.shared.widths[plateau.first_live] != pattern.shared.regular[plateau.first_live]:
            first, first_std = _first_live_widths(counts[:, plateau.first_live], pattern.flux, good)
        if plateau.end_seen:
            end = _period_end(counts, pattern, good, plateau)
            if pattern.shared.spread2 > 0.0:
                pattern = _with_last_codes(counts, pattern, end, good, plateau)
                end = _period_end(counts, pattern, good, plateau)
    words = words.copy()
    words[good & (z_score > 6.0)] |= flags.POOR_FIT
    absorbed, lost, lost_std = _codes_per_period(pattern, plateau.first_live, first, end)
    shape = hist.shape
    fit = CodeDensityFit(
        flux=pattern.flux.reshape(shape), phases=pattern.phases.reshape(*shape, -1),
        phase_std=pattern.phase_std.reshape(*shape, -1), phase_spread=pattern.phase_spread,
        code_widths=pattern.shared.widths, code_width_std=pattern.shared.std,
        code_spread=math.sqrt(pattern.shared.spread2),
        first_live_code=plateau.first_live,
        first_live_width=first.reshape(shape),
        end_code=end.end_code.reshape(shape),
        end_blur_codes=end.blur_codes, end_widths=end.end_widths,
        period_end_seen=plateau.end_seen, codes_absorbed=absorbed.reshape(shape),
        codes_lost=lost.reshape(shape),
        absorbed_std=np.hypot(lost_std, first_std).reshape(shape),
        lost_std=lost_std.reshape(shape), misfit_std=misfit.reshape(shape),
        chi2=chi2.reshape(shape), dof=plateau.stop - plateau.start - n_phases,
        structured=structured, flags=words.reshape(shape),
        photons=counts.sum(axis=1, dtype=np.float64).reshape(shape),
    )  # fmt: skip
    return _typical_where_unusable(fit)


def _period_end(
    counts: Counts, pattern: CodePattern, good: NDArray[np.bool_], plateau: Plateau
) -> PeriodEnd:
    return fit_period_end(
        counts, flux=pattern.flux, phases=pattern.phases, regular=pattern.shared.regular,
        good=good, start=plateau.fall,
    )  # fmt: skip


def _with_last_codes(
    counts: Counts,
    pattern: CodePattern,
    end: PeriodEnd,
    good: NDArray[np.bool_],
    plateau: Plateau,
) -> CodePattern:
    """The pattern with the widths of codes that some pixels see before their period ends."""
    code = np.arange(plateau.fall, counts.shape[1])
    observed, expected = np.zeros((2, counts.shape[1]))
    usable = np.flatnonzero(good)
    for some in pixel_blocks(len(usable)):
        block = usable[some]
        mean = pattern.phases[block][:, code % pattern.phases.shape[1]]
        mean = mean * pattern.shared.regular[code] * pattern.flux[block, np.newaxis]
        if len(end.end_widths):
            mean = mean * end_factor(end.end_code[block], code, end.end_widths)
        whole = end.end_code[block, np.newaxis] > code + _CLEAR + 3.0 * end.blur_codes
        observed[code] += np.sum(counts[block][:, code], axis=0, where=whole)
        expected[code] += np.sum(mean, axis=0, where=whole)
    return replace(pattern, shared=pattern.shared.with_counts(observed, expected))


def _codes_per_period(
    pattern: CodePattern, first_live: int, first: Floats, end: PeriodEnd
) -> tuple[Floats, Floats, Floats]:
    """Plateau widths in one period: dead codes' time absorbed, or lost; error of both: (n,) each.

    The error is that of the end and of the phases of its unfinished cycle.
    """
    n_pixels, n_phases = pattern.phases.shape
    absorbed, lost, variance = (np.zeros(n_pixels) for _ in range(3))
    code = np.arange(len(pattern.shared.widths))
    for block in pixel_blocks(n_pixels):
        end_code, phases = end.end_code[block], pattern.phases[block]
        near_end = {"end_code": end_code, "end_widths": end.end_widths}
        widths = relative_widths(
            phases, shared=pattern.shared.widths, first_live_code=first_live,
            first_live_width=first[block], **near_end,
        )  # fmt: skip
        absorbed[block] = edges_and_end(widths, end_code)[1]
        if n_phases == len(code):
            lost[block] = absorbed[block] + max(first_live - pattern.start_excess, 0.0)
            continue
        regular = relative_widths(
            phases, shared=pattern.shared.regular, first_live_code=first_live,
            first_live_width=np.full(len(phases), np.nan), **near_end,
        )  # fmt: skip
        lost[block] = edges_and_end(regular, end_code)[1]
        # Whole cycles of the pattern add up to the same whatever the phases: the
        # unfinished one does not.
        live = np.clip(end_code[:, None] - code, 0.0, 1.0)
        share = np.stack([live[:, j::n_phases].sum(axis=1) for j in range(n_phases)], axis=1)
        share = share - share.mean(axis=1, keepdims=True)
        variance[block] = np.sum((share * pattern.phase_std[block]) ** 2, axis=1)
    return absorbed, lost, np.sqrt(variance + end.end_code_std**2)


def _typical_where_unusable(fit: CodeDensityFit) -> CodeDensityFit:
    """Replace numbers of pixels that could not be measured by the array's, with its spread.

    Where the period ends beyond the last code it has more codes than are recorded: such a pixel is
    like the rest of the array beyond there, not like those that were measured.
    """
    n_codes = len(fit.code_widths)
    open_end = fit.period_end_seen & fit.structured & (fit.end_code > n_codes - 0.5)
    unusable = (fit.flags & (flags.NO_PHOTONS | flags.DEAD | flags.TOO_FEW)) != 0
    unusable = unusable | open_end
    if not unusable.any():
        return fit
    good = flags.is_usable(fit.flags) & ~unusable
    if not good.any():
        raise CalibrationError(
            "the end of the laser period lies beyond the last code in every pixel of the "
            "code-density recording: use more codes, or a shorter period"
        )
    words = fit.flags.copy()
    words[unusable] |= flags.UNCALIBRATED
    changed: dict[str, Any] = {"flags": words}
    for name in ("end_code", "codes_absorbed", "codes_lost", "first_live_width", "phases"):
        value = getattr(fit, name).copy()
        value[unusable] = value[good].mean(axis=0)
        changed[name] = value
    spread = float(np.std(fit.codes_absorbed[good])) if good.sum() > 1 else 0.0
    beyond, beyond_std = _beyond_the_edge(fit.end_code[good], int(open_end.sum()), n_codes)
    for name in ("codes_absorbed", "codes_lost"):
        changed[name][open_end] += beyond - fit.end_code[good].mean()
    own = np.where(open_end, beyond_std, spread)
    stds = {"absorbed_std": own, "lost_std": own, "phase_std": np.full_like(own, fit.phase_spread)}
    for name, std in stds.items():
        value = getattr(fit, name).copy()
        value[unusable] = std[unusable][:, np.newaxis] if value.ndim > own.ndim else std[unusable]
        changed[name] = value
    return replace(fit, **changed)


def _beyond_the_edge(seen: Floats, n_beyond: int, edge: float) -> tuple[float, float]:
    """Mean and standard deviation of normal deviates beyond an edge that cuts their sample.

    Expectation and maximisation in turn (Dempster et al., J. R. Stat. Soc. B 39, 1 (1977)): from
    those that were seen and how many were not.
    """
    total = len(seen) + n_beyond
    mean, std = float(seen.mean()), max(float(seen.std()), 1e-6)
    beyond, variance = mean, std**2
    for _ in range(_ROUNDS if n_beyond else 0):
        z = (edge - mean) / std
        hazard = math.exp(-0.5 * z**2) / max(math.erfc(z / math.sqrt(2.0)), 1e-300)
        hazard *= math.sqrt(2.0 / math.pi)
        beyond, variance = mean + std * hazard, std**2 * (1.0 + z * hazard - hazard**2)
        mean = float(seen.sum() + n_beyond * beyond) / total
        squares = float(np.sum((seen - mean) ** 2)) + n_beyond * (variance + (beyond - mean) ** 2)
        std = max(float(np.sqrt(squares / total)), 1e-6)
    return beyond, float(np.sqrt(max(variance, 0.0)))


def _first_live_widths(
    counts: Counts, flux: Floats, good: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Relative width of the first live code in each pixel and its error: (n,), (n,)."""
    safe = np.maximum(flux, 1e-12)
    raw = counts / safe
    typical = counts[good].sum(dtype=np.float64) / flux[good].sum()
    # By the expected counts: by its own, a pixel with few counts would claim the smaller error.
    std = np.sqrt(np.maximum(typical * safe, 1.0)) / safe
    width, width_std, _ = drawn_to_mean(raw[:, None], std[:, None], good)
    return width[:, 0], width_std[:, 0]


def _pattern_fails(fit: CodeDensityFit, good: NDArray[np.bool_]) -> bool:
    """Whether the pattern leaves out more than the noise of a free width (chi2 > 2 dof)."""
    return fit.dof > 0 and float(np.median(fit.chi2[good])) > 2.0 * fit.dof
