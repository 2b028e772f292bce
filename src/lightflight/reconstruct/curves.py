"""Arrival curves: time against place along a line of the picture, and the kinks of corners in them.

Pure functions of places (px), times (ps) and errors (ps).
"""

from __future__ import annotations

from typing import Any

import numpy as np
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
    s, times, errors : (n,), place along the leg, px; arrival time and its error, ps.
    """
    knots = np.arange(s.min() + _KINK_FROM_END_PX, s.max() - _KINK_FROM_END_PX + 1e-9, 1.0)
    if len(knots) == 0 or len(s) < 8:
        return None
    parabola = np.polynomial.polynomial.polyvander(s, 2)
    smooth = _misfit(np.polynomial.polynomial.polyvander(s, 3), times, errors)
    costs = [
        _misfit(np.column_stack((parabola, np.maximum(s - knot, 0.0))), times, errors)
        for knot in knots
    ]
    best = int(np.argmin(costs))
    scale = max(1.0, costs[best] / len(s))
    if costs[best] < min(_KINK_SHARE * smooth, smooth - _KINK_CHI2 * scale):
        return float(knots[best])
    return None


def _misfit(design: NDArray[Any], times: Floats, errors: Floats) -> float:
    """Chi-square of the best curve; a wild pixel counts as one of five errors at most."""
    weight = weights_from_errors(errors)
    best = np.linalg.lstsq(design * weight[:, np.newaxis], times * weight, rcond=None)[0]
    scaled = (times - design @ best) * weight
    return float(np.minimum(scaled**2, 25.0 * max(1.0, float(np.median(scaled**2)))).sum())
