"""How errors of code widths become errors of the time between two codes.

Pure functions behind `TimingCalibration.arrival_errors_ps`; widths and times are in plateau
codes.
"""

import numpy as np
from numpy.typing import NDArray

MOST_PHASES = 64
"""Longer patterns are treated as widths that are independent of each other."""


def walk_variance(
    code: NDArray[np.float64], anchor: NDArray[np.float64], end_code: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n,), variance of the sum of unit-variance widths between two codes, all summing to zero.

    Without an anchor: between the code and the end of the period.
    """
    between = np.abs(code - np.where(np.isfinite(anchor), anchor, end_code))
    return np.asarray(between * np.maximum(1.0 - between / end_code, 0.0))


def phase_lever(
    code: NDArray[np.float64], response_codes: NDArray[np.float64], n_phases: int
) -> NDArray[np.float64]:
    """Time of a pulse (in plateau widths) per unit of each phase, phases held to mean 1.

    With h_j(u) = (codes of phase j below u) - u / n_phases, a saw tooth of period n_phases, a
    pulse of width s at u moves by the Gaussian average of h_j; summed here as a Fourier series.

    Parameters
    ----------
    code : (n,), fractional code of the pulse.
    response_codes : (n,), standard deviation of the pulse, codes.

    Returns
    -------
    (n, n_phases), its mean over a period is zero.
    """
    harmonic = np.arange(1, 4 * n_phases + 1)
    omega = 2.0 * np.pi * harmonic / n_phases
    damping = np.exp(-0.5 * (omega * response_codes[:, None]) ** 2)
    wave = np.exp(1j * omega * code[:, None]) * damping
    start = np.exp(-1j * omega[:, None] * (np.arange(n_phases) + 0.5))
    weight = np.sinc(harmonic / n_phases) / n_phases / (1j * omega)
    return np.asarray(2.0 * np.real((wave * weight) @ start))
