"""The way through parallel planes, a window or the wall of a tank, in one unknown.

Fast path of `refraction.way_through`: along parallel planes p = n_i sin(theta_i) is the same in
every layer, so a way is one number, and with h_i the thickness of layer i a point at the distance
rho beside the camera's normal is seen where

    rho = sum_i h_i p / q_i,   q_i = sqrt(n_i^2 - p^2),   c t = sum_i g_i h_i n_i / q_i.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.camera.way import Way

Floats = NDArray[np.float64]

_MOST_STEPS = 60
_STILL = 1e-10
"""Newton's step, as a share, that is the last: the next would be its square."""


def way_through_parallel(
    points_mm: Floats,
    *,
    center_mm: Floats,
    normal: Floats,
    distances_mm: Floats,
    phase: Floats,
    group: Floats,
) -> Way:
    """The way from points behind parallel planes to the camera, and how it follows them.

    Parameters
    ----------
    points_mm : array of float, shape (n, 3)
        World, mm; NaN gives NaN.
    center_mm : array of float, shape (3,)
        The camera's entrance pupil, world, mm.
    normal : array of float, shape (3,)
        Unit, across the planes, away from the camera.
    distances_mm : array of float, shape (k,)
        Of the planes from the camera, along the normal.
    phase, group : array of float, shape (k + 1,)
        Indices of the layers, from the camera's on.

    Returns
    -------
    Way
        As `refraction.way_through`.
    """
    offset = points_mm - center_mm
    depth = offset @ normal
    beside = offset - depth[:, np.newaxis] * normal
    rho = np.linalg.norm(beside, axis=1)
    radial = beside / np.maximum(rho, 1e-300)[:, np.newaxis]
    fixed = np.diff(distances_mm, prepend=0.0)
    # A layer a row: sums over layers are then sums of rows, which NumPy is quick at.
    layers = np.empty((len(phase), len(rho)))
    layers[:-1], layers[-1] = fixed[:, np.newaxis], depth - distances_mm[-1]
    phase, group = phase[:, np.newaxis], group[:, np.newaxis]
    p = _invariant(rho, layers, phase)
    q = np.sqrt(phase * phase - p * p)
    cubed = q * q * q
    # How p follows rho and the depth behind the last plane.
    p_by_rho = 1.0 / np.sum(layers * phase**2 / cubed, axis=0)
    slope = p / q[-1]
    p_by_depth = -slope * p_by_rho

    out = layers[0] * p / q[0]
    out_by_p = layers[0] * phase[0] ** 2 / cubed[0]
    # The same share of rho near the axis, where rho is nothing.
    share = (layers[0] / q[0]) / np.sum(layers / q, axis=0)
    by_point = share[:, np.newaxis, np.newaxis] * (np.eye(3) - np.outer(normal, normal))
    along = (out_by_p * p_by_rho - share)[:, np.newaxis] * radial
    along += (out_by_p * p_by_depth)[:, np.newaxis] * normal
    by_point = by_point + radial[:, :, np.newaxis] * along[:, np.newaxis]

    optical_by_p = np.sum(group * layers * phase * p / cubed, axis=0)
    deeper = optical_by_p * p_by_depth + group[-1] * phase[-1] / q[-1]
    behind = layers[-1]
    return Way(
        first_mm=center_mm + fixed[0] * normal + out[:, np.newaxis] * radial,
        last_mm=points_mm
        - behind[:, np.newaxis] * normal
        - (behind * slope)[:, np.newaxis] * radial,
        optical_mm=np.sum(group * layers * phase / q, axis=0),
        first_by_point=by_point,
        optical_by_point=(optical_by_p * p_by_rho)[:, np.newaxis] * radial
        + deeper[:, np.newaxis] * normal,
    )


def _invariant(rho: Floats, layers: Floats, phase: Floats) -> Floats:
    """(n,) p of the ways that end `rho` (n,) beside the normal, through layers (k + 1, n).

    In the tangent of the angle in the least dense layer, rho is concave and rises: Newton's method
    finds the root from any start. `phase` is (k + 1, 1).
    """
    least = int(np.argmin(phase))
    thinnest, squared = phase[least, 0], phase * phase
    tangent = rho / layers.sum(axis=0)
    for _ in range(_MOST_STEPS):
        stretch = np.sqrt(1.0 + tangent * tangent)
        p = thinnest * tangent / stretch
        q = np.sqrt(squared - p * p)
        # Its own layer by its tangent, which stays exact near grazing.
        q[least] = thinnest / stretch
        ways = layers / q
        missed = rho - p * ways.sum(axis=0)
        by_p = np.sum(ways * squared / (q * q), axis=0)
        step = missed / (by_p * thinnest / (stretch * stretch * stretch))
        tangent = np.maximum(tangent + step, 0.0)
        if not (np.abs(step) > _STILL * (1.0 + tangent)).any():
            break
    found: Floats = thinnest * tangent / np.sqrt(1.0 + tangent * tangent)
    return found
