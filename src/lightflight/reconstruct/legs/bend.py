"""Which way the arrival curves of legs bend: upwards for straight light on a forward clock.

Takes legs in the picture and their arrivals, gives the mean bend in standard errors. A corner
that the picture does not show bends a curve too, and either way: its kink is told from a bend.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.legs.curves import kink_place, weights_from_errors
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.reconstruct.model.image_plane import mean_focal_px
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.units import std_from_mad

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_FEW_PIXELS = 10
"""A leg seen by fewer says nothing about its bend."""
_CLEAR_STDS = 4.0
"""A curve bends unevenly where that is told by as many of its errors."""
BEND_FROM_CORNER_PX = 2.5
"""About the ends of a leg the light of its neighbours mixes in."""


def bend_significance(legs: tuple[ImageLeg, ...], sighting: Sighting, camera: Camera) -> float:
    """Mean bend of the legs' arrival curves in standard errors; negative: the wrong way.

    Parameters
    ----------
    legs : tuple of ImageLeg
        Legs as found in the picture, in the order of flight.
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    camera : Camera
        The camera that sees it.

    Returns
    -------
    float
        Weighted by their errors; 0 where no leg tells.
    """
    total, variance = 0.0, 0.0
    for leg in legs:
        bend, std = _bend_of_leg(leg, sighting, camera)
        if np.isfinite(std) and std > 0:
            total += bend / std**2
            variance += 1 / std**2
    return total / np.sqrt(variance) if variance > 0 else 0.0


def _bend_of_leg(leg: ImageLeg, sighting: Sighting, camera: Camera) -> tuple[float, float]:
    """Second derivative of a leg's arrival curve and its error; ps per px^2.

    By viewing angle (counted in pixels of the picture's middle), not by place in the picture:
    the half-angle law bends upwards in the angle, whatever the leg; in the picture it need not.
    """
    arrivals = sighting.arrivals
    index = leg.members
    if leg.n_pixels < _FEW_PIXELS:
        return 0.0, float("inf")
    rays = camera.rays_from_pixels(arrivals.row[index], arrivals.col[index])
    middle = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
    across = rays - (rays @ middle)[:, np.newaxis] * middle
    # The leg's plane through the camera: rays of one leg differ along one direction only.
    axis = np.linalg.svd(across, full_matrices=False)[2][0]
    # Counted in pixels of the middle, so that gates in px mean the same in every picture.
    s = mean_focal_px(camera) * np.arctan2(rays @ axis, rays @ middle)
    inner = (s > s.min() + BEND_FROM_CORNER_PX) & (s < s.max() - BEND_FROM_CORNER_PX)
    if np.count_nonzero(inner) <= 3:
        # A patch of light as broad as long: a parabola through three places has no error.
        return 0.0, float("inf")
    index, s = index[inner], s[inner]
    times = sighting.arrival_ps[index]
    errors = arrivals.independent_std_ps[index]
    return _second_derivative(s, times, errors)


def _second_derivative(s: Floats, times: Floats, errors: Floats) -> tuple[float, float]:
    """2 x the quadratic coefficient and its error, of a parabola, or of one with a kink.

    A corner that lenses round bends a curve both ways: such a curve says nothing.
    """
    cubic = np.asarray(np.polynomial.polynomial.polyvander(s, 3), dtype=np.float64)
    parabola = cubic[:, :3]
    kink = kink_place(s, times, errors)
    if kink is not None:
        parabola = np.column_stack((parabola, np.maximum(s - kink, 0.0)))
    else:
        found, covariance = _robust_fit(cubic, times, errors)
        at_ends = 2.0 * found[2] + 6.0 * found[3] * np.array([s.min(), s.max()])
        clear = abs(found[3]) > _CLEAR_STDS * np.sqrt(covariance[3, 3])
        if clear and at_ends[0] * at_ends[1] < 0.0:
            return 0.0, float("inf")
    found, covariance = _robust_fit(parabola, times, errors)
    return float(2 * found[2]), float(2 * np.sqrt(covariance[2, 2]))


def _robust_fit(
    design: NDArray[np.floating], times: Floats, errors: Floats
) -> tuple[Floats, Floats]:
    """Coefficients and their covariance; wild pixels are left out.

    Pixels beside each other across a leg err alike where its light is uneven along it: how far
    times scatter is asked of single pixels and of those of each pixel along the leg together.
    """
    weight = weights_from_errors(errors)
    keep = np.ones(len(times), dtype=bool)
    coefficients: NDArray[np.floating] = np.zeros(design.shape[1])
    for _ in range(3):
        coefficients = np.asarray(
            np.linalg.lstsq(
                design[keep] * weight[keep, np.newaxis], times[keep] * weight[keep], rcond=None
            )[0],
            dtype=np.float64,
        )
        residual = times - design @ coefficients
        spread = std_from_mad(float(np.median(np.abs(residual[keep])))) + 1e-9
        keep = np.abs(residual) < 5 * np.maximum(spread, errors)
    scaled = residual[keep] * weight[keep]
    place = np.unique(np.rint(design[keep, 1]), return_inverse=True)[1]
    share = weight[keep] / np.sqrt(np.bincount(place, weight[keep] ** 2))[place]
    together = np.bincount(place, share * scaled)
    inflation = max(
        1.0, *(float(z @ z) / max(1, len(z) - design.shape[1]) for z in (scaled, together))
    )
    rows = design[keep] * weight[keep, np.newaxis]
    # A leg whose kink lies at its very end leaves the design singular.
    return np.asarray(coefficients), np.asarray(np.linalg.pinv(rows.T @ rows) * inflation)
