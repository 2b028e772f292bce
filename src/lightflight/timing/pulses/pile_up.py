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

from lightflight.recording.histograms import Histograms
from lightflight.timing.pulses.bins import bins_of, open_share

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
    """What pile-up does to each pixel; nothing where frames or periods are unknown.

    Attributes
    ----------
    rate : array of float, shape (pixels,)
        Photons per laser period; 0 where unknown.
    trials : array of float, shape (pixels,)
        Laser periods that could have ended with a photon; inf: times need no correction.
    scale : array of float, shape (pixels,)
        Photons that came for each that is counted, the time within a period aside.
    """

    rate: Floats

    trials: Floats

    scale: Floats


def pile_up_of(hist: Histograms) -> PileUp:
    """Rate, correction and scale of every pixel, from the share of frames with a photon.

    Parameters
    ----------
    hist : Histograms
        Counts with `n_frames` and `periods_per_frame`, where they are known.

    Returns
    -------
    PileUp
        Rate L = -log(1 - counts / frames) / periods of each pixel, and what follows from it.
    """
    frames, periods = hist.n_frames, hist.periods_per_frame
    one = np.ones(hist.shape[0] * hist.shape[1])
    none = PileUp(0.0 * one, np.inf * one, one)
    if not hist.poisson or frames is None or periods is None:
        return none
    counts = hist.photons.ravel().astype(np.float64)
    # More photons than frames: the camera keeps several per frame, and hides none.
    if counts.max() > frames:
        return none
    # A pixel that fires in every frame still has a finite rate: half a frame is left empty.
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

    Parameters
    ----------
    hist : Histograms
        Counts.
    rows, cols : array of int, shape (n,)
        Pixels that are asked for.
    intervals : (array of float, array of float), each of shape (n, codes)
        Where the codes of these pixels begin and end, ps.

    Returns
    -------
    array of float, shape (n, codes) or (n, 1)
        Of the photons that fall into the code, the share that is counted.
    """
    pile_up = pile_up_of(hist)
    pixels = rows * hist.shape[1] + cols
    scale = pile_up.scale[pixels, np.newaxis]
    if not np.isfinite(pile_up.trials[pixels]).any():
        return np.asarray(1.0 / scale)
    trials = pile_up.trials[pixels]
    never, none = np.full(len(pixels), np.inf), np.zeros((len(pixels), 2))
    period = hist.laser_period_ps or np.inf
    bins = bins_of(hist.counts[rows, cols], *intervals, period, never, none)
    bent = np.isfinite(trials)
    row, k = np.nonzero((bins.code >= 0) & bent[:, np.newaxis])
    shares = np.ones((len(pixels), hist.n_codes))
    share = np.ones(bins.counts.shape)
    # A period shows its first photon only: a late code is reached by periods that none has ended.
    share[bent] = open_share(bins.counts[bent], trials[bent, np.newaxis])
    shares[row, bins.code[row, k]] = share[row, k]
    return np.asarray(shares / scale)
