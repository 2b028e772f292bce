"""Poisson likelihood of the counts of one pixel, with score and information, for `forward`.

Local variables of a pixel with L legs, in this order: for each leg (ln photons, time, ln std of
its pulse), then ln background. Everything the path, the brightness and the clock do to a pixel
they do through these, so the kernel knows no geometry.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lightflight._kernels.jit import jit, piece

Floats = NDArray[np.float64]

_REACH = 7.0
"""Half width of a pulse's window, in standard deviations."""
_INV_SQRT_2 = 1.0 / math.sqrt(2.0)
_INV_SQRT_2PI = 1.0 / math.sqrt(2.0 * math.pi)


@piece
def shape_at(shape: Floats, upper: int, part: float, z: float) -> tuple[float, float, float]:
    """Share of a pulse that has come by z of its own std, density there, and what flight adds.

    shape (k, 3, m): of each flight z in even steps, cumulated shape, density, which is straight in
    between; `part` of the way from the table below `upper` to it, which would add the last.
    """
    step = shape[0, 0, 1] - shape[0, 0, 0]
    place = (z - shape[0, 0, 0]) / step
    if not place > 0.0:
        return 0.0, 0.0, 0.0
    if place >= shape.shape[2] - 1:
        return 1.0, 0.0, 0.0
    i = int(place)
    more = place - i
    come, density, added = 0.0, 0.0, 0.0
    for k in range(upper - 1, upper + 1):
        share = part if k == upper else 1.0 - part
        here = shape[k, 2, i] + more * (shape[k, 2, i + 1] - shape[k, 2, i])
        by_here = shape[k, 1, i] + 0.5 * more * step * (shape[k, 2, i] + here)
        come += share * by_here
        density += share * here
        added += by_here if k == upper else -by_here
    return come, density, added


@piece
def bend_at(shape: Floats, upper: int, part: float, z: float) -> float:
    """Second derivative of a pulse's density at z of its own std; as `shape_at`."""
    step = shape[0, 0, 1] - shape[0, 0, 0]
    place = (z - shape[0, 0, 0]) / step
    if not place > 0.0 or place >= shape.shape[2] - 1:
        return 0.0
    i = int(place)
    more = place - i
    below = shape[upper - 1, 3, i] + more * (shape[upper - 1, 3, i + 1] - shape[upper - 1, 3, i])
    above = shape[upper, 3, i] + more * (shape[upper, 3, i + 1] - shape[upper, 3, i])
    return float(below + part * (above - below))


@piece
def _add_leg(
    offset: float,
    width: float,
    std: float,
    third: float,
    photons: float,
    shape: Floats,
    spread: Floats,
    out: Floats,
) -> float:
    """Counts of a pulse in a code `offset` from its time; into out by ln photons, time, ln std."""
    if shape.shape[0] == 0:
        high = (offset + 0.5 * width) / std
        low = (offset - 0.5 * width) / std
        density_high = _INV_SQRT_2PI * math.exp(-0.5 * high * high)
        density_low = _INV_SQRT_2PI * math.exp(-0.5 * low * low)
        out[0] = photons * 0.5 * (math.erf(high * _INV_SQRT_2) - math.erf(low * _INV_SQRT_2))
        out[1] = -photons * (density_high - density_low) / std
        out[2] = -photons * (high * density_high - low * density_low)
        return float(out[0])
    # Half the variance that is not the shape's own; what tables do not reach stretches it.
    own = spread[0]
    flight = 0.5 * (std * std / (own * own) - 1.0)
    within = min(max(flight, -0.5 * spread[2]), spread[shape.shape[0]])
    scale = own if within == flight else std / math.sqrt(1.0 + 2.0 * within)
    upper = 1
    while upper < shape.shape[0] - 1 and spread[1 + upper] < within:
        upper += 1
    gap = spread[upper + 1] - spread[upper]
    part = (within - spread[upper]) / gap
    high = (offset + 0.5 * width) / scale
    low = (offset - 0.5 * width) / scale
    after, density_high, added_high = shape_at(shape, upper, part, high)
    before, density_low, added_low = shape_at(shape, upper, part, low)
    come = after - before
    if third != 0.0:
        # Gram and Charlier; small enough not to change how it follows time and width.
        bent = bend_at(shape, upper, part, high) - bend_at(shape, upper, part, low)
        come = max(come - third / (6.0 * scale * scale * scale) * bent, 0.0)
    out[0] = photons * come
    out[1] = -photons * (density_high - density_low) / scale
    if within == flight:
        out[2] = photons * (added_high - added_low) / gap * std * std / (own * own)
    else:
        out[2] = -photons * (high * density_high - low * density_low)
    return float(out[0])


@piece
def _add_code(
    observed: float,
    mean: float,
    gradient: Floats,
    n_local: int,
    expected_only: bool,
    score: Floats,
    information: Floats,
) -> float:
    """Add one code's term; returns its log-likelihood."""
    ratio = 1.0 if expected_only else observed / mean
    for i in range(n_local):
        if gradient[i] != 0.0:
            score[i] += gradient[i] * (ratio - 1.0)
            for j in range(i + 1):
                information[i, j] += gradient[i] * gradient[j] / mean
    if expected_only:
        return 0.0
    return observed * math.log(mean) - mean


@jit
def photon_score(
    counts: Floats,
    lower: Floats,
    upper: Floats,
    open_share: Floats,
    other: Floats,
    period: float,
    shape: Floats,
    spread: Floats,
    log_photons: Floats,
    delays: Floats,
    stds: Floats,
    thirds: Floats,
    log_background: Floats,
    use_outside: NDArray[np.bool_],
    expected_only: bool,
    score: Floats,
    information: Floats,
) -> float:
    """Fill `score` (n, 3 L + 1) and Fisher `information` (n, 3 L + 1, 3 L + 1); log-likelihood.

    counts, lower, upper: (n, codes); open_share: (n, codes or 1), counts per photon that came (1
    without pile-up); other: (n, codes), counts expected of light that is no leg's, or (0, 0);
    shape: of the pulse, see `shape_at`, (0, 3, 0) for a Gaussian; spread: its own std, ps, and half
    the variance that flight adds to it in each table (k + 1,);
    log_photons, delays, stds: (n, L), NaN delay: leg absent.
    Codes outside every window are one term with the background alone, left out where
    `use_outside` is False (something else flashes there). Values compare between parameters even
    where the windows take in other codes. `expected_only`: information at the expected counts,
    no data needed (bounds).
    """
    n, n_codes = counts.shape
    n_legs = delays.shape[1]
    n_local = 3 * n_legs + 1
    from_std, to_std, widest = -_REACH, _REACH, 1.0
    if shape.shape[0] > 0:
        from_std, to_std = shape[0, 0, 0], shape[0, 0, shape.shape[2] - 1]
        # Tables reach as far as the flight that they hold.
        widest = math.sqrt(1.0 + 2.0 * spread[shape.shape[0]])
    gradient = np.zeros(n_local)
    total = 0.0
    for p in range(n):
        rate = math.exp(log_background[p])
        outside_counts = 0.5
        outside_width = 0.0
        # ln(width) of the counts outside: what they owe to being counted code by code.
        outside_share = 0.0
        for k in range(n_codes):
            width = upper[p, k] - lower[p, k]
            if width <= 0.0:
                continue
            middle = 0.5 * (upper[p, k] + lower[p, k])
            seen = open_share[p, k if open_share.shape[1] > 1 else 0]
            live = seen * width
            mean = rate * live
            inside = False
            if other.shape[0] > 0:
                # A code with other light of consequence is a term of its own.
                inside = abs(other[p, k]) > 0.01 * mean and use_outside[p]
                mean = max(mean + other[p, k], 0.5 * mean)
            for q in range(n_legs):
                gradient[3 * q] = 0.0
                gradient[3 * q + 1] = 0.0
                gradient[3 * q + 2] = 0.0
                if math.isnan(delays[p, q]):
                    continue
                offset = middle - delays[p, q]
                std = stds[p, q]
                if shape.shape[0] > 0:
                    std /= max(1.0, min(std / spread[0], widest))
                if period > 0.0:  # about the middle of the pulse's window
                    centre = 0.5 * (from_std + to_std) * std
                    offset -= period * np.rint((offset - centre) / period)
                if from_std * std - width < offset < to_std * std + width:
                    inside = True
                    photons = seen * math.exp(log_photons[p, q])
                    by_leg = gradient[3 * q : 3 * q + 3]
                    mean += _add_leg(
                        offset, width, stds[p, q], thirds[p, q], photons, shape, spread, by_leg
                    )
            if inside:
                gradient[n_local - 1] = rate * live
                total += _add_code(
                    counts[p, k],
                    mean + 1e-12,
                    gradient,
                    n_local,
                    expected_only,
                    score[p],
                    information[p],
                )
                if not use_outside[p] and counts[p, k] > 0.0:
                    # Judged against a perfect fit, so that a code left out is a code well fitted.
                    total -= counts[p, k] * (math.log(counts[p, k]) - 1.0)
            else:
                outside_counts += counts[p, k]
                outside_width += live
                outside_share += counts[p, k] * math.log(live)
        if not use_outside[p]:
            outside_counts = 0.5
            outside_width = 0.5 / rate
        elif outside_width > 0.0 and not expected_only:
            total += outside_share - outside_counts * math.log(outside_width)
        if outside_width > 0.0:
            for i in range(n_local):
                gradient[i] = 0.0
            mean = rate * outside_width
            gradient[n_local - 1] = mean
            total += _add_code(
                outside_counts, mean, gradient, n_local, expected_only, score[p], information[p]
            )
        for i in range(n_local):
            for j in range(i):
                information[p, j, i] = information[p, i, j]
    return total
