"""Looks for a second pulse: the delay at which the counts show the light of all legs once more.

Every pixel says how much better its counts would fit with a copy of its own light at each delay,
its own unknowns and the strengths of diffuse light following. These scores are added up over the
pixels; the best delay is where a fit of delay and share starts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.path.verdict import FindingName
from lightflight.reconstruct.model import light
from lightflight.reconstruct.model.cells import CORE_STDS
from lightflight.reconstruct.model.second_pulse import Echo
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.other_light.strengths import Known

Floats = NDArray[np.float64]

_STEP_STDS = 0.8
"""Width of a cell about the second pulse, in its standard deviations, as about the first."""


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
    own = light.diffuse_light(pixels, known.beside.spread, strengths)
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
