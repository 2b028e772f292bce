"""Several flats at known delays: a second look at the scale of the clock and at each gain.

A flat that arrives dA later must appear dA later. Where the codes say dA / (1 + s + g[p]), the
clock runs wrong by s in all pixels and by g[p] in one. Used by `calibrate_timing`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DelayScan:
    """What flats at several delays say, relative to the clock that timed their pulses.

    Attributes
    ----------
    scale : float
        s: all true times are (1 + s) as long as the clock says.
    scale_std : float
        Its standard error.
    skew_ps : array of float, shape (rows, cols)
        Delay minus arrival time, mean over the flats, ps; NaN where none is seen.
    skew_std_ps : array of float, shape (rows, cols)
        Its photon error, ps.
    anchor_delay_ps : array of float, shape (rows, cols)
        Mean delay of the flats' pulses, ps.
    lever_ps : array of float, shape (rows, cols)
        Error that one flat pair leaves per unit of gain: 1 / (error of slope), ps per ps; 0 where
        fewer than two flats are seen.
    slope : array of float, shape (rows, cols)
        s + g[p] by each pixel alone; NaN where fewer than two flats are seen.
    """

    scale: float

    scale_std: float

    skew_ps: Floats

    skew_std_ps: Floats

    anchor_delay_ps: Floats

    lever_ps: Floats

    slope: Floats


def fit_scan(delay_ps: Floats, arrival_ps: Floats, std_ps: Floats, gain_std: Floats) -> DelayScan:
    """Weighted straight line through (delay, delay - arrival) of each pixel, and their mean slope.

    Parameters
    ----------
    delay_ps, std_ps : array of float, shape (k, rows, cols)
        Pulse times and errors, ps; NaN where not seen.
    arrival_ps : array of float, shape (k, rows, cols)
        Known arrival times, ps, on one clock; delay minus arrival must not jump by a period.
    gain_std : array of float, shape (rows, cols)
        How far gains may differ from each other, relative.

    Returns
    -------
    DelayScan
        Scale of all pixels, slope, delay and anchor of each.

    Notes
    -----
    A pixel's delays d_i at arrival times a_i lie on d_i - a_i = skew - slope (d_i - anchor), anchor
    the weighted mean of its d_i, so that the errors of skew and slope are independent.
    """
    weight = np.where(np.isfinite(delay_ps) & np.isfinite(std_ps), std_ps, np.inf) ** -2.0
    delay = np.nan_to_num(delay_ps)
    skew = np.where(weight > 0, delay - arrival_ps, 0.0)
    total = weight.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        anchor = np.sum(weight * delay, axis=0) / total
        mean = np.sum(weight * skew, axis=0) / total
        square = np.sum(weight * (delay - anchor) ** 2, axis=0)
        slope = -np.sum(weight * (delay - anchor) * (skew - mean), axis=0) / square
        std = total**-0.5
    several = (np.count_nonzero(weight > 0, axis=0) > 1) & (square > 0)
    slope = np.where(several, slope, np.nan)
    scale, scale_std = _mean_slope(slope, np.where(several, square, 0.0), gain_std)
    seen = total > 0
    return DelayScan(
        scale, scale_std, np.where(seen, mean, np.nan), np.where(seen, std, np.nan),
        np.where(seen, anchor, np.nan), np.sqrt(np.where(several, square, 0.0)), slope,
    )  # fmt: skip


def _mean_slope(slope: Floats, square: Floats, gain_std: Floats) -> tuple[float, float]:
    """Slope that all pixels share and its error; (0, inf) where no pixel has one."""
    use = np.isfinite(slope) & (square > 0)
    if not use.any():
        return 0.0, np.inf
    weight = 1.0 / (1.0 / square[use] + gain_std[use] ** 2)
    mean = float(np.sum(weight * slope[use]) / weight.sum())
    chi2 = float(np.sum(weight * (slope[use] - mean) ** 2))
    # Slopes that scatter more than stated widen the error; less scatter is chance.
    excess = max(1.0, chi2 / max(int(use.sum()) - 1, 1))
    return mean, float(np.sqrt(excess / weight.sum()))
