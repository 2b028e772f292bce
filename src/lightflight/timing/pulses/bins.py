"""Codes of pixels as bins in ascending time, and windows of them: what pulses are fitted to."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]

Indices = NDArray[np.int64]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bins:
    """Codes of pixels as bins in ascending time; see `_kernels.pulse` for what a bin is.

    Attributes
    ----------
    counts : array of float
        (p, N); those behind a pixel's own n are 0.
    edges : array of float
        (p, N + 1).
    exposure : array of float
        (p, N).
    code : array of int
        (p, N), code of each bin; -1 for time that no code covers.
    n : array of int
        (p,), number of bins.
    period : float
        Period of the ring, inf where nothing folds.
    dark : array of float
        (p, 2), counts and exposure of a background recording.
    """

    counts: Floats
    edges: Floats
    exposure: Floats
    code: Indices
    n: Indices
    period: float
    dark: Floats

    def some(self, index: Indices | Bools) -> Bins:
        """Bins of some of the pixels."""
        return Bins(
            self.counts[index], self.edges[index], self.exposure[index], self.code[index],
            self.n[index], self.period, self.dark[index],
        )  # fmt: skip

    @property
    def span(self) -> Floats:
        """(p,), time from the first edge to the last."""
        return np.asarray(self.edges[:, -1] - self.edges[:, 0])


def bins_of(
    counts: NDArray[np.generic],
    lower: Floats,
    upper: Floats,
    period: float,
    trials: Floats,
    dark: Floats,
) -> Bins:
    """Bins of pixels; rules as in `_kernels.pulse.bins_from_codes` and `thin_exposure`.

    counts: (p, codes); lower, upper: (p or 1, codes); trials: (p,), laser periods that could have
    ended with a photon (inf: no pile-up); dark: see `Bins`.
    """
    shape = counts.shape
    order = slice(None, None, -1 if lower[0, 0] > lower[0, -1] else 1)
    code = np.broadcast_to(np.arange(shape[1])[order], shape)
    start, end = (np.broadcast_to(edge[:, order], shape) for edge in (lower, upper))
    if math.isfinite(period):
        if order.step < 0:
            start = np.maximum(start, end[:, -1:] - period)
        else:
            end = np.minimum(end, start[:, :1] + period)
    so_far = np.maximum.accumulate(np.where(end > start, end, -np.inf), axis=1)
    here = np.concatenate([np.full((shape[0], 1), -np.inf), so_far[:, :-1]], axis=1)
    here = np.where(np.isinf(here), start, here)
    kept = (end > start) & (end > here)
    gap = kept & (start > here + 1e-6 * (end - start))
    place = np.cumsum(kept.astype(np.int64) + gap, axis=1) - 1
    first = np.where(kept.any(axis=1), start[np.arange(shape[0]), kept.argmax(axis=1)], 0.0)
    last = np.where(kept.any(axis=1), so_far[:, -1], 0.0)
    fold = np.isfinite(period) & (last < first + period) & kept.any(axis=1)
    n = place[:, -1] + 1 + fold
    edges = np.repeat(np.where(fold, first + period, last)[:, None], int(n.max()) + 1, axis=1)
    values, exposure = np.zeros((2, shape[0], int(n.max())))
    codes = np.full(exposure.shape, -1, dtype=np.int64)
    row, k = np.nonzero(kept)
    at, low = place[row, k], np.where(gap, start, here)[row, k]
    edges[row, at], edges[row, at + 1] = low, end[row, k]
    before = gap[row, k]
    edges[row[before], at[before] - 1] = here[row[before], k[before]]
    exposure[row, at] = end[row, k] - low
    codes[row, at] = code[row, k]
    values[row, at] = counts[row, code[row, k]]
    thinned = np.isfinite(trials)
    if thinned.any():
        exposure[thinned] *= open_share(values[thinned], trials[thinned, None])
    return Bins(values, edges, exposure, codes, n, period, dark)


def open_share(counts: Floats, trials: Floats) -> Floats:
    """(p, N), exposure of each bin, over its width, that explains its counts as Poisson's.

    A period ends with its first photon: of `trials` periods (p, 1), those that saw none before
    bin k reach it. Counts among them are binomial with chance 1 - exp(-rate); the exposure given,
    counts over the rate that explains them, makes that a Poisson likelihood with the same maximum.
    """
    left = np.maximum(trials - np.cumsum(counts, axis=1), 1e-3)
    alive = np.concatenate([trials, left[:, :-1]], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        closing = (counts > 0) & (left < alive)
        return np.asarray(np.where(closing, counts / np.log(alive / left), alive) / trials)


@dataclass(frozen=True, eq=False)
class Window:
    """Consecutive bins of every pixel, unfolded, and what lies outside of them.

    Attributes
    ----------
    counts : array of float
        (p, K).
    edges : array of float
        (p, K + 1).
    exposure : array of float
        (p, K), 0 in bins behind the window's own end.
    lit : array of bool
        (p, K), bins with exposure.
    m : array of int
        (p,), bins of the window.
    outside : array of float
        (p, 5), beyond the window: counts, exposure, bins, sums of counts^2 / exposure and of 1 /
        exposure.
    whole : array of bool
        (p,), True where no bin is outside.
    known : array of float
        (p, 2), from when to when all that was recorded is in the window; infinite towards where
        nothing else was.
    """

    counts: Floats
    edges: Floats
    exposure: Floats
    lit: Bools
    m: Indices
    outside: Floats
    whole: Bools
    known: Floats


def place_in(bins: Bins, low: Floats, high: Floats) -> tuple[Indices, Indices, Floats]:
    """First bin, number of bins and lap of the windows [low, high) of every pixel."""
    lap = np.zeros(len(low))
    if math.isfinite(bins.period):
        lap = np.floor((low - bins.edges[:, 0]) / bins.period) * bins.period
    real = np.arange(bins.edges.shape[1]) <= bins.n[:, None]
    first = np.sum((bins.edges <= (low - lap)[:, None]) & real, axis=1) - 1
    first = np.clip(first, 0, bins.n - 1)
    after = np.sum((bins.edges < (high - lap)[:, None]) & real, axis=1)
    if math.isfinite(bins.period):
        beyond = (bins.edges < (high - lap - bins.period)[:, None]) & real
        after = np.where(after > bins.n, bins.n + np.sum(beyond, axis=1), after)
    else:
        after = np.minimum(after, bins.n)
    return first, np.clip(after - first, 1, bins.n), lap


def window_at(bins: Bins, first: Indices, m: Indices, lap: Floats) -> Window:
    """The windows at a place; all as wide as the widest needs, in steps that it decides itself."""
    k = np.arange(int(step_above(m).max()) + 1)
    place = first[:, None] + np.minimum(k, m[:, None])
    folded = place > bins.n[:, None]
    row = np.arange(len(m))[:, None]
    edges = bins.edges[row, np.where(folded, place - bins.n[:, None], place)]
    edges = edges + lap[:, None]
    if math.isfinite(bins.period):
        edges += bins.period * folded
    place = np.where(place >= bins.n[:, None], place - bins.n[:, None], place)[:, :-1]
    inside = k[:-1] < m[:, None]
    counts, exposure = (np.where(inside, values[row, place], 0.0)
                        for values in (bins.counts, bins.exposure))  # fmt: skip
    outside = _sums(bins.counts, bins.exposure) - _sums(counts, exposure)
    whole, on_a_ring = m == bins.n, math.isfinite(bins.period)
    outside[whole] = 0.0
    none_before, none_after = (
        whole | (at_end & (not on_a_ring)) for at_end in (first == 0, first + m == bins.n)
    )
    known = np.stack(
        [np.where(none_before, -np.inf, edges[:, 0]), np.where(none_after, np.inf, edges[:, -1])],
        axis=1,
    )
    return Window(counts, edges, exposure, exposure > 0.0, m, outside, whole, known)


def step_above(m: Indices) -> Indices:
    """A width of which there are few, at least m, and at most 1.5 m for large ones."""
    power = 1 << np.ceil(np.log2(np.maximum(m, 16))).astype(np.int64)
    return np.where(m <= 3 * power // 4, 3 * power // 4, power)


def _sums(counts: Floats, exposure: Floats) -> Floats:
    """(p, 5), see `Window.outside`."""
    lit = exposure > 0.0
    inverse = np.where(lit, 1.0 / np.where(lit, exposure, 1.0), 0.0)
    terms = (counts * lit, exposure, lit, counts * counts * inverse, inverse)
    return np.stack([np.sum(term, axis=1, dtype=np.float64) for term in terms], axis=1)
