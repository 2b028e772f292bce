"""What a pixel sees of a line of light: through the spot of the lens and its own active area.

One owner for the shape of that spot. Where the active area is small beside it the spot is the
lens', a Gaussian. An area that fills the pitch behind a sharp lens makes it a square with soft
edges: then the light falls off beside the line in another way, and a line that passes beside the
centre, neither along a row nor on a diagonal, is seen before or behind its foot, in the rhythm in
which it crosses the rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(10)
"""Places of one side of the active area, on [-1, 1], and their weights: for the sharpest lens that
is believed 1e-3 of the light is misplaced, for one of 0.26 px 1e-9."""
_SHARPEST = 0.3
"""Share of the spot's width that is the lens', at least: a smaller spot has a smaller area."""


@dataclass(frozen=True, eq=False)
class SeenLine:
    """What n pixels see of lines of even light; (n,) each.

    Attributes
    ----------
    log_light : array of float
        Log of the light over that of a pixel on the line, had the same spot been a Gaussian.
    by_across : array of float
        Its derivative by the distance from the line, per px.
    by_log_spot : array of float
        By the log of the spot's standard deviation; the active area stays.
    ahead_px : array of float
        Mean place of the light along the line, from the foot, px.
    ahead_by_across : array of float
        Its derivative by the distance from the line.
    ahead_by_log_spot : array of float
        By the log of the spot's standard deviation, px.
    derived : callable
        Gives `by_area` and `ahead_by_area`, which few ask for.
    """

    log_light: Floats
    by_across: Floats
    by_log_spot: Floats
    ahead_px: Floats
    ahead_by_across: Floats
    ahead_by_log_spot: Floats
    derived: Callable[[], tuple[Floats, Floats]]

    @property
    def by_area(self) -> Floats:
        """Of the light, by the fourth power of the active area's side, px^-4; the spot stays."""
        return self.derived()[0]

    @property
    def ahead_by_area(self) -> Floats:
        """Of the place, by the same, px^-3."""
        return self.derived()[1]


def seen_line(
    across_px: Floats, spot_px: Floats, heading_rad: Floats, *, active_px: float
) -> SeenLine:
    """What pixels see of a line of even light that passes beside their centres.

    Parameters
    ----------
    across_px : array of float, shape (n,)
        Distance of the pixels from the line, to its right.
    spot_px : array of float, shape (n,)
        Standard deviation of the spot, the active area included.
    heading_rad : array of float, shape (n,)
        Direction of flight in the picture, from u to v.
    active_px : float
        Side of the square active area in pitches; 0: the spot is a Gaussian.

    Returns
    -------
    SeenLine
        Of those pixels.

    Notes
    -----
    The active area, of side w, is taken for points e that look through the lens alone, of variance
    g^2 = spot^2 - w^2 / 12: a pixel at y from the line gets the sum of exp(-(y - e_y)^2 / 2 g^2),
    and sees it at the mean of e_s with those weights. To the lowest order in w / spot, with
    u = y / spot and theta the heading, the log of its light is -u^2 / 2 -
    w^4 (3 + cos 4 theta) He_4(u) / (11520 spot^4), ahead of its foot by
    w^4 sin(4 theta) He_3(u) / (2880 spot^3).
    """
    if not active_px:
        return _gaussian(across_px, spot_px, heading_rad)
    free = np.sqrt(12.0 * (1.0 - _SHARPEST**2)) * spot_px
    held = free < active_px
    width = np.minimum(active_px, free)
    lens = np.sqrt(spot_px**2 - width**2 / 12.0)[:, np.newaxis]
    unit_s, unit_y, weights = _area(heading_rad)
    place_s, place_y = width[:, np.newaxis] * unit_s, width[:, np.newaxis] * unit_y
    m = (across_px[:, np.newaxis] - place_y) / lens
    lowest = 0.5 * np.min(m**2, axis=1)
    share = weights * np.exp(lowest[:, np.newaxis] - 0.5 * m**2)
    total = share.sum(axis=1)
    share /= total[:, np.newaxis]

    def mean(values: Floats) -> Floats:
        means: Floats = np.sum(share * values, axis=1)
        return means

    first, second, ahead = mean(m), mean(m**2), mean(place_s)
    lens = lens[:, 0]
    by_across, ahead_by_across = -first / lens, -(mean(place_s * m) - ahead * first) / lens
    wider = (spot_px / lens) ** 2
    # The area cannot be larger than its spot: there both grow together.
    by_spot = np.where(held, -across_px * by_across, 1.0 + (second - 1.0) * wider)
    ahead_by_spot = np.where(
        held,
        ahead - across_px * ahead_by_across,
        (mean(place_s * m**2) - ahead * second) * wider,
    )

    def derived() -> tuple[Floats, Floats]:
        per_lens = (width / (12.0 * lens**2))[:, np.newaxis]
        follows = m * unit_y / lens[:, np.newaxis] - (m**2 - 1.0) * per_lens
        by_width = mean(follows)
        ahead_by_width = ahead / width + mean(place_s * follows) - ahead * by_width
        # Of an area that its spot holds no more can be told.
        per_fourth = np.where(held, 0.0, 0.25 / width**3)
        return per_fourth * by_width, per_fourth * ahead_by_width

    return SeenLine(
        np.log(total * spot_px / lens) - lowest,
        by_across,
        by_spot,
        ahead,
        ahead_by_across,
        ahead_by_spot,
        derived,
    )


def _gaussian(across_px: Floats, spot_px: Floats, heading_rad: Floats) -> SeenLine:
    u, none = across_px / spot_px, np.zeros_like(across_px)
    u2 = u * u

    def derived() -> tuple[Floats, Floats]:
        he4, he3 = (u2 - 6.0) * u2 + 3.0, (u2 - 3.0) * u
        by_area = -(3.0 + np.cos(4.0 * heading_rad)) * he4 / (11520.0 * spot_px**4)
        return by_area, np.sin(4.0 * heading_rad) * he3 / (2880.0 * spot_px**3)

    return SeenLine(-0.5 * u2, -u / spot_px, u2, none, none, none, derived)


def _area(heading_rad: Floats) -> tuple[Floats, Floats, Floats]:
    """Points of an area of side 1, along (n, k) and across (n, k) the lines, and weights (k,)."""
    u, v = (each.ravel() for each in np.meshgrid(0.5 * _NODES, 0.5 * _NODES))
    weights = 0.25 * np.outer(_NODE_WEIGHTS, _NODE_WEIGHTS).ravel()
    ahead, down = np.cos(heading_rad)[:, np.newaxis], np.sin(heading_rad)[:, np.newaxis]
    return u * ahead + v * down, u * down - v * ahead, weights
