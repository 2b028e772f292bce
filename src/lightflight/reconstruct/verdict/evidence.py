"""What one test says of one cause, in the form that `judge` weighs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri, ndtri

from lightflight.path.verdict import BlindSpot, FindingName

Floats = NDArray[np.float64]

_LEAST_P = 1e-300

CHECK_AT = 0.01
"""Family-wise chance of a false "check"."""
SEEN_AT = 3.7
"""What is this many sigma is seen in half of all recordings: the threshold of some 40 tests."""
WITHIN = 9.0
"""Causes whose gain is within this of the best cannot be told from it."""
MOST_NAMED = 6
"""Causes that are named together."""
AT_MOST = 9.0
"""Chi-square below which a test is silent whose chance is only known to be at most so large (few
counts, a usual share): it takes no more of the budget than 3 sigma, which raise no alarm alone."""
SELDOM = 1e-3
"""Silent tests that speak less often where all is well count as independent of all others: their
directions are not asked for."""
LIGHT = "light"
"""Of tests that rest on counts; all others rest on times and lines."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Result of one test; where all is well, `chi2` is a chi-square of `dof` degrees.

    Attributes
    ----------
    name : FindingName
        The cause that is freed.
    chi2 : float
        By how much chi-square falls when it is freed alone.
    dof : int
        Number of parameters freed.
    gain : float
        `chi2` less what an implausible size costs, less `dof`: causes are ranked by it.
    sentence : str
        What was seen.
    remedy : str
        What to do.
    directions : array of float
        (N, dof), orthonormal directions of the whitened data that the test looks along, so that
        the correlation of tests of the same data is known; empty: of other data than all others.
    deviates : array of float
        (dof,), the data along `directions`.
    symptom : bool
        True for what any of several causes would bring: named only where no cause explains it.
    blind : tuple of BlindSpot
        What this test cannot see though it moves the path by more than stated.
    data : str
        Of what the test is: those of other data are independent.
    remains : float
        Of a symptom: chi-square left when the best cause of the same data is freed; NaN: to be
        worked out from `directions`.
    silent_below : float
        Chi-square that a misfit of no account may bring; the test speaks from there on.
    widened : float
        What its numbers are divided by, over what chance alone spreads them by: more than 1 where
        a misfit of no account is in the divisor.
    frees : str
        What `free=` calls the cause; "": nothing.
    need : float
        How many of its plausible sizes the cause would have to be, alone: each of its numbers, rms.
    """

    name: FindingName
    chi2: float
    dof: int
    gain: float
    sentence: str
    remedy: str
    directions: Floats = field(default_factory=lambda: np.empty((0, 0)), repr=False)
    deviates: Floats = field(default_factory=lambda: np.empty(0), repr=False)
    symptom: bool = False
    blind: tuple[BlindSpot, ...] = ()
    data: str = field(default="pulses", kw_only=True)
    remains: float = field(default=float("nan"), kw_only=True)
    silent_below: float = field(default=0.0, kw_only=True)
    widened: float = field(default=1.0, kw_only=True)
    frees: str = field(default="", kw_only=True)
    need: float = field(default=float("nan"), kw_only=True)

    @property
    def p_value(self) -> float:
        """Chance of a chi-square as large where all is well; 1 where the test is silent."""
        if self.chi2 < self.silent_below:
            return 1.0
        return float(max(chdtrc(self.dof, self.chi2), _LEAST_P))

    @property
    def speaks(self) -> float:
        """Chance that the test says anything where all is well."""
        return float(chdtrc(self.dof, self.widened**2 * self.silent_below))

    def chance_of(self, p_value: float) -> float:
        """Chance that its p-value is as small where all is well; as stated, if it is as small."""
        if self.p_value <= p_value:
            return p_value
        as_small = chdtrc(self.dof, self.widened**2 * chdtri(self.dof, p_value))
        return float(min(as_small, self.speaks))

    @property
    def sigma(self) -> float:
        """The same as a two-sided normal deviate."""
        return sigma_from_p(self.p_value)


def sigma_from_p(p_value: float) -> float:
    """Normal deviate that is exceeded, on both sides, with probability `p_value`."""
    return float(-ndtri(0.5 * min(max(p_value, _LEAST_P), 1.0)))


def evidence_from_deviate(
    name: FindingName,
    z: float,
    *,
    sentence: str,
    remedy: str,
    symptom: bool = False,
    silent_below: float = 0.0,
) -> Evidence:
    """Evidence of one number that is N(0, 1) where all is well, from data of its own."""
    return Evidence(
        name, z**2, 1, z**2 - 1.0, sentence, remedy, symptom=symptom, silent_below=silent_below,
    )  # fmt: skip
