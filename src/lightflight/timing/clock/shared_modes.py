"""Errors that all pixels of a clock share and that the user states: its zero, its scale, its drift.

They are one-sigma columns of the calibration: every estimator that asks it for its errors has them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lightflight.timing.clock.calibration import TimingCalibration


def with_shared_errors(
    clock: TimingCalibration,
    *,
    offset_std_ps: float = 0.0,
    scale_std: float = 0.0,
    drift_std_ps: float = 0.0,
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
    for name, std in {**stated, "clock scale": scale_std}.items():
        if not (np.isfinite(std) and std >= 0):
            raise ValueError(f"the error of the {name} must be finite and >= 0, got {std}")
    columns = {name: std for name, std in stated.items() if std > 0}
    if scale_std > 0:
        both = float(np.hypot(clock.code_length_std, scale_std))
        clock = replace(clock, code_length_std=both)
    if not columns:
        return clock
    flat = [np.full((*clock.shape, 1), std) for std in columns.values()]
    return replace(
        clock,
        flat_modes_ps=np.concatenate((clock.flat_modes_ps, *flat), axis=2),
        flat_mode_names=(*clock.flat_mode_names, *columns),
    )
