"""Bin kernels: the codes of one pixel as bins in ascending time, and scans for an excess.

A pixel is a row of *bins*: edges (n + 1), counts (n), exposure (n). A bin's exposure is its
width, or 0 where no light can be recorded (gaps between code intervals). With a period the bins
cover the whole ring and the last edge is the first edge + period.
"""

from __future__ import annotations

import math

import numpy as np

from lightflight._kernels.jit import jit_inlined, jit_lent, jit_reordered


@jit_lent
def put(source, n, target):
    """Copy the first n values (compiles in a tenth of the time of a slice assignment)."""
    for i in range(n):
        target[i] = source[i]


@jit_lent
def bins_from_codes(lower, upper, period, edges, exposure, codes):
    """Bins of one pixel in ascending time; returns how many, 0 where no code has a width.

    codes: the code of each bin, or -1 for time that no code covers, which becomes a bin without
    exposure. Codes without width have no bin: what they count is dropped. `period` is inf where
    nothing folds; a code more than one period from the start of code 0 (backward codes: from its
    end) cannot be reached.
    """
    n_codes = lower.size
    backward = lower[0] > lower[n_codes - 1]
    earliest = upper[0] - period if backward else -math.inf
    latest = math.inf if backward else lower[0] + period
    n, here = 0, 0.0  # here: edges[n]
    for i in range(n_codes):
        k = n_codes - 1 - i if backward else i
        start, end = max(lower[k], earliest), min(upper[k], latest)
        if n == 0:
            edges[0] = here = start
        if not end > max(start, here):
            continue
        if start > here + 1e-6 * (end - start):
            exposure[n], codes[n] = 0.0, -1
            n += 1
            edges[n] = here = start
        exposure[n], codes[n] = end - here, k
        n += 1
        edges[n] = here = end
    if n > 0 and period < math.inf and edges[n] < edges[0] + period:
        exposure[n], codes[n] = 0.0, -1
        edges[n + 1] = edges[0] + period
        n += 1
    return n


@jit_lent
def copy_counts(source, values):
    """Copy integers (or floats); returns their sum."""
    total = 0
    for i in range(source.size):
        values[i] = source[i]
        total += source[i]
    return total


@jit_inlined
def take_counts(counts, codes, n, values):
    """Counts of the bins, into `values`; returns their sum."""
    first, after = codes[0], codes[n - 1]
    gap = after < 0 and n > 1
    if gap:  # the fold: the last bin is no code
        values[n - 1] = 0
        after = codes[n - 2]
    if after - first + 1 == n - gap:  # slices, so that the copy becomes vector instructions
        return copy_counts(counts[first : after + 1], values[: n - gap])
    if first - after + 1 == n - gap:
        copy_counts(counts[after : first + 1], values[: n - gap])
        return reverse(values[: n - gap])
    total = 0
    for i in range(n):
        values[i] = counts[codes[i]] if codes[i] >= 0 else 0
        total += values[i]
    return total


@jit_lent
def reverse(values):
    """Turn the order around; returns the sum."""
    total, last = 0, values.size - 1
    for i in range(values.size // 2):
        values[i], values[last - i] = values[last - i], values[i]
    for i in range(values.size):
        total += values[i]
    return total


@jit_lent
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


@jit_lent
def log_excess_over(inside, expected):
    """Chernoff's bound where `expected` counts are due whatever the total: see `log_excess`."""
    if inside <= expected:
        return 0.0
    return inside * math.log(inside / expected) - (inside - expected)


@jit_inlined
def wrap_tail(values, n, reach):
    """Repeat the first bins behind the last, up to `reach` in all: windows across the fold."""
    if reach > n:
        copy_counts(values[: reach - n], values[n:reach])


@jit_lent
def accumulate(values, n, reach, sums):
    """Running sums over the bins, and on over those behind the fold."""
    sums[0] = 0.0
    for i in range(n):
        sums[i + 1] = sums[i] + values[i]
    for i in range(reach - n):
        sums[n + 1 + i] = sums[n] + sums[i + 1]


@jit_reordered
def invert_exposure(exposure, inverse):
    """Inverse of the exposure of each bin (0: of one without); returns their sum and number."""
    summed, live = 0.0, 0
    for k in range(exposure.size):
        lit = exposure[k] > 0.0
        inverse[k] = lit / (exposure[k] + (not lit))
        summed += inverse[k]
        live += lit
    return summed, live


@jit_reordered
def even_width(exposure):
    """Exposure of a bin where all but a few smaller ones have the same; else 0."""
    widest, smaller = 0.0, 0
    for k in range(exposure.size):
        widest = max(widest, exposure[k])
    for k in range(exposure.size):
        smaller += exposure[k] < 0.9999 * widest
    return widest if smaller <= 3 else 0.0


@jit_lent
def edge_at(edges, n, period, i):
    """Edge i, counted on beyond the fold and before the first."""
    if i > n:
        return edges[i - n] + period
    if i < 0:
        return edges[i + n] - period
    return edges[i]


@jit_lent
def add_arrays(left, right, both):
    """Sum of two arrays (slices, so that the loop becomes vector instructions); its largest."""
    best = left[0]
    for i in range(both.size):
        both[i] = left[i] + right[i]
        best = max(best, both[i])
    return best


@jit_lent
def largest(values):
    """Largest of at least one value."""
    best = values[0]
    for i in range(values.size):
        if values[i] > best:
            best = values[i]
    return best


@jit_lent
def index_of(values, wanted):
    """Index of the first value that equals `wanted`."""
    wanted = values.dtype.type(wanted)  # compared as it is stored
    for start in range(0, values.size, 64):
        block = values[start : start + 64]
        if largest(block) == wanted:
            for i in range(block.size):
                if block[i] == wanted:
                    return start + i
    return 0


@jit_lent
def may_exceed(inside, total, expected, value):
    """False where the log excess is below value: it is at most chi2, which needs no logarithm."""
    above = inside - expected
    if not 0.0 < above < inside or expected >= total:
        return False
    return above * above * total > value * expected * (total - expected)


@jit_lent
def count_exceeding(sums, before, after, due, total, value):
    """How many windows `may_exceed` a value (no branch, so that the loop becomes vectors)."""
    exceeding = 0
    for i in range(sums.size):
        expected = due * (after[i] - before[i])
        above = float(sums[i]) - expected
        likely = above * above * total > value * expected * (total - expected)
        exceeding += (above > 0.0) & likely
    return exceeding


@jit_lent
def best_window(sums, count, length, covered, due, total, best):
    """Update best (log excess, first bin, length) with windows of one length."""
    ends = covered[length:]
    for start in range(0, count, 32):
        stop = min(start + 32, count)
        some, before, after = sums[start:stop], covered[start:stop], ends[start:stop]
        if count_exceeding(some, before, after, due, total, best[0]) == 0:
            continue
        for i in range(stop - start):
            expected = due * (after[i] - before[i])
            if may_exceed(float(some[i]), total, expected, best[0]):
                value = log_excess(float(some[i]), total, expected)
                if value > best[0]:
                    best[0], best[1], best[2] = value, start + i, length


@jit_lent
def log_trials(n):
    """Logarithm of the number of windows that `scan_for_pulse` tries over n bins."""
    return math.log(max(n, 1) * int(math.log2(max(n, 2))))


@jit_inlined
def scan_for_pulse(levels, n, reach, covered, even, double_code, total, peak, floor, best):
    """Find the window of bins whose counts chance explains least.

    levels[0][:reach]: counts, with a tail behind the fold where they fold; peak: their largest;
    further levels are filled with sums over 2, 4, 8 ... bins, the lengths that are tried at every
    position. What is due in a window follows its exposure (`covered`: running sums), raised by
    what an imperfect clock may do: `double_code` bins' worth of light too much in a window, and
    5 % of `double_code` more. even: exposure of every bin, where the fullest window is the best,
    or 0. An excess up to `floor` is not looked for.

    best: log excess, first bin, number of bins; false alarms are fewer than exp(log_trials -
    excess), by trial exp(log_trials - excess - 3). Stops early at an unmistakable pulse.
    """
    best[0], best[1], best[2] = floor, 0.0, 1.0
    level, length, where, fullest, highest = 0, 1, -1, peak, 0.0
    while 2 * length <= n or length == 1:
        if level > 0:
            half, count = length // 2, reach - length + 1
            below, here = levels[level - 1], levels[level]
            fullest = float(add_arrays(below[:count], below[half : half + count], here[:count]))
        if length > 1 or double_code < 0.5:
            before = best[0]
            due = total * (1.0 + double_code * (1.0 / length + 0.05)) / covered[n]
            count = min(n, reach - length + 1)
            if even > 0.0:
                expected = due * min(length * even, covered[n])
                if may_exceed(fullest, total, expected, best[0]):
                    value = log_excess(fullest, total, expected)
                    if value > best[0]:
                        best[0], best[2], where, highest = value, length, level, fullest
            else:
                best_window(levels[level], count, length, covered, due, total, best)
            if best[0] > 50.0 and best[0] == before:
                break
        level += 1
        length *= 2
    if where >= 0:
        best[1] = index_of(levels[where][: min(n, reach - int(best[2]) + 1)], highest)


@jit_lent
def residual_level(std, bin_width, n):
    """Level of sums (2^level bins) in which a scan for another pulse of this std looks."""
    level, length = 0, 1.0
    while 1.414 * length < 2.5 * std / bin_width and 4.0 * length <= n:
        level += 1
        length *= 2.0
    return level


@jit_inlined
def start_from_window(values, edges, n, period, total, covered, first, length, theta):
    """Rough centre, photons, std, background (into theta) around the window a scan found.

    values and covered (running sums of the exposure) go on behind the fold.
    Background from the rest of the range; moments in a window twice as long.
    """
    low, high = first - length // 2, first + length + (length + 1) // 2
    origin = edge_at(edges, n, period, first)
    lap = 0.0
    if period == math.inf:
        low, high = max(low, 0), min(high, n)
    elif low < 0:  # read on from the end of the tail
        low, high, lap = low + n, high + n, period
    inside = float(values[low:high].sum())
    exposed = covered[high] - covered[low]
    unlit = max(covered[n] - exposed, 1e-3 * covered[n])
    background = min(max(total - inside, 0.5) / unlit, 0.9 * inside / exposed)
    signal, moment, square = 0.0, 0.0, 0.0
    left = edge_at(edges, n, period, low) - lap - origin
    for i in range(low, high):
        right = edge_at(edges, n, period, i + 1) - lap - origin
        excess = values[i] - background * (covered[i + 1] - covered[i])
        time = 0.5 * (left + right)
        signal += excess
        moment += excess * time
        square += excess * time * time
        left = right
    span = edge_at(edges, n, period, first + length) - origin
    centre = min(max(moment / signal, 0.0), span)
    variance = square / signal - centre * centre - (span / length) ** 2 / 12.0
    if signal * signal < 30.0 * inside:  # moments would be those of the noise
        variance = 0.09 * span * span
    theta[0] = origin + centre
    theta[1] = signal
    theta[2] = math.sqrt(min(max(variance, 0.0144 * span * span), 0.36 * span * span))
    theta[3] = background


@jit_lent
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
