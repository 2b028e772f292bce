"""The tail of a flat's pulses, found from the flat itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.response import Response
from lightflight.timing.pulses.fits import misfit_of_shapes
from lightflight.timing.pulses.pulses import Pulses, fit_pulses

Floats = NDArray[np.float64]

_SAMPLE = 100
"""Pixels that are enough to find the shape of the array's pulse."""
_SHOWN = 1.0
"""A shape that single pixels of a flat show by less than this, in the spread of their chi-square,
is none that a recording, which is dimmer, could show."""
_MOST_LEFT = 0.5
"""A tail explains at least half of what a Gaussian leaves, or something else is the matter."""


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
    first = fit_pulses(flat, timing=timing, max_pulses=1, response=Response.gaussian())
    others = _all_but_brightest(first, flat.shape)
    shape, _ = _best_tail(flat, timing, others)
    return _as_wide(shape, flat, timing, others)


def tail_of_flat_if_any(flat: Histograms, *, timing: TimingCalibration) -> Response | None:
    """`tail_of_flat` where the flat's pulses are no Gaussians; None where these do as well.

    Parameters
    ----------
    flat : Histograms
        Counts of a short pulse that reaches all pixels.
    timing : TimingCalibration
        Clock whose codes are calibrated; its delays are not used.

    Returns
    -------
    Response or None
        The shape, as wide as the array's median pulse.

    Raises
    ------
    NothingFoundError
        As `fit_pulses`: where no pixel shows a pulse.
    """
    first = fit_pulses(flat, timing=timing, max_pulses=1)
    others = _all_but_brightest(first, flat.shape)
    asked = ~others.ravel()
    dof = float(np.nansum(first.dof[asked]))
    excess = float(np.nansum(first.chi2[asked])) - dof
    if not asked.any() or excess < _SHOWN * np.sqrt(2.0 * dof * np.count_nonzero(asked)):
        return None
    shape, found = _best_tail(flat, timing, others)
    if found - dof >= _MOST_LEFT * excess:
        return None
    return _as_wide(shape, flat, timing, others)


def _all_but_brightest(pulses: Pulses, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels (rows, cols) that are not asked for the shape of the array's pulse."""
    photons = np.where(pulses.usable, pulses.photons, -1.0).reshape(shape)
    least = np.sort(photons, axis=None)[-min(_SAMPLE, photons.size)]
    others: NDArray[np.bool_] = photons < max(least, 1.0)
    return others


def _as_wide(
    shape: Response, flat: Histograms, timing: TimingCalibration, others: NDArray[np.bool_]
) -> Response:
    """The shape with the width of the array's median pulse."""
    pulses = fit_pulses(flat, timing=timing, max_pulses=1, response=shape, exclude_mask=others)
    middle = float(np.median(pulses.std_ps[pulses.usable]))
    return Response(shape.time_ps * (middle / shape.std_ps), shape.density)


def _best_tail(
    flat: Histograms, timing: TimingCalibration, others: NDArray[np.bool_]
) -> tuple[Response, float]:
    """Tail that fits all but some pixels best, and their summed chi-square."""
    from scipy.optimize import minimize

    def with_tail(x: Floats) -> Response:
        return Response.with_tail(
            std_ps=1.0, tail_ps=float(np.exp(x[0])), tail_share=float(1.0 / (1.0 + np.exp(-x[1])))
        )

    misfit_of = misfit_of_shapes(flat, timing, ~others)

    def misfit(x: Floats) -> float:
        # Out there a tail is absent, or all there is: nothing holds the simplex.
        if abs(x[0]) > 3.0 or abs(x[1]) > 8.0:
            return np.inf
        return misfit_of(with_tail(x))

    # A long tail of few photons, and one of half: a simplex finds the dip that it begins near.
    starts = (np.array([0.7, -2.0]), np.array([0.0, 0.0]))
    options: Any = {"maxfev": 60, "xatol": 0.02, "fatol": 0.5}
    found = [minimize(misfit, x, method="Nelder-Mead", options=options) for x in starts]
    best = min(found, key=lambda one: float(one.fun))
    return with_tail(best.x), float(best.fun)
