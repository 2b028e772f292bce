"""The tail that all pulses of a recording have in common, found from the recording itself.

A detector keeps some photons back, and so does what scattered the light: pulses are Gaussians with
a tail, of one kind for all pixels. Where no flat told the shape, the pulses themselves do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.response import Response
from lightflight.timing.pulses.fits import Misfit, misfit_of_shapes

if TYPE_CHECKING:
    from lightflight.timing.clock.code_clock import CodeClock
    from lightflight.timing.pulses.pulses import Pulses

Floats = NDArray[np.float64]

SAMPLE = 100
"""Pixels that are enough to find what kind of shape the array's pulse has."""
SHOWN = 1.0
"""A shape that single pixels of a flat show by less than this, in the spread of their chi-square,
is none that a recording, which is dimmer, could show."""
MOST_LEFT = 0.5
"""A tail explains at least half of what a Gaussian leaves, or something else is the matter."""

NEARLY_THERE = 0.1
"""Steps that end it where more pixels will be asked after these."""

_MANY = 300
"""Pixels of a recording that measure its shape: errors of a shape are the same in all pixels."""
_KEPT = 0.9
"""Of the pixels that Gaussians have a time of, at least so many keep one."""
_FIRST_TAILS = (0.5, 1.5, 4.0, 10.0)
_FIRST_SHARES = (0.05, 0.15, 0.35, 0.7)
"""Means of a tail, in the Gaussian's width, and its shares, of which the best is begun with."""
_ROUNDS = 12
"""Parabolas at most; typically two, and five from the best of a few kinds of tail, whose neighbours
are up to seven of the longest steps away."""
_NEAR = 0.02
"""Steps in which the misfit's curvature is looked at: of the log of a tail's mean, and of the log
odds of its share."""
_MOST_STEP = 0.2
"""The same beyond which a parabola is not believed."""
_LEAST_CURVATURE = 1e-6
"""Of the larger one: below, a misfit that is all but flat one way would send steps far off."""
_THERE = 0.02
"""The same that end the search: what a parabola leaves is about its step squared, a few parts in
ten thousand of a pulse."""


def common_shape(hist: Histograms, timing: CodeClock | None, gaussians: Pulses) -> Response | None:
    """Gaussian with a tail that the brightest pulses have in common; None where Gaussians do.

    Parameters
    ----------
    hist : Histograms
        The recording.
    timing : CodeClock or None
        Its clock; None: nominal codes.
    gaussians : Pulses
        Its pulses, fitted as Gaussians.

    Returns
    -------
    Response
        The shape, in widths of its Gaussian; its place is where pulses seem to stand that flight
        has widened (`Response.anchored`).
    """
    if _are_single(gaussians, SAMPLE):
        return None
    sample = _Asked.of(hist, timing, gaussians, SAMPLE)
    beyond, dof = sample.beyond(Response.gaussian())
    excess = _of_all(beyond)
    if not _shows_a_shape(beyond, dof):
        return None
    begin = best_of_first(lambda one: sample.excess(with_tail(one)))
    kind = sample.best_from(begin, NEARLY_THERE)
    if sample.excess(with_tail(kind)) >= MOST_LEFT * excess:
        return None
    return with_tail(_Asked.of(hist, timing, gaussians, _MANY).best_from(kind, _THERE)).anchored()


def _shows_a_shape(beyond: Floats, dof: Floats) -> bool:
    """Whether chi-square beyond its degrees of freedom, (n,) both, is more than chance."""
    return bool(_of_all(beyond) > SHOWN * np.sqrt(2.0 * dof.sum() * len(dof)))


def _are_single(gaussians: Pulses, number: int) -> bool:
    """Whether each of the brightest pixels has one pulse, and these show no other shape."""
    asked = ~all_but_brightest(gaussians, number)
    own = asked[gaussians.row, gaussians.col]
    dof = gaussians.dof[own].astype(np.float64)
    one_each = np.count_nonzero(own) == np.count_nonzero(asked)
    return one_each and not _shows_a_shape(gaussians.chi2[own] - dof, dof)


@dataclass(frozen=True, eq=False)
class _Asked:
    """Pixels that are asked for their shape: half of them tell it, those which it fits best.

    In the others light may come twice, and where legs meet pixels are brightest.

    Attributes
    ----------
    misfit_of : callable
        How far one pulse of a `Response` is from the counts of each pixel.
    dof : array of int, shape (rows * cols,)
        Degrees of freedom of such a fit, of every pixel.
    """

    misfit_of: Callable[[Response], Misfit]
    dof: NDArray[np.int64]

    @classmethod
    def of(
        cls, hist: Histograms, timing: CodeClock | None, gaussians: Pulses, number: int
    ) -> _Asked:
        """The brightest pixels."""
        own = ~all_but_brightest(gaussians, number)
        # Of a single pulse: what the others of a pixel took is free again.
        dof = gaussians.dof[gaussians.pulse_index == 0] + 2 * (_n_pulses(gaussians) - 1)
        return cls(misfit_of_shapes(hist, timing, own), dof)

    def beyond(self, shape: Response) -> tuple[Floats, Floats]:
        """Chi-square beyond its degrees of freedom, and these, (n,) each."""
        found = self.misfit_of(shape)
        dof = self.dof[found.pixels].astype(np.float64)
        return np.concatenate((np.empty(0), *found.chi2s)) - dof, dof

    def excess(self, shape: Response) -> float:
        """Chi-square of all beyond its degrees of freedom."""
        return _of_all(self.beyond(shape)[0])

    def best_from(self, kind: Floats, there: float) -> Floats:
        """Kind of a tail that fits best those pixels which one like it fits best."""
        beyond, _ = self.beyond(with_tail(kind))
        own = np.argsort(beyond)[: max(len(beyond) // 2, 1)]

        def deviance(x: Floats) -> float:
            return float(np.sum(np.concatenate(self.misfit_of(with_tail(x)).deviances)[own]))

        return lowest(deviance, kind, there)


def _of_all(beyond: Floats) -> float:
    """The sum over pixels, had each the median's."""
    return float(len(beyond) * np.median(beyond)) if len(beyond) else 0.0


def evenly_among(pulses: Pulses) -> NDArray[np.bool_]:
    """Some of the pixels that show a pulse, bright and dim alike.

    Parameters
    ----------
    pulses : Pulses
        Of all pixels.

    Returns
    -------
    array of bool, shape (rows, cols)
        True for every one of so many that a few hundred are.
    """
    shown = np.flatnonzero(_cost(pulses)[1])
    some = np.zeros(pulses.shape[0] * pulses.shape[1], dtype=bool)
    some[shown[:: max(1, len(shown) // _MANY)]] = True
    return some.reshape(pulses.shape)


def explained_better(by_shape: Pulses, gaussians: Pulses, some: NDArray[np.bool_]) -> bool:
    """Whether pulses of a common shape explain the counts better than Gaussians, for what they are.

    Parameters
    ----------
    by_shape, gaussians : Pulses
        The same recording, fitted with one and the other.
    some : array of bool, shape (rows, cols)
        Pixels that are asked: those where Gaussians are usable.

    Returns
    -------
    bool
        By chi-square and two for each number that is fitted (Akaike); not where the shape, cut by
        the end of the codes or too wide for the light there is, leaves many pixels without a time.
    """
    own = some.ravel()
    (shaped, usable), (plain, _) = (_cost(pulses) for pulses in (by_shape, gaussians))
    both = own & usable
    kept = np.count_nonzero(both) > _KEPT * np.count_nonzero(own)
    return bool(kept and shaped[both].sum() < plain[both].sum())


def _cost(pulses: Pulses) -> tuple[Floats, NDArray[np.bool_]]:
    """Chi-square of each pixel and twice what is fitted there, (n,); where there is one, (n,)."""
    first = pulses.pulse_index == 0
    cost = pulses.chi2[first] + 4.0 * _n_pulses(pulses)
    return cost, pulses.usable[first] & np.isfinite(cost)


def _n_pulses(pulses: Pulses) -> NDArray[np.intp]:
    """Rows of each pixel, (n,)."""
    return np.bincount(pulses.row.astype(np.int64) * pulses.shape[1] + pulses.col)


def all_but_brightest(pulses: Pulses, number: int) -> NDArray[np.bool_]:
    """Pixels that are not asked for the shape of the array's pulse.

    Parameters
    ----------
    pulses : Pulses
        One or more for each pixel.
    number : int
        How many are asked.

    Returns
    -------
    array of bool, shape (rows, cols)
    """
    photons = np.full(pulses.shape, -1.0)
    own = pulses.usable
    np.maximum.at(photons, (pulses.row[own], pulses.col[own]), pulses.photons[own])
    rank = photons.size - min(number, photons.size)
    least = np.partition(photons, rank, axis=None)[rank]
    others: NDArray[np.bool_] = photons < max(least, 1.0)
    return others


def with_tail(kind: Floats) -> Response:
    """The shape of a log of the tail's mean, in the Gaussian's width, and log odds of its share.

    Parameters
    ----------
    kind : array of float, shape (2,)
        Both.

    Returns
    -------
    Response
        Of a Gaussian of 1 ps.
    """
    share = float(1.0 / (1.0 + np.exp(-kind[1])))
    return Response.with_tail(std_ps=1.0, tail_ps=float(np.exp(kind[0])), tail_share=share)


def best_of_first(misfit: Callable[[Floats], float]) -> Floats:
    """The kind of tail (2,) to begin with: the one of least misfit of a few."""
    kinds = [
        np.array([np.log(tail), np.log(share / (1.0 - share))])
        for tail, share in product(_FIRST_TAILS, _FIRST_SHARES)
    ]
    return min(kinds, key=misfit)


def lowest(misfit: Callable[[Floats], float], start: Floats, there: float = _THERE) -> Floats:
    """Where a misfit of two numbers is least, by parabolas; near the start.

    Parameters
    ----------
    misfit : callable
        Of an array of float, shape (2,).
    start : array of float, shape (2,)
        Where to begin.
    there : float, optional
        Steps that end the search.

    Returns
    -------
    array of float, shape (2,)
    """
    at, least = start, misfit(start)
    for _ in range(_ROUNDS):
        slope, curvature = _parabola(misfit, at, least)
        values, vectors = np.linalg.eigh(curvature)
        # Where the misfit bends down a step goes down as well, and no farther than is believed.
        values = np.maximum(np.abs(values), _LEAST_CURVATURE * np.abs(values).max())
        step = -vectors @ ((slope @ vectors) / values)
        step *= min(1.0, _MOST_STEP / float(np.abs(step).max()))
        now = misfit(at + step)
        if now >= least:
            break
        at, least = at + step, now
        if np.abs(step).max() < there:
            break
    return at


def _parabola(misfit: Callable[[Floats], float], at: Floats, here: float) -> tuple[Floats, Floats]:
    """Slope (2,) and curvature (2, 2) of a misfit."""
    along = _NEAR * np.eye(2)
    up, down = (np.array([misfit(at + side * one) for one in along]) for side in (1.0, -1.0))
    both = misfit(at + along.sum(axis=0))
    curvature = np.diag(up + down - 2.0 * here)
    curvature[0, 1] = curvature[1, 0] = both + here - up.sum()
    return (up - down) / (2.0 * _NEAR), curvature / _NEAR**2
