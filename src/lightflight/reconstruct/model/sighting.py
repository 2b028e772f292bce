"""One recording as the reconstruction sees it: counts, clock, pulses on it, and its camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight.flight import Medium
from lightflight.reconstruct.model.geometry import PathState, footprints
from lightflight.timing.pulses.amplitudes import amplitudes_at_times

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.reconstruct.model.light import Diffuse
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.code_clock import CodeClock
    from lightflight.timing.pulses.arrivals import Arrivals

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_PIXEL_BITS = flags.SCREAMING | flags.DEAD | flags.MASKED | flags.SATURATED
"""A pixel with one of these tells nothing about how much light fell on it."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """One recording, calibrated and with its pulses found.

    Attributes
    ----------
    histograms : Histograms
        The counts.
    timing : TimingCalibration
        The clock they are read with.
    arrivals : Arrivals
        Pulses on the clock.
    arrival_ps : array of float, shape (n,)
        Arrival times of `arrivals`, unwrapped by whole laser periods, ps.
    blind : array of bool, shape (rows, cols)
        True where the pixel's counts are not to be used.
    view : int
        Which of the setting's cameras recorded it.
    diffuse : Diffuse or None
        Light that no leg sends straight to a pixel; None: it was not looked for.
    found : array of float, shape (k,)
        Errors of the clock that all its pixels share, as a fit found them, in standard deviations;
        (0,): none was fitted yet.
    """

    histograms: Histograms
    timing: CodeClock
    arrivals: Arrivals
    arrival_ps: Floats
    blind: NDArray[np.bool_]
    view: int = 0
    diffuse: Diffuse | None = None
    found: Floats = field(default_factory=lambda: np.zeros(0))

    def as_counted(self, rows: Indices, cols: Indices, arrival_ps: Floats) -> Floats:
        """Arrival times (n,) as the clock of these pixels counts them, errors found included.

        Codes that are 0.7 % longer than told, as dead ones may make them, are 200 ps in a whole
        period.
        """
        if not self.found.any():
            return arrival_ps
        counted = arrival_ps
        # Errors are told by what was counted: of 200 ps they are themselves off by 3.
        for _ in range(2):
            delay = counted + self.timing.skew_ps[rows, cols]
            columns = self.timing.shared_errors_ps(rows, cols, delay)[0]
            counted = arrival_ps + columns @ self.found[: columns.shape[1]]
        return counted

    @property
    def usable_pulses(self) -> Indices:
        """(n,), rows of `arrivals` that no flag excludes and that have a time."""
        usable = flags.is_usable(self.arrivals.flags) & np.isfinite(self.arrival_ps)
        return np.flatnonzero(usable)

    def pulses_in(self, pulses: Indices, rows: Indices, cols: Indices) -> tuple[Indices, Indices]:
        """Those of some pulses that lie in any of some pixels (n,), and in which of these."""
        place = np.full(self.blind.shape, -1)
        place[rows, cols] = np.arange(len(rows))
        at = place[self.arrivals.row[pulses], self.arrivals.col[pulses]]
        return pulses[at >= 0], at[at >= 0]


def without_pixels(sighting: Sighting, hidden: NDArray[np.bool_]) -> Sighting:
    """The sighting, of which some pixels take no part.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    hidden : array of bool, shape (rows, cols)
        True for those pixels.

    Returns
    -------
    Sighting
        Their pulses are flagged as masked.
    """
    arrivals = sighting.arrivals
    masked = np.where(hidden[arrivals.row, arrivals.col], np.uint32(flags.MASKED), 0)
    bits = (arrivals.flags | masked).astype(np.uint32)
    arrivals = replace(arrivals, flags=bits)
    return replace(sighting, arrivals=arrivals, blind=sighting.blind | hidden)


def first_of_each_view(sightings: Sequence[Sighting]) -> list[Sighting]:
    """Of the recordings of each camera the first: one picture shows what all repeats do."""
    first: dict[int, Sighting] = {}
    for one in sightings:
        first.setdefault(one.view, one)
    return list(first.values())


def blind_pixels(arrivals: Arrivals, timing: CodeClock) -> NDArray[np.bool_]:
    """(rows, cols), True where a pixel screams, is dead, saturated or masked, or has no clock."""
    blind = ~timing.is_known
    bad = (arrivals.flags & np.uint32(_PIXEL_BITS)) != 0
    blind[arrivals.row[bad], arrivals.col[bad]] = True
    return blind


def clock_errors(
    timing: CodeClock,
    rows: Indices,
    cols: Indices,
    near: NDArray[np.bool_],
    state: PathState,
    camera: Camera,
    medium: Medium,
) -> tuple[Floats, Floats]:
    """What a calibration leaves unknown of the pixels near a path, at its light's own times.

    Parameters
    ----------
    timing : CodeClock
        The clock.
    rows : array of int, shape (n,)
        Pixel rows.
    cols : array of int, shape (n,)
        Pixel columns.
    near : array of bool, shape (n, L)
        True where a leg's light can reach the pixel.
    state : PathState
        The path.
    camera : Camera
        The camera that sees it.
    medium : Medium
        Group indices out and back.

    Returns
    -------
    pixel_var : array of float, shape (n,)
        Of each pixel's delay, ps^2.
    modes_ps : array of float, shape (n, L, k)
        One-sigma columns of the errors that all share, ps.
    """
    modes: dict[int, Floats] = {}
    pixel_var = np.zeros(len(rows))
    for k in state.seen:
        print_ = footprints(state, camera=camera, medium=medium, legs=k, rows=rows, cols=cols)
        delay = print_.arrival_ps + timing.skew_ps[rows, cols]
        # A foot far off the leg has no time; any delay serves where the leg is not near.
        delay = np.where(np.isfinite(delay) & near[:, k], delay, np.nanmedian(delay[near[:, k]]))
        pixel_std, columns, _ = timing.arrival_errors_ps(rows, cols, delay)
        pixel_var = np.where(near[:, k], np.maximum(pixel_var, pixel_std**2), pixel_var)
        modes[k] = columns
    none = np.zeros_like(modes[state.seen[0]])
    return pixel_var, np.stack([modes.get(k, none) for k in range(near.shape[1])], axis=1)


@dataclass(frozen=True, eq=False)
class PixelCounts:
    """Counts of some pixels and the delay interval of each of their codes.

    Attributes
    ----------
    counts : array of float, shape (n, codes)
    lower_ps : array of float, shape (n, codes)
        On the delay clock.
    upper_ps : array of float, shape (n, codes)
    skew_ps : array of float, shape (n,)
        Delay of the pixel: delay = arrival + skew.
    """

    counts: Floats
    lower_ps: Floats
    upper_ps: Floats
    skew_ps: Floats


def pixel_counts(sighting: Sighting, rows: Indices, cols: Indices) -> PixelCounts:
    """Counts and code intervals of the pixels named by `rows`, `cols` (n,).

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    rows : array of int, shape (n,)
        Pixel rows.
    cols : array of int, shape (n,)
        Pixel columns.

    Returns
    -------
    PixelCounts
        (n, codes) each.
    """
    hist, timing = sighting.histograms, sighting.timing
    lower, upper = timing.code_intervals_ps(rows, cols)
    counts = hist.counts[rows, cols].astype(float)
    return PixelCounts(counts, lower, upper, timing.skew_ps[rows, cols])


def photons_at_times(
    sighting: Sighting, rows: Indices, cols: Indices, arrival_ps: Floats, std_ps: Floats
) -> tuple[Floats, Floats]:
    """Photons of pulses at known arrival times in each pixel.

    Parameters
    ----------
    rows, cols : array of int, shape (n,)
        Pixels.
    arrival_ps, std_ps : array of float, shape (n, L)
        Pulses looked for; NaN where a pixel has fewer.

    Returns
    -------
    photons : array of float
        (n, L); may be negative by chance.
    empty_variance : array of float, shape (n, L)
        Variance of `photons` without light; images of what no picture shows may be twice as bright
        as they are told, or none.
    """
    pixels = pixel_counts(sighting, rows, cols)
    response = sighting.timing.response
    table = None if response is None else response.table()
    arrival_ps = np.column_stack([sighting.as_counted(rows, cols, one) for one in arrival_ps.T])
    period_ps, other, guessed = sighting.histograms.laser_period_ps, None, None
    if sighting.diffuse is not None:
        skew = pixels.skew_ps[:, np.newaxis]
        intervals = pixels.lower_ps - skew, pixels.upper_ps - skew
        shape = sighting.blind.shape
        about = rows, cols, intervals, period_ps or 0.0
        other = sighting.diffuse.counts(*about, shape)
        other += sighting.diffuse.counts_of_second_pulse(*about, shape)
        guessed = sighting.diffuse.guessed(*about)

    def without(light: Floats | None) -> tuple[Floats, Floats, Floats]:
        return amplitudes_at_times(
            pixels.counts, pixels.lower_ps, pixels.upper_ps, period_ps,
            arrival_ps + pixels.skew_ps[:, np.newaxis], std_ps, light, table=table,
        )  # fmt: skip

    photons, variance, _ = without(other)
    if other is not None and guessed is not None:
        variance = variance + (photons - without(other + guessed)[0]) ** 2
    return photons, variance
