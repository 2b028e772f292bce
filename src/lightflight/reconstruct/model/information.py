"""From a Fisher information to a step, to the top of a likelihood and to a covariance.

Millimetres, picoseconds and logarithms stand side by side in one matrix whose entries differ by
many decades. Scaled to a unit diagonal it is as well conditioned as the data allow, and a cut of
small eigenvalues means the same for every parameter.

All fits of paths and of lines climb by `ascend`: what they maximise, and what a step does to what
they fit, is theirs; damping and the rule that ends a climb are the same for all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_TOLERANCE = 5e-3
"""A step shorter than this many standard errors, rms over its directions, ends a climb."""
_FREE_DAMPING = 1e-2
"""A short step tells that the top is near only where damping did not shorten it."""
_TINY = 1e-3
"""Along a gauge only short steps go up: one this short that does is an end, however damped."""
_LEFT = 1.0
"""It is the top only where an undamped step would be no longer than this many standard errors."""
_FIRST_DAMPING = 1e-3
_LEAST_DAMPING = 1e-12
"""Near the top the step is Fisher's, whose curvature is the covariance."""
_EASED, _TIGHTENED = 0.1, 2.0
"""Least and most that damping is multiplied by after a step that led up: as far as it should, or
hardly. By a rule that knows only up and down every other step along a ridge is refused."""
_REFUSED = 4.0
"""The same after a step that led down; twice as much for each one more."""
_MOST_DAMPING = 1e12
"""No step leads up any more."""
_WINDING = 12
"""A climb of more steps follows a ridge that winds; others end in four to ten."""
_LEAP = 5
"""Undamped steps that are tried from such a ridge: the first leaves it, two or three lead back."""
_UNDAMPED = 1e-9
"""Only a gauge is held by so little."""
_PROMISE = 0.1
"""Of the log-likelihood, half a standard error of one direction: no leap that should gain less is
tried, and a climb that is so near to its top when its steps are used up has reached it."""


class Slope(Protocol):
    """A log-likelihood about a point, its priors included; p parameters.

    Score and information may be made when they are asked for: half of all steps are refused.
    """

    @property
    def value(self) -> float:
        """Of the log-likelihood."""

    @property
    def score(self) -> Floats:
        """Its derivative (p,)."""

    @property
    def information(self) -> Floats:
        """Expected curvature (p, p)."""


Point = TypeVar("Point")
SlopeHere = TypeVar("SlopeHere", bound=Slope)


def _unit_scale(information: Floats) -> Floats:
    """(p,), factors that give the matrix a unit diagonal; finite where nothing is known."""
    scale: Floats = 1.0 / np.sqrt(np.diag(information) + 1e-30)
    return scale


def covariance_from_information(information: Floats, *, rcond: float) -> Floats:
    """Pseudo-inverse of an information matrix, taken at unit diagonal.

    Parameters
    ----------
    information : array of float, shape (p, p)
        Symmetric; any units.
    rcond : float
        Eigenvalues of the scaled matrix below this share of the largest count as zero: such a
        direction is a gauge, and no error is stated for it.

    Returns
    -------
    array of float, shape (p, p)
        Covariance, in the squared units of the parameters.

    Examples
    --------
    >>> covariance_from_information(np.diag([4.0, 1e-6]), rcond=1e-14)
    array([[2.5e-01, 0.0e+00],
           [0.0e+00, 1.0e+06]])
    """
    scale = _unit_scale(information)
    scaled = information * scale[:, np.newaxis] * scale
    inverse = np.linalg.pinv(scaled, rcond=rcond, hermitian=True)
    covariance: Floats = inverse * scale[:, np.newaxis] * scale
    return covariance


def damped_step(information: Floats, score: Floats, damping: float) -> Floats:
    """Levenberg's step (p,): (information + damping x its diagonal)^-1 score.

    `damping` is counted at unit diagonal; a small one is always wanted, which keeps a gauge, where
    the matrix is singular, from throwing the step far.
    """
    scale = _unit_scale(information)
    scaled = information * scale[:, np.newaxis] * scale
    step: Floats = scale * np.linalg.solve(scaled + damping * np.eye(len(scale)), scale * score)
    return step


def ascend(
    point: Point,
    slope_at: Callable[[Point], SlopeHere],
    moved: Callable[[Point, SlopeHere, Floats], Point],
    *,
    most_steps: int,
    level: float = 5e-5,
    gauge: float = 0.0,
    winds: bool = False,
) -> tuple[Point, SlopeHere, bool]:
    """Fisher scoring with Levenberg damping to the top of a likelihood.

    Parameters
    ----------
    point
        Where the climb starts; whatever is fitted.
    slope_at
        The likelihood about a point.
    moved
        The point after a step (p,) from it, and from what was found there.
    most_steps : int
        A climb that takes more has not converged, unless it is within half an error of the top.
    level : float, optional
        A step that changes the log-likelihood by less than this ends a climb, as does a
        short one. With 1e-3 in lines a short leg of one hard
        scene in four is missed.
    gauge : float, optional
        Share of the largest scaled information below which a direction is fixed by nothing.
    winds : bool, optional
        Whether ridges that wind are followed by undamped steps: where priors hold whatever the
        data do not. Elsewhere damping is all that keeps what nothing is known of where it was.

    Returns
    -------
    point, slope
        The highest that was found, and the likelihood there.
    converged : bool
        Whether it is the top.

    Notes
    -----
    With C the inverse of the information, s^T C^-1 s of a step s is its length in standard errors
    squared, and twice what it should gain.
    """
    slope, damping, refused = slope_at(point), _FIRST_DAMPING, _REFUSED
    information, score = slope.information, slope.score
    for number in range(1, most_steps + 1):
        step = damped_step(information, score, damping + gauge)
        if not np.isfinite(step).all():
            # Light without bounds, whose score is no number: no record of a set-up takes that.
            return point, slope, False
        trial = moved(point, slope, step)
        # A step too far may leave nothing finite: it is refused below.
        with np.errstate(over="ignore", invalid="ignore"):
            new = slope_at(trial)
            gained = new.value - slope.value
            higher = bool(np.isfinite(new.value) and gained >= -1e-12 * (1.0 + abs(slope.value)))
            curved = float(step @ information @ step)
            length2, expected = curved / len(step), float(step @ score) - 0.5 * curved
            if higher:
                point, slope = trial, new
                # Asked for here alone: a step that is refused costs its value.
                information, score = slope.information, slope.score
        short = length2 < _TOLERANCE**2 or abs(gained) < level
        ended = short and damping <= _FREE_DAMPING
        if winds and (ended or number % _WINDING == 0):
            ahead = damped_step(information, score, _UNDAMPED + gauge)
            promised = 0.5 * float(ahead @ score) > _PROMISE
            leapt = _leapt(point, slope, ahead, slope_at, moved, gauge) if promised else None
            if leapt is not None:
                (point, slope), damping, refused = leapt, _FIRST_DAMPING, _REFUSED
                information, score = slope.information, slope.score
                continue
        if ended:
            return point, slope, True
        damping *= _eased(gained, expected) if higher else refused
        damping, refused = max(damping, _LEAST_DAMPING), _REFUSED if higher else 2.0 * refused
        # No step leads higher where what follows the step sways by more than it gains: at the top.
        if (higher and length2 < _TINY**2) or damping > _MOST_DAMPING:
            left = damped_step(information, score, _FIRST_DAMPING + gauge)
            return point, slope, bool(left @ information @ left < _LEFT**2 * len(left))
    # Where steps lead up by less and less the top is near, whatever holds the last of them back.
    left = damped_step(information, score, _UNDAMPED + gauge)
    return point, slope, bool(0.5 * float(left @ score) < _PROMISE)


def _eased(gained: float, expected: float) -> float:
    """What damping is multiplied by after a step that led up, by `gained` instead of `expected`.

    Nielsen's rule (IMM-REP-1999-05): as it was after half of it.
    """
    kept = gained / expected if expected > 0.0 else 0.0
    return float(np.clip(1.0 - (2.0 * kept - 1.0) ** 3, _EASED, _TIGHTENED))


def _leapt(
    point: Point,
    slope: SlopeHere,
    ahead: Floats,
    slope_at: Callable[[Point], SlopeHere],
    moved: Callable[[Point, SlopeHere, Floats], Point],
    gauge: float,
) -> tuple[Point, SlopeHere] | None:
    """The first point above this one on undamped steps, of which `ahead` is the first; or None.

    Along a ridge that winds (a group index against the source's place) damped steps must be short.
    An undamped one lands beside the ridge, however low, and the next leads back onto it, far along.
    """
    at, here = point, slope
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_LEAP):
            at = moved(at, here, ahead)
            here = slope_at(at)
            if not np.isfinite(here.value):
                return None
            if here.value > slope.value:
                return at, here
            ahead = damped_step(here.information, here.score, _UNDAMPED + gauge)
    return None
