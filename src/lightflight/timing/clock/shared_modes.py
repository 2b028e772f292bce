"""Errors that the pixels of a clock share and that the user states: zero, scale, drift, skew.

They are one-sigma columns of the calibration: every estimator that asks it for its errors has them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.timing.clock.calibration import TimingCalibration

Floats = NDArray[np.float64]

SKEWS = ("skew over the rows", "skew over the columns", "skew towards the rim")
"""How delays go wrong smoothly: a warm edge, a flat that came askew, a screen nearer than told."""


def with_shared_errors(
    clock: TimingCalibration,
    *,
    offset_std_ps: float = 0.0,
    scale_std: float = 0.0,
    drift_std_ps: float = 0.0,
    skew_std_ps: float = 0.0,
) -> TimingCalibration:
    """The clock with further errors that all its pixels share; one whose std is 0 is not added.

    Parameters
    ----------
    clock : TimingCalibration
        Calibrated or nominal.
    offset_std_ps : float, optional
        Of its zero: a trigger cable, the place of the flat's light; ps.
    scale_std : float, optional
        Of the length of its codes since the calibration, as a share.
    drift_std_ps : float, optional
        How far its zero may have drifted by the middle of this recording, ps; recordings of one
        flight share the drift.
    skew_std_ps : float, optional
        Of the delays at the picture's edge against its middle, for each of `SKEWS`, ps.

    Returns
    -------
    TimingCalibration
        The same clock, its errors wider.

    Raises
    ------
    ValueError
        For an error below zero.
    """
    stated = {"clock offset": offset_std_ps, "clock drift": drift_std_ps}
    for name, std in {**stated, "clock scale": scale_std, "clock skew": skew_std_ps}.items():
        if not (np.isfinite(std) and std >= 0):
            raise ValueError(f"the error of the {name} must be finite and >= 0, got {std}")
    columns = {name: std for name, std in stated.items() if std > 0}
    if scale_std > 0:
        both = float(np.hypot(clock.code_length_std, scale_std))
        clock = replace(clock, code_length_std=both)
    whole = {name: np.full((*clock.shape, 1), std) for name, std in columns.items()}
    if skew_std_ps > 0:
        modes = skew_std_ps * skewed_delays(clock.shape)
        whole |= {name: modes[..., k : k + 1] for k, name in enumerate(SKEWS)}
    if not whole:
        return clock
    return replace(
        clock,
        flat_modes_ps=np.concatenate((clock.flat_modes_ps, *whole.values()), axis=2),
        flat_mode_names=(*clock.flat_mode_names, *whole),
    )


def skewed_delays(shape: tuple[int, int]) -> Floats:
    """Delays of each of `SKEWS`, one at the edges that it makes latest and zero in the middle.

    Parameters
    ----------
    shape : (int, int)
        (rows, cols) of the array.

    Returns
    -------
    array of float, shape (rows, cols, 3)
        The third is one at the ends of the longer side, as light from a point is.
    """
    down, across = (np.linspace(-1.0, 1.0, n) if n > 1 else np.zeros(1) for n in shape)
    row, col = np.meshgrid(down, across, indexing="ij")
    longer = max(shape)
    out = (row * shape[0] / longer) ** 2 + (col * shape[1] / longer) ** 2
    return np.stack((row, col, out), axis=-1)
