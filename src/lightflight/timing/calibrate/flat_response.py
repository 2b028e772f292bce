"""The tail of a flat's pulses, found from the flat itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.response import Response
from lightflight.timing.pulses.common_shape import (
    MOST_LEFT,
    SAMPLE,
    SHOWN,
    all_but_brightest,
    lowest,
    with_tail,
)
from lightflight.timing.pulses.fits import misfit_of_shapes
from lightflight.timing.pulses.pulses import fit_pulses

Floats = NDArray[np.float64]

_MANY = 1000
"""Pixels that measure it. Each knows its codes to a few percent, and a bright recording holds as
many photons as all of these: a shape of the sample alone misfits it by five deviations."""


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
    kind, _ = _best_tail(flat, timing, all_but_brightest(first, flat.shape, SAMPLE))
    return _measured(kind, flat, timing, all_but_brightest(first, flat.shape, _MANY))


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
    first = fit_pulses(flat, timing=timing, max_pulses=1, response="clock")
    others = all_but_brightest(first, flat.shape, SAMPLE)
    asked = ~others.ravel()
    dof = float(np.nansum(first.dof[asked]))
    excess = float(np.nansum(first.chi2[asked])) - dof
    if not asked.any() or excess < SHOWN * np.sqrt(2.0 * dof * np.count_nonzero(asked)):
        return None
    kind, found = _best_tail(flat, timing, others)
    if found - dof >= MOST_LEFT * excess:
        return None
    return _measured(kind, flat, timing, all_but_brightest(first, flat.shape, _MANY))


def _measured(
    kind: Floats, flat: Histograms, timing: TimingCalibration, others: NDArray[np.bool_]
) -> Response:
    """The tail that fits all but some pixels best, with the width of the array's median pulse."""
    misfit_of = misfit_of_shapes(flat, timing, ~others)
    shape = with_tail(lowest(lambda x: misfit_of(with_tail(x)).deviance, kind))
    pulses = fit_pulses(flat, timing=timing, max_pulses=1, response=shape, exclude_mask=others)
    middle = float(np.median(pulses.std_ps[pulses.usable]))
    return Response(shape.time_ps * (middle / shape.std_ps), shape.density)


def _best_tail(
    flat: Histograms, timing: TimingCalibration, others: NDArray[np.bool_]
) -> tuple[Floats, float]:
    """Kind of the tail (2,) that fits all but some pixels best, and their summed chi-square."""
    from scipy.optimize import minimize

    misfit_of = misfit_of_shapes(flat, timing, ~others)

    def misfit(x: Floats) -> float:
        # Out there a tail is absent, or all there is: nothing holds the simplex.
        if abs(x[0]) > 3.0 or abs(x[1]) > 8.0:
            return np.inf
        return misfit_of(with_tail(x)).chi2

    # A long tail of few photons, and one of half: a simplex finds the dip that it begins near.
    starts = (np.array([0.7, -2.0]), np.array([0.0, 0.0]))
    options: Any = {"maxfev": 60, "xatol": 0.02, "fatol": 0.5}
    found = [minimize(misfit, x, method="Nelder-Mead", options=options) for x in starts]
    best = min(found, key=lambda one: float(one.fun))
    return best.x, float(best.fun)
