"""A camera that ran without the laser's sync: only coarse codes, and no pulse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import CalibrationError
from lightflight.recording.histograms import Histograms

_LARGEST_STEP = 64
_OFF_GRID = 0.2
"""Codes are coarse where those beside the grid hold less than this share of those on it. The code
widths of real clocks alternate by less (PF32: 0.84)."""

_FEWEST_CODES = 6
_FEWEST_COUNTS = 200
_SOME_PIXELS = 1000
"""Of very many pixels: where these have light between the teeth nobody need look at the others."""
_TELL = 10 * _FEWEST_COUNTS
"""Counts of these that tell."""


def coarse_step(hist: Histograms, *, everywhere: bool = False) -> int | None:
    """Step n where nearly all counts sit on every n-th code, over a wide range; None: no such.

    A pulse fills neighbouring codes, even light fills all; both spoil a coarse grid.

    Parameters
    ----------
    hist : Histograms
        Counts of any recording.
    everywhere : bool, optional
        Only where the grid is filled from end to end, as no pulse could fill it, whatever codes a
        clock leaves out.

    Returns
    -------
    int or None
        2 to 64.
    """
    pixels = hist.counts.reshape(-1, hist.n_codes)
    # Of few pixels all are looked at, once.
    for every in sorted({max(1, len(pixels) // _SOME_PIXELS), 1}, reverse=True):
        counts = pixels[::every].sum(axis=0, dtype=np.float64) * hist.photon_codes
        found = _step_of(counts, everywhere=everywhere)
        if found is None and counts.sum() > _TELL:
            break
    return found


def _step_of(counts: NDArray[np.float64], *, everywhere: bool) -> int | None:
    """The same of counts (codes,) of all pixels together."""
    total, n_codes = float(counts.sum()), len(counts)
    if total < _FEWEST_COUNTS or counts.max() > 0.5 * total:
        return None
    # The largest step first: codes on every 8th are on every 4th and 2nd as well.
    for step in range(min(_LARGEST_STEP, n_codes // _FEWEST_CODES), 1, -1):
        on_grid = np.bincount(np.arange(n_codes) % step, counts, minlength=step)
        best = int(np.argmax(on_grid))
        if np.delete(on_grid, best).max() >= _OFF_GRID * on_grid[best]:
            continue
        teeth = counts[best::step]
        filled = np.count_nonzero(teeth > 0.01 * total / _FEWEST_CODES)
        even = np.count_nonzero(teeth > 0.25 * teeth.mean()) > 0.5 * len(teeth)
        if filled >= _FEWEST_CODES and (even or not everywhere):
            return step
    return None


def check_sync(hist: Histograms, *, everywhere: bool = False) -> None:
    """Check that a recording does not look as without sync; see `coarse_step`.

    Parameters
    ----------
    hist : Histograms
        Counts of any recording.
    everywhere : bool, optional
        As `coarse_step`.

    Raises
    ------
    CalibrationError
        Where it does.
    """
    step = coarse_step(hist, everywhere=everywhere)
    if step is not None:
        raise CalibrationError(
            f"the camera ran without sync: no pulse, and only every {step}th code is used; connect "
            "the laser's trigger to the camera's sync input and record again"
        )
