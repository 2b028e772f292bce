"""Where a photon is caught: lens blur and the pixels' active areas.

A point imaged at (row, col) is blurred by a Gaussian; a pixel catches what falls on its active
square. Both are separable, so along one axis a pixel whose centre is `d` away catches

    P(d) = Phi((d + h) / s) - Phi((d - h) / s),  h = half the active width, s = blur,

all in pixels. `caught_fraction` sums P over the pixels of an axis; `draw_pixels` draws which
pixel caught a photon that *was* caught: nothing is drawn and thrown away, although a PF32
catches 1.5 % of the light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

_REACH_STD = 6.0
"""Light further out than this is not followed: 2e-9 of it."""

_TABLE_STEPS = 4096
"""Positions within a pixel for which the choice is tabulated: 1/8192 px of rounding."""


@dataclass(frozen=True)
class Catch:
    """Blur and active area of one kind of pixel.

    Attributes
    ----------
    psf_std_px : float
        Standard deviation of the lens blur, pixel.
    active_width_px : float
        Width of the square active area, pixel (1: no gaps).
    """

    psf_std_px: float

    active_width_px: float

    @property
    def reach_px(self) -> int:
        """Pixels on either side of the nearest one that can catch the light of a point."""
        reach = _REACH_STD * self.psf_std_px + 0.5 * self.active_width_px - 0.5
        return max(1, math.ceil(reach))

    def probability(self, distance_px: ArrayLike) -> Floats:
        """P(d): share of the light of a point that a pixel catches, along one axis.

        Parameters
        ----------
        distance_px : array-like, shape (...)
            d, from the pixel's centre to the point, pixel.

        Returns
        -------
        array of float, shape (...)
            0 to 1.

        Examples
        --------
        >>> Catch(psf_std_px=0.1, active_width_px=1.0).probability([0.0, 0.5, 1.0]).round(3)
        array([1. , 0.5, 0. ])
        """
        # Imported here: every command reads the keys of a set-up, the detector's among them.
        from scipy.special import ndtr

        d = np.abs(np.asarray(distance_px, dtype=float))
        half = 0.5 * self.active_width_px
        # of the two equal forms, the one whose terms are small far out keeps its digits
        share: Floats = ndtr((half - d) / self.psf_std_px) - ndtr((-half - d) / self.psf_std_px)
        return share

    def neighbours(self, position_px: Floats, n_pixels: int) -> tuple[NDArray[np.int64], Floats]:
        """The pixels near each position, and what they catch of its light.

        Parameters
        ----------
        position_px : array of float, shape (n,)
            Image of a point along one axis, pixel.
        n_pixels : int
            Pixels along the axis.

        Returns
        -------
        pixel : array of int, shape (n, 2 reach + 1)
            Clipped to the rim of the array.
        share : array of float, shape (n, 2 reach + 1)
            See `probability`; 0 for pixels outside the array.
        """
        nearest = np.rint(position_px).astype(np.int64)
        offsets = np.arange(-self.reach_px, self.reach_px + 1)
        pixel = nearest[:, np.newaxis] + offsets
        share = self.probability(position_px[:, np.newaxis] - pixel)
        share[(pixel < 0) | (pixel >= n_pixels)] = 0.0
        return np.clip(pixel, 0, n_pixels - 1), share

    def caught_fraction(self, position_px: ArrayLike, n_pixels: int) -> Floats:
        """Share of the light of a point that any pixel in a line catches.

        Parameters
        ----------
        position_px : array-like, shape (n,)
            Image of the point along one axis, pixel.
        n_pixels : int
            Pixels along the axis.

        Returns
        -------
        array of float, shape (n,)
            0 where the position is NaN.
        """
        position = np.asarray(position_px, dtype=float)
        total = np.zeros(position.shape)
        margin = self.reach_px + 0.5
        with np.errstate(invalid="ignore"):
            near = (position > -0.5 - margin) & (position < n_pixels - 0.5 + margin)
        total[near] = self.neighbours(position[near], n_pixels)[1].sum(axis=1)
        return total

    @property
    def most_caught(self) -> float:
        """Upper bound of `caught_fraction`, for any position."""
        position = np.linspace(-0.5, 0.5, 257)
        pixel = np.arange(-self.reach_px - 1, self.reach_px + 2)
        total = self.probability(position[:, np.newaxis] - pixel).sum(axis=1)
        return float(total.max()) * (1.0 + 1e-4)

    def choice_table(self) -> Floats:
        """What `draw_pixels` looks a photon's pixel up in.

        Returns
        -------
        array of float, shape (4096, 2 reach + 2)
            Running sums of P over the offsets, per position within a pixel.
        """
        fraction = (np.arange(_TABLE_STEPS) + 0.5) / _TABLE_STEPS - 0.5
        offsets = np.arange(-self.reach_px, self.reach_px + 1)
        share = self.probability(fraction[:, np.newaxis] - offsets)
        return np.concatenate((np.zeros((_TABLE_STEPS, 1)), np.cumsum(share, axis=1)), axis=1)

    def draw_pixels(
        self, position_px: Floats, n_pixels: int, *, table: Floats, uniform: Floats
    ) -> NDArray[np.int64]:
        """The pixel that caught each photon, given that one of them did.

        Parameters
        ----------
        position_px : array of float, shape (n,)
            Image of the photon's origin along one axis, pixel.
        n_pixels : int
            Pixels along the axis.
        table : array of float
            From `choice_table`.
        uniform : array of float, shape (n,)
            Random numbers in [0, 1).

        Returns
        -------
        array of int, shape (n,)
            Along the axis.
        """
        reach = self.reach_px
        nearest = np.floor(position_px + 0.5)
        step = ((position_px - nearest + 0.5) * _TABLE_STEPS).astype(np.int64)
        np.clip(step, 0, _TABLE_STEPS - 1, out=step)
        nearest = nearest.astype(np.int64)
        width = 2 * reach + 2
        flat = table.ravel()
        place = step * width
        # the window of offsets that lie in the array: all of them but near the rim
        first = np.clip(reach - nearest, 0, width - 1)
        last = np.clip(n_pixels - 1 - nearest + reach + 1, 0, width - 1)
        low = flat[place + first]
        threshold = low + uniform * (flat[place + last] - low)
        offset = np.zeros(len(position_px), dtype=np.int64)
        for k in range(1, width - 1):
            offset += threshold >= flat[place + k]
        pixel = nearest + offset - reach
        return np.clip(pixel, 0, n_pixels - 1, out=pixel)
