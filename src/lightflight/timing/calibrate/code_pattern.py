"""The repeating pattern of code widths: its length, each pixel's widths, what all share.

Used by `code_density`, on counts with pixels along the first axis. Levels are counts per
plateau code; widths are relative to the plateau code of the pixel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.timing.calibrate.shared_widths import Plateau, SharedWidths, shared_widths

_LONGEST_PATTERN = 64
_BLOCK = 2048

Counts = NDArray[np.unsignedinteger]
Floats = NDArray[np.float64]


def find_pattern_length(counts: Counts, *, start: int, stop: int) -> int:
    """Length of the repeating pattern of code widths, 1 where there is none.

    For each length n, chi-square of the counts summed by (code modulo n), beyond its
    expectation, over pixels, and over the array's sum (which sees patterns that all pixels
    share in recordings too short for one pixel). The length with the largest excess, less ten
    times its noise, wins: multiples of the true length explain no more and cost more.

    Parameters
    ----------
    counts : array of unsigned int, shape (n, codes)
        Of usable pixels.
    start, stop : int
        Range of codes to look at.

    Returns
    -------
    int
        Codes after which the widths repeat, at most 64.
    """
    # A thousand pixels tell the length as well as all of them, and sooner.
    sample = counts[:: max(1, len(counts) // 1024), start:stop].astype(np.float64)
    summed = counts[:, start:stop].sum(axis=0, dtype=np.float64)[None]
    lengths = np.arange(2, min(_LONGEST_PATTERN, (stop - start) // 8) + 1)
    if not len(lengths):
        return 1
    for table in (sample, summed):
        alone = _chi2_of_pattern(table, table.shape[1])
        chi2 = np.array([_chi2_of_pattern(table, int(n)) for n in lengths])
        # Codes that differ one by one bring as much to any pattern as to what it leaves.
        best = int(np.argmax(_pattern_excess(chi2, lengths, len(table), 1.0)))
        cells = len(table) * (table.shape[1] - int(lengths[best]))
        left = max(1.0, (alone - float(chi2[best])) / cells)
        gains = _pattern_excess(chi2, lengths, len(table), left)
        if gains.max() > 0.0:
            return int(lengths[np.argmax(gains)])
    return 1


def _pattern_excess(chi2: Floats, lengths: NDArray[np.intp], n_pixels: int, left: float) -> Floats:
    """Chi-square that patterns of some lengths explain, less chance and ten times its noise.

    Chance is `left` times that of counts, and what of it all pixels share as large in each of them.
    """
    dof = n_pixels * (lengths - 1)
    shared = (1.0 - 1.0 / left) * n_pixels * np.sqrt(2.0 * (lengths - 1))
    excess: Floats = chi2 / left - dof - 10.0 * (np.sqrt(2.0 * dof) + shared)
    return excess


def _chi2_of_pattern(table: Floats, n_phases: int) -> float:
    """Of the counts of each pixel, summed by (code modulo n_phases), against equal codes."""
    flux, chi2 = table.mean(axis=1), 0.0
    for phase in range(n_phases):
        part = table[:, phase::n_phases]
        expected = flux * part.shape[1]
        chi2 += float(np.sum((part.sum(axis=1) - expected) ** 2 / np.maximum(expected, 1e-9)))
    return chi2


@dataclass(frozen=True)
class CodePattern:
    """Shared and per-pixel parts of the structured model, pixels along the first axis.

    Attributes
    ----------
    flux : array of float, shape (n,)
        Counts in a plateau code.
    raw_phases : array of float, shape (n, n_phases)
        Each pixel's own relative widths.
    phases : array of float, shape (n, n_phases)
        The same drawn towards the array's mean as far as their noise demands.
    phase_std : array of float, shape (n, n_phases)
        Standard error of `phases`.
    phase_spread : float
        True spread (rms) of `raw_phases` between pixels, the noise taken off.
    shared : SharedWidths
        What all pixels share.
    start_excess : float
        Free widths only: time of the first live codes beyond that of as many plateau codes.
    """

    flux: Floats

    raw_phases: Floats

    phases: Floats

    phase_std: Floats

    phase_spread: float

    shared: SharedWidths

    start_excess: float = 0.0


def fit_pattern(
    counts: Counts, good: NDArray[np.bool_], plateau: Plateau, n_phases: int
) -> CodePattern:
    """Phases per pixel and shared widths, in turn until they agree (each step is convex).

    Parameters
    ----------
    counts : array of unsigned int, shape (n, codes)
        Counts of each pixel.
    good : array of bool, shape (n,)
        Usable pixels: they decide what all share.
    plateau : Plateau
        Where the codes are all alike.
    n_phases : int
        Length of the pattern, codes.

    Returns
    -------
    CodePattern
        Flux and phases of each pixel, widths that all share.
    """
    n_codes = counts.shape[1]
    summed = counts[good].sum(axis=0, dtype=np.float64)
    phase_of_code = np.arange(n_codes) % n_phases
    shared = SharedWidths(np.ones(n_codes), np.ones(n_codes))
    phase_counts = np.stack(
        [
            counts[:, k : plateau.stop : n_phases].sum(axis=1, dtype=np.float64)
            for k in range(plateau.start, plateau.start + n_phases)
        ],
        axis=1,
    )
    # Phases are counted from code 0, wherever the plateau begins.
    phase_counts = np.roll(phase_counts, plateau.start % n_phases, axis=1)
    for _ in range(4):
        time = np.bincount(
            phase_of_code[plateau.codes], weights=shared.widths[plateau.codes], minlength=n_phases
        )
        level = phase_counts / time
        shared = shared_widths(summed, level[good].sum(axis=0)[phase_of_code], plateau)
    flux = level.mean(axis=1)
    safe = np.maximum(flux, 1e-12)[:, None]
    raw = level / safe
    std = np.sqrt(np.maximum(phase_counts, 1.0)) / time / safe
    # Each is divided by the mean of all, its own noise among them: hence more than std^2.
    variance = std**2 * (1.0 - 2.0 * raw / n_phases) + (raw / n_phases) ** 2 * np.sum(
        std**2, axis=1, keepdims=True
    )
    phases, phase_std, spread = drawn_to_mean(raw, np.sqrt(variance), good)
    mean = phases.mean(axis=1, keepdims=True)
    # All counts over all time: drawn phases lend the flux their smaller noise.
    flux = phase_counts.sum(axis=1) / np.maximum((phases / mean) @ time, 1e-12)
    return CodePattern(flux, raw, phases / mean, phase_std, spread, shared)


def fit_free_widths(
    counts: Counts, good: NDArray[np.bool_], plateau: Plateau, n_phases: int
) -> CodePattern:
    """Every code of every pixel by itself.

    Parameters
    ----------
    counts : array of unsigned int, shape (n, codes)
        Counts of each pixel.
    good : array of bool, shape (n,)
        Usable pixels.
    plateau : Plateau
        Where the codes are all alike.
    n_phases : int
        Number of codes: the pattern is as long as the clock.

    Returns
    -------
    CodePattern
        `raw_phases` and `phases` are the same: nothing is drawn to the mean.
    """
    flux = counts[:, plateau.start : plateau.stop].mean(axis=1, dtype=np.float64)
    safe = np.maximum(flux, 1e-12)[:, None]
    raw = counts / safe
    std = np.sqrt(np.maximum(counts, 1.0)) / safe
    spread = float(np.sqrt(np.mean(np.var(raw[good][:, plateau.codes], axis=0))))
    widths = np.where(np.arange(n_phases) < plateau.first_live, 0.0, 1.0)
    excess = raw[good][:, plateau.first_live : plateau.start].mean(axis=0) - 1.0
    # Only an unbroken run from the first live code on can hold the dead ones' time.
    wide = np.cumprod(excess > 0.05).astype(bool)
    shared = SharedWidths(np.ones(n_phases), widths)
    return CodePattern(flux, raw, raw, std, spread, shared, float(excess[wide].sum()))


def drawn_to_mean(
    value: Floats, std: Floats, good: NDArray[np.bool_]
) -> tuple[Floats, Floats, float]:
    """Draw noisy per-pixel values towards the array's mean: (values, errors, true spread).

    Best linear prediction with the spread taken from the array itself: a value keeps the part
    spread^2 / (spread^2 + std^2) of its distance from the mean. With fewer than 8 usable pixels
    nothing is known of the spread, and values stay as they are.

    Parameters
    ----------
    value, std : array of float, shape (n, k)
    good : array of bool, shape (n,)
        Pixels that define mean and spread.

    Returns
    -------
    value : array of float, shape (n, k)
        The values drawn to the mean.
    std : array of float, shape (n, k)
        Their standard errors.
    spread : float
        True spread (rms) between pixels.
    """
    weight = 1.0 / np.maximum(std[good], 1e-12) ** 2
    if np.count_nonzero(good) < 8:
        spread2 = float(np.mean(np.var(value[good], axis=0)))
        return value, std, float(np.sqrt(spread2))
    mean = np.sum(weight * value[good], axis=0) / weight.sum(axis=0)
    for _ in range(3):
        residual2 = (value[good] - mean) ** 2 - std[good] ** 2
        # Noisy pixels say little of the spread: a squared residual's variance goes with std^4.
        trust = 1.0 / (std[good] ** 2 + max(1e-12, float(np.mean(std[good] ** 2)))) ** 2
        spread2 = max(0.0, float(np.sum(trust * residual2) / np.sum(trust)))
        weight = 1.0 / (std[good] ** 2 + spread2 + 1e-30)
        mean = np.sum(weight * value[good], axis=0) / weight.sum(axis=0)
    kept = spread2 / (spread2 + std**2 + 1e-30)
    mean_variance = 1.0 / weight.sum(axis=0)
    variance = kept * std**2 + (1.0 - kept) ** 2 * mean_variance
    return mean + kept * (value - mean), np.sqrt(variance), float(np.sqrt(spread2))


def pattern_goodness(
    counts: Counts,
    model: CodePattern,
    good: NDArray[np.bool_],
    plateau: Plateau,
) -> tuple[Floats, Floats, Floats]:
    """Pearson's chi-square of the plateau, its z-score, and the rms misfit: (n,) each.

    Parameters
    ----------
    counts : array of unsigned int, shape (n, codes)
        Counts of each pixel.
    model : CodePattern
        What `fit_pattern` or `fit_free_widths` makes of them.
    good : array of bool, shape (n,)
        Usable pixels.
    plateau : Plateau
        The codes that are asked.

    Returns
    -------
    chi2 : array of float, shape (n,)
        Sum of (counts - mean)^2 / mean over the plateau.
    z_score : array of float, shape (n,)
        (chi2 - dof) over its standard deviation, sqrt(2 dof + sum 1 / mean).
    misfit_std : array of float, shape (n,)
        Relative width (rms) that the model leaves out; 0 where chance explains it.
    """
    n_phases = model.phases.shape[1]
    dof = plateau.stop - plateau.start - n_phases
    chi2, total, inverse = (np.zeros(len(counts)) for _ in range(3))
    if dof <= 0:
        return chi2, np.zeros(len(counts)), np.zeros(len(counts))
    for block in pixel_blocks(len(counts)):
        mean = model.raw_phases[block][:, plateau.codes % n_phases]
        mean = mean * model.shared.widths[plateau.codes]
        mean = np.maximum(mean * model.flux[block][:, None], 1e-9)
        chi2[block] = np.sum((counts[block][:, plateau.codes] - mean) ** 2 / mean, axis=1)
        total[block], inverse[block] = mean.sum(axis=1), np.minimum(1.0 / mean, 1.0).sum(axis=1)
    noise2 = 2.0 * dof + inverse
    z_score = (chi2 - dof) / np.sqrt(noise2)
    excess = chi2 - dof
    misfit2 = np.where(z_score > 5.0, excess / np.maximum(total, 1.0), 0.0)
    # Of all pixels together it is told where it explains more than its price (Schwarz).
    if excess[good].sum() > np.sqrt(np.log(dof * good.sum()) * noise2[good].sum()):
        misfit2 = np.maximum(misfit2, excess[good].sum() / total[good].sum())
    return chi2, z_score, np.sqrt(np.maximum(misfit2, 0.0))


def pixel_blocks(n_pixels: int) -> Iterator[slice]:
    """Ranges of pixels small enough to work on at once.

    Parameters
    ----------
    n_pixels : int
        Pixels in all.

    Yields
    ------
    slice
        The next few of them.
    """
    for start in range(0, n_pixels, _BLOCK):
        yield slice(start, min(start + _BLOCK, n_pixels))
