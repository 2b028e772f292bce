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
from lightflight.timing.pulses.checks import ABNORMAL_FACTOR
from lightflight.timing.pulses.fits import clock_of, exposure_ratio, fit_all
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
    for sums in _sums_of(background, clock, cut):
        _cut_pulses(cut, sums, hist, ratio, response, threads)
    if not cut.any():
        return None
    pixel, code = np.nonzero(cut.reshape(n_pixels, -1))
    without = ClockWithoutCodes.of(clock, pixel, code, hist.n_codes)
    if pdtrc(len(without.cut) - 1, n_pixels * _BY_CHANCE) < _TELL_BY_CHANCE:
        flight, lost = (
            hist.counts[some].sum() - background.counts[some].sum() / ratio for some in (..., cut)
        )
        share = min(max(lost, 0.0) / max(flight, lost, 1.0), 1.0)
        warnings.warn(
            f"the background holds pulses in {len(without.cut)} of {n_pixels} pixels (a leak, "
            "reflections or a signal): codes where they come take no part, and with them "
            f"{100.0 * share:.0f} % of the flight's light",
            SuspectDataWarning,
            stacklevel=4,
        )
    return without


def _sums_of(background: Histograms, clock: CodeClock, cut: NDArray[np.bool_]) -> Iterator[_Sums]:
    """Sums to be searched, one after another, of what is not `cut` by then.

    What all pixels have a little of shows in their sum alone, what few have in these. A signal has
    no delays: in the sum of all it is drawn out where light is not, and light where it is not.
    """
    edge = _FINER ** math.ceil(math.log(max(background.shape), _FINER))
    light, codes = _Frame(clock, by_light=True), _Frame(clock, by_light=False)
    if edge > 1:
        both = [_Sums.of(background, frame, cut, edge) for frame in (light, codes)]
        sharper, other = sorted(both, key=lambda one: -one.unevenness)
        yield sharper
        yield _Sums.of(background, other.frame, cut, edge)
    while (edge := edge // _FINER) > 1:
        yield _Sums.of(background, light, cut, edge)
    pixels, own = _blocks_of(background.shape, 1), _Frame(clock, by_light=None)
    yield _Sums(background, clock, cut.reshape(len(pixels), -1).copy(), pixels, own)


@dataclass(frozen=True, eq=False)
class _Frame:
    """The time in which codes of several pixels are laid over each other.

    Attributes
    ----------
    clock : CodeClock
        That of the camera.
    by_light : bool or None
        True: arrival of light; False: codes of one length; None: each pixel's own delays.
    """

    clock: CodeClock
    by_light: bool | None

    def intervals_ps(self, hist: Histograms, rows: Indices, cols: Indices) -> tuple[Floats, Floats]:
        """(lower, upper) of the codes of some pixels, (n, codes) each."""
        if self.by_light is False:
            lower, upper = TimingCalibration.nominal(hist).code_intervals_ps([0], [0])
            shape = len(rows), hist.n_codes
            return np.broadcast_to(lower, shape), np.broadcast_to(upper, shape)
        lower, upper = self.clock.code_intervals_ps(rows, cols)
        late = self.clock.skew_ps[rows, cols, np.newaxis] if self.by_light else 0.0
        return lower - late, upper - late


@dataclass(frozen=True, eq=False)
class _Sums:
    """Counts of a background, summed over blocks of pixels.

    Attributes
    ----------
    hist : Histograms
        One pixel for each block.
    clock : CodeClock
        That of blocks.
    cut : array of bool, shape (blocks, codes)
        Codes that take no part in a pixel of the block.
    members : tuple of tuple of array of int
        Rows and columns of the pixels of each block.
    frame : _Frame
        What the times of blocks are to those of their pixels.
    """

    hist: Histograms
    clock: CodeClock
    cut: NDArray[np.bool_]
    members: tuple[tuple[Indices, Indices], ...]
    frame: _Frame

    @property
    def unevenness(self) -> float:
        """How far counts are from a level, squared: the more, the shorter its pulses are."""
        counts = self.hist.counts[:, 0].astype(np.float64)
        lower, upper = self.clock.code_intervals_ps(
            np.arange(len(counts)), np.zeros(len(counts), int)
        )
        width = np.where(self.cut, 0.0, upper - lower)
        share = width / np.maximum(width.sum(axis=1, keepdims=True), 1e-300)
        return float(np.sum((counts - counts.sum(axis=1, keepdims=True) * share) ** 2))

    @classmethod
    def of(cls, background: Histograms, frame: _Frame, cut: NDArray[np.bool_], edge: int) -> _Sums:
        """Sums over blocks of so many pixels along a side."""
        members, n_codes = _blocks_of(background.shape, edge), background.n_codes
        told = _not_hot(background) & frame.clock.is_known
        counts = np.zeros((len(members), 1, n_codes), dtype=np.uint64)
        width = np.zeros((len(members), n_codes))
        lost = np.tile(~background.photon_codes, (len(members), 1))
        axis = TimingCalibration.nominal(background).code_intervals_ps([0], [0])
        middle = 0.5 * (axis[0] + axis[1])[0]
        for block, (row, col) in enumerate(members):
            kept = told[row, col]
            for rows, cols in _in_parts((row[kept], col[kept]), n_codes):
                lower, upper = frame.intervals_ps(background, rows, cols)
                at, found = _codes_at(middle, lower, upper, background.laser_period_ps)
                place = rows[:, np.newaxis], cols[:, np.newaxis], at
                start, end = frame.clock.code_intervals_ps(rows, cols)
                own = np.take_along_axis(end - start, at, axis=1)
                # A code as long as two would count for each of these.
                gone = ~found | cut[place] | (own <= 0.0) | (own > 1.5 * frame.clock.bin_width_ps)
                counts[block, 0] += np.where(gone, 0, background.counts[place]).sum(
                    axis=0, dtype=np.uint64
                )
                width[block] += own.sum(axis=0)
                lost[block] |= gone.any(axis=0)
        counts[:, 0][lost] = 0
        counts.setflags(write=False)
        hist = replace(background, counts=counts, n_frames=None)
        return cls(hist, _clock_of_blocks(hist, width, lost), lost, members, frame)


def _clock_of_blocks(hist: Histograms, width_ps: Floats, lost: NDArray[np.bool_]) -> CodeClock:
    """A clock whose codes are as long as those of a block's pixels are on the average."""
    live = ~lost & (width_ps > 0.0)
    mean = np.where(live, width_ps, 0.0).sum(axis=1) / np.maximum(live.sum(axis=1), 1)
    phases = np.divide(width_ps, mean[:, np.newaxis], out=np.ones_like(width_ps), where=live)
    phases /= phases.mean(axis=1, keepdims=True)
    return replace(TimingCalibration.nominal(hist), phases=phases[:, np.newaxis])


def _codes_at(
    times: Floats, lower: Floats, upper: Floats, period: float | None
) -> tuple[Indices, NDArray[np.bool_]]:
    """Code of each pixel (n,) at each of some times (m,), and whether there is one, (n, m) each."""
    back = lower[0, 0] > lower[0, -1]
    starts, ends = (one[:, :: -1 if back else 1] for one in (lower, upper))
    first = starts[:, :1]
    wanted = np.broadcast_to(times, (len(lower), len(times)))
    if period:
        wanted = first + (wanted - first) % period
    at = np.stack([np.searchsorted(e, t, side="right") for e, t in zip(ends, wanted, strict=True)])
    found = at < lower.shape[1]
    at = np.minimum(at, lower.shape[1] - 1)
    found &= np.take_along_axis(starts, at, axis=1) <= wanted
    return (lower.shape[1] - 1 - at if back else at), found


def _not_hot(background: Histograms) -> NDArray[np.bool_]:
    """(rows, cols), False where a pixel's own counts would hide all others' in their sum."""
    photons = background.photons
    most: NDArray[np.bool_] = photons <= ABNORMAL_FACTOR * np.median(photons) + 20.0
    return most


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
    clock = ClockWithoutCodes(
        sums.clock, np.arange(len(sums.cut)).reshape(sums.hist.shape), sums.cut
    )
    fits = fit_all(
        sums.hist, clock_of(sums.hist, clock), np.ones(sums.hist.shape, dtype=bool),
        method="likelihood", max_pulses=_MOST_PULSES, background=None,
        pile_up=pile_up_of(sums.hist), response=response, threads=threads, by_chance=_BY_CHANCE,
    )  # fmt: skip
    table = None if response is None else response.table()
    for pulse in np.flatnonzero(np.isfinite(fits.values).all(axis=1)):
        members = sums.members[fits.pixel[pulse]]
        centre, std, photons = fits.values[pulse, :3]
        # Of a few photons the width is a guess, often too small a one.
        std, photons = np.fmax(std, fits.typical_std), photons / (len(members[0]) * ratio)
        for rows, cols in _in_parts(members, hist.n_codes):
            lower, upper = sums.frame.intervals_ps(hist, rows, cols)
            half = 0.5 * (upper - lower)
            offset = the_shorter_way(0.5 * (lower + upper) - centre, hist.laser_period_ps)
            before, after = ((offset + side * half) / std for side in (-1.0, 1.0))
            light = photons * (share_before(after, table) - share_before(before, table))
            reached = light > _LEFT_PHOTONS
            counted = np.where(reached, hist.counts[rows, cols], 0).sum(axis=1)
            least = np.maximum(_LEAST_SHARE * counted, _LEAST_NOISE * np.sqrt(counted))
            much = (light * reached).sum(axis=1) > least
            much &= reached.mean(axis=1) <= _MOST_CODES
            cut[rows[much], cols[much]] |= reached[much]
