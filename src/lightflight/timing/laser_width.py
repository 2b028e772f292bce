"""The laser pulse's own width: what is left of recorded widths when the response is taken off.

A pixel's pulse is laser, response and the transit of the pulse through the pixel's footprint,
convolved; of Gaussians the variances add. What an observer sees of the *length* of the pulse in
one camera frame is another matter, and depends on the leg's direction: `apparent_fwhm_ps`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import finite_number
from lightflight.errors import NothingFoundError, SuspectDataWarning
from lightflight.flight import Medium, apparent_speed_from_direction
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS, fwhm_from_std, std_from_fwhm

if TYPE_CHECKING:
    from lightflight.timing.pulses.arrivals import Arrivals
    from lightflight.timing.pulses.pulses import Pulses

Floats = NDArray[np.float64]

_CLEARLY = 5.0
"""Recorded pulses narrower than the response by this many errors: it was told too wide."""
_WIDEST_PS = 1e12
"""A second: nobody calls longer light a pulse."""


@dataclass(frozen=True)
class LaserWidth:
    """Width of the laser pulse by deconvolution.

    Attributes
    ----------
    fwhm_ps : float
        Full width at half maximum, ps; 0 where the response alone is wider than what was seen.
    fwhm_std_ps : float
        Its standard error from the photons and from the response, ps.
    n_pulses : int
        Pulses that went in.
    recorded_fwhm_ps : float
        Weighted mean width of the pulses as recorded, ps.
    """

    fwhm_ps: float

    fwhm_std_ps: float

    n_pulses: int

    recorded_fwhm_ps: float


def laser_width_from_pulses(
    pulses: Pulses | Arrivals,
    *,
    response_fwhm_ps: float,
    response_fwhm_std_ps: float = 0.0,
    transit_std_ps: ArrayLike = 0.0,
) -> LaserWidth:
    """Width of the laser pulse: laser^2 = recorded^2 - response^2 - transit^2.

    Parameters
    ----------
    pulses : Pulses or Arrivals
        Fitted with code widths integrated over (`fit_pulses`, any method but the paper's).
    response_fwhm_ps, response_fwhm_std_ps : float
        Of the camera alone, and how well that is known, ps. A flat recorded with the same laser has
        the laser in it already: it is no response.
    transit_std_ps : array-like, optional
        Standard deviation of arrival times over a pixel's footprint, scalar or (n,), ps; below 1 ps
        of width for legs within 10 deg of the reference plane. NaN leaves a pulse out.

    Returns
    -------
    LaserWidth
        0 wide where the response alone explains the widths.

    Raises
    ------
    NothingFoundError
        No usable pulse.
    ValueError
        A width is negative or not finite.
    """
    must = f"be finite and not negative, and at most {_WIDEST_PS:g}"
    for name, value in (
        ("response_fwhm_ps", response_fwhm_ps), ("response_fwhm_std_ps", response_fwhm_std_ps)
    ):  # fmt: skip
        finite_number(name, value, must, low=0.0, high=_WIDEST_PS)
    std_error = _std_errors(pulses)
    transit = np.broadcast_to(np.asarray(transit_std_ps, dtype=np.float64), std_error.shape)
    use = pulses.usable & np.isfinite(pulses.std_ps) & (std_error > 0) & np.isfinite(transit)
    if not use.any():
        raise NothingFoundError("no usable pulse, so no width: look at the flags of the pulses")
    # Errors scale with the width itself: weights by photons alone do not favour narrow pulses.
    weight = np.maximum(pulses.photons[use], 1.0)
    variance = pulses.std_ps[use] ** 2 - transit[use] ** 2
    mean = float(np.sum(weight * variance) / weight.sum())
    error2 = float(np.sum((weight * 2.0 * pulses.std_ps[use] * std_error[use]) ** 2))
    error2 /= float(weight.sum()) ** 2
    response = std_from_fwhm(response_fwhm_ps)
    error2 += (2.0 * response * std_from_fwhm(response_fwhm_std_ps)) ** 2
    # Noise can make the difference of squares negative: the width is then unresolved, not
    # imaginary.
    laser2 = max(mean - response**2, 0.0)
    if response**2 - mean > _CLEARLY * np.sqrt(error2):
        warnings.warn(
            f"pulses were recorded {fwhm_from_std(np.sqrt(max(mean, 0.0))):.1f} ps wide, narrower "
            f"than the camera's response of {response_fwhm_ps:g} ps: give the width of that "
            "alone (FWHM); nothing is left for the laser's",
            SuspectDataWarning,
            stacklevel=2,
        )
    # Near zero width the error of the square is what is known.
    std = np.sqrt(error2) / (2.0 * np.sqrt(laser2)) if laser2**2 > error2 else error2**0.25
    return LaserWidth(
        fwhm_ps=float(fwhm_from_std(np.sqrt(laser2))),
        fwhm_std_ps=float(fwhm_from_std(std)),
        n_pulses=int(np.count_nonzero(use)),
        recorded_fwhm_ps=float(fwhm_from_std(np.sqrt(max(mean, 0.0)))),
    )


def _std_errors(pulses: Pulses | Arrivals) -> Floats:
    """(n,), standard errors of the widths, ps."""
    from lightflight.timing.pulses.pulses import Pulses

    if isinstance(pulses, Pulses):
        return np.asarray(np.sqrt(pulses.covariance[:, 1, 1]))
    return pulses.std_error_ps


def apparent_fwhm_ps(
    pulse_fwhm_ps: float,
    direction: ArrayLike,
    towards_camera: ArrayLike,
    *,
    medium: Medium | None = None,
) -> Floats:
    """Length of the pulse as one camera frame shows it, as flight time along the path.

    tau n_p / (n_p - n_r d.u): light of the pulse's head and tail that arrives together left at
    different times. 58 to 82 ps for 68 ps, from -10 to 10 degrees of elevation.

    Parameters
    ----------
    pulse_fwhm_ps : float
        tau, full width at half maximum of the pulse, ps.
    direction : array-like, shape (..., 3)
        Unit vector d along the leg.
    towards_camera : array-like, shape (..., 3)
        Unit vector u from the pulse to the camera.
    medium : Medium, optional
        Group indices n_p on the path and n_r on the way back; air unless given.

    Returns
    -------
    array of float, shape (...)
        ps.
    """
    medium = Medium() if medium is None else medium
    speed = apparent_speed_from_direction(direction, towards_camera, medium=medium)
    return np.asarray(pulse_fwhm_ps * speed * medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS)
