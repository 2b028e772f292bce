"""From a Fisher information to a step and to a covariance, whatever the units of its parameters.

Millimetres, picoseconds and logarithms stand side by side in one matrix whose entries differ by
many decades. Scaled to a unit diagonal it is as well conditioned as the data allow, and a cut of
small eigenvalues means the same for every parameter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


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
