"""Photons of pulses whose times and widths are known: one linear likelihood fit per pixel.

Of a pixel's codes, only those near its pulses are fitted; the others give the background.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lightflight._kernels.jit import jit, jit_lent, jit_reordered
from lightflight._kernels.pulse import factorise, solve

Floats = NDArray[np.float64]

_REACH = 5.0
"""Half width of a pulse's window, in standard deviations."""

_DAMPING = 1e-9
"""Keeps two pulses at one place apart; nothing otherwise."""

_STEPS = 4
"""Solutions of the linear fit, each weighted by the one before."""


@jit
def amplitudes_at_times(
    counts: Floats,
    lower: Floats,
    upper: Floats,
    period: float,
    delays: Floats,
    stds: Floats,
    amplitude: Floats,
    empty_variance: Floats,
    background: Floats,
) -> None:
    """Fill `amplitude` (n, L), `empty_variance` (n, L) and `background` (n,) pixel by pixel.

    counts, lower, upper: (n, codes); delays, stds: (n, L), NaN delay where a pulse is absent;
    period: 0 for none. `empty_variance` is the variance an amplitude would have were it zero,
    that is the share of the background; the light adds its own count. Amplitudes may come out
    negative: nothing is clipped, so sums stay unbiased.
    """
    n, n_codes = counts.shape
    size = delays.shape[1]
    near, places = np.empty(n_codes, np.bool_), np.empty(n_codes, np.int64)
    shares, seen, due = np.empty((size, n_codes)), np.empty(n_codes), np.empty(n_codes)
    square = (np.empty((size, size)), np.empty((size, size)), np.ones(size, np.bool_))
    room = (*square, np.empty(size), np.empty(size), np.empty(size))
    for p in range(n):
        near[:] = False
        for q in range(size):
            if not math.isnan(delays[p, q]):
                mark_near(lower[p], upper[p], period, delays[p, q], _REACH * stds[p, q], near)
        rate = background_rate(counts[p], lower[p], upper[p], near)
        m = 0
        for k in range(n_codes):
            if near[k] and upper[p, k] > lower[p, k]:
                places[m], seen[m] = k, counts[p, k]
                due[m] = rate * (upper[p, k] - lower[p, k])
                m += 1
        for q in range(size):
            delay, std = delays[p, q], stds[p, q]
            share_of_pulse(lower[p], upper[p], period, delay, std, places[:m], shares[q])
        background[p] = rate
        fit_amplitudes(shares, seen[:m], due[:m], delays[p], amplitude[p], room)
        for q in range(size):
            empty_variance[p, q] = variance_without(q, shares, due[:m], delays[p], amplitude[p])


@jit_lent
def offset_from(delay, lower, upper, period):
    """Time from `delay` to the middle of a code, the shorter way round; period: 0 for none."""
    offset = 0.5 * (lower + upper) - delay
    return offset - period * math.floor(offset / period + 0.5) if period > 0.0 else offset


@jit_lent
def mark_near(lower, upper, period, delay, reach, near):
    """Mark the codes that come within `reach` of a delay."""
    for k in range(near.size):
        offset = offset_from(delay, lower[k], upper[k], period)
        near[k] |= abs(offset) < reach + 0.5 * (upper[k] - lower[k])


@jit_reordered
def background_rate(counts, lower, upper, near):
    """Counts per unit of time in the codes that are not near a pulse."""
    total, exposed = 0.0, 0.0
    for k in range(near.size):
        width = upper[k] - lower[k]
        outside = (width > 0.0) & (not near[k])
        total += counts[k] * outside
        exposed += width * outside
    return total / exposed if exposed > 0.0 else 0.0


@jit_lent
def share_of_pulse(lower, upper, period, delay, std, places, share):
    """Share of a Gaussian pulse in each of the codes `places`; 0 beyond its window, or absent."""
    for i in range(places.size):
        low, high = lower[places[i]], upper[places[i]]
        offset, half = offset_from(delay, low, high, period), 0.5 * (high - low)
        share[i] = 0.0
        if abs(offset) < _REACH * std + half:
            scale = 1.0 / (math.sqrt(2.0) * std)
            share[i] = 0.5 * (math.erf((offset + half) * scale) - math.erf((offset - half) * scale))


@jit_lent
def expected_at(i, shares, due, amplitude, left_out):
    """Counts expected in code i, without those of the pulse `left_out` (-1: with all)."""
    mean = due[i]
    for q in range(amplitude.size):
        if q != left_out and shares[q, i] > 0.0:
            mean += max(amplitude[q], 0.0) * shares[q, i]
    return mean


@jit_lent
def fit_amplitudes(shares, seen, due, delays, amplitude, room):
    """Photons of every pulse (NaN: absent), of maximum likelihood but for negative ones."""
    hessian, factor, free, score, solution, norm = room
    size = amplitude.size
    for q in range(size):
        total = 0.0
        for i in range(seen.size):
            if shares[q, i] > 0.0:
                total += seen[i] - due[i]
        amplitude[q] = math.nan if math.isnan(delays[q]) else max(total, 0.0)
    for _ in range(_STEPS):
        for q in range(size):
            score[q] = 0.0
            for r in range(size):
                hessian[q, r] = 0.0
        for i in range(seen.size):
            weight = 1.0 / (expected_at(i, shares, due, amplitude, -1) + 1e-9)
            for q in range(size):
                weighted = shares[q, i] * weight
                score[q] += weighted * (seen[i] - due[i])
                for r in range(size):
                    hessian[q, r] += weighted * shares[r, i]
        for q in range(size):
            if hessian[q, q] <= 0.0:
                hessian[q, q] = 1.0
        factorise(hessian, free, size, _DAMPING, norm, factor)
        solve(factor, norm, free, size, score, solution)
        for q in range(size):
            if not math.isnan(delays[q]):
                amplitude[q] = solution[q]


@jit_lent
def variance_without(q, shares, due, delays, amplitude):
    """Variance that the amplitude of pulse q would have, were it zero; NaN where it is absent."""
    if math.isnan(delays[q]):
        return math.nan
    information = 0.0
    for i in range(due.size):
        mean = expected_at(i, shares, due, amplitude, q)
        if mean > 0.0:
            information += shares[q, i] ** 2 / mean
        elif shares[q, i] > 0.0:
            information = math.inf
    return 1.0 / information if information > 0.0 else math.inf
