"""Whether the line of a leg has a kink, and where: a score test on the counts of its pixels.

Takes a leg that was fitted as one straight line, gives the chi-square that a kink would gain at
places along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.units import MEDIAN_CHI2

Floats = NDArray[np.float64]

LEAST_TELLING = 0.5
"""Dark pixels agree with any model: those whose photons vary by less (in photons squared) must not
hide that the lit ones do not."""

_PLACES_AT_ONCE = 64
"""Places of a kink that are tried together."""


@dataclass(frozen=True, eq=False)
class Kinkable:
    """A fitted leg, as the test for kinks needs it; n pixels, p parameters of leg and spot.

    Attributes
    ----------
    along_px : array of float, shape (n,)
    by_offset : array of float, shape (n,)
        D ln(expected) / d(distance of the line), per px.
    gradient : array of float, shape (n, p)
        D ln(expected) / d(parameters).
    mean : array of float, shape (n,)
        Expected photons.
    residual : array of float, shape (n,)
        Photons seen beyond those expected.
    variance : array of float, shape (n,)
        Of the photons.
    weights : array of float, shape (n,)
        1, or 0 for pixels left out.
    """

    along_px: Floats
    by_offset: Floats
    gradient: Floats
    mean: Floats
    residual: Floats
    variance: Floats
    weights: Floats


def bends_along(
    leg: Kinkable, span: tuple[float, float], covariance: Floats
) -> tuple[Floats, Floats]:
    """Score test of a kink of a leg's line at places two pixels or more from its ends.

    Parameters
    ----------
    leg : Kinkable
        As it was fitted, without a kink.
    span : (float, float)
        First and last place along its line that the fit covers, px.
    covariance : array of float, shape (p, p)
        Of its parameters.

    Returns
    -------
    places : array of float, shape (b,)
        Along the line, px.
    chi2 : array of float, shape (b,)
        What a kink there would gain, one number each.
    """
    places = np.arange(span[0] + 2.0, span[1] - 1.9, 1.0)
    weight = leg.weights * leg.mean / leg.variance
    chi2 = np.zeros(len(places))
    weighted = leg.gradient * (weight * leg.mean)[:, np.newaxis]
    for first in range(0, len(places), _PLACES_AT_ONCE):
        some = slice(first, first + _PLACES_AT_ONCE)
        beyond = np.maximum(leg.along_px[:, np.newaxis] - places[some], 0)
        kinks = leg.by_offset[:, np.newaxis] * beyond
        score = kinks.T @ (weight * leg.residual)
        crossed = weighted.T @ kinks
        information = (weight * leg.mean) @ kinks**2 - np.sum(crossed * (covariance @ crossed), 0)
        told = information > 1e-12
        chi2[some][told] = score[told] ** 2 / information[told]
    used = (leg.weights > 0) & (leg.variance > LEAST_TELLING)
    scaled = leg.residual[used] ** 2 / leg.variance[used]
    # Judged against the scatter that is there: a bend itself adds to it, so by the median.
    spread = max(1.0, float(np.median(scaled)) / MEDIAN_CHI2) if len(scaled) else 1.0
    return places, chi2 / spread
