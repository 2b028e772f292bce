"""How a pulse lies in time: as the detector makes it, and drawn out by flight through a footprint.

A Gaussian that flight draws out is a wider one. Any other shape must not be stretched for it: its
tail stays as long as the detector makes it. It is spread as heat is, F_f = F * N(0, 2 f), by half
the variance f that flight adds: tables for a few f, and what lies between two of them on a line.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

if TYPE_CHECKING:
    from lightflight.timing.clock.response import Response

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_REACH_STDS = 5.0
"""Beyond so many standard deviations of flight there is less of a pulse than counts can show."""
_APART = 0.12
"""Between neighbouring tables, in the variance of the narrowest part of a pulse: between them the
share of photons at another time than they are is 0.2 of the square of this at most, 0.3 %."""
_LEAST_TOP = 0.1
"""Half a variance that tables reach to, at least: flight may be more than was expected."""
_MORE = 1.6
"""... and so many times the largest that is expected."""
_LEAST_VARIANCE = 0.1
"""Of a pulse, in that without flight: what counts say of flight may be less than none."""
_MOST_DRAWN_OUT = 8.0
"""Pulses wider than so many times their own width are stretched beyond that."""
_COME, _DENSITY, _FIRST, _SECOND, _THIRD, _FOURTH = range(6)
"""Rows of a table: the share that has come, and the density with its derivatives."""


@dataclass(frozen=True, eq=False)
class _Tables:
    """The shape spread by each of a few flights.

    Attributes
    ----------
    first, step : float
        Places, in standard deviations of the pulse without flight.
    flights : array of float, shape (k,)
        Ascending from 0.
    rows : array of float, shape (k, 6, m)
        Share that has come, density and its four first derivatives.
    """

    first: float
    step: float
    flights: Floats
    rows: Floats

    def at(self, z: Floats, flight: Floats, row: int) -> Floats:
        """One row, linear in place and flight; beyond the ends of the table as at the ends."""
        place, i = self._places(z)
        lower, upper = (
            values + place * (following - values)
            for values, following in self._neighbours(i, flight, row)
        )
        out: Floats = lower + self._part(flight) * (upper - lower)
        return out

    def come_and_density(self, z: Floats, flight: Floats) -> tuple[Floats, Floats]:
        """Share that has come, to the second order between two places, and density."""
        part, i = self._places(z)
        share, density = [], []
        for come, dense in zip(
            self._neighbours(i, flight, _COME), self._neighbours(i, flight, _DENSITY), strict=True
        ):
            here = dense[0] + part * (dense[1] - dense[0])
            share.append(come[0] + 0.5 * part * self.step * (dense[0] + here))
            density.append(here)
        between = self._part(flight)
        return (
            share[0] + between * (share[1] - share[0]),
            density[0] + between * (density[1] - density[0]),
        )

    def _places(self, z: Floats) -> tuple[Floats, Indices]:
        place = np.clip((z - self.first) / self.step, 0.0, self.rows.shape[2] - 1.0)
        i = np.minimum(place.astype(np.int64), self.rows.shape[2] - 2)
        return place - i, i

    def _below(self, flight: Floats) -> Indices:
        last = max(len(self.flights) - 2, 0)
        return np.clip(np.searchsorted(self.flights, flight, side="right") - 1, 0, last)

    def _part(self, flight: Floats) -> Floats:
        """How far between two tables; a little less than no flight is told by the first two."""
        if len(self.flights) == 1:
            return np.zeros_like(flight)
        j = self._below(flight)
        gap = self.flights[j + 1] - self.flights[j]
        part: Floats = np.clip((flight - self.flights[j]) / gap, -1.0, 1.0)
        return part

    def _neighbours(self, i: Indices, flight: Floats, row: int) -> list[tuple[Floats, Floats]]:
        """A row at a place and the next one, in the table below the flight and in that above."""
        j, n = self._below(flight), self.rows.shape[2]
        flat = self.rows[:, row].ravel()
        tables = [j, np.minimum(j + 1, len(self.flights) - 1)]
        starts = [table * n + i for table in tables]
        return [(flat.take(start), flat.take(start + 1)) for start in starts]


def _tables(table: Floats, top: float) -> _Tables:
    """Tables of a shape for half variances up to `top`; 0: its own alone."""
    # A third of the time that importing `reconstruct` takes, and few clocks have a table.
    from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

    place, come, density = table
    step = float(place[1] - place[0])
    core2 = _steepest_std(place, density) ** 2
    flights = [0.0]
    while flights[-1] < top:
        flights.append(flights[-1] + _APART * (core2 + 2.0 * flights[-1]))
    more = int(np.ceil(_REACH_STDS * np.sqrt(2.0 * flights[-1]) / step))
    size = next_fast_len(len(place) + 2 * more, real=True)
    waves = rfft(np.pad(density, (more, size - len(place) - more)))
    turns = 2.0 * np.pi * rfftfreq(size, step)
    n = len(place) + 2 * more
    spread = [np.pad(density, more)] + [
        irfft(waves * np.exp(-flight * turns**2), size)[:n] for flight in flights[1:]
    ]
    own = np.pad(come, more, constant_values=(0.0, come[-1]))
    rows = [_rows(own if k == 0 else None, each, step) for k, each in enumerate(spread)]
    return _Tables(float(place[0]) - more * step, step, np.array(flights), np.stack(rows))


def _steepest_std(place: Floats, density: Floats) -> float:
    """From the top of a pulse to where its steeper side is as low as a Gaussian after one std."""
    top, low = int(np.argmax(density)), np.exp(-0.5) * density.max()
    before = place[top] - np.interp(low, density[: top + 1], place[: top + 1])
    after = np.interp(-low, -density[top:], place[top:]) - place[top]
    return float(max(min(before, after), place[1] - place[0]))


def _rows(come: Floats | None, density: Floats, step: float) -> Floats:
    """(6, m), all that is looked up of one table; its share that has come where that is known."""
    if come is None:
        come = np.append(0.0, np.cumsum(0.5 * step * (density[1:] + density[:-1])))
        come, density = come / come[-1], density / come[-1]
    # Nothing comes before the first place, nor after the last.
    density = np.where(np.arange(len(density)) % (len(density) - 1) == 0, 0.0, density)
    rows = [come, density]
    for _ in range(_FOURTH - _DENSITY):
        rows.append(np.gradient(rows[-1], step))
    return np.stack(rows)


@dataclass(frozen=True, eq=False)
class Shape:
    """How pulses lie about their place, in their own standard deviations.

    Attributes
    ----------
    table : array of float, shape (3, m)
        Of the flat's pulse (`timing.response.Response.table`): place, share before it, density;
        (3, 0): a Gaussian.
    flight : array of float, shape (n, s), or None
        Half the variance that flight through the footprint adds to each pulse of n pixels, in the
        pulse's own; always None for a Gaussian, whose standard deviation holds it. None: nothing.
    """

    table: Floats
    flight: Floats | None = None
    _drawn: _Tables | None = None

    @property
    def is_gaussian(self) -> bool:
        """Whether flight makes it wider, and no other shape of it."""
        return not self.table.size

    def drawn_out(self, flight: Floats) -> Shape:
        """The shape in pixels (n,) with legs (s,) after so much flight (n, s); NaN: none."""
        if self.is_gaussian:
            return self
        flight = np.nan_to_num(flight)
        top = max(_MORE * float(flight.max(initial=0.0)), _LEAST_TOP)
        return replace(self, flight=flight, _drawn=_tables(self.table, top))

    def with_more(self, more: Floats) -> Shape:
        """The same with so much more flight (n, s)."""
        return self if self.flight is None else replace(self, flight=self.flight + more)

    def of(self, pixels: Indices | NDArray[np.bool_], leg: int | None = None) -> Shape:
        """That of some pixels, and of one leg in each, (k, 1)."""
        if self.flight is None:
            return self
        own = self.flight[pixels]
        return replace(self, flight=own if leg is None else own[:, leg : leg + 1])

    def drawn_out_ps(self, std_ps: Floats) -> Floats:
        """Standard deviation of pulses (n, s) with what flight adds, ps."""
        if self.flight is None:
            return std_ps
        wider: Floats = std_ps * np.sqrt(np.maximum(1.0 + 2.0 * self.flight, _LEAST_VARIANCE))
        return wider

    @cached_property
    def _tables(self) -> _Tables:
        return _tables(self.table, 0.0) if self._drawn is None else self._drawn

    @cached_property
    def _flight(self) -> Floats:
        return np.zeros(()) if self.flight is None else self.flight

    def at(self, z: Floats) -> tuple[Floats, Floats]:
        """Share of a pulse that came before places (k, m), in standard deviations, and density."""
        if self.is_gaussian:
            return ndtr(z), np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
        return self._tables.come_and_density(z, self._flight)

    def come(self, z: Floats) -> Floats:
        """The first of `at`, alone."""
        return np.asarray(ndtr(z)) if self.is_gaussian else self.at(z)[0]

    def widening(self, z: Floats) -> Floats:
        """What flight adds to `come`, per half its variance in the pulse's own."""
        return self._tables.at(z, self._flight, _FIRST)

    def unevenly(
        self, z: Floats, density: Floats, skewness: Floats, kurtosis: Floats
    ) -> tuple[Floats, Floats]:
        """What `at` gains where flight adds a third and a fourth cumulant (Gram-Charlier).

        `density` as `at` tells it.
        """
        if self.is_gaussian:
            # Products: NumPy raises to the third and fourth power forty times as slowly.
            squared = z * z
            second, third = (squared - 1.0) * density, (3.0 - squared) * z * density
            fourth = ((squared - 6.0) * squared + 3.0) * density
        else:
            second, third, fourth = (
                self._tables.at(z, self._flight, row) for row in (_SECOND, _THIRD, _FOURTH)
            )
        skewed, flat = -skewness / 6.0, kurtosis / 24.0
        return skewed * second + flat * third, skewed * third + flat * fourth

    def kept_back(self, z: Floats, ratio: Floats) -> Floats:
        """Share of the pulse that exponential waits of std / `ratio` still keep back at `z`.

        A tabulated shape is drawn out once, by the median of the ratios: its waits are stretched
        with it from pixel to pixel.
        """
        if self.is_gaussian:
            # Where the exponential is large the share below it is nothing: the product is finite.
            kept: Floats = 0.5 * ratio - z
            kept *= ratio
            np.minimum(kept, 500.0, out=kept)
            np.exp(kept, out=kept)
            kept *= ndtr(z - ratio)
            return kept
        if not np.size(ratio):
            return np.zeros_like(z)
        # As in `_tables`.
        from scipy.signal import lfilter

        tables, middle = self._tables, float(np.median(ratio))
        step = middle * tables.step
        come = np.diff(tables.rows[:, _COME], prepend=0.0, axis=1) * (-np.expm1(-step) / step)
        waiting = lfilter([1.0], [1.0, -np.exp(-step)], come, axis=1)
        last = tables.first + tables.step * (waiting.shape[1] - 1)
        after = np.exp(-middle * np.maximum(z - last, 0.0))
        kept_at = replace(tables, rows=waiting[:, np.newaxis])
        drawn_out: Floats = kept_at.at(z, self._flight, 0) * after
        return drawn_out


def tables_for_counts(
    response: Response | None, most_ps: float | None = None
) -> tuple[Floats, Floats]:
    """A clock's pulse as the kernel of all counts takes it, for pulses as wide as `most_ps`.

    Parameters
    ----------
    response : Response or None
        None: a Gaussian.
    most_ps : float, optional
        Standard deviation of the widest pulse, ps; None: as wide as the response.

    Returns
    -------
    rows : array of float, shape (k, 4, m)
        Of each flight place, share before it, density and its second derivative; (0, 4, 0): a
        Gaussian.
    spread : array of float, shape (k + 1,)
        Standard deviation without flight, ps, and half the variance that each flight adds, in it.
    """
    if response is None:
        return np.empty((0, 4, 0)), np.empty(0)
    ratio = 1.0 if most_ps is None else min(most_ps / response.std_ps, _MOST_DRAWN_OUT)
    found = _tables(response.table(), max(_MORE * 0.5 * (ratio**2 - 1.0), _LEAST_TOP))
    place = found.first + found.step * np.arange(found.rows.shape[2])
    places = np.broadcast_to(place, (len(found.flights), 1, len(place)))
    rows = np.concatenate((places, found.rows[:, (_COME, _DENSITY, _SECOND)]), axis=1)
    return rows, np.append(response.std_ps, found.flights)


GAUSSIAN = Shape(np.empty((3, 0)))


def shape_of(response: Response | None) -> Shape:
    """The shape of a clock's pulses; None: a Gaussian."""
    return GAUSSIAN if response is None else Shape(response.table())
