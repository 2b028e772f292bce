"""Arithmetic of many small vectors, the last axis of arrays: to the last bit what NumPy gives.

Its reductions and `np.cross` cost three times as much for vectors of two or three numbers, which is
what most of a fit is made of.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def summed(values: Floats) -> Floats:
    """Sums over the last axis, of two or three numbers.

    Parameters
    ----------
    values : array of float, shape (..., 2 | 3)
        Any unit.

    Returns
    -------
    array of float, shape (...)
        In the same.
    """
    total: Floats = values[..., 0] + values[..., 1]
    return total if values.shape[-1] == 2 else total + values[..., 2]


def lengths(vectors: Floats) -> Floats:
    """Euclidean lengths.

    Parameters
    ----------
    vectors : array of float, shape (..., 2 | 3)
        Any unit.

    Returns
    -------
    array of float, shape (...)
        In the same.
    """
    found: Floats = np.sqrt(summed(vectors * vectors))
    return found


def cross(a: Floats, b: Floats) -> Floats:
    """Vector products a x b.

    Parameters
    ----------
    a, b : array of float, shape (..., 3)
        Any units.

    Returns
    -------
    array of float, shape (..., 3)
        In their product.
    """
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for axis, (one, other) in enumerate(((1, 2), (2, 0), (0, 1))):
        product[..., axis] = a[..., one] * b[..., other] - a[..., other] * b[..., one]
    return product


def finite(values: Floats) -> Floats:
    """`np.nan_to_num`, which copies and compares where nothing is to be done.

    Parameters
    ----------
    values : array of float
        Any shape and unit.

    Returns
    -------
    array of float
        The array itself where all of it is finite.
    """
    return values if np.isfinite(values).all() else np.nan_to_num(values)


def unit(vector: Floats) -> Floats:
    """The direction of a vector.

    Parameters
    ----------
    vector : array of float, shape (3,)

    Returns
    -------
    array of float, shape (3,)
        Of length one; zeros stay zeros.
    """
    direction: Floats = vector / max(float(np.linalg.norm(vector)), 1e-12)
    return direction
