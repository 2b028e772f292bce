"""What is wrong with fitted pulses: each by itself, then against the rest of the array.

The four cases of the paper's Fig. 2b are here: too wide, too narrow, good, abnormal count.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
from numpy.typing import NDArray

from lightflight import flags as fl
from lightflight._kernels import pulse as col
from lightflight.errors import NothingFoundError, SuspectDataWarning
from lightflight.recording.histograms import Histograms
from lightflight.recording.stored import largest_count
from lightflight.timing.pulses.fits import Fits, even_sample, zero_for_nan

WIDTH_FACTOR = 1.6
"""A pulse this much wider or narrower than the array's typical one is not the array's pulse."""

WIDTH_STD = 4.0
"""... if it also differs from it by this many standard errors."""

PERIOD_PULSES = 6.0
"""A laser period must hold this many std of the pulse."""

HELD_SHARE = 0.9
"""Least share of a pulse that live codes must cover."""

POOR_FIT_STD = 4.5
"""Deviate of chi2 (standard normal: one in 300,000) from which a fit is called poor."""

FEW_COUNTS = 8
"""A pixel with fewer counts than this and no pulse may well have one: too few to tell."""

ABNORMAL_FACTOR = 8.0
"""Background that many times the array's, without a pulse to speak of, is abnormal."""

DIMMEST = 3.0
"""A living pixel is at most this many times less sensitive than the median one."""

DEAD_BY_CHANCE = 1e-4
"""Chance that any pixel of an array of living ones, each that dim, counts nothing."""

_MOST_CUT = 0.01
"""Of the pixels that count: more than these are no hot ones."""

SATURATED_OCCUPANCY = 0.999
"""A pixel that fires in this share of all frames counts frames, not photons."""


def flags_of(
    fits: Fits, hist: Histograms, todo: NDArray[np.bool_], period: float
) -> NDArray[np.uint32]:
    """(n,), flags of every row: what the counts, the fit and the array say."""
    flags = _pixel_flags(fits, hist, todo.ravel())
    if not fits.one_per_pixel:
        flags = flags[fits.pixel]
    flags |= _pulse_flags(fits)
    flags |= _width_flags(fits, period)
    return flags


def _pixel_flags(fits: Fits, hist: Histograms, todo: NDArray[np.bool_]) -> NDArray[np.uint32]:
    """(pixels,), what is wrong with the counts of each pixel."""
    table = fits.table
    flags = np.zeros(len(table), dtype=np.uint32)
    flags[~todo] |= fl.MASKED
    counts = zero_for_nan(table[:, col.COUNTS])
    found = table[:, col.N_PULSES] > 0
    missed = todo & ~found & (counts > 0)
    few = counts < FEW_COUNTS if hist.poisson else np.zeros_like(missed)
    flags[todo & (counts <= 0)] |= fl.NO_PHOTONS
    flags[missed & few] |= fl.TOO_FEW
    flags[missed & ~few] |= fl.NO_PULSE
    with np.errstate(invalid="ignore"):
        flags[found & (table[:, col.CONVERGED] == 0)] |= fl.NOT_CONVERGED
        flags[found & (table[:, col.CHI2_DEVIATE] > POOR_FIT_STD)] |= fl.POOR_FIT
        flags[found & (table[:, col.HELD_SHARE] < HELD_SHARE)] |= fl.NEAR_GATE_EDGE
    flags[table[:, col.N_PULSES] > 1] |= fl.MULTIPLE_PULSES
    if hist.poisson:
        flags |= _count_flags(fits, hist, todo, counts)
    return flags


def _count_flags(
    fits: Fits, hist: Histograms, todo: NDArray[np.bool_], counts: NDArray[np.float64]
) -> NDArray[np.uint32]:
    """(pixels,), dead, abnormal, screaming and saturated pixels.

    Bright is not abnormal: only a pixel whose counts are background, far beyond the array's
    background, is. Dark is not dead: only where half of the array counts so much that no living
    pixel could count nothing.
    """
    flags = np.zeros(len(counts), dtype=np.uint32)
    asked = counts[todo]
    typical = float(np.median(asked[even_sample(len(asked))])) if len(asked) else 0.0
    if len(asked) * math.exp(-typical / DIMMEST) < DEAD_BY_CHANCE:
        flags[todo & (counts <= 0)] |= fl.DEAD
    photons = zero_for_nan(fits.values[:, 2])
    if not fits.one_per_pixel:
        photons = np.bincount(fits.pixel, photons, len(counts)).astype(np.float64)
    signal = np.minimum(photons, counts)
    dark = counts - signal
    lit = todo & (counts > 0) & np.isfinite(fits.table[:, col.EXPOSURE])
    if not lit.any():
        return flags
    flat = signal < 0.2 * dark
    of_peers = dark[lit]
    peers = float(np.median(of_peers[even_sample(len(of_peers))]))
    flags[lit & flat & (dark > ABNORMAL_FACTOR * max(peers, 1.0) + 20.0)] |= fl.ABNORMAL_COUNT
    if hist.n_frames is not None:
        flags[lit & flat & (dark > fl.SCREAMING_OCCUPANCY * hist.n_frames)] |= fl.SCREAMING
        flags[lit & (counts >= SATURATED_OCCUPANCY * hist.n_frames)] |= fl.SATURATED
    flags[lit & (fits.table[:, col.PEAK] >= largest_count(hist))] |= fl.SATURATED
    return flags


def _pulse_flags(fits: Fits) -> NDArray[np.uint32]:
    """(n,), pulses without usable errors, or with too few photons to be placed."""
    flags = np.zeros(len(fits.pixel), dtype=np.uint32)
    found = fits.column(col.N_PULSES) > 0
    errors = [fits.std_of(i) for i in range(4)]
    known = np.logical_and.reduce([np.isfinite(error) for error in errors])
    free = fits.column(col.STD_FREE) == 1
    with np.errstate(invalid="ignore"):
        placed = (fits.values[:, 2] > 3.0 * errors[2]) & (errors[0] < fits.values[:, 1])
    flags[found & ~known] |= fl.NO_COVARIANCE
    flags[found & known & free & ~placed] |= fl.TOO_FEW
    return flags


def _width_flags(fits: Fits, period: float) -> NDArray[np.uint32]:
    """(n,), pulses much wider or narrower than the array's, beyond their errors.

    Where the array's own widths scatter, the limits widen with them; without a typical width
    only pulses that fill the range, or sit inside one code, are called so.
    """
    flags = np.zeros(len(fits.pixel), dtype=np.uint32)
    std, error, photons = fits.values[:, 1], fits.std_of(1), fits.values[:, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        at_bound = (fits.column(col.N_PULSES) > 0) & (fits.column(col.STD_FREE) == 0)
        wide = std > np.minimum(0.25 * fits.column(col.EXPOSURE), period / PERIOD_PULSES)
        narrow = at_bound & ~wide
        typical = fits.typical_std
        if math.isfinite(typical):
            wide |= (std > WIDTH_FACTOR * typical) & (std - typical > WIDTH_STD * error)
            error = np.maximum(error, typical / np.sqrt(2.0 * np.maximum(photons, 1.0)))
            narrow |= (std < typical / WIDTH_FACTOR) & (typical - std > WIDTH_STD * error)
    flags[wide] |= fl.TOO_WIDE
    flags[narrow] |= fl.TOO_NARROW
    return flags


def warn_of_cut_counts(fits: Fits, flags: NDArray[np.uint32], hist: Histograms) -> None:
    """Give SuspectDataWarning where more than a few pixels hold the largest count of all.

    Single ones are hot. They are left out, and where the light is brightest nothing is told.
    """
    # Of most recordings none is, and nobody asks at which count they were cut.
    if not hist.poisson or not (flags & fl.SATURATED).any():
        return
    most = largest_count(hist)
    lit = fits.table[:, col.COUNTS] > 0
    n_cut = np.count_nonzero(lit & (fits.table[:, col.PEAK] >= most))
    if n_cut > max(_MOST_CUT * np.count_nonzero(lit), 1.0):
        warnings.warn(
            f"{n_cut} pixels are saturated and left out: counts were cut at {most}; record with "
            "less light, or store counts in a wider type",
            SuspectDataWarning, stacklevel=3,
        )  # fmt: skip


def check_fits(fits: Fits, flags: NDArray[np.uint32], period: float) -> None:
    """Raise NothingFoundError where darkness, hot pixels or a short period leave nothing to fit.

    A recording that merely shows no pulse is not refused here: its rows say so.
    """
    if not (fits.table[:, col.COUNTS] > 0).any():
        raise NothingFoundError(
            "the recording holds no photons: every count is zero, in the no-photon code, or in "
            "an excluded pixel"
        )
    counting = (flags & (fl.NO_PHOTONS | fl.MASKED | fl.DEAD)) == 0
    hot = (flags & (fl.SCREAMING | fl.SATURATED | fl.ABNORMAL_COUNT)) != 0
    if counting.any() and not (counting & ~hot).any():
        raise NothingFoundError(
            f"all {np.unique(fits.pixel[counting]).size} pixels that count are hot or saturated: "
            "lower the light or the exposure, or shield the camera"
        )
    found = np.isfinite(fits.values[:, 1]) & (fits.column(col.N_PULSES) > 0)
    if math.isfinite(period) and found.any():
        # Scattered light alone, off the beam, may well be as long.
        middle = float(np.fmin(fits.typical_std, np.median(fits.values[found, 1])))
        if middle > period / PERIOD_PULSES:
            raise NothingFoundError(
                f"the pulses (std {middle:.0f} ps) fill the laser period of {period:.0f} ps: "
                "check laser_period_ps and bin_width_ps, or use a slower laser"
            )
