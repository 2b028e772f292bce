"""Where the laser period ends among the codes of each pixel.

The last code that light reaches is filled only in part; how far says where the period ends, to
a small part of one code, and the period over the codes in it is the width of a code. Used by
`code_density`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import ndtr

from lightflight.news import listener
from lightflight.timing.clock.code_edges import end_factor

Counts = NDArray[np.unsignedinteger]
Floats = NDArray[np.float64]

_BLOCK = 2048
FARTHEST_FROM_END = 64
"""Codes before the end of the period that the sync may disturb."""
_SURELY = 8.0
"""Blurs from the end at which a code is full, or empty, to the last digit."""
_HILL = 0.5
"""Part of a blur, or of a code, within which the likelihood of an end is one hill."""
_SCORINGS = 5
"""Steps from there to the top: no end of a plain scan is likelier by 0.01 then."""
_BRIGHTEST = 200
"""Pixels that decide the blur and the stray counts, which are common to all."""


def live_fraction(end_code: Floats, edges: Floats, blur_codes: float) -> Floats:
    """Part of each code that lies before the end of the period, blurred by the clock's jitter.

    Integral of Phi((end - u) / s) over the code, with the antiderivative z Phi(z) + phi(z).

    Parameters
    ----------
    end_code : array of float, shape (n,)
        Fractional codes.
    edges : array of float, shape (k + 1,)
        Of k neighbouring codes.
    blur_codes : float
        s, codes.

    Returns
    -------
    array of float, shape (n, k)
        Between 0 and 1.
    """
    z = (end_code[:, None] - edges) / blur_codes
    area = z * ndtr(z) + np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    return np.asarray(-blur_codes * np.diff(area, axis=1))


@dataclass(frozen=True)
class FullCodes:
    """Counts that full codes of each pixel would hold: flux * phases * regular.

    Attributes
    ----------
    flux : array of float, shape (n,)
        Counts in a plateau code.
    phases : array of float, shape (n, n_phases)
        Relative widths of codes modulo n_phases.
    regular : array of float, shape (codes,)
        Relative widths that all pixels share.
    end_code : array of float, shape (n,)
        End of the period as known so far, for `end_widths`.
    end_widths : array of float, shape (m,)
        Relative widths by distance from the end, see `code_edges.end_factor`.
    """

    flux: Floats

    phases: Floats

    regular: Floats

    end_code: Floats

    end_widths: Floats

    def counts(self, pixels: slice | NDArray[np.intp], code: NDArray[np.intp]) -> Floats:
        """(pixels, k), expected counts of full codes; never zero.

        Parameters
        ----------
        pixels : slice or array of int
            Which pixels.
        code : array of int, shape (k,)
            Which codes.

        Returns
        -------
        array of float, shape (pixels, k)
            Counts.
        """
        level = self.phases[pixels][:, code % self.phases.shape[1]] * self.regular[code]
        if len(self.end_widths):
            level = level * end_factor(self.end_code[pixels], code, self.end_widths)
        return np.maximum(self.flux[pixels, None] * level, 1e-9)


@dataclass(frozen=True)
class PeriodEnd:
    """Result of `fit_period_end`; codes.

    Attributes
    ----------
    end_code : array of float, shape (n,)
        Fractional code at which the period ends.
    end_code_std : array of float, shape (n,)
        Its standard error.
    blur_codes : float
        Jitter of the clock (rms), as it blurs the end; common to all pixels.
    stray : float
        Counts beyond the end over those of a full code; common to all pixels.
    end_widths : array of float, shape (m,)
        Relative widths of the last codes by distance from the end; empty: undisturbed.
    """

    end_code: Floats

    end_code_std: Floats

    blur_codes: float

    stray: float

    end_widths: Floats


def fit_period_end(
    counts: Counts,
    *,
    flux: Floats,
    phases: Floats,
    regular: Floats,
    good: NDArray[np.bool_],
    start: int,
) -> PeriodEnd:
    """Fractional code where the period ends in each pixel, by Poisson likelihood.

    Blur, stray counts and the widths of the codes near the end are those that suit all usable
    pixels; they are fitted in turn with the ends.

    Parameters
    ----------
    counts : array of unsigned int, shape (n, codes)
    flux, phases, regular : array of float
        What full codes hold, known from the plateau, see `FullCodes`.
    good : array of bool, shape (n,)
        Usable pixels.
    start : int
        First code to look at; all pixels are still on the plateau there.

    Returns
    -------
    PeriodEnd
        Ends of all pixels, good or not; blur, stray counts and last widths by the good ones.
    """
    full = FullCodes(flux, phases, regular, np.zeros(len(flux)), np.zeros(0))
    found = _fit_ends(counts, full, good, start, turns=2)
    for _ in range(2):
        end_widths = _widths_near_end(counts, full, found, good)
        if not len(end_widths) and not len(found.end_widths):
            break
        full = replace(full, end_code=found.end_code, end_widths=end_widths)
        found = _fit_ends(counts, full, good, start, turns=1, stray=found.stray)
    return found


def _fit_ends(
    counts: Counts,
    full: FullCodes,
    good: NDArray[np.bool_],
    start: int,
    *,
    turns: int,
    stray: float = 1e-3,
) -> PeriodEnd:
    """The ends for given heights of full codes; blur and stray counts by the brightest pixels."""
    last = int(np.flatnonzero(counts[good].any(axis=0))[-1])
    code = np.arange(start, min(last + 4, counts.shape[1]))
    sample = np.flatnonzero(good)
    # Every step of the blur costs a scan of all ends.
    sample = sample[np.argsort(-full.flux[sample], kind="stable")][:_BRIGHTEST]
    for _ in range(turns):
        tail = _Tail.of(counts, full, code, sample, stray)
        blur = _most_likely_blur(tail)
        beyond = code > _scan_end(tail, blur)[0][:, None] + 0.5 + 5.0 * blur
        height = float((full.flux[sample, None] * beyond).sum())
        # Never zero: one stray count beyond the end would rule that end out.
        stray = max((float(tail.observed[beyond].sum()) + 0.1) / max(height, 1.0), 1e-7)
    end, std = np.zeros(len(counts)), np.zeros(len(counts))
    tell = listener()
    for first in range(0, len(counts), _BLOCK):
        block = slice(first, first + _BLOCK)
        tail = _Tail.of(counts, full, code, block, stray)
        end[block] = _scan_end(tail, blur)[0]
        std[block] = _end_std(tail, end[block], blur)
        tell(min(first + _BLOCK, len(counts)), len(counts))
    return PeriodEnd(end, std, blur, stray, full.end_widths)


def _widths_near_end(
    counts: Counts, full: FullCodes, found: PeriodEnd, good: NDArray[np.bool_]
) -> Floats:
    """Relative widths of codes by distance from the end, from all usable pixels: (m,).

    Kept out to the last distance at which five codes together stand out by 5.5 standard
    deviations (chance in 64 distances: 2e-6); the codes that the blurred end itself touches
    take the width of those next to them.
    """
    nearest = int(np.ceil(1.0 + 3.0 * found.blur_codes))
    end = found.end_code[good]
    farthest = min(FARTHEST_FROM_END, int(end.min()) // 2)
    observed, expected = np.zeros(farthest), np.zeros(farthest)
    undisturbed = replace(full, end_widths=np.zeros(0))
    pixels = np.flatnonzero(good)
    code = np.arange(max(int(end.min()) - farthest, 0), min(int(end.max()) + 1, counts.shape[1]))
    for first in range(0, len(pixels), _BLOCK):
        block = pixels[first : first + _BLOCK]
        distance = np.floor(found.end_code[block][:, None] - (code + 0.5)).astype(np.intp)
        inside = (distance >= nearest) & (distance < farthest)
        place = distance[inside]
        observed += np.bincount(place, weights=counts[block][:, code][inside], minlength=farthest)
        expected += np.bincount(
            place, weights=undisturbed.counts(block, code)[inside], minlength=farthest
        )
    # Closer in, the blurred end itself takes counts away.
    observed[:nearest], expected[:nearest] = observed[nearest], expected[nearest]
    kernel = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0
    ratio = observed / np.maximum(expected, 1e-9)
    smooth = np.convolve(np.pad(ratio, 2, mode="edge"), kernel, mode="valid")
    noise = np.sqrt(np.sum(kernel**2) / np.maximum(expected, 1e-9))
    standing_out = np.flatnonzero((np.abs(smooth - 1.0) > 5.5 * noise)[nearest:])
    if not len(standing_out):
        return np.zeros(0)
    smooth[:nearest] = smooth[nearest]
    return np.asarray(smooth[: nearest + standing_out[-1] + 1])


@dataclass(frozen=True)
class _Tail:
    """The last codes of some pixels."""

    observed: Floats  # (n, k)
    level: Floats  # (n, k), counts of full codes
    edges: Floats  # (k + 1,)
    stray: float

    @classmethod
    def of(
        cls,
        counts: Counts,
        full: FullCodes,
        code: NDArray[np.intp],
        pixels: slice | NDArray[np.intp],
        stray: float,
    ) -> _Tail:
        observed = counts[pixels][:, code].astype(np.float64)
        edges = np.arange(code[0], code[-1] + 2.0)
        return cls(observed, full.counts(pixels, code), edges, stray)

    def parted(self, low: float, high: float) -> tuple[_Tail, Floats]:
        """The codes in which an end between two codes shows, and what all others say: (n,).

        Those before are full and those after empty, wherever the end is.
        """
        first = max(int(np.searchsorted(self.edges, low, "right")) - 1, 0)
        last = min(int(np.searchsorted(self.edges, high)) + 1, self.observed.shape[1])
        inside = slice(first, max(last, first + 1))
        share = np.where(np.arange(self.observed.shape[1]) < first, 1.0, 0.0) + self.stray
        mean = self.level * share
        alone = self.observed * np.log(mean) - mean
        alone[:, inside] = 0.0
        near = _Tail(
            self.observed[:, inside],
            self.level[:, inside],
            self.edges[inside.start : inside.stop + 1],
            self.stray,
        )
        return near, alone.sum(axis=1)


def _most_likely_blur(tail: _Tail) -> float:
    """Blur that makes the ends of these pixels most likely, codes."""

    def cost(log_blur: float) -> float:
        return -float(_scan_end(tail, float(np.exp(log_blur)))[1].sum())

    widest = 0.25 * len(tail.edges)
    found = minimize_scalar(
        cost, bounds=(np.log(0.01), np.log(widest)), method="bounded", options={"xatol": 0.03}
    )
    return float(np.exp(found.x))


def _scan_end(tail: _Tail, blur: float) -> tuple[Floats, Floats]:
    """Most likely end of each pixel and its log-likelihood: (n,), (n,).

    From the end that the summed counts tell, over grids that shrink threefold each time, and at
    last by Fisher scoring.
    """
    first, n_codes = tail.edges[0], tail.edges[-1] - tail.edges[0]
    height = tail.level.mean(axis=1)
    summed = tail.observed.sum(axis=1)
    center = first + np.minimum(summed / height, n_codes)
    half = np.minimum(6.0 * np.sqrt(summed + 1.0) / height + 3.0 * blur + 1.0, n_codes)
    pixel = np.arange(len(height))
    tail, beside = tail.parted(
        float((center - half).min()) - _SURELY * blur, float((center + half).max()) + _SURELY * blur
    )
    steps = np.linspace(-1.0, 1.0, 9)
    score = np.empty((len(steps), len(height)))
    while True:
        for i, step in enumerate(steps):
            score[i] = _end_likelihood(tail, center + step * half, blur)
        best = np.argmax(score, axis=0)
        center = center + steps[best] * half
        half = half / 3.0
        if half.max() < _HILL * min(blur, 1.0):
            break
    end = center
    for _ in range(_SCORINGS):
        end = end + np.clip(_end_step(tail, end, blur), -half, half)
    climbed = _end_likelihood(tail, end, blur)
    higher = climbed > score[best, pixel]
    return np.where(higher, end, center), np.where(higher, climbed, score[best, pixel]) + beside


def _end_step(tail: _Tail, end: Floats, blur: float) -> Floats:
    """(n,), step of Fisher scoring from an end; none where no count tells."""
    share, slope = _share_and_slope(tail, end, blur)
    score = np.sum((tail.observed / share - tail.level) * slope, axis=1)
    return np.asarray(score / np.maximum(np.sum(tail.level * slope**2 / share, axis=1), 1e-12))


def _share_and_slope(tail: _Tail, end: Floats, blur: float) -> tuple[Floats, Floats]:
    """(n, k), what codes hold of a full one, and how it follows the end."""
    share = live_fraction(end, tail.edges, blur) + tail.stray
    return share, -np.diff(ndtr((end[:, None] - tail.edges) / blur), axis=1)


def _end_likelihood(tail: _Tail, end: Floats, blur: float) -> Floats:
    """(n,), Poisson log-likelihood of an end, without the terms that do not depend on it."""
    mean = tail.level * (live_fraction(end, tail.edges, blur) + tail.stray)
    return np.asarray(np.sum(tail.observed * np.log(mean) - mean, axis=1))


def _end_std(tail: _Tail, end: Floats, blur: float) -> Floats:
    """(n,), error of the end from Fisher's information; never below one photon's worth."""
    share, slope = _share_and_slope(tail, end, blur)
    information = np.sum(tail.level * slope**2 / share, axis=1)
    last = np.clip((end - tail.edges[0]).astype(int), 0, tail.level.shape[1] - 1)
    height = tail.level[np.arange(len(end)), last]
    return np.asarray(np.sqrt(1.0 / np.maximum(information, 1e-12) + 1.0 / height**2))
