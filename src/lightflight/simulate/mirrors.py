"""Mirrors: the path of a pulse from a source by way of plane mirrors, and uneven air.

`vertices_from_mirrors` gives the vertices of a `Scene`; `dust` gives a `brightness` that varies
along the path as scattering in real air does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.errors import GeometryError
from lightflight.simulate.streams import Streams

Floats = NDArray[np.float64]

_CLEARANCE_MM = 1e-6
"""A mirror nearer than this along the ray is the one the light just left."""


def _unit(name: str, vector: ArrayLike) -> Floats:
    values = np.asarray(vector, dtype=float)
    size = float(np.linalg.norm(values)) if values.shape == (3,) else 0.0
    if not (math.isfinite(size) and size > 0):
        raise ValueError(f"{name} must be three finite numbers, not all zero, got {vector!r}")
    return np.asarray(values / size)


@dataclass(frozen=True, eq=False)
class Mirror:
    """A plane mirror that reflects on both sides.

    Attributes
    ----------
    point_mm : ArrayLike
        (3,), its centre, world, mm.
    normal : ArrayLike
        (3,), direction across its surface; of any length, to either side.
    diameter_mm : float or None
        Size of its round face, mm. None: it has no rim.
    """

    point_mm: ArrayLike

    normal: ArrayLike

    diameter_mm: float | None = None

    def __post_init__(self) -> None:
        _unit("normal", self.normal)
        point = np.asarray(self.point_mm, dtype=float)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise ValueError(f"point_mm must be three finite numbers, got {self.point_mm!r}")
        if self.diameter_mm is not None and not self.diameter_mm > 0:
            raise ValueError(f"diameter_mm must be positive, got {self.diameter_mm}")

    def distance_mm(self, start_mm: Floats, direction: Floats) -> float:
        """How far along a ray the mirror is hit.

        Parameters
        ----------
        start_mm : array of float, shape (3,)
            Where the ray starts, world, mm.
        direction : array of float, shape (3,)
            Unit vector along it.

        Returns
        -------
        float
            mm; inf where the ray misses the mirror, or starts on it.
        """
        normal = _unit("normal", self.normal)
        center = np.asarray(self.point_mm, dtype=float)
        approach = float(direction @ normal)
        # Along the surface: the ray never comes nearer.
        if abs(approach) < 1e-12:
            return math.inf
        distance = float((center - start_mm) @ normal) / approach
        if distance < _CLEARANCE_MM:
            return math.inf
        off_center = float(np.linalg.norm(start_mm + distance * direction - center))
        if self.diameter_mm is not None and off_center > 0.5 * self.diameter_mm:
            return math.inf
        return distance


def reflected(direction: ArrayLike, normal: ArrayLike) -> Floats:
    """Direction after a mirror: d - 2 (d.n) n.

    Parameters
    ----------
    direction : array-like, shape (3,)
        d, before the mirror.
    normal : array-like, shape (3,)
        Along n, of any length, to either side.

    Returns
    -------
    array of float, shape (3,)
        As long as `direction`.

    Examples
    --------
    >>> reflected((1.0, 2.0, 0.0), (1.0, 0.0, 0.0))
    array([-1.,  2.,  0.])
    """
    d, n = np.asarray(direction, dtype=float), _unit("normal", normal)
    return np.asarray(d - 2.0 * (d @ n) * n)


def vertices_from_mirrors(
    source_mm: ArrayLike,
    *,
    direction: ArrayLike,
    mirrors: Sequence[Mirror],
    exit_length_mm: float,
    most_reflections: int = 100,
) -> Floats:
    """Vertices of a pulse's path: source, a corner on every mirror it meets, end.

    Parameters
    ----------
    source_mm : array-like, shape (3,)
        Where the pulse starts, world, mm.
    direction : array-like, shape (3,)
        In which it starts; of any length.
    mirrors : sequence of Mirror
        In any order.
    exit_length_mm : float
        Length of the last leg, mm: after the last mirror, or after `most_reflections`.
    most_reflections : int, optional
        Where a cavity lets the pulse go.

    Returns
    -------
    array of float, shape (m, 3)
        World, mm.

    Raises
    ------
    GeometryError
        Where the pulse meets none of the mirrors.
    ValueError
        For directions and lengths that make no sense.
    """
    if not (math.isfinite(exit_length_mm) and exit_length_mm > 0):
        raise ValueError(f"exit_length_mm must be positive and finite, got {exit_length_mm}")
    ray = _unit("direction", direction)
    vertices = [np.asarray(source_mm, dtype=float)]
    for _ in range(most_reflections):
        distances = [mirror.distance_mm(vertices[-1], ray) for mirror in mirrors]
        nearest = int(np.argmin(distances)) if distances else 0
        if not distances or not math.isfinite(distances[nearest]):
            break
        vertices.append(vertices[-1] + distances[nearest] * ray)
        ray = reflected(ray, mirrors[nearest].normal)
    if mirrors and len(vertices) == 1:
        raise GeometryError(
            "the pulse meets none of the mirrors: check source, direction, and the mirrors' "
            "places, normals and diameters"
        )
    vertices.append(vertices[-1] + exit_length_mm * ray)
    return np.array(vertices)


def dust(
    seed: int, *, contrast: float = 0.3, correlation_mm: float = 10.0
) -> Callable[[Floats], Floats]:
    """A brightness that wanders along the path, as dust and haze make it.

    The logarithm is a stationary Gaussian process with a Gaussian correlation; the mean is 1.

    Parameters
    ----------
    seed : int
        Decides the pattern.
    contrast : float, optional
        Standard deviation of the logarithm.
    correlation_mm : float, optional
        Path length over which the brightness stays alike (one sigma of the correlation), mm.

    Returns
    -------
    callable
        Relative strength from path length (mm, array in and out), for `Scene.brightness`.

    Raises
    ------
    ValueError
        For a negative contrast, or a correlation that is not positive.
    """
    if not (contrast >= 0 and correlation_mm > 0):
        raise ValueError(
            f"dust needs contrast >= 0 and correlation_mm > 0, got {contrast}, {correlation_mm}"
        )
    rng = Streams(seed).generator("dust")
    # random waves: 200 of them have the wanted spectrum, at any path length
    wave = rng.standard_normal(200) / correlation_mm
    phase = rng.uniform(0.0, 2.0 * np.pi, 200)

    def brightness(length_mm: Floats) -> Floats:
        angle = np.multiply.outer(np.asarray(length_mm, dtype=float), wave) + phase
        wander = math.sqrt(2.0 / 200) * np.cos(angle).sum(axis=-1)
        return np.asarray(np.exp(contrast * wander - 0.5 * contrast**2))

    return brightness
