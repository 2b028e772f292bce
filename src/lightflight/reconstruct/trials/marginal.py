"""How likely a recording is under a path, whatever the numbers of that path: its evidence.

By Laplace's approximation, in the fit's own whitened model. A path with more numbers, or with
numbers that the recording fixes more sharply than what was thought of them beforehand, fits for a
price: the share of all that was thought possible that still is (Occam's factor).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.fit.least_squares import Solution
from lightflight.reconstruct.model.freedom import Freedom
from lightflight.reconstruct.model.geometry import PathState
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]

ANYWHERE_MM = 300.0
"""Prior standard deviation of a corner or an end that nobody told, along each axis, mm: the paper's
mirrors stand 375 mm apart. Ten times as much makes a corner a thousand times less likely."""


def log_evidence(solution: Solution, freedom: Freedom) -> float:
    r"""Natural log of the evidence of a fit's data, up to what all fits of the same data share.

    .. math:: \ln Z = -\tfrac12 \chi^2 - \tfrac12 \ln\det\left(P^{-1} (I + D)\right),

    with the chi-square of data and priors at the best fit, its information I, D = 1/sigma^2 of
    what nobody told (`ANYWHERE_MM`), and P the information of all priors, D included.

    Parameters
    ----------
    solution : Solution
        The fit. Of two that are compared times, their errors and weights, and lines are the same.
    freedom : Freedom
        What it could move, and the priors on that.

    Returns
    -------
    float
    """
    information = solution.columns.T @ solution.columns
    n_free, n = freedom.basis.shape[1], len(information)
    # Shared errors of clock, cameras and medium: unit priors, in the fit as here.
    prior = np.eye(n)
    untold = np.diag(_untold(solution.state, freedom))
    prior[:n_free, :n_free] = freedom.prior_information + untold
    information[:n_free, :n_free] += untold
    gained = np.linalg.slogdet(information)[1] - np.linalg.slogdet(prior)[1]
    return float(-0.5 * solution.rows @ solution.rows - 0.5 * gained)


def _untold(state: PathState, freedom: Freedom) -> Floats:
    """(p,), information on every column where nothing is told, in 1 over its unit squared."""
    rows = freedom.basis.copy()
    # The start time stands behind the vertices, and is counted as light flies.
    rows[state.vertices_mm.size] *= SPEED_OF_LIGHT_MM_PER_PS
    information: Floats = np.sum(rows**2, axis=0) / ANYWHERE_MM**2
    return information
