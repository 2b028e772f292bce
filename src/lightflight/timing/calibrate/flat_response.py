"""The tail of a flat's pulses, found from the flat itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.response import Response
from lightflight.timing.pulses.common_shape import (
    MOST_LEFT,
    NEARLY_THERE,
    SAMPLE,
    SHOWN,
    all_but_brightest,
    best_of_first,
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

    Place, width, photons and background are each pixel's own; the likelihood of the brightest
    pixels decides.

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
    kind, _ = _best_tail(flat, timing, all_but_brightest(first, SAMPLE))
    return _measured(kind, flat, timing, all_but_brightest(first, _MANY))


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
    others = all_but_brightest(first, SAMPLE)
    asked = ~others.ravel()
    dof = float(np.nansum(first.dof[asked]))
    excess = float(np.nansum(first.chi2[asked])) - dof
    if not asked.any() or excess < SHOWN * np.sqrt(2.0 * dof * np.count_nonzero(asked)):
        return None
    kind, found = _best_tail(flat, timing, others)
    if found - dof >= MOST_LEFT * excess:
        return None
    return _measured(kind, flat, timing, all_but_brightest(first, _MANY))


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
    misfit_of = misfit_of_shapes(flat, timing, ~others)
    begin = best_of_first(lambda kind: misfit_of(with_tail(kind)).chi2)
    kind = lowest(lambda x: misfit_of(with_tail(x)).deviance, begin, NEARLY_THERE)
    return kind, misfit_of(with_tail(kind)).chi2
