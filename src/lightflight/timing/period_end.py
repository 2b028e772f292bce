"""Where the laser period ends among the codes of each pixel.

The last code that light reaches is filled only in part; how far says where the period ends, to
a small part of one code, and the period over the codes in it is the width of a code. Used by
`code_density`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import ndtr

Floats = NDArray[np.float64]

_BLOCK = 2048
_BRIGHTEST = 256
"""Pixels that decide the blur and the stray counts, which are common to all."""


def live_fraction(end_code: Floats, code: Floats, blur_codes: float) -> Floats:
    """Part of a code that lies before the end of the period, blurred by the clock's jitter.

    Integral of Phi((end - u) / s) over the code, with the antiderivative z Phi(z) + phi(z).

    Parameters
    ----------
    end_code : (n, 1), fractional code.
    code : (k,).
    blur_codes : s, codes.
    """
    low = (end_code - code) / blur_codes
    high = low - 1.0 / blur_codes
    density = np.exp(-0.5 * low**2) - np.exp(-0.5 * high**2)
    return np.asarray(
        blur_codes * (low * ndtr(low) - high * ndtr(high) + density / np.sqrt(2.0 * np.pi))
    )


@dataclass(frozen=True)
class FullCodes:
    """Counts that full codes of each pixel would hold: flux * phases * regular."""

    flux: Floats
    """(n,), counts in a plateau code."""

    phases: Floats
    """(n, n_phases), relative widths of codes modulo n_phases."""

    regular: Floats
    """(codes,), relative widths that all pixels share."""

    def counts(self, pixels: slice | NDArray[np.intp], code: NDArray[np.intp]) -> Floats:
        """(pixels, k), expected counts of full codes; never zero."""
        phases = self.phases[pixels][:, code % self.phases.shape[1]]
        return np.maximum(self.flux[pixels, None] * phases * self.regular[code], 1e-9)


@dataclass(frozen=True)
class PeriodEnd:
    """Result of `fit_period_end`; codes."""

    end_code: Floats
    """(n,), fractional code at which the period ends."""

    end_code_std: Floats
    """(n,), its standard error."""

    blur_codes: float
    """Jitter of the clock (rms), as it blurs the end; common to all pixels."""

    stray: float
    """Counts beyond the end over those of a full code; common to all pixels."""


def fit_period_end(
    counts: NDArray[np.unsignedinteger], full: FullCodes, *, good: NDArray[np.bool_], start: int
) -> PeriodEnd:
    """Fractional code where the period ends in each pixel, by Poisson likelihood.

    Blur and stray counts are those that suit the brightest usable pixels.

    Parameters
    ----------
    counts : (n, codes).
    full : what full codes hold, known from the plateau.
    good : (n,), usable pixels.
    start : first code to look at; all pixels are still on the plateau there.
    """
    last = int(np.flatnonzero(counts[good].any(axis=0))[-1])
    code = np.arange(start, min(last + 4, counts.shape[1]))
    sample = np.flatnonzero(good)
    sample = sample[np.argsort(-full.flux[sample], kind="stable")][:_BRIGHTEST]
    stray, blur = 1e-3, 0.3
    for _ in range(2):
        tail = _Tail.of(counts, full, code, sample, stray)
        blur = _most_likely_blur(tail)
        beyond = code > _scan_end(tail, blur)[0][:, None] + 0.5 + 5.0 * blur
        height = float((full.flux[sample, None] * beyond).sum())
        stray = max((float(tail.observed[beyond].sum()) + 0.1) / max(height, 1.0), 1e-7)
    end, std = np.zeros(len(counts)), np.zeros(len(counts))
    for first in range(0, len(counts), _BLOCK):
        block = slice(first, first + _BLOCK)
        tail = _Tail.of(counts, full, code, block, stray)
        end[block] = _scan_end(tail, blur)[0]
        std[block] = _end_std(tail, end[block], blur)
    return PeriodEnd(end, std, blur, stray)


@dataclass(frozen=True)
class _Tail:
    """The last codes of some pixels."""

    observed: Floats  # (n, k)
    level: Floats  # (n, k), counts of full codes
    code: Floats  # (k,)
    stray: float

    @classmethod
    def of(
        cls,
        counts: NDArray[np.unsignedinteger],
        full: FullCodes,
        code: NDArray[np.intp],
        pixels: slice | NDArray[np.intp],
        stray: float,
    ) -> _Tail:
        observed = counts[pixels][:, code].astype(np.float64)
        return cls(observed, full.counts(pixels, code), code.astype(np.float64), stray)


def _most_likely_blur(tail: _Tail) -> float:
    """Blur that makes the ends of these pixels most likely, codes."""

    def cost(log_blur: float) -> float:
        return -float(_scan_end(tail, float(np.exp(log_blur)))[1].sum())

    widest = 0.25 * len(tail.code)
    found = minimize_scalar(
        cost, bounds=(np.log(0.01), np.log(widest)), method="bounded", options={"xatol": 0.02}
    )
    return float(np.exp(found.x))


def _scan_end(tail: _Tail, blur: float) -> tuple[Floats, Floats]:
    """Most likely end of each pixel and its log-likelihood: (n,), (n,).

    From the end that the summed counts tell, over grids that shrink fourfold each time.
    """
    n_codes = tail.code[-1] + 1.0 - tail.code[0]
    height = tail.level.mean(axis=1)
    summed = tail.observed.sum(axis=1)
    center = tail.code[0] + np.minimum(summed / height, n_codes)
    half = np.minimum(6.0 * np.sqrt(summed + 1.0) / height + 3.0 * blur + 1.0, n_codes)
    pixel = np.arange(len(height))
    score = np.empty((17, len(height)))
    steps = np.linspace(-1.0, 1.0, 17)
    for _ in range(4 + int(np.log(n_codes / min(blur, 1.0)) / np.log(4.0))):
        for i, step in enumerate(steps):
            score[i] = _end_likelihood(tail, center + step * half, blur)
        best = np.argmax(score, axis=0)
        center = center + steps[best] * half
        half = half / 4.0
    return center, score[best, pixel]


def _end_likelihood(tail: _Tail, end: Floats, blur: float) -> Floats:
    """(n,), Poisson log-likelihood of an end, without the terms that do not depend on it."""
    mean = tail.level * (live_fraction(end[:, None], tail.code, blur) + tail.stray)
    return np.asarray(np.sum(tail.observed * np.log(mean) - mean, axis=1))


def _end_std(tail: _Tail, end: Floats, blur: float) -> Floats:
    """(n,), error of the end from Fisher's information; never below one photon's worth."""
    share = live_fraction(end[:, None], tail.code, blur) + tail.stray
    low = (end[:, None] - tail.code) / blur
    slope = ndtr(low) - ndtr(low - 1.0 / blur)
    information = np.sum(tail.level * slope**2 / share, axis=1)
    last = np.clip((end - tail.code[0]).astype(int), 0, len(tail.code) - 1)
    height = tail.level[np.arange(len(end)), last]
    return np.asarray(np.sqrt(1.0 / np.maximum(information, 1e-12) + 1.0 / height**2))
