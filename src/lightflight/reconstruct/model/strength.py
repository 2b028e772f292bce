"""The strength of the light along a leg: a cubic spline of its logarithm, and the priors on it.

One owner for what `lateral`, `photon` and the bound must agree on: where the knots lie, how a
known strength becomes coefficients, how the spot varies along a leg, and what is believed of it
before any count is seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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

SPOT_VARIES_LN = (0.2, 0.01, 0.001)
"""How far the log of a leg's spot is from that of all, how fast it grows along the leg and how fast
that changes; ln, ln per px, ln per px^2. A lens is sharp at one distance and in the middle of its
field, and a beam widens. Counts of 400 photons a pixel already say more than this."""

_EDGE_PX = 1.0
"""Of either end of a leg's image, px: the centre of no pixel lies beyond, and the spline, which
nothing holds there, has been eight times too bright."""

_KNOWN_LN, _PER_PX = 1.0, 4.0
"""Where its error is larger than this, ln, the strength at the end of a leg is not known. Looked at
so often per px."""

_BRIGHTER_LN = 1.5
"""Nor where it is brighter than any pixel by more than this, ln: one lies within half a pixel
of the line. Beside late light of another leg it has been e^34 for e^10."""

LOG_SPOT_RANGE = (np.log(0.08), np.log(6.0))
"""Log of the least and largest std of a spot that a fit may try, px: beyond these the counts of a
row say nothing more of it, and a step would run away."""


def shares_of_anchors(along_px: Floats, anchors_px: Floats) -> Floats:
    """(n, 2), what a straight line along a leg takes of its values at the two anchors."""
    share = (along_px - anchors_px[0]) / (anchors_px[1] - anchors_px[0])
    return np.column_stack((1 - share, share))


@dataclass(frozen=True, eq=False)
class SpotAlong:
    """How a leg's spot differs from that of all: the log of its std is a parabola along the leg.

    Attributes
    ----------
    anchors_px : array of float, shape (2,)
        Places along the leg's line, px.
    varies_ln : array of float, shape (3,)
        Log of the spot over the common one: at the two anchors, and by how much it is more halfway
        than on the straight line between them.
    """

    anchors_px: Floats
    varies_ln: Floats

    def log_at(self, along_px: Floats) -> Floats:
        """(n,), log of the spot over the common one."""
        log: Floats = self.shares(along_px) @ self.varies_ln
        return log

    def growth_at(self, along_px: Floats) -> Floats:
        """(n,), d ln(spot) / d(along), per px."""
        growth: Floats = self.growth_shares(along_px) @ self.varies_ln
        return growth

    @property
    def precision(self) -> Floats:
        """(3, 3), of what is believed of `varies_ln` before any count is seen."""
        apart = self.anchors_px[1] - self.anchors_px[0]
        told = np.array([[0.5, 0.5, 0.0], [-1.0 / apart, 1.0 / apart, 0.0], [0, 0, 8.0 / apart**2]])
        scaled = told / np.array(SPOT_VARIES_LN)[:, np.newaxis]
        precision: Floats = scaled.T @ scaled
        return precision

    def shares(self, along_px: Floats) -> Floats:
        """(n, 3), what `log_at` takes of `varies_ln`."""
        shares = shares_of_anchors(along_px, self.anchors_px)
        return np.column_stack((shares, 4.0 * shares[:, 0] * shares[:, 1]))

    def growth_shares(self, along_px: Floats) -> Floats:
        """(n, 3), what `growth_at` takes of `varies_ln`, per px."""
        first, last = shares_of_anchors(along_px, self.anchors_px).T
        one = np.ones_like(first)
        apart = self.anchors_px[1] - self.anchors_px[0]
        growth: Floats = np.column_stack((-one, one, 4.0 * (first - last))) / apart
        return growth


def knots_over(low: float, high: float, spacing_px: float = KNOT_SPACING_PX) -> Floats:
    """Knots (k,) of a cubic spline on [low, high] px, fourfold at both ends, evenly spaced."""
    n = max(1, int(np.ceil((high - low) / spacing_px)))
    inner = np.linspace(low, high, n + 1)
    return np.concatenate((np.full(3, low), inner, np.full(3, high)))


def span_of_knots(knots: Floats) -> tuple[float, float]:
    """First and last place, px, that a cubic spline with these knots covers."""
    return knots[3], knots[-4]


def slopes_of_splines(knots: Floats, along_px: Floats) -> Floats:
    """Slope of the spline of each coefficient alone, at places along a line.

    Parameters
    ----------
    knots : array of float, shape (k,)
        Of a cubic spline, px.
    along_px : array of float, shape (n,)

    Returns
    -------
    array of float, shape (n, k - 4)
        Per px; zero outside of the span of the knots.
    """
    low, high = span_of_knots(knots)
    each = BSpline(knots, np.eye(len(knots) - 4), 3).derivative()
    inside = (along_px >= low) & (along_px <= high)
    slopes: Floats = each(np.clip(along_px, low, high)) * inside[:, np.newaxis]
    return slopes


def strength_as_seen(
    spline: BSpline, covariance: Floats, brightest: float, along_px: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Strength of a leg's light at places along its line, also where its picture does not show it.

    Parameters
    ----------
    spline : BSpline
        ln(photons per pixel on the line).
    covariance : array of float, shape (k, k)
        Of its coefficients, ln^2.
    brightest : float
        Photons of the brightest pixel of the picture.
    along_px : array of float, shape (n,)

    Returns
    -------
    strength : array of float, shape (n,)
        Photons per pixel on the line; beyond what is seen, as at the last place that is.
    beyond : array of bool, shape (n,)
    """
    low, high = span_of_knots(spline.t)
    edge = min(_EDGE_PX, 0.5 * (high - low))
    places = np.linspace(low + edge, high - edge, max(2, int(_PER_PX * (high - low))))
    basis = BSpline.design_matrix(places, spline.t, spline.k).toarray()
    variance = np.einsum("nk,kl,nl->n", basis, covariance, basis)
    bright = spline(places) > np.log(brightest) + _BRIGHTER_LN
    known = places[(variance < _KNOWN_LN**2) & ~bright]
    known = known if len(known) else places[[len(places) // 2]]
    seen = np.clip(along_px, known[0], known[-1])
    return np.exp(spline(seen)), seen != along_px


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
