"""The tail of a flat's pulses, found from the flat itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.response import Response
from lightflight.timing.pulses.fits import misfit_of_shapes
from lightflight.timing.pulses.pulses import Pulses, fit_pulses

Floats = NDArray[np.float64]

_SAMPLE = 100
"""Pixels that are enough to find what kind of shape the array's pulse has."""
_MANY = 1000
"""Pixels that measure it. Each knows its codes to a few percent, and a bright recording holds as
many photons as all of these: a shape of the sample alone misfits it by five deviations."""
_ROUNDS = 4
"""Parabolas at most; typically one or two."""
_NEAR = 0.02
"""Steps in which the misfit's curvature is looked at: of the log of a tail's mean, and of the log
odds of its share."""
_MOST_STEP = 0.2
"""The same beyond which a parabola is not believed."""
_THERE = 2e-3
"""The same that end the search: a few parts in ten thousand of a pulse."""
_SHOWN = 1.0
"""A shape that single pixels of a flat show by less than this, in the spread of their chi-square,
is none that a recording, which is dimmer, could show."""
_MOST_LEFT = 0.5
"""A tail explains at least half of what a Gaussian leaves, or something else is the matter."""


def tail_of_flat(flat: Histograms, *, timing: TimingCalibration) -> Response:
    """Gaussian with a tail that fits the pulses of a flat best: one ratio and share for all.

    Place, width, photons and background are each pixel's own; the least sum of Pearson's chi2
    over the brightest pixels decides.

    Parameters
    ----------
    flat : Histograms
        Counts of a short pulse that reaches all pixels.
    timing : TimingCalibration
        Clock whose codes are calibrated; its delays are not used.

    Returns
    -------
    Response
        The shape, as wide as the array's median pulse.

    Raises
    ------
    NothingFoundError
        As `fit_pulses`: where no pixel shows a pulse.
    """
    first = fit_pulses(flat, timing=timing, max_pulses=1, response=Response.gaussian())
    kind, _ = _best_tail(flat, timing, _all_but_brightest(first, flat.shape, _SAMPLE))
    return _measured(kind, flat, timing, _all_but_brightest(first, flat.shape, _MANY))


def tail_of_flat_if_any(flat: Histograms, *, timing: TimingCalibration) -> Response | None:
    """`tail_of_flat` where the flat's pulses are no Gaussians; None where these do as well.

    Parameters
    ----------
    flat : Histograms
        Counts of a short pulse that reaches all pixels.
    timing : TimingCalibration
        Clock whose codes are calibrated; its delays are not used.

    Returns
    -------
    Response or None
        The shape, as wide as the array's median pulse.

    Raises
    ------
    NothingFoundError
        As `fit_pulses`: where no pixel shows a pulse.
    """
    first = fit_pulses(flat, timing=timing, max_pulses=1)
    others = _all_but_brightest(first, flat.shape, _SAMPLE)
    asked = ~others.ravel()
    dof = float(np.nansum(first.dof[asked]))
    excess = float(np.nansum(first.chi2[asked])) - dof
    if not asked.any() or excess < _SHOWN * np.sqrt(2.0 * dof * np.count_nonzero(asked)):
        return None
    kind, found = _best_tail(flat, timing, others)
    if found - dof >= _MOST_LEFT * excess:
        return None
    return _measured(kind, flat, timing, _all_but_brightest(first, flat.shape, _MANY))


def _all_but_brightest(pulses: Pulses, shape: tuple[int, int], number: int) -> NDArray[np.bool_]:
    """Pixels (rows, cols) that are not asked for the shape of the array's pulse."""
    photons = np.where(pulses.usable, pulses.photons, -1.0).reshape(shape)
    least = np.sort(photons, axis=None)[-min(number, photons.size)]
    others: NDArray[np.bool_] = photons < max(least, 1.0)
    return others


def _measured(
    kind: Floats, flat: Histograms, timing: TimingCalibration, others: NDArray[np.bool_]
) -> Response:
    """The tail that fits all but some pixels best, with the width of the array's median pulse."""
    misfit_of = misfit_of_shapes(flat, timing, ~others)
    shape = _with_tail(_lowest(lambda x: misfit_of(_with_tail(x)).deviance, kind))
    pulses = fit_pulses(flat, timing=timing, max_pulses=1, response=shape, exclude_mask=others)
    middle = float(np.median(pulses.std_ps[pulses.usable]))
    return Response(shape.time_ps * (middle / shape.std_ps), shape.density)


def _with_tail(kind: Floats) -> Response:
    """The shape of a log of the tail's mean, in the Gaussian's width, and log odds of its share."""
    share = float(1.0 / (1.0 + np.exp(-kind[1])))
    return Response.with_tail(std_ps=1.0, tail_ps=float(np.exp(kind[0])), tail_share=share)


def _best_tail(
    flat: Histograms, timing: TimingCalibration, others: NDArray[np.bool_]
) -> tuple[Floats, float]:
    """Kind of the tail (2,) that fits all but some pixels best, and their summed chi-square."""
    from scipy.optimize import minimize

    misfit_of = misfit_of_shapes(flat, timing, ~others)

    def misfit(x: Floats) -> float:
        # Out there a tail is absent, or all there is: nothing holds the simplex.
        if abs(x[0]) > 3.0 or abs(x[1]) > 8.0:
            return np.inf
        return misfit_of(_with_tail(x)).chi2

    # A long tail of few photons, and one of half: a simplex finds the dip that it begins near.
    starts = (np.array([0.7, -2.0]), np.array([0.0, 0.0]))
    options: Any = {"maxfev": 60, "xatol": 0.02, "fatol": 0.5}
    found = [minimize(misfit, x, method="Nelder-Mead", options=options) for x in starts]
    best = min(found, key=lambda one: float(one.fun))
    return best.x, float(best.fun)


def _lowest(misfit: Callable[[Floats], float], start: Floats) -> Floats:
    """(2,), where a misfit is least, by parabolas; near the start."""
    at, least = start, misfit(start)
    for _ in range(_ROUNDS):
        slope, curvature = _parabola(misfit, at, least)
        values, vectors = np.linalg.eigh(curvature)
        if values[0] <= 0.0:
            break
        step = -vectors @ ((slope @ vectors) / values)
        step *= min(1.0, _MOST_STEP / float(np.abs(step).max()))
        now = misfit(at + step)
        if now >= least:
            break
        at, least = at + step, now
        if np.abs(step).max() < _THERE:
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
