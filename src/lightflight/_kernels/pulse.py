"""Pulse kernel: every pixel of a tile from codes to its strongest pulse. Plain arrays, no checks.

A pixel is a row of *bins*: edges (n + 1), counts (n), exposure (n). A bin's exposure is its
width, or 0 where no light can be recorded (gaps between code intervals). With a period the bins
cover the whole ring and the last edge is the first edge + period.

The expected counts of bin k are  A [Phi((e_{k+1} - c)/s) - Phi((e_k - c)/s)] + b w_k  with centre
c, photons A, std s and background b per unit time. `timing.pulses.batch` is the same fit in NumPy,
of any number of pulses of any shape; tests hold the two against each other.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lightflight._kernels.jit import jit, piece

Floats = NDArray[np.float64]
Counts = NDArray[np.generic]
"""uint32 or float64: what `timing.pulses.fits.scannable` makes of them."""

N_COLUMNS = 12
"""Columns of a table of fits (rows in the kernel, which keep each together in memory)."""

(
    COUNTS, EXPOSURE, PEAK, N_PULSES, CONVERGED, STEPS_TAKEN, CHI2, CHI2_BINS, CHI2_DEVIATE,
    HELD_SHARE, STD_FREE, RESIDUAL,
) = range(N_COLUMNS)  # fmt: skip

MIN_EXPECTED = 0.01
"""Bins expected to hold fewer counts say nothing about goodness of fit."""

ALONE = 3.0
"""Further than this many std from every pulse, light is another pulse or a tail."""

WIDEST = 1024
"""Bins that a window of the fit may have; a wider pulse is left to `timing.pulses.batch`."""

# Rows of a window, one number per bin: constants, so that the compiler knows them apart and turns
# loops into vector instructions. More than pages each, or they would compete in the cache.
_ROW = WIDEST + 24
(EDGE, COUNT, WIDTH, LIVE, DEAD, BELOW, DENSITY, STEEP, MEAN) = range(0, 9 * _ROW, _ROW)
ROOM = 9 * _ROW

_VECTOR = 8
_MOST_STEPS = 60
_WHOLE_STEPS = 8
"""From then on half steps are taken: of few photons, whole ones may turn to and fro."""

_SETTLED = 1e-6
"""Squared distance from the maximum, in standard errors, at which a fit ends: steps shrink by
about the same factor each, so two of them tell what is left."""

_SHORT = 1e-3
"""Squared length of the last step, at most; less is taken, out of steps (a background that creeps
to zero)."""

_SPARE_REACH = 1.0
"""Std that a window has on either side beyond the pulse of the start."""

_FURTHEST = 8.5
"""Std beyond which a tail is nothing (1e-17)."""

_INV_SQRT_2PI = 1.0 / math.sqrt(2.0 * math.pi)
_EXP_SCALE = -0.5 / 128.0
_E2, _E3, _E4, _E5, _E6 = (1.0 / math.factorial(i) for i in range(2, 7))

# Mills' ratio (1 - Phi(z)) / phi(z) as a polynomial in t = 1 / (1 + _T z), after the form of
# Abramowitz & Stegun 26.2.17; fitted here for 0 <= z <= 8.5, error of Phi below 1e-9.
_T = 0.24
_M0, _M1, _M2, _M3, _M4, _M5, _M6, _M7 = (
    0.00318881163018813, 0.196444909262509, 0.494364871157439, -0.60213529734641,
    1.83449097143721, -1.81558317495243, 1.46995196554003, -0.327408921012691,
)  # fmt: skip


@piece
def bins_from_codes(lower, upper, at, period, edges, exposure, codes):
    """Bins of pixel `at` in ascending time; returns how many, 0 where no code has a width.

    codes: the code of each bin, or -1 for time that no code covers, which becomes a bin without
    exposure. Codes without width have no bin: what they count is dropped. `period` is inf where
    nothing folds; a code more than one period from the start of code 0 (backward codes: from its
    end) cannot be reached.
    """
    n_codes = lower.shape[1]
    backward = lower[at, 0] > lower[at, n_codes - 1]
    earliest = upper[at, 0] - period if backward else -math.inf
    latest = math.inf if backward else lower[at, 0] + period
    n, here = 0, 0.0  # here: edges[n]
    for i in range(n_codes):
        k = n_codes - 1 - i if backward else i
        start, end = lower[at, k], upper[at, k]
        start = start if start > earliest else earliest
        end = end if end < latest else latest
        if n == 0:
            edges[0] = here = start
        if not (end > start and end > here):
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


@piece
def take_counts(counts, at, codes, n, reach, levels):
    """Counts of the bins of pixel `at`, and a tail, into levels[0]; their sum and largest."""
    first, last, m = codes[0], codes[n - 1], n
    if last < 0 and n > 1:  # the fold: the last bin is no code
        m = n - 1
        last = codes[m - 1]
    total, largest = 0 * counts[at, 0], counts[at, first]
    levels[0, n - 1] = 0
    if last - first + 1 == m:  # no code is left out: loops that become vector instructions
        for i in range(np.uint64(m)):
            levels[0, i] = counts[at, np.uint64(first) + i]
    elif first - last + 1 == m:
        for i in range(np.uint64(m)):
            levels[0, i] = counts[at, np.uint64(first) - i]
    else:
        for i in range(m):
            levels[0, i] = counts[at, codes[i]] if codes[i] >= 0 else 0
    for i in range(m):
        total += levels[0, i]
        largest = levels[0, i] if levels[0, i] > largest else largest
    for i in range(np.uint64(reach - n)):
        levels[0, np.uint64(n) + i] = levels[0, i]
    return float(total), float(largest)


@piece
def thin_exposure(counts, n, trials, exposure):
    """Exposure of bins that an earlier photon of the same period may have closed.

    A period ends with its first photon: of `trials` periods, those that saw none before bin k
    reach it. Counts among them are binomial with chance 1 - exp(-rate); the exposure given, counts
    over the rate that explains them, makes that a Poisson likelihood with the same maximum.
    """
    alive = trials
    for k in range(n):
        left = alive - counts[0, k]
        left = left if left > 1e-3 else 1e-3
        seen = alive
        if counts[0, k] > 0 and left < alive:
            seen = counts[0, k] / math.log(alive / left)
        exposure[k] *= seen / trials
        alive = left


@piece
def sum_exposure(exposure, n, reach, inverse, covered):
    """Running sums and inverse of the exposure.

    Returns the live bins, and the exposure of every bin where all but a few smaller ones have the
    same, else 0.
    """
    widest, live, smaller = 0.0, 0, 0
    covered[0] = 0.0
    for k in range(n):
        lit = exposure[k] > 0.0
        live += lit
        inverse[k] = 1.0 / exposure[k] if lit else 0.0
        widest = exposure[k] if exposure[k] > widest else widest
        covered[k + 1] = covered[k] + exposure[k]
    for k in range(reach - n):
        covered[n + 1 + k] = covered[n] + covered[k + 1]
    for k in range(n):
        smaller += exposure[k] < 0.9999 * widest
    return live, widest if smaller <= 3 else 0.0


@piece
def edge_at(edges, n, period, i):
    """Edge i, counted on beyond the fold and before the first."""
    if i > n:
        return edges[i - n] + period
    if i < 0:
        return edges[i + n] - period
    return edges[i]


@piece
def log_excess(inside, total, expected, least):
    """Chernoff's bound: counts in a window this high by chance have probability <= exp(-value).

    `inside` of `total` counts fell into a window where `expected` were due. 0 where the value is
    below `least`: it is at most chi2, which needs no logarithm.
    """
    above = inside - expected
    if not (above > 0.0 and above * above * total > least * expected * (total - expected)):
        return 0.0
    value = inside * math.log(inside / expected)
    if total > inside:
        value += (total - inside) * math.log((total - inside) / (total - expected))
    return value


@piece
def add_shifted(levels, level, shift, count):
    """Sums over twice as many bins as those of the level below; returns the largest."""
    fullest = levels[level - 1, 0]
    for i in range(np.uint64(count)):
        both = levels[level - 1, i] + levels[level - 1, np.uint64(shift) + i]
        levels[level, i] = both
        fullest = both if both > fullest else fullest
    return float(fullest)


@piece
def any_exceeds(levels, level, covered, length, start, stop, due, total, least):
    """True where the log excess of one of some windows may exceed a value (no branch: a vector)."""
    exceeding = 0
    for i in range(np.uint64(start), np.uint64(stop)):
        expected = due * (covered[i + np.uint64(length)] - covered[i])
        above = float(levels[level, i]) - expected
        likely = above * above * total > least * expected * (total - expected)
        exceeding += (above > 0.0) & likely
    return exceeding > 0


@piece
def scan_for_pulse(levels, n, reach, covered, even, double_code, total, peak, floor):
    """Find the window of bins whose counts chance explains least: log excess, first bin, length.

    levels[0, :reach]: counts, with a tail behind the fold where they fold; further levels are
    filled with sums over 2, 4, 8 ... bins, the lengths that are tried at every position. What is
    due in a window follows its exposure (`covered`: running sums), raised by what an imperfect
    clock may do: `double_code` bins' worth of light too much in a window, and 5 % of `double_code`
    more. even: exposure of every bin, where the fullest window is the best, or 0. An excess up to
    `floor` is not looked for. False alarms are fewer than exp(log_trials - excess), by trial
    exp(log_trials - excess - 3). Stops early at an unmistakable pulse.
    """
    best, best_first, best_length, where = floor, 0, 1, -1
    fullest, wanted = peak, peak
    level, length = 0, 1
    while 2 * length <= n or length == 1:
        count = reach - length + 1
        if level > 0:
            fullest = add_shifted(levels, level, length // 2, count)
        if length > 1 or double_code < 0.5:
            before = best
            due = total * (1.0 + double_code * (1.0 / length + 0.05)) / covered[n]
            last = count if count < n else n
            if even > 0.0:
                expected = due * (length * even if length * even < covered[n] else covered[n])
                value = log_excess(fullest, total, expected, best)
                if value > best:
                    best, best_length, where, wanted = value, length, level, fullest
                last = 0
            for start in range(0, last, 32):  # whole pieces, so that loops become vectors
                stop = start + 32 if start + 32 < last else last
                if not any_exceeds(levels, level, covered, length, start, stop, due, total, best):
                    continue
                for i in range(start, stop):
                    expected = due * (covered[i + length] - covered[i])
                    value = log_excess(float(levels[level, i]), total, expected, best)
                    if value > best:
                        best, best_first, best_length, where = value, i, length, -1
            if best > 50.0 and best == before:
                break
        level += 1
        length *= 2
    if where >= 0:
        while levels[where, best_first] != wanted:
            best_first += 1
    return best, best_first, best_length


@piece
def start_from_window(levels, edges, n, period, total, covered, first, length, theta):
    """Rough centre, std, photons, background (into theta) around the window a scan found.

    The first row of levels and covered (running sums of the exposure) go on behind the fold.
    Background from the rest of the range; moments in a window twice as long.
    """
    low, high = first - length // 2, first + length + (length + 1) // 2
    origin = edge_at(edges, n, period, first)
    lap = 0.0
    if period == math.inf:
        low, high = low if low > 0 else 0, high if high < n else n
    elif low < 0:  # read on from the end of the tail
        low, high, lap = low + n, high + n, period
    inside = 0.0
    for i in range(low, high):
        inside += levels[0, i]
    exposed = covered[high] - covered[low]
    unlit, rest = covered[n] - exposed, total - inside
    unlit = unlit if unlit > 1e-3 * covered[n] else 1e-3 * covered[n]
    background = (rest if rest > 0.5 else 0.5) / unlit
    most = 0.9 * inside / exposed
    background = background if background < most else most
    signal, moment, square = 0.0, 0.0, 0.0
    left = edge_at(edges, n, period, low) - lap - origin
    for i in range(low, high):
        right = edge_at(edges, n, period, i + 1) - lap - origin
        excess = levels[0, i] - background * (covered[i + 1] - covered[i])
        time = 0.5 * (left + right)
        signal += excess
        moment += excess * time
        square += excess * time * time
        left = right
    span = edge_at(edges, n, period, first + length) - origin
    centre = clipped(moment / signal, 0.0, span)
    variance = square / signal - centre * centre - (span / length) ** 2 / 12.0
    if signal * signal < 30.0 * inside:  # moments would be those of the noise
        variance = 0.09 * span * span
    variance = clipped(variance, 0.0144 * span * span, 0.36 * span * span)
    theta[0], theta[1], theta[2] = origin + centre, math.sqrt(variance), signal
    theta[3] = background


@piece
def clipped(value, least, most):
    """The value, or the bound it is beyond; `least` for NaN."""
    value = value if value > least else least
    return value if value < most else most


@piece
def load_window(levels, edges, exposure, n, period, centre, half, w):
    """Copy the bins that overlap centre +- half, times from `centre`; returns (first bin, bins)."""
    lap = 0.0
    if period < math.inf:
        lap = math.floor((centre - half - edges[0]) / period) * period
    low, after = 0, n
    while after - low > 1:
        middle = (low + after) // 2
        if edges[middle] + lap - centre <= -half:
            low = middle
        else:
            after = middle
    m, k = 0, low
    w[EDGE] = edges[k] + lap - centre
    while m < n and m < WIDEST and w[EDGE + m] < half:
        end = edges[k + 1] + lap - centre
        w[COUNT + m] = levels[0, k]
        w[WIDTH + m] = exposure[k]
        w[LIVE + m] = exposure[k] / (end - w[EDGE + m])
        w[DEAD + m] = exposure[k] <= 0.0
        m += 1
        w[EDGE + m] = end
        k += 1
        if k == n:
            if period == math.inf:
                break
            k = 0
            lap += period
    for k in range(m, padded(m)):
        w[COUNT + k] = w[WIDTH + k] = w[LIVE + k] = 0.0
        w[DEAD + k] = 1.0
        w[EDGE + k + 1] = w[EDGE + m]
    return low, m


@piece
def padded(m):
    """Bins of a window with dead ones behind: more than m, as many as some vectors hold.

    A loop over them has no remainder, which would be done one by one.
    """
    return (m // _VECTOR + 1) * _VECTOR


@piece
def normal_at_edges(w, m, centre, scale):
    """Normal integral, density and z density at the edges of a window: no table, no branch.

    scale: one over the std. exp(-x) is a Taylor polynomial of x / 128, squared seven times.
    """
    for k in range(padded(m)):
        z = (w[EDGE + k] - centre) * scale
        z = z if z > -_FURTHEST else -_FURTHEST
        z = z if z < _FURTHEST else _FURTHEST
        y = z * z * _EXP_SCALE
        e = 1.0 + y * (1.0 + y * (_E2 + y * (_E3 + y * (_E4 + y * (_E5 + y * _E6)))))
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        density = _INV_SQRT_2PI * e
        t = 1.0 / (1.0 + _T * abs(z))
        mills = _M4 + t * (_M5 + t * (_M6 + t * _M7))
        mills = _M0 + t * (_M1 + t * (_M2 + t * (_M3 + t * mills)))
        tail = density * mills
        w[BELOW + k] = tail if z <= 0.0 else 1.0 - tail
        w[DENSITY + k] = density
        w[STEEP + k] = z * density


@piece
def inverse_of(cc, cs, ca, cb, ss, sa, sb, aa, ab, bb):
    """Inverse of a symmetric 4 x 4 matrix by blocks of 2 x 2, in the order it is given."""
    scale = 1.0 / (cc * ss - cs * cs)
    own_cc, own_cs, own_ss = ss * scale, -cs * scale, cc * scale
    w_ca, w_cb = own_cc * ca + own_cs * sa, own_cc * cb + own_cs * sb
    w_sa, w_sb = own_cs * ca + own_ss * sa, own_cs * cb + own_ss * sb
    left_aa, left_bb = aa - ca * w_ca - sa * w_sa, bb - cb * w_cb - sb * w_sb
    left_ab = ab - ca * w_cb - sa * w_sb
    scale = 1.0 / (left_aa * left_bb - left_ab * left_ab)
    v_aa, v_ab, v_bb = left_bb * scale, -left_ab * scale, left_aa * scale
    v_ca, v_cb = -w_ca * v_aa - w_cb * v_ab, -w_ca * v_ab - w_cb * v_bb
    v_sa, v_sb = -w_sa * v_aa - w_sb * v_ab, -w_sa * v_ab - w_sb * v_bb
    v_cc, v_ss = own_cc - v_ca * w_ca - v_cb * w_cb, own_ss - v_sa * w_sa - v_sb * w_sb
    v_cs = own_cs - v_ca * w_sa - v_cb * w_sb
    return v_cc, v_cs, v_ca, v_cb, v_ss, v_sa, v_sb, v_aa, v_ab, v_bb


@piece
def fit_window(w, m, out_counts, out_exposure, floor, theta, v):
    """Fisher scoring of one pulse from the start in theta, which it replaces; returns the steps.

    Poisson likelihood of all bins: those outside the window enter through two sums. Centres count
    from the start; the inverse of the information, without symmetric twins, goes into v (10).
    """
    centre, std, photons, background = 0.0, theta[1], theta[2], theta[3]
    before, length2, steps, settled = 1.0, 1.0, 0, False
    scale = 1.0 / std  # taken from step to step, or the compiler would divide in the loops
    while not settled and steps < _MOST_STEPS:
        steps += 1
        before = length2 if length2 < 1.0 else 1.0
        normal_at_edges(w, m, centre, scale)
        slope = photons * scale
        g_c = g_s = g_a = 0.0
        f_cc = f_cs = f_ca = f_cb = f_ss = f_sa = f_sb = f_aa = f_ab = 0.0
        g_b = out_counts / background - out_exposure
        f_bb = out_exposure / background
        for k in range(padded(m)):
            live, width = w[LIVE + k], w[WIDTH + k]
            share = (w[BELOW + k + 1] - w[BELOW + k]) * live
            by_c = slope * (w[DENSITY + k] - w[DENSITY + k + 1]) * live
            by_s = slope * (w[STEEP + k] - w[STEEP + k + 1]) * live
            weight = 1.0 / (photons * share + background * width + w[DEAD + k])
            pull = w[COUNT + k] * weight - 1.0
            g_c += by_c * pull
            g_s += by_s * pull
            g_a += share * pull
            g_b += width * pull
            heavy_c, heavy_s, heavy_a = by_c * weight, by_s * weight, share * weight
            f_cc += heavy_c * by_c
            f_cs += heavy_c * by_s
            f_ca += heavy_c * share
            f_cb += heavy_c * width
            f_ss += heavy_s * by_s
            f_sa += heavy_s * share
            f_sb += heavy_s * width
            f_aa += heavy_a * share
            f_ab += heavy_a * width
            f_bb += width * weight * width
        if background <= floor and g_b < 0.0:  # at its bound, and pushed against it
            g_b = f_cb = f_sb = f_ab = 0.0
            f_bb = 1.0
        cc, cs, ca, cb, ss, sa, sb, aa, ab, bb = inverse_of(
            f_cc, f_cs, f_ca, f_cb, f_ss, f_sa, f_sb, f_aa, f_ab, f_bb
        )
        to_c = cc * g_c + cs * g_s + ca * g_a + cb * g_b
        to_s = cs * g_c + ss * g_s + sa * g_a + sb * g_b
        to_a = ca * g_c + sa * g_s + aa * g_a + ab * g_b
        to_b = cb * g_c + sb * g_s + ab * g_a + bb * g_b
        length2 = to_c * g_c + to_s * g_s + to_a * g_a + to_b * g_b
        if abs(to_c) > std or to_s < -0.3 * std or to_s > 0.4 * std or to_a < -0.6 * photons:
            length2 = math.inf
        shrinking = 1.0 - math.sqrt(length2 / before) if length2 < before else 0.0
        settled = length2 < _SHORT and length2 * length2 < _SETTLED * before * shrinking**2
        if steps > _WHOLE_STEPS:
            to_c, to_s, to_a, to_b = 0.5 * to_c, 0.5 * to_s, 0.5 * to_a, 0.5 * to_b
        centre += clipped(to_c, -std, std)
        std += clipped(to_s, -0.3 * std, 0.4 * std)
        photons += to_a if to_a > -0.6 * photons else -0.6 * photons
        background = background + to_b if background + to_b > floor else floor
        scale = 1.0 / std
    theta[0], theta[1], theta[2], theta[3] = centre, std, photons, background
    v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9] = (
        cc, cs, ca, cb, ss, sa, sb, aa, ab, bb
    )  # fmt: skip
    certain = cc > 0.0 and ss > 0.0 and aa > 0.0 and bb > 0.0
    return steps if certain and length2 < _SHORT else 0


@piece
def log_excess_over(inside, expected):
    """Chernoff's bound where `expected` counts are due whatever the total: see `log_excess`."""
    if inside <= expected:
        return 0.0
    return inside * math.log(inside / expected) - (inside - expected)


@piece
def excess_outside(levels, level, first, last, covered, even, background):
    """Largest log excess over the background of the windows `first` ... `last`."""
    length = 1 << level
    best, fullest = 0.0, levels[level, first] if last > first else levels[0, 0]
    if even > 0.0:
        for i in range(np.uint64(first), np.uint64(last)):
            fullest = levels[level, i] if levels[level, i] > fullest else fullest
        return log_excess_over(float(fullest), background * even * length) if last > first else 0.0
    for i in range(first, last):
        due = background * (covered[i + length] - covered[i])
        above = levels[level, i] - due
        if above > 0.0 and above * above > best * due:  # the excess is at most chi2
            value = log_excess_over(float(levels[level, i]), due)
            best = value if value > best else best
    return best


@piece
def residual_of(levels, n, low, m, covered, even, bin_width, theta, double_code, w):
    """Largest log excess over the fit far from the pulse, in windows of a pulse's length.

    Outside the window of the fit, of `m` bins from `low` on, it is over the background; windows
    may reach half their length into it, where the pulse has all but ended.
    """
    level, length = 0, 1
    while 1.414 * length < 2.5 * theta[1] / bin_width and 4 * length <= n:
        level += 1
        length *= 2
    raised = theta[3] * double_code * (1.0 / length + 0.05)
    count, half, best = n - length + 1, length // 2, 0.0
    ring = low + m - n if low + m > n else 0  # bins of a window across the fold
    first, last = (ring - half if ring > half else 0), low - half
    for _ in range(1 if ring > 0 else 2):  # before the window of the fit, behind it
        last = last if last < count else count
        value = excess_outside(levels, level, first, last, covered, even, theta[3] + raised)
        best = value if value > best else best
        first, last = (low + m - half + 1 if low + m - half + 1 > 0 else 0), count
    inside, due = 0.0, 0.0
    for k in range(m):
        inside += w[COUNT + k]
        due += w[MEAN + k] + raised * w[WIDTH + k]
        if k >= length:
            inside -= w[COUNT + k - length]
            due -= w[MEAN + k - length] + raised * w[WIDTH + k - length]
        if k >= length - 1 and inside > due + 1.0:
            middle = 0.5 * (w[EDGE + k - length + 1] + w[EDGE + k + 1])
            if abs(middle - theta[0]) > ALONE * theta[1]:
                value = log_excess_over(inside, due if due > 1e-12 else 1e-12)
                best = value if value > best else best
    return best


@piece
def describe_fit(levels, inverse, covered, n, live, m, total, theta, w, table, at):
    """Goodness of fit, and the share of the pulse that live bins could record, into the table.

    Pearson chi2, its bins, how unlikely chi2 over the bins with >= 1 expected count is (as a
    standard normal deviate). Leaves the expected counts in the window.
    """
    centre, std, photons, background = theta[0], theta[1], theta[2], theta[3]
    normal_at_edges(w, m, centre, 1.0 / std)
    chi2 = n_bins = rich_chi2 = n_rich = rich_variance = held = 0.0
    out_squares, out_inverse = 0.0, 0.0
    for k in range(n):
        out_squares += float(levels[0, k]) * float(levels[0, k]) * inverse[k]
        out_inverse += inverse[k]
    out_live, out_counts, out_exposure = float(live), total, covered[n]
    for k in range(padded(m)):
        share, width, count = w[BELOW + k + 1] - w[BELOW + k], w[WIDTH + k], w[COUNT + k]
        alive = 1.0 - w[DEAD + k]
        mean = photons * share * w[LIVE + k] + background * width
        w[MEAN + k] = mean
        weight = alive / (mean + w[DEAD + k])
        inverted = alive / (width + w[DEAD + k])
        term = (count - mean) * (count - mean) * weight
        counted = alive if mean >= MIN_EXPECTED else 0.0
        rich = alive if mean >= 1.0 else 0.0
        held += share * alive
        chi2 += term * counted
        n_bins += counted
        rich_chi2 += term * rich
        n_rich += rich
        rich_variance += (2.0 + weight) * rich
        out_squares -= count * count * inverted
        out_inverse -= inverted
        out_live -= alive
        out_counts -= count
        out_exposure -= width
    out = background * out_exposure
    term = out_squares / background - 2.0 * out_counts + out
    if out_live > 0.0 and out >= MIN_EXPECTED * out_live:
        chi2 += term
        n_bins += out_live
    if out_live > 0.0 and out >= out_live:
        rich_chi2 += term
        n_rich += out_live
        rich_variance += 2.0 * out_live + out_inverse / background
    deviate = 0.0
    if n_rich > 0.0:  # Wilson & Hilferty (1931) on the scaled chi2 of the same two moments
        narrow = rich_variance / (9.0 * n_rich * n_rich)
        root = math.exp(math.log(rich_chi2 / n_rich) / 3.0)
        deviate = (root - 1.0 + narrow) / math.sqrt(narrow)
    table[CHI2, at], table[CHI2_BINS, at] = chi2, n_bins
    table[CHI2_DEVIATE, at], table[HELD_SHARE, at] = deviate, held


@piece
def leave_blank(values, covariances, table, at):
    """NaN in a column of the results: nothing is known of the pixel."""
    for a in range(4):
        values[a, at] = math.nan
        for b in range(4):
            covariances[a, b, at] = math.nan
    for a in range(N_COLUMNS):
        table[a, at] = math.nan


def room_for(counts: Counts) -> tuple[Counts, Floats, NDArray[np.int64], Floats]:
    """What `fit_tile` works in: levels of sums, rows of a pixel, codes of its bins, a window."""
    size = 2 * counts.shape[1] + 2
    levels = np.empty((int(math.log2(size)) + 2, 2 * size), counts.dtype)
    return levels, np.empty((6, 2 * size + 10)), np.empty(size, np.int64), np.zeros(ROOM)


@piece
def fit_one(
    levels, edges, exposure, inverse, covered, n, live, even, period, total, dark_counts, whole,
    double_code, n_log, theta, v, w, values, covariances, table, column,
):  # fmt: skip
    """Fit a Gaussian from the start in theta, into a column of the results; False: it is left."""
    floor, origin = 1e-3 / covered[n], theta[0]
    theta[3] = theta[3] if theta[3] > floor else floor
    enough = math.sqrt(2.0 * math.log(1.0 + 100.0 * total))  # std that hold but 1e-3 photons
    noise = math.sqrt(theta[2] + 6.0 * theta[3] * theta[1]) / theta[2]
    half = (enough + _SPARE_REACH) * theta[1] * (1.0 + 2.5 * noise)
    half = half if half < 0.5 * period else 0.5 * period
    low, m = load_window(levels, edges, exposure, n, period, origin, half, w)
    out_counts, out_exposure = total + dark_counts, whole
    for k in range(m):
        out_counts -= w[COUNT + k]
        out_exposure -= w[WIDTH + k]
    steps = fit_window(w, m, out_counts, out_exposure, floor, theta, v)
    open_low = period < math.inf or low > 0
    open_high = period < math.inf or low + m < n
    if (
        steps == 0
        or not theta[1] > 0.2 * covered[n] / live
        or not w[EDGE] < theta[0] < w[EDGE + m]
        or (open_low and theta[0] - enough * theta[1] < w[EDGE])
        or (open_high and theta[0] + enough * theta[1] > w[EDGE + m])
    ):
        return False
    describe_fit(levels, inverse, covered, n, live, m, total, theta, w, table, column)
    bin_width = (edges[n] - edges[0]) / n
    residual = residual_of(levels, n, low, m, covered, even, bin_width, theta, double_code, w)
    if theta[3] <= floor:
        v[9] = 1.0 / (whole * whole)
    i = 0
    for a in range(4):
        values[a, column] = theta[a]
        for b in range(a, 4):
            covariances[a, b, column] = covariances[b, a, column] = v[i]
            i += 1
    values[0, column] += origin
    table[CONVERGED, column], table[STEPS_TAKEN, column] = 1.0, steps
    table[STD_FREE, column], table[RESIDUAL, column] = 1.0, residual - n_log
    return True


@jit
def fit_tile(
    counts: Counts,
    lower: Floats,
    upper: Floats,
    period: float,
    todo: NDArray[np.bool_],
    double_code: Floats,
    trials: Floats,
    dark_counts: Floats,
    dark_ratio: Floats,
    log_alarms: float,
    counted: bool,
    fits: bool,
    first: int,
    starts: Floats,
    left: NDArray[np.int64],
    values: Floats,
    covariances: Floats,
    table: Floats,
    levels: Counts,
    row: Floats,
    codes: NDArray[np.int64],
    w: Floats,
) -> int:
    """Find the one strongest pulse of each pixel of a tile and, where `fits`, fit a Gaussian to it.

    Returns how many pixels with a pulse are left to fit; they are first in `left` (m,), with a
    rough (centre, std, photons, background) in the rows `first` ... of `starts`. Returns -1 where
    counts are too many for their integers: give them as floats.

    counts (m, codes), uint32 or float64; lower, upper (m or 1, codes);
    period inf where nothing folds; todo (m,); double_code (m,), see `scan_for_pulse`; trials (m,):
    laser periods that could have ended with a photon, see `thin_exposure` (inf: no pile-up);
    dark_counts (m,): counts of a background recording, dark_ratio (m,): its exposure over this
    one's (0: none); log_alarms: a pulse must be less likely by chance than exp(-that - 3);
    counted: False for scaled intensities; levels, row, codes, w: see `room_for`.

    Of all pixels, the tile's in columns from `first` on: values (4, n) centre, std, photons,
    background; covariances (4, 4, n) in that order; table (N_COLUMNS, n): counts, exposure,
    largest bin, pulses found, converged, steps, chi2, its bins, its deviate, share of the pulse
    in live bins, 1 where std is not at a bound, log excess of the residuals far from the pulse.
    What has no meaning is NaN.
    """
    edges, exposure, inverse, covered, theta, v = row[0], row[1], row[2], row[3], row[4], row[5]
    shared, fresh = lower.shape[0] == 1, False
    n, reach, live, even, n_left, n_log, trials_log = 0, 0, 0, 0.0, 0, 0.0, 0.0
    most = 4294967296.0 if levels.itemsize == 4 else math.inf
    for i in range(counts.shape[0]):
        column = first + i
        leave_blank(values, covariances, table, column)
        if not todo[i]:
            continue
        if not (shared and fresh):
            n = bins_from_codes(lower, upper, 0 if shared else i, period, edges, exposure, codes)
            reach = 2 * n if period < math.inf else n
            live, even = sum_exposure(exposure, n, reach, inverse, covered)
            fresh, n_log, trials_log = True, math.log(n) if n > 0 else 0.0, log_trials(n)
        table[N_PULSES, column] = 0.0
        if n == 0:  # no code of this pixel has a width
            table[COUNTS, column] = 0.0
            for k in range(counts.shape[1]):
                table[COUNTS, column] += counts[i, k]
            continue
        total, peak = take_counts(counts, i, codes, n, reach, levels)
        if total >= most:
            return -1
        table[COUNTS, column], table[EXPOSURE, column] = total, covered[n]
        table[PEAK, column] = peak
        dark_exposure = dark_ratio[i] * covered[n]
        if trials[i] < math.inf:
            thin_exposure(levels, n, trials[i], exposure)
            live, even = sum_exposure(exposure, n, reach, inverse, covered)
            fresh = False
        whole = covered[n] + dark_exposure
        floor = log_alarms + trials_log if counted else 0.0
        excess, at, length = scan_for_pulse(
            levels, n, reach, covered, even, double_code[i], total, peak, floor
        )
        if total <= 0.0 or (counted and excess <= floor):
            values[3, column] = (total + dark_counts[i]) / whole
            continue
        table[N_PULSES, column] = 1.0
        start_from_window(levels, edges, n, period, total, covered, at, length, theta)
        for k in range(4):
            starts[column, k] = theta[k]
        left[n_left] = column
        n_left += 1
        if not fits:
            continue
        n_left -= fit_one(
            levels, edges, exposure, inverse, covered, n, live, even, period, total,
            dark_counts[i], whole, double_code[i], n_log, theta, v, w, values, covariances,
            table, column,
        )  # fmt: skip
    return n_left


@piece
def log_trials(n):
    """Logarithm of the number of windows that `scan_for_pulse` tries over n bins."""
    levels = 0
    while (2 << levels) <= n:
        levels += 1
    return math.log(n * (levels if levels > 0 else 1)) if n > 0 else 0.0
