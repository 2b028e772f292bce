"""The tail of a flat's pulses, found from the flat itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.response import Response
from lightflight.timing.pulses.pulses import fit_pulses

Floats = NDArray[np.float64]

_SAMPLE = 100
"""Pixels that are enough to find the shape of the array's pulse."""


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
    from scipy.optimize import minimize

    first = fit_pulses(flat, timing=timing, max_pulses=1, response=Response.gaussian())
    photons = np.where(first.usable, first.photons, -1.0).reshape(flat.shape)
    least = np.sort(photons, axis=None)[-min(_SAMPLE, photons.size)]
    others = photons < max(least, 1.0)

    def with_tail(x: Floats) -> Response:
        return Response.with_tail(
            std_ps=1.0, tail_ps=float(np.exp(x[0])), tail_share=float(1.0 / (1.0 + np.exp(-x[1])))
        )

    def misfit(x: Floats) -> float:
        # Out there a tail is absent, or all there is: nothing holds the simplex.
        if abs(x[0]) > 3.0 or abs(x[1]) > 8.0:
            return np.inf
        fits = fit_pulses(
            flat, timing=timing, max_pulses=1, response=with_tail(x), exclude_mask=others
        )
        return float(np.nansum(fits.chi2[~others.ravel()]))

    # A long tail of few photons, and one of half: a simplex finds the dip that it begins near.
    starts = (np.array([0.7, -2.0]), np.array([0.0, 0.0]))
    options: Any = {"maxfev": 60, "xatol": 0.02, "fatol": 0.5}
    found = [minimize(misfit, x, method="Nelder-Mead", options=options) for x in starts]
    best = min(found, key=lambda one: float(one.fun))
    middle = float(np.median(first.std_ps[first.usable]))
    shape = with_tail(best.x)
    return Response(shape.time_ps * (middle / shape.std_ps), shape.density)
