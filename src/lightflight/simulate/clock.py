"""The true clock: which TDC code a photon gets in which pixel.

A pixel's TDC counts in codes of unequal width. Code k of pixel p covers

    w_p phase_p[k mod n] start[k - k1]        (start = 1 but for the first few live codes)

picoseconds of the interval s it measures: from the laser sync to the photon for a forward
clock, from the photon to the next sync for a reversed one. Edges follow in closed form from a
few numbers per pixel; no table of pixels x codes is kept.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LOST = -1
"""Stands for "the photon got no code": it fell on dead time or outside the range."""


@dataclass(frozen=True, eq=False)
class TrueClock:
    """Code edges of every pixel; pixels are numbered row by row.

    Attributes
    ----------
    n_codes : int
        Number of TDC codes.
    laser_period_ps : float or None
        Period of the laser, ps; None: one sweep.
    reversed_codes : bool
        True where the photon starts the clock and the sync stops it.
    first_edge_ps : float
        Interval at which the first code starts, ps.
    first_live_code : int
        k1: codes below are dead.
    width_ps : array of float, shape (pixels,)
        w: width of a plateau code, ps.
    phases : array of float, shape (pixels, n)
        Relative widths of the codes modulo n; mean 1.
    start_widths : array of float, shape (n_start,)
        Extra factor on the widths of the first live codes.
    dead_time_is_lost : bool
        True: photons in the time of the dead codes get no code. False: the live ones share it.
    """

    n_codes: int

    laser_period_ps: float | None

    reversed_codes: bool

    first_edge_ps: float

    first_live_code: int

    width_ps: Floats

    phases: Floats

    start_widths: Floats

    dead_time_is_lost: bool

    _phase_sums: Floats = field(init=False, repr=False)
    _start_excess: Floats = field(init=False, repr=False)
    _base: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        n_pixels, n = self.phases.shape
        sums = np.zeros((n_pixels, n + 1))
        np.cumsum(self.phases, axis=1, out=sums[:, 1:])
        object.__setattr__(self, "_phase_sums", sums)
        k1 = self.first_live_code
        start_codes = (k1 + np.arange(len(self.start_widths))) % n
        excess = np.zeros((n_pixels, len(self.start_widths) + 1))
        np.cumsum(self.phases[:, start_codes] * (self.start_widths - 1), axis=1, out=excess[:, 1:])
        object.__setattr__(self, "_start_excess", excess)
        before = (k1 // n) * n + sums[:, k1 % n]
        lost = np.maximum(before - excess[:, -1], 0.0) if self.dead_time_is_lost else 0.0 * before
        # edge(k) = base + w (sum of phases below k + excess of the start codes below k)
        object.__setattr__(self, "_base", self.first_edge_ps + self.width_ps * (lost - before))

    def _lower_edges(self, pixel: Ints, code: Ints) -> Floats:
        """Interval s at which a code of a pixel starts; `code` >= k1; broadcast; ps."""
        n = self.phases.shape[1]
        rest = code % n
        # Past the first few live codes, all of their excess has been added up.
        start = np.minimum(code - self.first_live_code, self._start_excess.shape[1] - 1)
        codes = (code - rest) + self._phase_sums[pixel, rest] + self._start_excess[pixel, start]
        edges: Floats = self._base[pixel] + self.width_ps[pixel] * codes
        return edges

    def edges_ps(self, pixels: ArrayLike) -> Floats:
        """Edges of all codes on the axis of the measured interval s; (n, codes + 1), ps.

        Ascending. A dead code has zero width, and no code reaches beyond one period.

        Parameters
        ----------
        pixels : array-like, shape (n,)
            Pixels, numbered row by row.

        Returns
        -------
        array of float, shape (n, codes + 1)
            ps.
        """
        pixel = np.atleast_1d(np.asarray(pixels, dtype=np.int64))[:, np.newaxis]
        code = np.arange(self.n_codes + 1)[np.newaxis, :]
        edges = self._lower_edges(pixel, np.maximum(code, self.first_live_code))
        if self.laser_period_ps is not None:
            np.minimum(edges, self.first_edge_ps + self.laser_period_ps, out=edges)
        return edges

    def intervals_ps(self, pixels: ArrayLike) -> tuple[Floats, Floats]:
        """True delay interval of each code, not folded.

        Parameters
        ----------
        pixels : array-like, shape (n,)
            Pixels, numbered row by row.

        Returns
        -------
        lower, upper : array of float, shape (n, codes)
            Delay after the sync, ps.
        """
        edges = self.edges_ps(pixels)
        if not self.reversed_codes:
            return edges[:, :-1].copy(), edges[:, 1:].copy()
        assert self.laser_period_ps is not None
        delays = self.laser_period_ps - edges
        return delays[:, 1:].copy(), delays[:, :-1].copy()

    def intervals_of_codes(self, pixel: Ints, code: Ints) -> tuple[Floats, Floats]:
        """True delay interval of one code of each pixel.

        Parameters
        ----------
        pixel : array of int, shape (n,)
            Pixels, numbered row by row.
        code : array of int, shape (n,)
            A code of each.

        Returns
        -------
        lower, upper : array of float, shape (n,)
            Delay after the sync, ps.
        """
        lower, upper = self._lower_edges(pixel, code), self._lower_edges(pixel, code + 1)
        if self.laser_period_ps is None:
            return lower, upper
        end = self.first_edge_ps + self.laser_period_ps
        lower, upper = np.minimum(lower, end), np.minimum(upper, end)
        if not self.reversed_codes:
            return lower, upper
        return self.laser_period_ps - upper, self.laser_period_ps - lower

    def interval_from_delay(self, delay_ps: Floats) -> Floats:
        """The interval s the TDC measures for photons at delays after the sync.

        Parameters
        ----------
        delay_ps : array of float, shape (n,)
            Delay after the sync, ps.

        Returns
        -------
        array of float, shape (n,)
            From the first edge to one period later, ps; without a period, the delay.
        """
        if self.laser_period_ps is None:
            return delay_ps
        period, first = self.laser_period_ps, self.first_edge_ps
        unfolded = -delay_ps if self.reversed_codes else delay_ps
        interval: Floats = first + np.mod(unfolded - first, period)
        return interval

    def codes_from_delays(self, pixel: Ints, delay_ps: Floats) -> Ints:
        """TDC codes of photons.

        Parameters
        ----------
        pixel : array of int, shape (n,)
            Pixel of each photon, numbered row by row.
        delay_ps : array of float, shape (n,)
            Delay after the sync, the pixel's own delay in it, ps.

        Returns
        -------
        array of int, shape (n,)
            `LOST` where a photon gets none.

        Raises
        ------
        RuntimeError
            Where the code is farther from the guess than any clock of `Detector` allows.
        """
        interval = self.interval_from_delay(delay_ps)
        n = self.phases.shape[1]
        # a guess from the mean width, then a step where the true edges say so
        guess = (interval - self._base[pixel]) / self.width_ps[pixel]
        guess -= self._start_excess[pixel, -1]
        code = np.clip(guess, self.first_live_code, self.n_codes).astype(np.int64)
        pending = np.arange(len(code))
        # Bounded: where phases are far from even, a guess may be many codes off.
        for _ in range(4 * n + 2 * len(self.start_widths) + 8):
            step = self._step_towards(interval[pending], pixel[pending], code[pending])
            moved = step != 0
            pending = pending[moved]
            if not len(pending):
                break
            code[pending] += step[moved]
        else:
            raise RuntimeError("a code search did not end: the phases are far from even")
        first = np.flatnonzero(code == self.first_live_code)
        too_early = interval[first] < self._lower_edges(pixel[first], code[first])
        code[first[too_early]] = LOST
        code[code >= self.n_codes] = LOST
        return code

    def _step_towards(self, interval: Floats, pixel: Ints, code: Ints) -> Ints:
        """+1 where a code ends before the interval, -1 where it starts after it, else 0."""
        above = (interval >= self._lower_edges(pixel, code + 1)) & (code < self.n_codes)
        below = (interval < self._lower_edges(pixel, code)) & (code > self.first_live_code)
        return above.astype(np.int64) - below
