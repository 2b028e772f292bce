"""A camera that ran without the laser's sync: only coarse codes, and no pulse."""

from __future__ import annotations

import numpy as np

from lightflight.errors import CalibrationError
from lightflight.recording.histograms import Histograms

_LARGEST_STEP = 64
_COARSE_SHARE = 0.9
"""Share of the counts on every n-th code from which codes are called coarse."""

_FEWEST_CODES = 6
_FEWEST_COUNTS = 200


def coarse_step(hist: Histograms) -> int | None:
    """Step n where nearly all counts sit on every n-th code, over a wide range; None: no such.

    A pulse fills neighbouring codes, even light fills all; both spoil a coarse grid.

    Parameters
    ----------
    hist : Histograms
        Counts of any recording.

    Returns
    -------
    int or None
        2 to 64.
    """
    counts = hist.counts.sum(axis=(0, 1), dtype=np.float64) * hist.photon_codes
    total = float(counts.sum())
    if total < _FEWEST_COUNTS or counts.max() > 0.5 * total:
        return None
    # The largest step first: codes on every 8th are on every 4th and 2nd as well.
    for step in range(min(_LARGEST_STEP, hist.n_codes // _FEWEST_CODES), 1, -1):
        on_grid = np.bincount(np.arange(hist.n_codes) % step, counts, minlength=step)
        best = int(np.argmax(on_grid))
        filled = np.count_nonzero(counts[best::step] > 0.01 * total / _FEWEST_CODES)
        if on_grid[best] > _COARSE_SHARE * total and filled >= _FEWEST_CODES:
            return step
    return None


def check_sync(hist: Histograms) -> None:
    """Check that a recording does not look as without sync; see `coarse_step`.

    Parameters
    ----------
    hist : Histograms
        Counts of any recording.

    Raises
    ------
    CalibrationError
        Where it does.
    """
    step = coarse_step(hist)
    if step is not None:
        raise CalibrationError(
            f"the camera ran without sync: no pulse, and only every {step}th code is used; connect "
            "the laser's trigger to the camera's sync input and record again"
        )
