"""Pulses of a recording without the flight: the codes where their light comes take no part.

A leak of the laser, a reflection in a window or a signal of the trigger comes in the recording of
the flight as it does without it. Nothing is subtracted: where such light comes, a pixel's codes
last no time on the clock, and no count of them says anything for or against a path.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtrc

from lightflight.errors import SuspectDataWarning
from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.code_clock import ClockWithoutCodes, CodeClock
from lightflight.timing.pulses.amplitudes import share_before, the_shorter_way
from lightflight.timing.pulses.fits import Fits, clock_of, exposure_ratio, fit_all
from lightflight.timing.pulses.pile_up import pile_up_of

if TYPE_CHECKING:
    from lightflight.timing.clock.response import Response

Floats = NDArray[np.float64]

Indices = NDArray[np.int64]

_MOST_PULSES = 20
"""Of a pixel's background: a room reflects a few times before its light is faint."""

_BY_CHANCE = 0.01
"""Share of pixels in which chance may make a pulse of the background: what is missed is taken for
light of the flight, what is made costs a pixel the codes of one pulse."""

_LEFT_PHOTONS = 0.01
"""Photons of such a pulse that a code of the recording may hold and still take part."""

_MOST_CODES = 0.25
"""Share of a pixel's codes: light that lasts for longer is its level, and no pulse."""

_LEAST_SHARE = 0.005
"""Of what a recording counts in these codes: less than this the verdict does not see either
(`verdict.count_tests`), and a bright pulse of the flight is worth more than it."""

_LEAST_NOISE = 0.1
"""Of the noise of what a recording counts there: less moves no time by more."""

_FINER = 8
"""Times as many pixels along a side has each block as one of the next."""

_TELL_BY_CHANCE = 1e-4
"""Chance that a background without pulses is said to hold some."""

_AT_ONCE = 1 << 17
"""Codes of all pixels worked on at once, which then stay in the cache."""


def without_background_pulses(
    hist: Histograms,
    background: Histograms,
    timing: CodeClock | None,
    *,
    response: Response | None = None,
    threads: int = 1,
) -> ClockWithoutCodes | None:
    """The clock without the codes where pulses of the background come.

    Parameters
    ----------
    hist : Histograms
        Recording of the flight.
    background : Histograms
        Recording of the same scene without the flight, by the same camera.
    timing : CodeClock or None
        Clock of both; None: nominal codes.
    response : Response or None, optional
        Shape of a pulse; None: a Gaussian.
    threads : int, optional
        Threads to share the pixels among.

    Returns
    -------
    ClockWithoutCodes or None
        Both recordings are to be `emptied` by it; None where no pulse stands out.

    Raises
    ------
    ValueError
        Where the two recordings cannot be compared.

    Warns
    -----
    SuspectDataWarning
        Where more pixels show a pulse than chance makes.
    """
    ratio = exposure_ratio(background, hist)
    clock = TimingCalibration.nominal(hist) if timing is None else timing
    n_pixels = hist.shape[0] * hist.shape[1]
    cut = np.zeros(hist.counts.shape, dtype=bool)
    for edge, is_light in _sums_to_search(background, clock):
        sums = _Sums.of(background, clock, cut, edge, is_light=is_light)
        _cut_pulses(cut, sums, hist, ratio, response, threads)
    if not cut.any():
        return None
    pixel, code = np.nonzero(cut.reshape(n_pixels, -1))
    without = ClockWithoutCodes.of(clock, pixel, code, hist.n_codes)
    if pdtrc(len(without.cut) - 1, n_pixels * _BY_CHANCE) < _TELL_BY_CHANCE:
        flight, lost = (
            hist.counts[some].sum() - background.counts[some].sum() / ratio for some in (..., cut)
        )
        warnings.warn(
            f"the background holds pulses in {len(without.cut)} of {n_pixels} pixels (a leak, "
            "reflections or a signal): codes where they come take no part, and with them "
            f"{min(max(lost, 0.0) / max(flight, lost, 1.0), 1.0):.0%} of the flight's light",
            SuspectDataWarning,
            stacklevel=4,
        )
    return without


def _sums_to_search(background: Histograms, clock: CodeClock) -> Iterator[tuple[int, bool]]:
    """Pixels along a side of a block, and whether their delays are taken off, one after another.

    What all pixels have a little of shows in their sum alone, what few have in these. A signal has
    no delays: in the sum of all it is drawn out where light is not, and light where it is not.
    """
    edge = _FINER ** math.ceil(math.log(max(background.shape), _FINER))
    light, signal = (_sharpness(background, clock, edge, is_light=one) for one in (True, False))
    yield edge, light >= signal
    yield edge, light < signal
    while edge > 1:
        edge //= _FINER
        yield edge, edge > 1


def _sharpness(background: Histograms, clock: CodeClock, edge: int, *, is_light: bool) -> float:
    """Sum of squared counts of the sum of all pixels, whose delays were taken off or not."""
    nothing = np.zeros(background.counts.shape, dtype=bool)
    sums = _Sums.of(background, clock, nothing, edge, is_light=is_light)
    return float(np.square(sums.hist.counts, dtype=np.float64).sum())


@dataclass(frozen=True, eq=False)
class _Sums:
    """Counts of a background, summed over blocks of pixels.

    Attributes
    ----------
    hist : Histograms
        One pixel for each block.
    clock : ClockWithoutCodes
        That of blocks, without codes that take no part in a pixel of theirs.
    members : tuple of tuple of array of int
        Rows and columns of the pixels of each block.
    shift : array of int, shape (rows, cols)
        Codes by which each pixel's were moved forward.
    """

    hist: Histograms
    clock: ClockWithoutCodes
    members: tuple[tuple[Indices, Indices], ...]
    shift: Indices

    @classmethod
    def of(
        cls, background: Histograms, clock: CodeClock, cut: NDArray[np.bool_], edge: int, *,
        is_light: bool,
    ) -> _Sums:  # fmt: skip
        """Sums of what is not yet cut; `is_light`: of pixels whose delays were taken off."""
        shift = np.zeros(background.shape, dtype=np.int64)
        if is_light and edge > 1:
            late = np.nan_to_num(clock.skew_ps) / clock.bin_width_ps
            shift = np.rint(-late if background.reversed_codes else late).astype(np.int64)
        members = _blocks_of(background.shape, edge)
        counts, lost = background.counts, cut
        if edge > 1:
            shape = len(members), 1, background.n_codes
            counts, lost = np.zeros(shape, dtype=np.uint64), np.zeros(shape, dtype=bool)
            for block, pixels in enumerate(members):
                for rows, cols in _in_parts(pixels, shape[2]):
                    codes = _later(np.arange(shape[2]), shift[rows, cols], shape[2])
                    at = rows[:, np.newaxis], cols[:, np.newaxis], codes
                    counts[block, 0] += np.where(cut[at], 0, background.counts[at]).sum(
                        axis=0, dtype=np.uint64
                    )
                    lost[block, 0] |= cut[at].any(axis=0)
            counts[lost] = 0
            counts.setflags(write=False)
            background = replace(background, counts=counts, n_frames=None)
            clock = TimingCalibration.nominal(background)
        place = np.arange(len(members)).reshape(background.shape)
        gone = lost.reshape(len(members), -1)
        return cls(background, ClockWithoutCodes(clock, place, gone.copy()), members, shift)


def _blocks_of(shape: tuple[int, int], edge: int) -> tuple[tuple[Indices, Indices], ...]:
    """Rows and columns of the pixels of each block, in the order of blocks."""
    rows, cols = np.indices(shape)
    block = (rows // edge) * -(-shape[1] // edge) + cols // edge
    pixels = np.argsort(block, axis=None, kind="stable")
    parts = np.split(pixels, np.cumsum(np.bincount(block.ravel()))[:-1])
    return tuple((part // shape[1], part % shape[1]) for part in parts)


def _in_parts(pixels: tuple[Indices, Indices], n_codes: int) -> Iterator[tuple[Indices, Indices]]:
    """Rows and columns of some pixels, as many at once as have `_AT_ONCE` codes."""
    step = max(1, _AT_ONCE // n_codes)
    return (
        (pixels[0][first : first + step], pixels[1][first : first + step])
        for first in range(0, len(pixels[0]), step)
    )


def _cut_pulses(
    cut: NDArray[np.bool_],
    sums: _Sums,
    hist: Histograms,
    ratio: float,
    response: Response | None,
    threads: int,
) -> None:
    """Mark the codes (rows, cols, codes) that pulses of the sums reach in the recording."""
    fits = fit_all(
        sums.hist, clock_of(sums.hist, sums.clock), np.ones(sums.hist.shape, dtype=bool),
        method="likelihood", max_pulses=_MOST_PULSES, background=None,
        pile_up=pile_up_of(sums.hist), response=response, threads=threads, by_chance=_BY_CHANCE,
    )  # fmt: skip
    table = None if response is None else response.table()
    there = np.flatnonzero(np.isfinite(fits.values).all(axis=1))
    step = max(1, _AT_ONCE // hist.n_codes)
    for some in (there[first : first + step] for first in range(0, len(there), step)):
        light = _light_of(fits, some, sums.clock.timing, sums.hist.shape[1], table) / ratio
        for block, each in zip(fits.pixel[some], light, strict=True):
            rows, cols = sums.members[block]
            codes = np.flatnonzero(each > _LEFT_PHOTONS * len(rows))
            if len(codes) > _MOST_CODES * hist.n_codes:
                continue
            at = _later(codes, sums.shift[rows, cols], hist.n_codes)
            counted = hist.counts[rows[:, np.newaxis], cols[:, np.newaxis], at].sum(axis=1)
            least = np.maximum(_LEAST_SHARE * counted, _LEAST_NOISE * np.sqrt(counted))
            reached = each[codes].sum() / len(rows) > least
            cut[rows[reached, np.newaxis], cols[reached, np.newaxis], at[reached]] = True


def _later(codes: Indices, shift: Indices, n_codes: int) -> Indices:
    """(n, k), codes (k,) that come `shift` (n,) later, round the end."""
    return np.asarray((codes + shift[:, np.newaxis]) % n_codes)


def _light_of(
    fits: Fits, some: Indices, clock: CodeClock, n_cols: int, table: Floats | None
) -> Floats:
    """Photons (n, codes) of some pulses in the codes of their pixels."""
    rows, cols = np.divmod(fits.pixel[some], n_cols)
    lower, upper = clock.code_intervals_ps(rows, cols)
    centre, std, photons = fits.values[some, :3].T[..., np.newaxis]
    # Of a few photons the width is a guess, often too small a one.
    std = np.fmax(std, fits.typical_std)
    half = 0.5 * (upper - lower)
    offset = the_shorter_way(0.5 * (lower + upper) - centre, clock.laser_period_ps)
    before, after = ((offset + side * half) / std for side in (-1.0, 1.0))
    return np.asarray(photons * (share_before(after, table) - share_before(before, table)))
