"""Photons of pulses whose times and widths are known: one linear likelihood fit per pixel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lightflight._kernels.jit import jit
from lightflight._kernels.pulse import factorise, solve

Floats = NDArray[np.float64]

_REACH = 5.0
"""Half width of a pulse's window, in standard deviations."""

_DAMPING = 1e-9
"""Keeps two pulses at one place apart; nothing otherwise."""


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
    n_pulses = delays.shape[1]
    shape = np.zeros((n_pulses, n_codes))
    near = np.zeros(n_codes, dtype=np.int64)
    hessian = np.zeros((n_pulses, n_pulses))
    score, solution, norm = np.zeros(n_pulses), np.zeros(n_pulses), np.zeros(n_pulses)
    factor, free = np.zeros((n_pulses, n_pulses)), np.ones(n_pulses, dtype=np.bool_)
    for p in range(n):
        n_near = 0
        outside_counts = 0.0
        outside_width = 0.0
        for k in range(n_codes):
            width = upper[p, k] - lower[p, k]
            if width <= 0.0:
                continue
            middle = 0.5 * (upper[p, k] + lower[p, k])
            inside = False
            for q in range(n_pulses):
                shape[q, k] = 0.0
                if math.isnan(delays[p, q]):
                    continue
                offset = middle - delays[p, q]
                if period > 0.0:
                    offset -= period * np.rint(offset / period)
                if abs(offset) < _REACH * stds[p, q] + 0.5 * width:
                    scale = 1.0 / (math.sqrt(2.0) * stds[p, q])
                    shape[q, k] = 0.5 * (
                        math.erf((offset + 0.5 * width) * scale)
                        - math.erf((offset - 0.5 * width) * scale)
                    )
                    inside = True
            if inside:
                near[n_near] = k
                n_near += 1
            else:
                outside_counts += counts[p, k]
                outside_width += width
        rate = outside_counts / outside_width if outside_width > 0.0 else 0.0
        background[p] = rate
        for q in range(n_pulses):
            total = 0.0
            for i in range(n_near):
                k = near[i]
                if shape[q, k] > 0.0:
                    total += counts[p, k] - rate * (upper[p, k] - lower[p, k])
            amplitude[p, q] = max(total, 0.0) if not math.isnan(delays[p, q]) else math.nan
            empty_variance[p, q] = math.nan
        for _ in range(4):
            for q in range(n_pulses):
                score[q] = 0.0
                for r in range(n_pulses):
                    hessian[q, r] = 0.0
            for i in range(n_near):
                k = near[i]
                width = upper[p, k] - lower[p, k]
                mean = rate * width + 1e-9
                for q in range(n_pulses):
                    if shape[q, k] > 0.0:
                        mean += max(amplitude[p, q], 0.0) * shape[q, k]
                excess = counts[p, k] - rate * width
                for q in range(n_pulses):
                    score[q] += shape[q, k] * excess / mean
                    for r in range(n_pulses):
                        hessian[q, r] += shape[q, k] * shape[r, k] / mean
            for q in range(n_pulses):
                if hessian[q, q] <= 0.0:
                    hessian[q, q] = 1.0
            factorise(hessian, free, n_pulses, _DAMPING, norm, factor)
            solve(factor, norm, free, n_pulses, score, solution)
            for q in range(n_pulses):
                if not math.isnan(delays[p, q]):
                    amplitude[p, q] = solution[q]
        for q in range(n_pulses):
            if math.isnan(delays[p, q]):
                continue
            information = 0.0
            for i in range(n_near):
                k = near[i]
                width = upper[p, k] - lower[p, k]
                mean = rate * width
                for r in range(n_pulses):
                    if r != q and shape[r, k] > 0.0:
                        mean += max(amplitude[p, r], 0.0) * shape[r, k]
                if mean > 0.0:
                    information += shape[q, k] ** 2 / mean
                elif shape[q, k] > 0.0:
                    information = math.inf
            empty_variance[p, q] = 1.0 / information if information > 0.0 else math.inf
