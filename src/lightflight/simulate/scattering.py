"""How much light a piece of path sends to the camera, relative to another piece.

One function per effect; `light.py` multiplies those that a scene switches on. Angles follow from
the direction of flight d, the unit vector u from the point to the camera, and the camera's
backward axis n.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import finite_numbers

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

Scattering = Literal["uniform", "rayleigh"]


def inverse_square_from_distance(distance_mm: ArrayLike) -> Floats:
    """Share of isotropically scattered light that a pupil takes up: 1 / r^2.

    Parameters
    ----------
    distance_mm : array-like, shape (...)
        r, from the point to the pupil, mm.

    Returns
    -------
    array of float, shape (...)
        1/mm^2.
    """
    return np.asarray(1.0 / np.asarray(distance_mm, dtype=float) ** 2)


def rayleigh_from_directions(
    direction: ArrayLike, towards_camera: ArrayLike, *, polarization: ArrayLike | None = None
) -> Floats:
    """Rayleigh's phase function, mean 1 over the sphere.

    Unpolarised light: 3/4 (1 + (d.u)^2). Linearly polarised along e: 3/2 (1 - (e.u)^2).

    Parameters
    ----------
    direction : array-like, shape (..., 3)
        Unit direction of flight d.
    towards_camera : array-like, shape (..., 3)
        Unit vector u from the point to the camera.
    polarization : array-like, shape (..., 3), optional
        Unit vector e, normal to d. None: unpolarised.

    Returns
    -------
    array of float, shape (...)
        Relative to light that is scattered alike in all directions.

    Examples
    --------
    >>> rayleigh_from_directions([1.0, 0.0, 0.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    array([1.5 , 0.75])
    """
    u = np.asarray(towards_camera, dtype=float)
    if polarization is None:
        cosine = np.sum(np.asarray(direction, dtype=float) * u, axis=-1)
        return np.asarray(0.75 * (1.0 + cosine**2))
    along = np.sum(np.asarray(polarization, dtype=float) * u, axis=-1)
    return np.asarray(1.5 * (1.0 - along**2))


def cos4_from_directions(towards_camera: ArrayLike, backward_axis: ArrayLike) -> Floats:
    """Natural fall-off of a lens towards the rim of its field: cos^4 of the field angle.

    Parameters
    ----------
    towards_camera : array-like, shape (..., 3)
        Unit vector u from the point to the camera.
    backward_axis : array-like, shape (3,)
        Unit vector n against the camera's view.

    Returns
    -------
    array of float, shape (...)
        (u.n)^4; 0 behind the camera.
    """
    cosine = np.sum(np.asarray(towards_camera, float) * np.asarray(backward_axis, float), axis=-1)
    return np.asarray(np.clip(cosine, 0.0, 1.0) ** 4)


def rim_of_camera(camera: Camera) -> float:
    """Tangent of the field angle at the farthest corner of the picture.

    Parameters
    ----------
    camera : Camera
        Shape, field and axis.

    Returns
    -------
    float
        tan w there.
    """
    rows, cols = camera.shape
    corners = camera.rays_from_pixels(
        np.array([-0.5, -0.5, rows - 0.5, rows - 0.5]), np.array([-0.5, cols - 0.5] * 2)
    )
    cosine = -(corners @ camera.backward_axis)
    return float(np.sqrt(np.max(1.0 / cosine**2 - 1.0)))


def vignetting_from_directions(
    towards_camera: ArrayLike, backward_axis: ArrayLike, *, rim: float, loss: float
) -> Floats:
    """Share of light that the mount of the lens lets through: 1 - loss (tan w / rim)^4, not < 0.

    Parameters
    ----------
    towards_camera : array-like, shape (..., 3)
        Unit vector u from the point to the camera.
    backward_axis : array-like, shape (3,)
        Unit vector n against the camera's view; cos w = u.n.
    rim : float
        Tangent of the field angle at which `loss` is lost, see `rim_of_camera`.
    loss : float
        Share of light that is lost there.

    Returns
    -------
    array of float, shape (...)
        0 to 1.
    """
    cosine = np.sum(np.asarray(towards_camera, float) * np.asarray(backward_axis, float), axis=-1)
    with np.errstate(divide="ignore"):
        tangent2 = np.where(cosine > 0, 1.0 / cosine**2 - 1.0, np.inf)
    return np.asarray(np.clip(1.0 - loss * (tangent2 / rim**2) ** 2, 0.0, 1.0))


def polarizations_from_vertices(vertices_mm: ArrayLike, polarization: ArrayLike) -> Floats:
    """Polarisation of each leg from that of the first, through ideal mirrors.

    Parameters
    ----------
    vertices_mm : array-like, shape (m, 3)
        Source, mirrors, end; world, mm.
    polarization : array-like, shape (3,)
        Direction of the field on the first leg, world, of any length.

    Returns
    -------
    array of float, shape (legs, 3)
        Unit vectors.

    Raises
    ------
    ValueError
        Where `polarization` lies along the first leg.
    """
    steps = np.diff(np.asarray(vertices_mm, dtype=float), axis=0)
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    must = "be the direction of the field, three finite numbers"
    e = finite_numbers("polarization", polarization, must, shapes=[(3,)])
    e = e - (e @ directions[0]) * directions[0]
    size = float(np.linalg.norm(e))
    if size < 1e-9:
        raise ValueError(
            "polarization points along the first leg: light is polarised across its direction"
        )
    legs = [e / size]
    for before, after in itertools.pairwise(directions):
        turn = after - before
        square = float(turn @ turn)
        e = legs[-1]
        # Legs that go straight on meet no mirror.
        legs.append(e if square < 1e-24 else e - 2.0 * (e @ turn) / square * turn)
    return np.array(legs)
