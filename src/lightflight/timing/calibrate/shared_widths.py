"""Widths of codes that all pixels share, from the counts of the whole array.

Most follow a smooth course: a Legendre series in the code, as many terms as the counts demand. Dead
codes have none, the first live ones may take up their time, and single codes stand out. Beyond that
codes may be unequal one by one (a delay line, the differential nonlinearity of a converter): how
unequal they are is told by all of them together, and each is drawn from its own counts to the
smooth course as far as its noise demands (empirical Bayes). What is left adds up from code to code.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from lightflight.units import MEDIAN_CHI2

_SMOOTH_DEGREE = 4
_ODD_STDS = 6.0
_ODD_SHARE = 0.005
"""A code stands out that differs by more than chance and more than codes do, and by half a percent:
with enough counts every code is significantly odd."""
_LOG_SPREAD2 = (-23.0, -1.0)
"""Log of the variances of codes that are looked for: from 1e-5 of a width, rms, to 60 %."""

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Plateau:
    """Codes from `start` to `stop` are all alike; they decide flux and pattern.

    Attributes
    ----------
    first_live : int
        First code that is not dead.
    start : int
        First code after those that may take up the dead ones' time.
    stop : int
        First code that the end of the period may disturb.
    fall : int
        First code that may lie beyond the end of the period in some pixel.
    end_seen : bool
        False where codes stop before the period does.
    """

    first_live: int

    start: int

    stop: int

    fall: int

    end_seen: bool

    @property
    def codes(self) -> NDArray[np.intp]:
        """The codes of the plateau."""
        return np.arange(self.start, self.stop)


@dataclass(frozen=True)
class SharedWidths:
    """Relative widths of k codes that all pixels share.

    Attributes
    ----------
    regular : array of float, shape (k,)
        Without what is special: dead codes, the first live ones, and codes that stand out.
    widths : array of float, shape (k,)
        All of them; 0 for dead codes.
    spread2 : float
        Variance of codes about the smooth course; 0: they follow it.
    std : float
        Error of a code that is left, rms.
    """

    regular: Floats

    widths: Floats

    spread2: float = 0.0

    std: float = 0.0

    def with_counts(self, observed: Floats, expected: Floats) -> SharedWidths:
        """The same where further codes were counted (k,), `expected` of them as they are so far.

        Parameters
        ----------
        observed, expected : array of float, shape (k,)
            Counts; zero where there is nothing new.

        Returns
        -------
        SharedWidths
        """
        own = _drawn(observed, expected, self.spread2)
        return replace(self, regular=self.regular * own, widths=self.widths * own)


def shared_widths(summed: Floats, expected: Floats, plateau: Plateau) -> SharedWidths:
    """Widths that all pixels share.

    Parameters
    ----------
    summed : array of float, shape (k,)
        Counts of the whole array.
    expected : array of float, shape (k,)
        The same where all codes were alike but for the patterns of the pixels.
    plateau : Plateau
        Where they are.

    Returns
    -------
    SharedWidths
        With mean 1 over the plateau.
    """
    code = np.arange(len(summed))
    place = 2.0 * (code - plateau.start) / (plateau.stop - 1 - plateau.start) - 1.0
    inside = (code >= plateau.start) & (code < plateau.stop)
    smooth, odd, spread2 = _smooth_and_odd(summed, expected, place, inside)
    told = (code >= plateau.first_live) & (code < plateau.fall) & ~(odd & inside)
    special = odd & inside
    for k in range(plateau.first_live, plateau.start):
        if not odd[k]:
            break
        special[k], told[k] = True, False
    mean = expected * smooth
    regular = smooth * _drawn(np.where(told, summed, 0.0), np.where(told, mean, 0.0), spread2)
    widths = np.where(special, summed / np.maximum(expected, 1e-9), regular)
    widths[: plateau.first_live] = 0.0
    scale = np.sum(expected[inside] * widths[inside]) / np.sum(expected[inside])
    noise2 = 1.0 / np.maximum(mean[inside], 1e-9)
    left = float(np.sqrt(np.mean(_kept(noise2, spread2) * noise2)))
    return SharedWidths(regular / scale, widths / scale, spread2, left)


def _smooth_and_odd(
    summed: Floats, expected: Floats, place: Floats, inside: Bools
) -> tuple[Floats, Bools, float]:
    """The smooth course (k,), which codes stand out from it, and the variance of the others."""
    plain, spread2 = inside, 0.0
    for _ in range(3):
        noise2 = 1.0 / np.maximum(expected, 1e-9)
        wide = 1.0 + spread2 / float(np.median(noise2[plain]))
        smooth = _smooth_course(summed, expected, place, plain, wide)
        mean = np.maximum(expected * smooth, 1e-9)
        off, noise2 = summed / mean - 1.0, 1.0 / mean
        spread2 = _spread2(off[plain], noise2[plain], np.abs(off[inside]), noise2[inside])
        # By their number the largest of chance, by their size no matter.
        odd = np.abs(off) > np.maximum(_ODD_STDS * np.sqrt(noise2 + spread2), _ODD_SHARE)
        plain = inside & ~odd
    return smooth, odd, spread2


def _spread2(off: Floats, noise2: Floats, all_off: Floats, all_noise2: Floats) -> float:
    """Variance of widths about their course, of what most are off by and its noise.

    The likeliest of a normal one; 0 where it explains less than its price (Schwarz, Ann. Stat. 6,
    461 (1978)). No more than half of all codes show, whatever the others do.
    """

    def unlikely(log_spread2: float) -> float:
        variance = noise2 + np.exp(log_spread2)
        return 0.5 * float(np.sum(off**2 / variance + np.log(variance)))

    found = minimize_scalar(unlikely, bounds=_LOG_SPREAD2, method="bounded")
    nothing = 0.5 * float(np.sum(off**2 / noise2 + np.log(noise2)))
    if nothing - found.fun <= 0.5 * np.log(len(off)):
        return 0.0
    most = float(np.median(all_off**2)) / MEDIAN_CHI2
    return float(min(np.exp(found.x), most)) if most > np.median(all_noise2) else 0.0


def _kept(noise2: Floats, spread2: float) -> Floats:
    """(k,), part of what a code is off by that is its own."""
    kept: Floats = spread2 / (spread2 + noise2 + 1e-30)
    return kept


def _drawn(observed: Floats, expected: Floats, spread2: float) -> Floats:
    """(k,), factor of the widths of codes by their counts; 1 where none are expected."""
    mean = np.maximum(expected, 1e-9)
    own = 1.0 + _kept(1.0 / mean, spread2) * (observed / mean - 1.0)
    return np.where(expected > 0.0, own, 1.0)


def _smooth_course(
    summed: Floats, expected: Floats, place: Floats, plain: Bools, wide: float
) -> Floats:
    """exp(Legendre series) fitted to summed / expected by Poisson likelihood (Newton steps).

    A term stays if it lowers the deviance by more than 16 (one in 16,000 by chance), `wide` times
    as much where codes scatter so much more than their counts.
    """
    best = np.full(len(summed), summed[plain].sum() / expected[plain].sum())
    best_deviance = _deviance(summed[plain], (expected * best)[plain])
    for degree in range(1, _SMOOTH_DEGREE + 1):
        basis = np.polynomial.legendre.legvander(place, degree)
        coefficients = np.zeros(degree + 1)
        coefficients[0] = np.log(summed[plain].sum() / expected[plain].sum())
        for _ in range(6):
            mean = expected[plain] * np.exp(basis[plain] @ coefficients)
            gradient = basis[plain].T @ (summed[plain] - mean)
            hessian = (basis[plain].T * mean) @ basis[plain]
            coefficients = coefficients + np.linalg.solve(hessian, gradient)
        trial = np.exp(basis @ coefficients)
        deviance = _deviance(summed[plain], (expected * trial)[plain])
        if deviance < best_deviance - 16.0 * wide:
            best, best_deviance = trial, deviance
    return best


def _deviance(observed: Floats, mean: Floats) -> float:
    """Twice the log-likelihood ratio of Poisson counts to a perfect fit."""
    filled = observed > 0
    terms = mean - observed
    terms[filled] += observed[filled] * np.log(observed[filled] / mean[filled])
    return 2.0 * float(terms.sum())
