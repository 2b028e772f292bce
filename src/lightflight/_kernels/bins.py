"""Bin kernels: the codes of one pixel as bins in ascending time, and scans for an excess.

A pixel is a row of *bins*: edges (n + 1), counts (n), exposure (n). A bin's exposure is its
width, or 0 where no light can be recorded (gaps between code intervals). With a period the bins
cover the whole ring and the last edge is the first edge + period.
"""

from __future__ import annotations

import math

import numpy as np

from lightflight._kernels.jit import jit


@jit
def bins_from_codes(counts, lower, upper, period, bins):
    """Bins of one pixel in ascending time; returns how many, 0 where no code has a width.

    Codes without width are dropped together with what they counted; time that no code covers
    becomes a bin without exposure. `period` is inf where nothing folds; a code more than one
    period from the start of code 0 (backward codes: from its end) cannot be reached.
    """
    bin_counts, edges, exposure = bins
    n_codes = counts.size
    backward = lower[0] > lower[n_codes - 1]
    earliest = upper[0] - period if backward else -math.inf
    latest = math.inf if backward else lower[0] + period
    n = 0
    for i in range(n_codes):
        k = n_codes - 1 - i if backward else i
        start, end = max(lower[k], earliest), min(upper[k], latest)
        if n == 0:
            edges[0] = start
        if not end > max(start, edges[n]):
            continue
        if start > edges[n] + 1e-6 * (end - start):
            bin_counts[n], exposure[n] = 0.0, 0.0
            n += 1
            edges[n] = start
        bin_counts[n] = counts[k]
        exposure[n] = end - edges[n]
        edges[n + 1] = end
        n += 1
    if n > 0 and period < math.inf and edges[n] < edges[0] + period:
        bin_counts[n], exposure[n] = 0.0, 0.0
        edges[n + 1] = edges[0] + period
        n += 1
    return n


@jit
def log_excess(inside, total, expected):
    """Chernoff's bound: counts in a window this high by chance have probability <= exp(-value).

    `inside` of `total` counts fell into a window where `expected` were due.
    """
    if inside <= expected or expected <= 0.0:
        return 0.0
    value = inside * math.log(inside / expected)
    if total > inside:
        value += (total - inside) * math.log((total - inside) / (total - expected))
    return value


@jit
def log_excess_over(inside, expected):
    """Chernoff's bound where `expected` counts are due whatever the total: see `log_excess`."""
    if inside <= expected:
        return 0.0
    return inside * math.log(inside / expected) - (inside - expected)


@jit
def next_length(length):
    """1, 2, 3, 4, 6, 8, 12, 16, 24 ...: window lengths of a scan."""
    if length < 3:
        return length + 1
    return length * 3 // 2 if length % 3 else length * 4 // 3


@jit
def accumulate(values, n, folds, sums):
    """Running sums over the bins, and a second time around where they fold."""
    sums[0] = 0.0
    for i in range(n):
        sums[i + 1] = sums[i] + values[i]
    if folds:
        for i in range(n):
            sums[n + i + 1] = sums[n + i] + values[i]


@jit
def edge_at(edges, n, period, i):
    """Edge i, counted on beyond the fold."""
    return edges[i] if i <= n else edges[i - n] + period


@jit
def scan_for_pulse(bins, n, folds, double_code, sums, best):
    """Find the window of bins whose counts chance explains least; returns all counts.

    Windows of 1, 2, 3, 4, 6, 8, ... bins are tried at every position (across the fold where
    `folds`). What is due in a window follows its exposure, raised by what an imperfect clock may
    do: `double_code` bins' worth of light too much in a window, and 5 % of `double_code` more.

    best: log excess over the number of windows tried (false alarms: fewer than exp(-that), by
    trial exp(-that - 3)), first bin, number of bins. Leaves running counts and exposure in sums.
    """
    accumulate(bins[0], n, folds, sums[0])
    accumulate(bins[2], n, folds, sums[1])
    total, all_exposure = sums[0][n], sums[1][n]
    best[0], best[1], best[2] = 0.0, 0.0, 1.0
    n_lengths, length = 0, 1 if double_code < 0.5 else 2
    while 2 * length <= n or n_lengths == 0:
        n_lengths += 1
        due = total * (1.0 + double_code * (1.0 / length + 0.05)) / all_exposure
        for i in range(n if folds else n - length + 1):
            inside = sums[0][i + length] - sums[0][i]
            expected = due * (sums[1][i + length] - sums[1][i])
            if inside > expected and expected < total:
                value = log_excess(inside, total, expected)
                if value > best[0]:
                    best[0], best[1], best[2] = value, i, length
        length = next_length(length)
    best[0] -= math.log(n * n_lengths)
    return total


@jit
def start_from_window(bins, n, period, sums, first, length, theta):
    """Rough centre, photons, std, background from the window a scan found, into theta."""
    counts, edges, exposure = bins
    inside = sums[0][first + length] - sums[0][first]
    covered = sums[1][first + length] - sums[1][first]
    unlit = max(sums[1][n] - covered, 1e-3 * sums[1][n])
    background = min(max(sums[0][n] - inside, 0.5) / unlit, 0.9 * inside / covered)
    signal, moment = 0.0, 0.0
    for i in range(first, first + length):
        k, shift = (i, 0.0) if i < n else (i - n, period)
        excess = counts[k] - background * exposure[k]
        signal += excess
        moment += excess * (0.5 * (edges[k] + edges[k + 1]) + shift)
    low, high = edges[first], edge_at(edges, n, period, first + length)
    theta[0] = min(max(moment / signal, low), high)
    theta[1] = 1.1 * signal
    theta[2] = (high - low) / 3.2
    theta[3] = background


@jit
def load_window(bins, n, period, low, high, window):
    """Copy the bins that overlap [low, high), unfolded around it; returns how many."""
    counts, edges, exposure = bins
    w_counts, w_edges, w_exposure = window
    shift = 0.0
    if period < math.inf:
        shift = math.floor((low - edges[0]) / period) * period
    k = np.searchsorted(edges[: n + 1], low - shift, side="right") - 1
    k = min(max(k, 0), n - 1)
    m = 0
    w_edges[0] = edges[k] + shift
    while m < n and (m == 0 or w_edges[m] < high):
        w_counts[m] = counts[k]
        w_exposure[m] = exposure[k]
        w_edges[m + 1] = edges[k + 1] + shift
        m += 1
        k += 1
        if k == n:
            if period == math.inf:
                break
            k = 0
            shift += period
    return m
