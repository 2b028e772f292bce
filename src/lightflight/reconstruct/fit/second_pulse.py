"""Looks for a second pulse: the delay at which the counts show the light of all legs once more.

Every pixel says how much better its counts would fit with a copy of its own light at each delay,
its own unknowns and the strengths of diffuse light following. These scores are added up over the
pixels; the best delay is where a fit of delay and share starts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.path.second_pulse import SecondPulse
from lightflight.path.verdict import FindingName
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.strengths import Known
from lightflight.reconstruct.model import light
from lightflight.reconstruct.model.cells import CORE_STDS
from lightflight.reconstruct.model.second_pulse import Echo
from lightflight.reconstruct.model.sizes import PLAUSIBLE

Floats = NDArray[np.float64]

_STEP_STDS = 0.8
"""Width of a cell about the second pulse, in its standard deviations, as about the first."""


def second_pulse_of_fit(fit: JointFit) -> SecondPulse | None:
    """The second pulse that a fit has found; where several clocks saw it, their mean.

    Parameters
    ----------
    fit : JointFit
        With the light beside the path at its place.

    Returns
    -------
    SecondPulse or None
        None: there is none.
    """
    seen: dict[tuple[int, int], tuple[Echo, float]] = {}
    for number, sighting in enumerate(fit.sightings):
        echo = None if sighting.diffuse is None else sighting.diffuse.second
        key = sighting.view, id(sighting.timing)
        if isinstance(echo, Echo) and key not in seen:
            seen[key] = echo, _clock_std_ps(fit, number, echo.delay_ps)
    if not seen:
        return None
    values = np.array([(echo.delay_ps, echo.share) for echo, _ in seen.values()])
    variances = np.array(
        [
            (echo.covariance[1, 1] + clock_ps**2, echo.covariance[0, 0])
            for echo, clock_ps in seen.values()
        ]
    )
    weights = 1.0 / np.maximum(variances, 1e-300)
    mean = np.sum(weights * values, axis=0) / weights.sum(axis=0)
    std = 1.0 / np.sqrt(weights.sum(axis=0))
    return SecondPulse(float(mean[0]), float(std[0]), float(mean[1]), float(std[1]))


def _clock_std_ps(fit: JointFit, number: int, delay_ps: float) -> float:
    """By how much the clock's shared errors may stretch a delay, ps."""
    sighting, own = fit.sightings[number], np.flatnonzero(fit.sighting_of == number)
    if not len(own):
        return 0.0
    rows, cols = (each[own].astype(np.int64) for each in (fit.times.row, fit.times.col))
    first = fit.times.arrival_ps[own] + sighting.timing.skew_ps[rows, cols]
    columns = [
        sighting.timing.arrival_errors_ps(rows, cols, when)[1] for when in (first, first + delay_ps)
    ]
    return float(np.linalg.norm(np.median(columns[1] - columns[0], axis=0)))


def lags_with(lags_ps: Floats, delay_ps: float, within_ps: float, std_ps: float) -> Floats:
    """(k + 1,), edges of cells as they are and, about a delay, as fine as about the pulse itself.

    Parameters
    ----------
    lags_ps : array of float, shape (m + 1,)
        Edges as they are.
    delay_ps : float
        Of the second pulse, roughly.
    within_ps : float
        How far it may be from there.
    std_ps : float
        Standard deviation of a pulse.
    """
    reach = within_ps + CORE_STDS * std_ps
    n = int(np.ceil(2.0 * reach / (_STEP_STDS * std_ps)))
    finer = delay_ps + np.linspace(-reach, reach, n + 1)
    finer = finer[(finer > lags_ps[0]) & (finer < lags_ps[-1])]
    edges: Floats = np.union1d(lags_ps, finer)
    return edges


def second_pulse_in(
    known: Known, lags_ps: Floats, std_ps: float, period_ps: float
) -> tuple[Echo, float] | None:
    """The delay at which a copy of the light explains most, and the chi-square that it explains.

    Parameters
    ----------
    known : Known
        Diffuse light as it was found without, with the pixels that the legs light.
    lags_ps : array of float, shape (m + 1,)
        Edges of their cells about the nearest leg.
    std_ps : float
        Standard deviation of a pulse.
    period_ps : float
        Of the laser; 0: none.

    Returns
    -------
    (Echo, float) or None
        None: there is no other light.
    """
    pixels, strengths = known.pixels, known.strengths
    tried = light.other_lags(lags_ps, std_ps, (-np.inf, np.inf))
    own = light.diffuse_light(pixels, known.beside.wide, strengths.tails)
    both = np.concatenate((own, light.other_pulses(pixels, tried)), axis=2)
    score, information, _ = pixels.said_of(both)
    k = own.shape[2]
    # What diffuse light takes up of it is no second pulse's.
    held = PLAUSIBLE[FindingName.HAZE].size ** -2.0 * np.eye(k)
    taken = np.linalg.solve(information[:k, :k] + held, information[:k, k:])
    gain = score[k:] - score[:k] @ taken
    left = np.diagonal(information)[k:] - np.sum(information[:k, k:] * taken, axis=0)
    share = np.where(left > 0.0, np.maximum(gain, 0.0) / np.maximum(left, 1e-12), 0.0)
    chi2 = share * gain
    best = int(np.argmax(chi2))
    if not chi2[best] > 0.0:
        return None
    found = Echo(float(share[best]), float(tried[best]), std_ps, period_ps)
    return found, float(chi2[best])
