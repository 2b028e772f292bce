"""Photons of pulses whose times and widths are known: one linear likelihood fit per pixel.

Of a pixel's codes, only those near its pulses are fitted; the others give the background.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

Floats = NDArray[np.float64]

_REACH = 5.0
"""Half width of a pulse's window, in standard deviations: 3e-7 of a Gaussian on either side."""

_BEYOND = 3e-7
"""Share of a pulse of another shape that comes before and after its window, each."""

_DAMPING = 1e-9
"""Keeps two pulses at one place apart; nothing otherwise."""

_STEPS = 4
"""Solutions of the linear fit, each weighted by the one before."""

_AT_ONCE = 1 << 17
"""Pixels times codes worked on at once, which then stay in the cache."""


def amplitudes_at_times(
    counts: NDArray[np.generic],
    lower: Floats,
    upper: Floats,
    period: float | None,
    delays: Floats,
    stds: Floats,
    other: Floats | None = None,
    *,
    table: Floats | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Photons of each pulse (n, L), their variance without light (n, L), background rate (n,).

    counts, lower, upper: (n, codes); delays, stds: (n, L), NaN delay where a pulse is absent;
    other: (n, codes), counts expected of light that is no pulse's; table: the pulses' shape as
    `Response.table` tells it, whose tail lies beneath the pulses that follow; None: Gaussians.
    The variance is the one an amplitude would have were it zero, that is the share of the
    background; the light adds its own count. Amplitudes may come out negative: nothing is
    clipped, so sums stay unbiased.
    """
    step = max(1, _AT_ONCE // counts.shape[1])
    other = np.zeros((1, 1)) if other is None else other
    other = np.broadcast_to(other, counts.shape)
    parts = [
        _amplitudes(
            counts[part],
            lower[part],
            upper[part],
            period,
            delays[part],
            stds[part],
            other[part],
            table,
        )
        for part in (slice(i, i + step) for i in range(0, max(len(counts), 1), step))
    ]
    photons, empty, background = (np.concatenate(part) for part in zip(*parts, strict=True))
    return photons, empty, background


def _amplitudes(
    counts: NDArray[np.generic], lower: Floats, upper: Floats, period: float | None,
    delays: Floats, stds: Floats, other: Floats, table: Floats | None,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """`amplitudes_at_times` of a few pixels."""
    first, last = _window(table)
    middle, width = 0.5 * (lower + upper), upper - lower
    live = width > 0.0
    near = np.zeros((*delays.shape, counts.shape[1]), dtype=bool)
    for j in range(delays.shape[1]):
        offset, std = the_shorter_way(middle - delays[:, j : j + 1], period), stds[:, j : j + 1]
        near[:, j] = live & (offset > first * std - 0.5 * width)
        near[:, j] &= offset < last * std + 0.5 * width
    inside = np.asarray(near.any(axis=1))
    exposed = np.sum(width * (live & ~inside), axis=1)
    above = counts.astype(np.float64) - other
    outside = np.sum(above * (live & ~inside), axis=1)
    rate = np.divide(outside, exposed, out=np.zeros(len(counts)), where=exposed > 0.0)
    rate = np.maximum(rate, 0.0)
    # The codes near a pulse, side by side: (n, K).
    order = np.argsort(~inside, axis=1, kind="stable")[:, : int(inside.sum(axis=1).max(initial=1))]
    row = np.arange(len(counts))[:, None]
    kept, width, middle = inside[row, order], width[row, order], middle[row, order]
    due = (rate[:, None] * width + other[row, order]) * kept
    above = (counts[row, order] - due) * kept
    share = np.zeros((*delays.shape, order.shape[1]))
    for j in range(delays.shape[1]):
        its, k = np.nonzero(near[row, j, order])
        offset = the_shorter_way(middle[its, k] - delays[its, j], period)
        half, std = 0.5 * width[its, k], stds[its, j]
        share[its, j, k] = share_before((offset + half) / std, table) - share_before(
            (offset - half) / std, table
        )
    photons = _maximum_likelihood(share, above, due, np.isnan(delays))
    return photons, _variance_without(share, due, photons), rate


def share_before(z: Floats, table: Floats | None) -> Floats:
    """Share of a pulse that came before places (n,), in standard deviations."""
    return np.asarray(ndtr(z) if table is None else np.interp(z, table[0], table[1]))


def _window(table: Floats | None) -> tuple[float, float]:
    """First and last place of a pulse's window, in standard deviations."""
    if table is None:
        return -_REACH, _REACH
    first, last = np.searchsorted(table[1], (_BEYOND, 1.0 - _BEYOND))
    return float(table[0, max(first - 1, 0)]), float(table[0, min(last, table.shape[1] - 1)])


def the_shorter_way(offset: Floats, period: float | None) -> Floats:
    """Time differences moved into [-period/2, period/2)."""
    return offset - period * np.floor(offset / period + 0.5) if period else offset


def _maximum_likelihood(
    share: Floats, above: Floats, due: Floats, absent: NDArray[np.bool_]
) -> Floats:
    """Photons (n, L) of largest likelihood but for negative ones; NaN where `absent`.

    share (n, L, K), of each pulse in each code; above (n, K), counts over the background due.
    """
    photons = np.maximum(np.sum((share > 0.0) * above[:, None], axis=2), 0.0)
    diagonal = np.arange(share.shape[1])
    for _ in range(_STEPS):
        mean = np.maximum(due, 0.0) + np.einsum("nl,nlk->nk", np.maximum(photons, 0.0), share)
        weighted = share / (mean + 1e-9)[:, None]
        information = weighted @ share.swapaxes(1, 2)
        own = information[:, diagonal, diagonal]
        scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
        information *= scale[:, :, None] * scale[:, None, :]
        information[:, diagonal, diagonal] = 1.0 + _DAMPING
        score = np.einsum("nlk,nk->nl", weighted, above) * scale
        photons = np.linalg.solve(information, score[..., None])[..., 0] * scale
    return np.asarray(np.where(absent, np.nan, photons))


def _variance_without(share: Floats, due: Floats, photons: Floats) -> Floats:
    """Variance (n, L) that each amplitude would have, were it zero; NaN where it is absent."""
    light = np.maximum(np.nan_to_num(photons), 0.0)[:, :, None] * share
    mean = due[:, None] + light.sum(axis=1, keepdims=True) - light
    with np.errstate(divide="ignore", invalid="ignore"):
        information = np.where(share > 0.0, share**2 / np.maximum(mean, 0.0), 0.0).sum(axis=2)
        return np.asarray(np.where(np.isnan(photons), math.nan, 1.0 / information))
