"""The strength of the light along a leg: a cubic spline of its logarithm, and the priors on it.

One owner for what `lateral`, `photon` and the bound must agree on: where the knots lie, how a
known strength becomes coefficients, and what is believed of the spot before any count is seen.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

Floats = NDArray[np.float64]

KNOT_SPACING_PX = 3.0
"""Distance between knots of the log-strength along a leg, px."""

DENSE_KNOT_SPACING_PX = 1.5
"""The same where the counts show that the light changes faster, px: a spot of a usual width hides
what changes faster still, and the waves that it leaves are for `fit.uneven`."""

SPOT_PRIOR = (np.log(0.4), 0.8)
"""Log of the spot's std in px and its width, where too few rows are lit to see it."""

LOG_SPOT_RANGE = (np.log(0.08), np.log(6.0))
"""Log of the least and largest std of a spot that a fit may try, px: beyond these the counts of a
row say nothing more of it, and a step would run away."""


def knots_over(low: float, high: float, spacing_px: float = KNOT_SPACING_PX) -> Floats:
    """Knots (k,) of a cubic spline on [low, high] px, fourfold at both ends, evenly spaced."""
    n = max(1, int(np.ceil((high - low) / spacing_px)))
    inner = np.linspace(low, high, n + 1)
    return np.concatenate((np.full(3, low), inner, np.full(3, high)))


def span_of_knots(knots: Floats) -> tuple[float, float]:
    """First and last place, px, that a cubic spline with these knots covers."""
    return knots[3], knots[-4]


def strength_spline(
    low: float,
    high: float,
    log_strength: Callable[[Floats], Floats],
    *,
    spacing_px: float = KNOT_SPACING_PX,
) -> tuple[Floats, Floats]:
    """Knots and coefficients of the spline nearest to a known log-strength on [low, high].

    Parameters
    ----------
    low, high : float
        Where the leg's image begins and ends along its line, px.
    log_strength : callable
        ln(photons per pixel on the line) at places (g,) along it, px.
    spacing_px : float, optional
        Largest distance of the knots, px.

    Returns
    -------
    knots : array of float, shape (k,)
        By `knots_over`, px.
    coefficients : array of float, shape (k - 4,)
        Least-squares coefficients, ln.
    """
    knots = knots_over(low, high, spacing_px)
    # Four points per coefficient and more: enough for the shape, whatever lies between them.
    grid = np.linspace(low, high, 12 * (len(knots) - 6))
    design = BSpline.design_matrix(grid, knots, 3).toarray()
    coefficients = np.linalg.lstsq(design, log_strength(grid), rcond=None)[0]
    return knots, coefficients.astype(np.float64, copy=False)
