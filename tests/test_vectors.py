"""Sums, lengths and products of many small vectors are NumPy's, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.vectors import cross, finite, lengths, summed


@pytest.fixture
def vectors() -> np.ndarray:
    """Of sizes that differ by decades, so that the order of sums shows."""
    rng = np.random.default_rng(3)
    return rng.normal(size=(2, 500, 3)) * 10.0 ** rng.integers(-6, 6, (2, 500, 3))


@pytest.mark.parametrize("size", [2, 3])
def test_sums_and_lengths(vectors: np.ndarray, size: int) -> None:
    some = vectors[..., :size]
    np.testing.assert_array_equal(summed(some), some.sum(axis=-1))
    np.testing.assert_array_equal(lengths(some), np.linalg.norm(some, axis=-1))


def test_products(vectors: np.ndarray) -> None:
    np.testing.assert_array_equal(cross(*vectors), np.cross(*vectors))
    one, many = vectors[0][:, np.newaxis], vectors[1]
    np.testing.assert_array_equal(cross(one, many), np.cross(one, many))


def test_what_is_not_finite_becomes_a_number(vectors: np.ndarray) -> None:
    broken = vectors[0].copy()
    assert finite(broken) is broken
    broken[0] = np.nan, np.inf, -np.inf
    np.testing.assert_array_equal(finite(broken), np.nan_to_num(broken))
