"""Sixteen single-pulse fits at once: the Poisson fit of `_kernels.pulse`, one pixel per lane.

The arithmetic of a step is written for a *lane file*: a flat array in which row r of lane i is
`r + i` for the row constants below (multiples of LANES), and for *windows*: a flat array of BIN
numbers per bin, with rows of its own. Offsets known when compiling are what lets the compiler
turn every line of a `for i in range(LANES)` into one vector instruction.

Single precision is enough: times count from the start of the fit, tails are kept as tails, and
rounding stays below 1e-3 standard errors up to 10^9 photons. Lanes do not influence each other:
a bin beyond a lane's own window has no width, no weight and adds exact zeros. What a lane cannot
settle (no convergence in a few undamped steps, a window too small) is left to the general kernel.
"""

from __future__ import annotations

import math

import numpy as np

from lightflight._kernels.jit import jit, jit_lent

LANES = 16
MAX_BINS = 48
MOST_STEPS = 12

_N_ROWS = 48
(
    CENTRE, STD, PHOTONS, BACKGROUND, FLOOR, OUT_COUNTS, OUT_EXPOSURE, SCALE,
    FIRST, Z, PDF, TAIL, LENGTH2,
    G_C, G_S, G_A, G_B,
    F_CC, F_CS, F_CA, F_CB, F_SS, F_SA, F_SB, F_AA, F_AB, F_BB,
    V_CC, V_CS, V_CA, V_CB, V_SS, V_SA, V_SB, V_AA, V_AB, V_BB,
    HELD, CHI2, N_BINS, RICH_CHI2, N_RICH, RICH_VARIANCE, FAR_CHI2,
) = range(0, 44 * LANES, LANES)  # fmt: skip

BIN = 4 * LANES
END, COUNT, WIDTH, MEAN = range(0, BIN, LANES)

# Everything in single precision: a plain 1.0 would make the compiler compute in double.
_ZERO, _HALF, _ONE, _TWO, _INF = (np.float32(x) for x in (0.0, 0.5, 1.0, 2.0, math.inf))
_FURTHEST = np.float32(8.5)  # std beyond which a tail is nothing (1e-17)
_FAR = np.float32(3.0)  # std beyond which counts in excess may be another pulse
_SOFT = np.float32(0.1)  # counts that soften the chi2 of far bins
_LEAST = np.float32(0.01)  # bins expected to hold fewer counts say nothing about goodness of fit
_SHRINK_STD, _GROW_STD, _SHRINK_PHOTONS = np.float32(-0.3), np.float32(0.4), np.float32(-0.6)
_INV_SQRT_2PI = np.float32(1.0 / math.sqrt(2.0 * math.pi))
_EXP_SCALE = np.float32(-0.5 / 128.0)
_E2, _E3, _E4, _E5, _E6 = (np.float32(1.0 / math.factorial(i)) for i in range(2, 7))

# Mills' ratio (1 - Phi(z)) / phi(z) as a polynomial in t = 1 / (1 + _T z), after the form of
# Abramowitz & Stegun 26.2.17; fitted here for 0 <= z <= 8.5, error of Phi below 1e-9.
_T = np.float32(0.24)
_M0, _M1, _M2, _M3, _M4, _M5, _M6, _M7 = (
    np.float32(x)
    for x in (
        0.00318881163018813, 0.196444909262509, 0.494364871157439, -0.60213529734641,
        1.83449097143721, -1.81558317495243, 1.46995196554003, -0.327408921012691,
    )
)  # fmt: skip


@jit_lent
def normal_pdf_tail(z):
    """Density phi(z) and tail 1 - Phi(|z|) of the standard normal, for |z| <= 8.5.

    exp(-x) is a Taylor polynomial of x / 128, squared seven times: no table, no branch.
    """
    y = z * z * _EXP_SCALE
    e = _ONE + y * (_ONE + y * (_E2 + y * (_E3 + y * (_E4 + y * (_E5 + y * _E6)))))
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    pdf = _INV_SQRT_2PI * e
    t = _ONE / (_ONE + _T * abs(z))
    mills = _M0 + t * (_M1 + t * (_M2 + t * (_M3 + t * (_M4 + t * (_M5 + t * (_M6 + t * _M7))))))
    return pdf, pdf * mills


@jit_lent
def start_pass(f):
    """Clear the sums; terms of the first edge; what the bins outside the window contribute."""
    for i in range(LANES):
        scale = _ONE / f[STD + i]
        z = (f[FIRST + i] - f[CENTRE + i]) * scale
        z = min(max(z, -_FURTHEST), _FURTHEST)
        pdf, tail = normal_pdf_tail(z)
        f[SCALE + i] = scale
        f[Z + i] = z
        f[PDF + i] = pdf
        f[TAIL + i] = tail
        inverse = _ONE / f[BACKGROUND + i]
        f[G_B + i] = f[OUT_COUNTS + i] * inverse - f[OUT_EXPOSURE + i]
        f[F_BB + i] = f[OUT_EXPOSURE + i] * inverse
    for i in range(LANES):
        f[G_C + i] = f[G_S + i] = f[G_A + i] = _ZERO
        f[F_CC + i] = f[F_CS + i] = f[F_CA + i] = f[F_CB + i] = _ZERO
        f[F_SS + i] = f[F_SA + i] = f[F_SB + i] = f[F_AA + i] = f[F_AB + i] = _ZERO
        f[HELD + i] = f[CHI2 + i] = f[N_BINS + i] = f[FAR_CHI2 + i] = _ZERO
        f[RICH_CHI2 + i] = f[N_RICH + i] = f[RICH_VARIANCE + i] = _ZERO


@jit_lent
def add_bin(f, w):
    """Add the bin w, which ends at END with COUNT counts and WIDTH of exposure, to all sums."""
    for i in range(LANES):
        scale, width, count = f[SCALE + i], w[WIDTH + i], w[COUNT + i]
        before, pdf_before, tail_before = f[Z + i], f[PDF + i], f[TAIL + i]
        z = (w[END + i] - f[CENTRE + i]) * scale
        z = min(max(z, -_FURTHEST), _FURTHEST)
        pdf, tail = normal_pdf_tail(z)
        f[Z + i], f[PDF + i], f[TAIL + i] = z, pdf, tail
        # Differences of tails on one side of the centre: precise however small.
        around = _ONE - tail - tail_before
        left_or_around = tail - tail_before if z <= _ZERO else around
        share = tail_before - tail if before >= _ZERO else left_or_around
        steep = f[PHOTONS + i] * scale
        by_c = steep * (pdf_before - pdf)
        by_s = steep * (before * pdf_before - z * pdf)
        mean = f[PHOTONS + i] * share + f[BACKGROUND + i] * width
        w[MEAN + i] = mean
        live = _ONE if width > _ZERO else _ZERO
        weight = _ONE / mean if width > _ZERO else _ZERO
        pull = count * weight - live
        f[HELD + i] += share * live
        f[G_C + i] += by_c * pull
        f[G_S + i] += by_s * pull
        f[G_A + i] += share * pull
        f[G_B + i] += width * pull
        heavy_c, heavy_s, heavy_a = by_c * weight, by_s * weight, share * weight
        f[F_CC + i] += heavy_c * by_c
        f[F_CS + i] += heavy_c * by_s
        f[F_CA + i] += heavy_c * share
        f[F_CB + i] += heavy_c * width
        f[F_SS + i] += heavy_s * by_s
        f[F_SA + i] += heavy_s * share
        f[F_SB + i] += heavy_s * width
        f[F_AA + i] += heavy_a * share
        f[F_AB + i] += heavy_a * width
        f[F_BB + i] += width * weight * width
        off = count - mean
        chi2 = off * off * weight
        counted = live if mean >= _LEAST else _ZERO
        rich = live if mean >= _ONE else _ZERO
        f[CHI2 + i] += chi2 * counted
        f[N_BINS + i] += counted
        f[RICH_CHI2 + i] += chi2 * rich
        f[N_RICH + i] += rich
        f[RICH_VARIANCE + i] += (_TWO + weight) * rich
        far = live if abs(z + before) > _TWO * _FAR else _ZERO
        excess = max(off, _ZERO)
        f[FAR_CHI2 + i] += far * excess * excess / (mean + _SOFT)


@jit_lent
def invert_information(f):
    """Set V to the inverse of the 4 x 4 information F, by its factors L D L^T.

    A background at its floor and pushed down is taken out: unit row, no gradient.
    """
    for i in range(LANES):
        stuck = f[BACKGROUND + i] <= f[FLOOR + i] and f[G_B + i] < _ZERO
        keep = _ZERO if stuck else _ONE
        f[G_B + i] *= keep
        f30, f31, f32 = f[F_CB + i] * keep, f[F_SB + i] * keep, f[F_AB + i] * keep
        f33 = _ONE if stuck else f[F_BB + i]
        d0 = _ONE / f[F_CC + i]
        l10, l20, l30 = f[F_CS + i] * d0, f[F_CA + i] * d0, f30 * d0
        d1 = _ONE / (f[F_SS + i] - l10 * f[F_CS + i])
        u21 = f[F_SA + i] - l20 * f[F_CS + i]
        u31 = f31 - l30 * f[F_CS + i]
        l21, l31 = u21 * d1, u31 * d1
        d2 = _ONE / (f[F_AA + i] - l20 * f[F_CA + i] - l21 * u21)
        u32 = f32 - l30 * f[F_CA + i] - l31 * u21
        l32 = u32 * d2
        d3 = _ONE / (f33 - l30 * f30 - l31 * u31 - l32 * u32)
        m20 = l21 * l10 - l20  # rows of the inverse of L
        m31 = l32 * l21 - l31
        m30 = l31 * l10 - l30 - l32 * m20
        f[V_CC + i] = d0 + l10 * l10 * d1 + m20 * m20 * d2 + m30 * m30 * d3
        f[V_CS + i] = m31 * m30 * d3 - l10 * d1 - l21 * m20 * d2
        f[V_CA + i] = m20 * d2 - l32 * m30 * d3
        f[V_CB + i] = m30 * d3
        f[V_SS + i] = d1 + l21 * l21 * d2 + m31 * m31 * d3
        f[V_SA + i] = -l21 * d2 - l32 * m31 * d3
        f[V_SB + i] = m31 * d3
        f[V_AA + i] = d2 + l32 * l32 * d3
        f[V_AB + i] = -l32 * d3
        f[V_BB + i] = d3


@jit_lent
def take_step(f):
    """Step V G, limited; LENGTH2 is its squared length in standard errors (inf if limited)."""
    for i in range(LANES):
        gc, gs, ga, gb = f[G_C + i], f[G_S + i], f[G_A + i], f[G_B + i]
        dc = f[V_CC + i] * gc + f[V_CS + i] * gs + f[V_CA + i] * ga + f[V_CB + i] * gb
        ds = f[V_CS + i] * gc + f[V_SS + i] * gs + f[V_SA + i] * ga + f[V_SB + i] * gb
        da = f[V_CA + i] * gc + f[V_SA + i] * gs + f[V_AA + i] * ga + f[V_AB + i] * gb
        db = f[V_CB + i] * gc + f[V_SB + i] * gs + f[V_AB + i] * ga + f[V_BB + i] * gb
        std, photons, background = f[STD + i], f[PHOTONS + i], f[BACKGROUND + i]
        step_c = min(max(dc, -std), std)
        step_s = min(max(ds, _SHRINK_STD * std), _GROW_STD * std)
        step_a = max(da, _SHRINK_PHOTONS * photons)
        whole = step_c == dc and step_s == ds and step_a == da
        length2 = dc * gc + ds * gs + da * ga + db * gb
        f[LENGTH2 + i] = length2 if whole else _INF
        f[CENTRE + i] += step_c
        f[STD + i] = std + step_s
        f[PHOTONS + i] = photons + step_a
        f[BACKGROUND + i] = max(background + db, f[FLOOR + i])


@jit_lent
def step_lanes(lanes, n_bins):
    """One Fisher scoring step of every lane, over windows of up to n_bins bins.

    The rows MEAN of the windows then hold the expected counts before the step.
    """
    f, windows = lanes
    start_pass(f)
    for k in range(n_bins):
        add_bin(f, windows[k * BIN : (k + 1) * BIN])
    invert_information(f)
    take_step(f)


@jit
def new_lanes():
    """(lane file, windows), with harmless content."""
    f = np.zeros(_N_ROWS * LANES, np.float32)
    f[CENTRE : CENTRE + 4 * LANES] = _ONE
    return f, np.zeros(MAX_BINS * BIN, np.float32)
