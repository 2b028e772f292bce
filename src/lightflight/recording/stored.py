"""What became of counts before they were stored: multiplied, or cut at a largest one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.recording.histograms import Histograms

_FEWEST_VALUES = 64
"""Counts that are multiples of one number by chance: one time in 2^64."""
_FEWEST_DIFFERENT = 8
"""Different counts among them: fewer are no recording, but numbers that somebody made up."""
_AT_ONCE = 256
"""Pixels that are looked at before it is asked whether they tell already."""
_CUT_SHARE = 0.5
"""Of the pixels with the largest count, those where three codes in a row have it: a pulse that is
cut is so over its width, while one that was scaled to the largest reaches it once."""


def common_factor(hist: Histograms) -> int:
    """Largest number that all counts are multiples of; 1 where they are photons, or too few tell.

    Parameters
    ----------
    hist : Histograms
        Counts of any recording.

    Returns
    -------
    int
    """
    factor, told = 0, 0
    pixels = hist.counts.reshape(-1, hist.n_codes) if hist.poisson else np.empty((0, 1), int)
    for first in range(0, len(pixels), _AT_ONCE):
        some = pixels[first : first + _AT_ONCE]
        values = some[some > 0]
        told += len(values)
        # Of most recordings the first pixels hold a single photon.
        factor = int(np.gcd.reduce(values, initial=factor)) if len(values) else factor
        if factor == 1:
            return 1
    if factor < 2 or told < _FEWEST_VALUES:
        return 1
    return factor if len(np.unique(hist.counts)) > _FEWEST_DIFFERENT else 1


def check_photons(hist: Histograms) -> None:
    """Check that counts are of single photons, not multiples of them.

    Parameters
    ----------
    hist : Histograms
        Counts of any recording.

    Raises
    ------
    ValueError
        Where something multiplied them.
    """
    factor = common_factor(hist)
    if factor > 1:
        raise ValueError(
            f"all counts of the recording are multiples of {factor}: something multiplied its "
            f"photons, and errors would be {np.sqrt(factor):.2g} times too small; divide counts by "
            f"{factor}, or pass poisson=False"
        )


def largest_count(hist: Histograms) -> int:
    """Count at which a recording is cut: that of its storage type, or a smaller one where it shows.

    It shows in the pixels that have the largest count: they have it more often than the three
    below it, mostly in several codes in a row. What is not cut thins out towards its brightest.

    Parameters
    ----------
    hist : Histograms
        Counts of any recording.

    Returns
    -------
    int
    """
    counts: NDArray[Any] = hist.counts
    limit = int(np.iinfo(counts.dtype).max)
    if not hist.photon_codes.all():
        counts = counts[..., hist.photon_codes]
    brightest = counts.max(axis=2)
    largest = int(brightest.max())
    if largest in (0, limit):
        return limit
    counts = counts[brightest == largest]
    at = counts == largest
    n_below = np.count_nonzero(counts >= max(largest - 3, 0)) - np.count_nonzero(at)
    in_a_row = (at[:, :-2] & at[:, 1:-1] & at[:, 2:]).any(axis=1)
    # A pulse that is cut has its flanks; counts that are all one number were made.
    in_a_row &= ((counts > 0) & ~at).any(axis=1)
    is_cut = np.count_nonzero(at) > n_below and in_a_row.mean() > _CUT_SHARE
    return largest if is_cut else limit
