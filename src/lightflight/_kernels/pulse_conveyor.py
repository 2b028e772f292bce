"""A conveyor of lanes: pixels are put into free lanes, stepped together, taken out when settled.

What `_kernels.pulse_lanes` computes for sixteen pixels is fed and read here, one at a time. A
pixel that a lane cannot settle is handed back, and the general kernel fits it from the same
start. The order of pixels does not change their results.
"""

from __future__ import annotations

import math

import numpy as np

from lightflight._kernels import pulse_lanes as lane
from lightflight._kernels.bins import largest, log_excess_over, residual_level
from lightflight._kernels.jit import jit, jit_inlined, jit_lent, jit_reordered
from lightflight._kernels.pulse import MIN_EXPECTED, normal_from_chi2
from lightflight._kernels.pulse_lanes import BIN, LANES, MAX_BINS, MOST_STEPS, step_lanes

SPARE_REACH = 1.0  # std that a window has on either side beyond the pulse of the start
SETTLED = 1e-4  # squared length of the last step, in standard errors
ALONE = 3.0  # residuals further than this many std from the pulse may be another one
SUSPICIOUS = 12.0  # chi2 of such bins from which they are looked at
NARROW, BROAD = 18, 28  # bins; windows of like length travel together
FREE = -1.0

# What is kept of the pixel in each lane, beside its window (rows of `kept`).
(
    PIXEL, BINS, STEPS, ORIGIN, OUT_COUNTS, OUT_EXPOSURE, OUT_SQUARES, OUT_INVERSES, OUT_BINS,
    WHOLE, LENGTH, RAISED, LOW_CUT, HIGH_CUT, MIN_STD, RESIDUAL, LOG_ALL, REACH,
) = range(18)  # fmt: skip


@jit
def new_conveyor():
    """Lanes with nothing in them: lanes, what is kept of their pixels, running sums."""
    kept = np.zeros((18, LANES))
    kept[PIXEL] = FREE
    return lane.new_lanes(), kept, np.empty(MAX_BINS + 1)


@jit_inlined
def free_slot(conveyor):
    """A lane with nothing in it, or -1."""
    for slot in range(LANES):
        if conveyor[1][PIXEL, slot] == FREE:
            return slot
    return -1


@jit_inlined
def reach_of(photons):
    """Std on either side of its centre beyond which a pulse holds less than 1e-3 photons."""
    return math.sqrt(2.0 * math.log(1.0 + 100.0 * photons))


@jit_reordered
def sum_of_squares(values, inverse):
    """Sum of counts^2 / exposure."""
    total = 0.0
    for i in range(values.size):
        total += float(values[i]) * float(values[i]) * inverse[i]
    return total


@jit_inlined
def excess_outside(sums, n, low, high, length, covered, even, background):
    """Largest log excess over the background of windows outside bins [low, high).

    Windows may reach half their length into it, where the pulse has all but ended.
    """
    count = n - length + 1
    before = min(max(low - length // 2, 0), count)
    after = max(high - length // 2 + 1, 0)
    best, fullest = 0.0, 0.0
    for part in range(2):
        first, last = (0, before) if part == 0 else (after, count)
        if last <= first:
            continue
        if even > 0.0:
            fullest = max(fullest, float(largest(sums[first:last])))
            continue
        for i in range(first, last):
            due = background * (covered[i + length] - covered[i])
            above = sums[i] - due
            if above > 0.0 and above * above > best * due:  # the excess is at most chi2
                best = max(best, log_excess_over(float(sums[i]), due))
    if even > 0.0:
        return log_excess_over(fullest, background * even * length)
    return best


@jit_inlined
def window_of(theta, near, edges, n, period, enough):
    """Bins (low, high) that a pulse like theta needs; (0, 0) where lanes cannot hold them.

    near: a bin near the centre; enough: std on either side that hold the pulse (`reach_of`).
    """
    centre, photons, std, background = theta
    if not edges[0] < centre < edges[n]:
        return 0, 0
    low = min(near, n - 1)
    while edges[low] > centre:
        low -= 1
    while edges[low + 1] <= centre:
        low += 1
    high = low + 1
    noise = math.sqrt(photons + 6.0 * background * std) / photons
    # a noisy start may have to widen
    reach = (enough + SPARE_REACH) * std * (1.0 + 2.5 * noise)
    while low > 0 and edges[low] > centre - reach:
        low -= 1
    while high < n and edges[high] < centre + reach:
        high += 1
    if high - low > MAX_BINS or (period < math.inf and (low == 0 or high == n)):
        return 0, 0
    return low, high


@jit_inlined
def load_lane(conveyor, pixel, theta, low, high, row, double_code, dark):
    """Put bins [low, high) of a pixel, and a start, into a free lane.

    row: (levels, edges, exposure, inverse, covered, n, total, enough, even, bounds, log of n);
    dark: (counts, exposure) of a background recording.
    """
    (file, windows), kept, _ = conveyor
    levels, edges, exposure, inverse, covered, n, total, enough, even, bounds, n_log = row
    centre, std, background = theta[0], theta[2], max(theta[3], bounds[2])
    slot = free_slot(conveyor)
    out_counts, out_inverses, out_bins = total, inverse[n], inverse[n + 1]
    out_exposure = covered[n] - (covered[high] - covered[low])
    out_squares = sum_of_squares(levels[0][:low], inverse[:low])
    out_squares += sum_of_squares(levels[0][high:n], inverse[high:n])
    counts, ends = levels[0][low:high], edges[low + 1 : high + 1]
    widths, inverses = exposure[low:high], inverse[low:high]
    w_ends, w_counts = windows[lane.END + slot :: BIN], windows[lane.COUNT + slot :: BIN]
    w_widths = windows[lane.WIDTH + slot :: BIN]
    file[lane.FIRST + slot] = edges[low] - centre
    for k in range(high - low):
        w_ends[k] = ends[k] - centre
        w_counts[k] = counts[k]
        w_widths[k] = widths[k]
        out_counts -= counts[k]
        out_inverses -= inverses[k]
        out_bins -= widths[k] > 0.0
    for k in range(high - low, int(kept[BINS, slot])):
        w_widths[k] = 0.0
    file[lane.CENTRE + slot], file[lane.STD + slot] = 0.0, std
    file[lane.PHOTONS + slot], file[lane.BACKGROUND + slot] = theta[1], background
    file[lane.FLOOR + slot] = bounds[2]
    file[lane.OUT_COUNTS + slot] = out_counts + dark[0]
    file[lane.OUT_EXPOSURE + slot] = out_exposure + dark[1]
    level = residual_level(std, (edges[n] - edges[0]) / n, n)
    length = 1 << level
    raised = double_code * (1.0 / length + 0.05) * background
    kept[PIXEL, slot], kept[BINS, slot], kept[STEPS, slot] = pixel, high - low, 0.0
    kept[ORIGIN, slot], kept[LOG_ALL, slot] = centre, n_log
    kept[REACH, slot] = enough
    kept[OUT_COUNTS, slot], kept[OUT_EXPOSURE, slot] = out_counts, out_exposure
    kept[OUT_SQUARES, slot], kept[OUT_INVERSES, slot] = out_squares, out_inverses
    kept[OUT_BINS, slot], kept[WHOLE, slot] = out_bins, covered[n] + dark[1]
    kept[LENGTH, slot], kept[RAISED, slot], kept[MIN_STD, slot] = length, raised, bounds[0]
    kept[LOW_CUT, slot], kept[HIGH_CUT, slot] = low == 0, high == n
    kept[RESIDUAL, slot] = excess_outside(
        levels[level], n, low, high, length, covered, even, background + raised
    )


@jit_inlined
def is_good(conveyor, slot):
    """True where a lane holds a converged fit of a pulse well inside its window."""
    (file, windows), kept, _ = conveyor
    centre, std = file[lane.CENTRE + slot], file[lane.STD + slot]
    first = file[lane.FIRST + slot]
    last = windows[(int(kept[BINS, slot]) - 1) * BIN + lane.END + slot]
    reach = kept[REACH, slot] * std
    settled = file[lane.LENGTH2 + slot] < SETTLED and std > 2.0 * kept[MIN_STD, slot]
    holds_low = kept[LOW_CUT, slot] == 1.0 or centre - reach >= first
    holds_high = kept[HIGH_CUT, slot] == 1.0 or centre + reach <= last
    certain = min(file[lane.V_CC + slot], file[lane.V_SS + slot]) > 0.0
    certain &= min(file[lane.V_AA + slot], file[lane.V_BB + slot]) > 0.0
    return settled and holds_low and holds_high and certain and first < centre < last


@jit_inlined
def read_lane(conveyor, slot, results, at):
    """Fit of a lane into column `at` of the results; see `pulse_tile.fit_tile`."""
    (file, _), kept, _ = conveyor
    values, covariances, table = results
    background = file[lane.BACKGROUND + slot]
    values[0, at] = kept[ORIGIN, slot] + float(file[lane.CENTRE + slot])
    values[1, at], values[2, at] = file[lane.STD + slot], file[lane.PHOTONS + slot]
    values[3, at] = background
    rows = (
        (lane.V_CC, lane.V_CS, lane.V_CA, lane.V_CB),
        (lane.V_CS, lane.V_SS, lane.V_SA, lane.V_SB),
        (lane.V_CA, lane.V_SA, lane.V_AA, lane.V_AB),
        (lane.V_CB, lane.V_SB, lane.V_AB, lane.V_BB),
    )
    for a in range(4):
        for b in range(4):
            covariances[a, b, at] = file[rows[a][b] + slot]
    if background <= file[lane.FLOOR + slot]:
        covariances[3, 3, at] = 1.0 / kept[WHOLE, slot] ** 2
    chi2, n_bins = float(file[lane.CHI2 + slot]), float(file[lane.N_BINS + slot])
    rich_chi2, n_rich = float(file[lane.RICH_CHI2 + slot]), float(file[lane.N_RICH + slot])
    rich_variance = float(file[lane.RICH_VARIANCE + slot])
    n_out, out = kept[OUT_BINS, slot], background * kept[OUT_EXPOSURE, slot]
    term = kept[OUT_SQUARES, slot] / background - 2.0 * kept[OUT_COUNTS, slot] + out
    if n_out > 0 and out >= MIN_EXPECTED * n_out:
        chi2 += term
        n_bins += n_out
    if n_out > 0 and out >= n_out:
        rich_chi2 += term
        n_rich += n_out
        rich_variance += 2.0 * n_out + kept[OUT_INVERSES, slot] / background
    residual = kept[RESIDUAL, slot]
    if file[lane.FAR_CHI2 + slot] > SUSPICIOUS:
        residual = max(residual, residual_in_lane(conveyor, slot))
    table[0, at], table[1, at], table[2, at], table[3, at] = 1.0, 1.0, kept[STEPS, slot], chi2
    table[4, at], table[5, at] = n_bins, normal_from_chi2(rich_chi2, n_rich, rich_variance)
    table[6, at], table[7, at] = file[lane.HELD + slot], 1.0
    table[8, at] = residual - kept[LOG_ALL, slot]


@jit_lent
def residual_in_lane(conveyor, slot):
    """Largest log excess over the fit of windows in a lane that are ALONE std from the pulse."""
    (file, windows), kept, running = conveyor
    m, length = int(kept[BINS, slot]), int(kept[LENGTH, slot])
    centre, alone = file[lane.CENTRE + slot], ALONE * file[lane.STD + slot]
    ends, counts = windows[lane.END + slot :: BIN], windows[lane.COUNT + slot :: BIN]
    widths, means = windows[lane.WIDTH + slot :: BIN], windows[lane.MEAN + slot :: BIN]
    running[0] = 0.0
    for k in range(m):
        running[k + 1] = running[k] + means[k] + kept[RAISED, slot] * widths[k]
    best, inside = 0.0, 0.0
    for k in range(min(length, m)):
        inside += counts[k]
    for i in range(m - length + 1):
        due = running[i + length] - running[i]
        if inside > due + 1.0:
            start = ends[i - 1] if i > 0 else file[lane.FIRST + slot]
            middle = 0.5 * (start + ends[i + length - 1])
            if abs(middle - centre) > alone:
                best = max(best, log_excess_over(inside, max(due, 1e-12)))
        if i < m - length:
            inside += counts[i + length] - counts[i]
    return best


@jit_lent
def run_conveyor(conveyor, drain, results, left, n_left):
    """Step the lanes until one is free (drain: until all are); returns how many are left over.

    Settled fits go into their columns of the results, pixels that did not settle into `left`.
    """
    lanes, kept, _ = conveyor
    file = lanes[0]
    while drain or free_slot(conveyor) < 0:
        longest = 0.0
        for slot in range(LANES):
            if kept[PIXEL, slot] != FREE:
                longest = max(longest, kept[BINS, slot])
        if longest == 0.0:
            break
        step_lanes(lanes, int(longest))
        for slot in range(LANES):
            kept[STEPS, slot] += 1.0
            moving = file[lane.LENGTH2 + slot] >= SETTLED and kept[STEPS, slot] < MOST_STEPS
            if moving or kept[PIXEL, slot] == FREE:
                continue
            pixel = int(kept[PIXEL, slot])
            kept[PIXEL, slot] = FREE
            if is_good(conveyor, slot):
                read_lane(conveyor, slot, results, pixel)
            else:
                left[n_left] = pixel
                n_left += 1
    return n_left
