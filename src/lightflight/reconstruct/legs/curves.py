"""Arrival curves: time against place along a line of the picture, and the kinks of corners in them.

Pure functions of places (px), times (ps) and errors (ps).
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_KINK_CHI2 = 30.0
"""A kink must fit better than a smooth curve of as many numbers by this much ..."""
_KINK_SHARE = 0.7
"""... and leave no more than this share of the smooth curve's misfit."""
_KINK_FROM_END_PX = 4.0
"""No kink is looked for nearer to an end: the light of neighbouring legs mixes in there."""


def weights_from_errors(errors: Floats) -> Floats:
    """1 / error, none above five times the median: no single pixel holds a curve alone."""
    weight: Floats = 1.0 / np.maximum(errors, 0.2 * np.median(errors))
    return weight


def kink_place(s: Floats, times: Floats, errors: Floats) -> float | None:
    """Place where the slope of an arrival curve jumps, px; None where a smooth curve does.

    A parabola with a kink is held against a cubic: as many numbers, and the arrival curve of
    straight light is smoother than that over a whole picture.

    Parameters
    ----------
    s, times, errors : array of float, shape (n,)
        Place along the leg, px; arrival time and its error, ps.
    """
    knots = np.arange(s.min() + _KINK_FROM_END_PX, s.max() - _KINK_FROM_END_PX + 1e-9, 1.0)
    if len(knots) == 0 or len(s) < 8:
        return None
    bends = np.maximum(s[:, np.newaxis] - knots, 0.0)
    misfits = _misfits(s, np.column_stack((s**3, bends)), times, errors)
    smooth, kinked = misfits[0], misfits[1:]
    best = int(np.argmin(kinked))
    # Where even the kinked curve misses its errors, so does chance: the gate grows with them.
    scale = max(1.0, kinked[best] / len(s))
    if kinked[best] < min(_KINK_SHARE * smooth, smooth - _KINK_CHI2 * scale):
        return float(knots[best])
    return None


def _misfits(s: Floats, extra: Floats, times: Floats, errors: Floats) -> Floats:
    """Chi-square of the best parabola with each of the columns `extra` (n, k) added; (k,).

    A wild pixel counts as one of five errors at most.
    """
    weight = weights_from_errors(errors)
    # What the parabola takes of times and columns is taken off once for all.
    parabola, _ = np.linalg.qr(polynomial.polyvander(s, 2) * weight[:, np.newaxis])
    left = np.column_stack((times, extra)) * weight[:, np.newaxis]
    size = np.linalg.norm(left, axis=0)
    left -= parabola @ (parabola.T @ left)
    target, columns = left[:, 0], left[:, 1:]
    squared = np.sum(columns**2, axis=0)
    # A column that the parabola holds already (a knot before all places) tells nothing new.
    told = squared > (1e-9 * size[1:]) ** 2
    share = np.where(told, target @ columns / np.where(told, squared, 1.0), 0.0)
    scaled = (target[:, np.newaxis] - columns * share) ** 2
    # Five errors squared, or five times the scatter that is there.
    most = 25.0 * np.maximum(1.0, np.median(scaled, axis=0))
    chi2: Floats = np.minimum(scaled, most).sum(axis=0)
    return chi2
