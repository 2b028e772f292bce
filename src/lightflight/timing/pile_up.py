"""Pile-up: what a camera that sees one photon per frame makes of the light it gets.

With rate L photons per laser period and m periods in a frame, a pixel sees the first photon of
the frame. The period that holds it is one like any other, and ends with it: late photons of a
period are missed with chance 1 - exp(-(rate before them)), whatever m is. How many frames see
none, exp(-m L), tells L. (Coates, J. Phys. E 1, 878 (1968) is the case m = 1.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight._kernels.pile_up import open_shares
from lightflight.histogram import Histograms

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Intervals = tuple[Floats, Floats]

BENT = 0.05
"""Photons per period times the root of the photons beyond which times are corrected: below, a
pulse moves by less than 0.03 of its standard error."""

HIGH_RATE = 0.01
"""Photons per laser period from which pixels are flagged `pile_up`."""


@dataclass(frozen=True, eq=False)
class PileUp:
    """What pile-up does to each pixel; nothing where frames or periods are unknown."""

    rate: Floats
    """(pixels,), photons per laser period; 0 where unknown."""

    trials: Floats
    """(pixels,), laser periods that could have ended with a photon; inf: times need no
    correction."""

    scale: Floats
    """(pixels,), photons that came for each that is counted, the time within a period aside."""


def pile_up_of(hist: Histograms) -> PileUp:
    """Rate, correction and scale of every pixel, from the share of frames with a photon."""
    frames, periods = hist.n_frames, hist.periods_per_frame
    one = np.ones(hist.shape[0] * hist.shape[1])
    none = PileUp(0.0 * one, np.inf * one, one)
    if not hist.poisson or frames is None or periods is None:
        return none
    counts = hist.photons.ravel().astype(np.float64)
    if counts.max() > frames:
        return none
    empty = np.maximum(frames - counts, 0.5) / frames
    rate = -np.log(empty) / periods
    with np.errstate(divide="ignore", invalid="ignore"):
        trials = np.where(counts > 0, counts / -np.expm1(-rate), np.inf)
        # Within a frame the rate per period is the pulse's; both are of all the frame's periods.
        bent = rate * np.sqrt(counts) > BENT
        thinned = np.where(counts > 0, rate * periods * frames / counts, 1.0)
        scale = np.where(bent, frames * periods / trials, thinned)
    return PileUp(rate, np.where(bent, trials, np.inf), scale)


def open_share_of(hist: Histograms, rows: Indices, cols: Indices, intervals: Intervals) -> Floats:
    """Counts in each code per photon that came: (n, codes), or (n, 1) without pile-up.

    `intervals` are the (lower, upper) of the codes of these pixels, (n, codes), ps.
    """
    pile_up = pile_up_of(hist)
    pixels = rows * hist.shape[1] + cols
    scale = pile_up.scale[pixels, np.newaxis]
    if not np.isfinite(pile_up.trials[pixels]).any():
        return np.asarray(1.0 / scale)
    shares = np.empty((len(pixels), hist.n_codes))
    counts = hist.counts[rows, cols].astype(np.float64)
    lower, upper = (np.ascontiguousarray(edge, dtype=np.float64) for edge in intervals)
    period = hist.laser_period_ps or np.inf
    open_shares(counts, lower, upper, period, pile_up.trials[pixels], shares)
    return np.asarray(shares / scale)
