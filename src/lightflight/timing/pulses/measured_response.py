"""The shape of a pulse from a curve that was measured with the camera's own codes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lightflight.arguments import real_numbers
from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.response import Response

_FOOT = 1e-5
"""A measured curve ends where it is lost in the noise, or has fallen below this share."""

_FINE = 16
"""Points per code of a measured curve."""


def response_from_counts(counts: ArrayLike, hist: Histograms) -> Response:
    """Measured curve, counted in the codes of a recording; its background is taken off.

    Parameters
    ----------
    counts : array-like, shape (codes,)
        Counts of many pulses on the nominal codes of `hist`.
    hist : Histograms
        Recording that states the nominal codes.

    Returns
    -------
    Response
        A smooth curve, only its shape matters.

    Raises
    ------
    ValueError
        Wrong length, or no pulse in it.
    """
    from scipy.interpolate import CubicSpline

    heights = real_numbers("response", counts)
    if heights.shape != (hist.n_codes,):
        raise ValueError(
            f"a measured response needs one count per code, ({hist.n_codes},), got shape "
            f"{heights.shape}"
        )
    if not np.isfinite(heights).all() or heights.min() < 0:
        raise ValueError("counts of a measured response must be finite and not negative")
    lower, upper = TimingCalibration.nominal(hist).code_intervals_ps([0], [0])
    live = np.flatnonzero(upper[0] > lower[0])
    live = live[np.argsort(lower[0, live])]
    heights = heights[live]
    # The pulse fills a few codes of many: the median one holds background alone.
    level = float(np.median(heights))
    excess = heights - level
    peak = int(np.argmax(excess))
    if not excess[peak] > 0:
        raise ValueError("the measured response is flat: give a curve with a pulse in it")
    low = np.flatnonzero(excess < max(2.0 * np.sqrt(level + 1.0), _FOOT * excess[peak]))
    first = int(low[low < peak].max(initial=-1))
    last = int(low[low > peak].min(initial=len(excess)))
    inside = slice(max(first, 0), min(last + 1, len(excess)))
    edges = np.append(lower[0, live][inside], upper[0, live[inside][-1]])
    # A smooth curve that holds the counts of every code: codes are wide against the shape.
    held = np.append(0.0, np.cumsum(np.maximum(excess[inside], 0.0)))
    time = np.linspace(edges[0], edges[-1], _FINE * (len(edges) - 1) + 1)
    density = CubicSpline(edges, held, bc_type="clamped").derivative()(time)
    return Response(time, np.maximum(density, 0.0))
