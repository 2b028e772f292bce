"""Code edges from the few numbers that describe a clock, and how their errors add up.

Pure functions in units of the width of a plateau code, shared by `code_density`, which fits
those numbers, and `TimingCalibration`, which gives edges on demand.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_BLOCK = 4096

MOST_PHASES = 64
"""Longer patterns are treated as widths that are independent of each other."""


def relative_widths(
    phases: Floats,
    *,
    shared: Floats,
    end_code: Floats,
    end_widths: Floats,
    first_live_code: int,
    first_live_width: Floats,
) -> Floats:
    """Relative width of every code of some pixels, as if no period ended: (n, codes).

    Parameters
    ----------
    phases : array of float, shape (n, n_phases)
        Widths of codes modulo n_phases.
    shared : array of float, shape (codes,)
        Widths that all pixels share.
    end_code : array of float, shape (n,)
        Fractional code at which the period ends.
    end_widths : array of float, shape (m,)
        Widths by distance from that end, see `end_factor`.
    first_live_code : int
        The first code that is not dead.
    first_live_width : array of float, shape (n,)
        Its width in each pixel; NaN: none of its own.

    Returns
    -------
    array of float, shape (n, codes)
        In widths of a plateau code of each pixel.
    """
    code = np.arange(len(shared))
    widths = phases[:, code % phases.shape[1]] * shared
    if len(end_widths):
        widths = widths * end_factor(end_code, code, end_widths)
    # It takes up the dead codes' time, which differs between pixels and follows no pattern.
    own = np.isfinite(first_live_width)
    widths[own, first_live_code] = first_live_width[own]
    return widths


def end_factor(end_code: Floats, code: NDArray[np.intp], end_widths: Floats) -> Floats:
    """Relative width of codes by their distance from the end of the period: (n, k).

    The sync disturbs the clock; `end_widths[i]` is the width of a code whose middle lies
    i + 1/2 codes before the end. Farther away codes are undisturbed.

    Parameters
    ----------
    end_code : array of float, shape (n,)
        Fractional code at which the period ends.
    code : array of int, shape (k,)
        Codes that are asked for.
    end_widths : array of float, shape (m,)
        Width of a code whose middle lies i + 1/2 codes before the end.

    Returns
    -------
    array of float, shape (n, k)
        1 where the sync does not disturb the clock.
    """
    distance = end_code[:, None] - (code + 0.5)
    middle = np.arange(len(end_widths) + 1) + 0.5
    return np.asarray(np.interp(distance, middle, np.append(end_widths, 1.0)))


def edges_and_end(widths: Floats, end_code: Floats) -> tuple[Floats, Floats]:
    """Edges counted from code 0, and the place of the period's end among them.

    Parameters
    ----------
    widths : array of float, shape (n, codes)
    end_code : array of float, shape (n,)
        Beyond the last code, codes are taken as 1 wide.

    Returns
    -------
    edges : array of float, shape (n, codes + 1)
    end : array of float, shape (n,)
    """
    n_codes = widths.shape[1]
    edges = np.zeros((len(widths), n_codes + 1))
    np.cumsum(widths, axis=1, out=edges[:, 1:])
    # A pixel whose end is not known has edges all the same, of which none is known.
    whole = np.clip(np.nan_to_num(end_code).astype(np.intp), 0, n_codes)
    pixel = np.arange(len(widths))
    # The period may end in a part of a code, and beyond the last code.
    last = np.where(whole < n_codes, widths[pixel, np.minimum(whole, n_codes - 1)], 1.0)
    return edges, edges[pixel, whole] + (end_code - whole) * last


def walk_variance(code: Floats, anchor: Floats, end_code: Floats) -> Floats:
    """Variance of the sum of unit-variance widths between two codes, all summing to zero.

    Parameters
    ----------
    code : array of float, shape (n,)
        Fractional code of the pulse.
    anchor : array of float, shape (n,)
        Fractional code of the flat's pulse; NaN: none.
    end_code : array of float, shape (n,)
        N, the fractional code at which the period ends.

    Returns
    -------
    array of float, shape (n,)
        m (1 - m / N) for m codes in between, never negative: a random walk that returns to zero.
    """
    # Without a flat nothing is known but the period's end: the walk starts there.
    between = np.abs(code - np.where(np.isfinite(anchor), anchor, end_code))
    return np.asarray(between * np.maximum(1.0 - between / end_code, 0.0))


def walked(codes: Floats, ends: Floats) -> Floats:
    """A walk of unit steps from zero to some places, by stretches that are independent: (n, 2 k).

    Within each stretch it is taken for a straight line: one number says where it leads.

    Parameters
    ----------
    codes : array of float, shape (n,)
        Distance that is walked, forward or back.
    ends : array of float, shape (k - 1,)
        Of the stretches but the last, ascending; the same in both directions.

    Returns
    -------
    array of float, shape (n, 2 k)
        Its squares summed up are the variance at the end of each stretch.
    """
    columns = []
    for gone in (codes, -codes):
        passed = np.maximum(gone, 0.0)
        for first, last in pairwise((0.0, *ends)):
            inside = np.clip(passed - first, 0.0, last - first)
            columns.append(inside / np.sqrt(last - first))
        columns.append(np.sqrt(np.maximum(passed - ends[-1], 0.0)))
    return np.stack(columns, axis=1)


def phase_lever(code: Floats, response_codes: Floats, n_phases: int) -> Floats:
    """Time of a pulse (in plateau widths) per unit of each phase, phases held to mean 1.

    With h_j(u) = (codes of phase j below u) - u / n_phases, a saw tooth of period n_phases, a
    pulse of width s at u moves by the Gaussian average of h_j; summed here as a Fourier series.

    Parameters
    ----------
    code : array of float, shape (n,)
        Fractional code of the pulse.
    response_codes : array of float, shape (n,)
        Standard deviation of the pulse, codes.

    Returns
    -------
    array of float, shape (n, n_phases)
        Its mean over a period is zero.
    """
    # Pulses are wider than a code: the Gaussian damps higher harmonics of the saw tooth to nothing.
    harmonic = np.arange(1, 4 * n_phases + 1)
    omega = 2.0 * np.pi * harmonic / n_phases
    start = np.exp(-1j * omega[:, None] * (np.arange(n_phases) + 0.5))
    weight = np.sinc(harmonic / n_phases) / n_phases / (1j * omega)
    lever = np.empty((len(code), n_phases))
    for first in range(0, len(code), _BLOCK):
        block = slice(first, first + _BLOCK)
        damping = np.exp(-0.5 * (omega * response_codes[block, None]) ** 2)
        wave = np.exp(1j * omega * code[block, None]) * damping
        lever[block] = 2.0 * np.real((wave * weight) @ start)
    return lever
