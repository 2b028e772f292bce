"""One recording as the reconstruction sees it: counts, clock, pulses on it, and its camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight._kernels.amplitudes import amplitudes_at_times

if TYPE_CHECKING:
    from lightflight.histogram import Histograms
    from lightflight.timing.arrivals import Arrivals
    from lightflight.timing.calibration import TimingCalibration

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_PIXEL_BITS = flags.SCREAMING | flags.DEAD | flags.MASKED | flags.SATURATED
"""A pixel with one of these tells nothing about how much light fell on it."""


@dataclass(frozen=True, eq=False)
class Observation:
    """One recording, calibrated and with its pulses found."""

    histograms: Histograms
    """The counts."""
    timing: TimingCalibration
    """The clock they are read with."""
    arrivals: Arrivals
    """Pulses on the clock."""
    arrival_ps: Floats
    """(n,), arrival times of `arrivals`, unwrapped by whole laser periods, ps."""
    blind: NDArray[np.bool_]
    """(rows, cols), True where the pixel's counts are not to be used."""
    view: int = 0
    """Which of the setting's cameras recorded it."""


def blind_pixels(arrivals: Arrivals) -> NDArray[np.bool_]:
    """(rows, cols), True where a pixel screams, is dead, saturated or masked."""
    blind = np.zeros(arrivals.shape, dtype=bool)
    bad = (arrivals.flags & np.uint32(_PIXEL_BITS)) != 0
    blind[arrivals.row[bad], arrivals.col[bad]] = True
    return blind


@dataclass(frozen=True, eq=False)
class PixelCounts:
    """Counts of some pixels and the delay interval of each of their codes."""

    counts: Floats
    """(n, codes)."""
    lower_ps: Floats
    """(n, codes), on the delay clock."""
    upper_ps: Floats
    """(n, codes)."""
    skew_ps: Floats
    """(n,), delay of the pixel: delay = arrival + skew."""


def pixel_counts(observation: Observation, rows: Indices, cols: Indices) -> PixelCounts:
    """Counts and code intervals of the pixels named by `rows`, `cols` (n,)."""
    hist, timing = observation.histograms, observation.timing
    lower, upper = timing.code_intervals_ps(rows, cols)
    counts = hist.counts[rows, cols].astype(float)
    return PixelCounts(counts, lower, upper, timing.skew_ps[rows, cols])


def photons_at_times(
    observation: Observation, rows: Indices, cols: Indices, arrival_ps: Floats, std_ps: Floats
) -> tuple[Floats, Floats, Floats]:
    """Photons of pulses at known arrival times in each pixel.

    Parameters
    ----------
    rows, cols : (n,), pixels.
    arrival_ps, std_ps : (n, L), pulses looked for; NaN where a pixel has fewer.

    Returns
    -------
    photons : (n, L); may be negative by chance.
    empty_variance : (n, L), variance of `photons` without light.
    background_per_ps : (n,).
    """
    n, n_pulses = arrival_ps.shape
    photons, empty = np.empty((n, n_pulses)), np.empty((n, n_pulses))
    background = np.empty(n)
    period = observation.histograms.laser_period_ps or 0.0
    tile = max(1, 4_000_000 // observation.histograms.n_codes)
    for first in range(0, n, tile):
        part = slice(first, first + tile)
        pixels = pixel_counts(observation, rows[part], cols[part])
        delays = arrival_ps[part] + pixels.skew_ps[:, np.newaxis]
        amplitudes_at_times(
            pixels.counts,
            pixels.lower_ps,
            pixels.upper_ps,
            period,
            np.ascontiguousarray(delays),
            np.ascontiguousarray(std_ps[part]),
            photons[part],
            empty[part],
            background[part],
        )
    return photons, empty, background
