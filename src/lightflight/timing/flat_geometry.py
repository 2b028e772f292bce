"""When the light of a flat reaches each pixel: a lit screen, or a beam that may be tilted.

- a screen lit from a known source: `flat_arrival_from_screen_ps`, for `flat_arrival_ps`
- a collimated beam on the bare sensor, its tilt not known: `fit_tilt`, by `calibrate_timing`
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.errors import GeometryError
from lightflight.flight import Medium, arrival_time_from_event
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]


def flat_arrival_from_screen_ps(
    camera: Camera,
    *,
    source_mm: ArrayLike,
    screen_point_mm: ArrayLike,
    screen_normal: ArrayLike,
    medium: Medium | None = None,
) -> Floats:
    """Arrival time at each pixel of light that a pulsed source throws on a flat screen.

    t_a = n_p |B - X| / c + n_r |X - A| / c, X where the pixel's ray meets the screen; zero is the
    moment the pulse leaves the source. Pass the result to `calibrate_timing` as
    `flat_arrival_ps`.

    Parameters
    ----------
    camera : Camera
        Where each pixel looks.
    source_mm : array-like, shape (3,)
        B, where the light spreads from, world, mm.
    screen_point_mm : array-like, shape (3,)
        Any point of the screen, world, mm.
    screen_normal : array-like, shape (3,)
        Normal of the screen, world, any length and sign.
    medium : Medium, optional
        Group indices out and back; air unless given.

    Returns
    -------
    array of float, shape (rows, cols)
        ps.

    Raises
    ------
    GeometryError
        Where a pixel's ray does not meet the screen in front of the camera.
    ValueError
        Where a vector is not finite, or the normal is zero.
    """
    medium = Medium() if medium is None else medium
    source = _vector("source_mm", source_mm)
    point = _vector("screen_point_mm", screen_point_mm)
    normal = _vector("screen_normal", screen_normal)
    if not normal.any():
        raise ValueError("screen_normal must not be zero")
    rays = camera.rays_from_pixels(*np.indices(camera.shape))
    towards = rays @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = ((point - camera.center_mm) @ normal) / towards
    # A ray along the screen never meets it (inf or NaN), one away from it meets it behind the
    # camera.
    misses = ~(np.isfinite(distance) & (distance > 0))
    if misses.any():
        raise GeometryError(
            f"{int(misses.sum())} pixels do not look at the screen: check screen_point_mm and "
            "screen_normal against the camera's pose",
            offenders=misses,
        )
    seen = camera.center_mm + distance[..., None] * rays
    lit = np.linalg.norm(seen - source, axis=-1) * medium.path_group_index
    return np.asarray(
        arrival_time_from_event(
            seen,
            lit / SPEED_OF_LIGHT_MM_PER_PS,
            camera_center_mm=camera.center_mm,
            return_group_index=medium.return_group_index,
        )
    )


def _vector(name: str, value: ArrayLike) -> Floats:
    vector = np.asarray(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{name} must be three finite numbers, got {value!r}")
    return vector


@dataclass(frozen=True, eq=False)
class Tilt:
    """Tilt of a beam over the sensor, by the pixels' delays and what was known before.

    Attributes
    ----------
    across_ps : (float, float)
        Time from the first to the last row, and from the first to the last column, ps.
    across_std_ps : (float, float)
        Their standard errors, ps.
    modes_ps : array of float, shape (rows, cols, 2)
        One sigma of each on the pixels' delays, ps.
    """

    across_ps: tuple[float, float]

    across_std_ps: tuple[float, float]

    modes_ps: Floats


def fit_tilt(skew_ps: Floats, prior_std_ps: float) -> Tilt:
    """Plane through the pixels' delays, as far as a tilt of this size is to be expected.

    Delays that truly differ from row to row look like a tilt: the prior says how much of a
    gradient is the beam's. Their scatter about the plane is its noise.

    Parameters
    ----------
    skew_ps : array of float, shape (rows, cols)
        ps; NaN where unknown.
    prior_std_ps : float
        Expected tilt from edge to edge of the array, ps.

    Returns
    -------
    Tilt
        Across the rows and the columns, drawn to zero as far as the prior demands.

    Notes
    -----
    Each gradient g with information I and prior width s keeps the part I / (I + s^-2) of itself;
    its variance is 1 / (I + s^-2).
    """
    places = [_centered(n) for n in skew_ps.shape]
    row, col = np.meshgrid(*places, indexing="ij")
    seen = np.isfinite(skew_ps)
    design = np.stack([np.ones(seen.sum()), row[seen], col[seen]], axis=1)
    plane, *_ = np.linalg.lstsq(design, skew_ps[seen], rcond=None)
    # The pixels' own delays scatter far more than photons do: they are the noise of a plane.
    scatter2 = float(np.var(skew_ps[seen] - design @ plane))
    across, std = [], []
    for place, found in ((row, plane[1]), (col, plane[2])):
        information = float(np.sum(place[seen] ** 2)) / max(scatter2, 1e-12)
        posterior = 1.0 / (prior_std_ps**-2.0 + information)
        across.append(float(found * information * posterior))
        std.append(float(np.sqrt(posterior)))
    modes = np.stack([row * std[0], col * std[1]], axis=-1)
    return Tilt((across[0], across[1]), (std[0], std[1]), modes)


def tilt_ps(tilt: Tilt, shape: tuple[int, int]) -> Floats:
    """Arrival time that a tilt adds, zero in the middle of the array.

    Parameters
    ----------
    tilt : Tilt
        Of a flat's beam.
    shape : (int, int)
        (rows, cols) of the array.

    Returns
    -------
    array of float, shape (rows, cols)
        ps.
    """
    row, col = np.meshgrid(*(_centered(n) for n in shape), indexing="ij")
    return np.asarray(row * tilt.across_ps[0] + col * tilt.across_ps[1])


def _centered(n: int) -> Floats:
    """(n,), from -1/2 to 1/2; zero where there is one element."""
    return (np.arange(n) - 0.5 * (n - 1)) / max(n - 1, 1)
