"""How codes are read as times: the fields that `Recording` and `Histograms` share, and their rules.

What each means stands with the records; files keep them under these names.
"""

from __future__ import annotations

import math
import numbers
import operator
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

CLOCK_FIELDS = (
    "bin_width_ps",
    "laser_period_ps",
    "n_frames",
    "periods_per_frame",
    "reversed_codes",
    "first_edge_ps",
    "no_photon_code",
)
"""Names of the fields, in the order in which they are kept and shown."""


def clock_fields_of(record: object) -> dict[str, Any]:
    """The clock's fields of a `Recording` or `Histograms`, by name."""
    return {name: getattr(record, name) for name in CLOCK_FIELDS}


def check_clock_fields(clock: Mapping[str, Any], *, n_codes: int) -> None:
    """Raise ValueError where the clock's fields cannot be those of `n_codes` codes.

    Parameters
    ----------
    clock : mapping of str
        All of `CLOCK_FIELDS`.
    n_codes : int
        Number of TDC codes.

    Raises
    ------
    ValueError
        For a width, period or number that is not positive and finite, a number of frames that is
        not whole, reversed codes without a period, and a `no_photon_code` that is no code.
    """
    for name in ("bin_width_ps", "laser_period_ps", "n_frames", "periods_per_frame"):
        value = clock[name]
        if value is not None and not (_is_finite(value) and value > 0):
            raise ValueError(f"{name} must be positive and finite, got {value!r}")
    for name in ("n_frames", "periods_per_frame"):
        value = clock[name]
        if value is not None and value != int(value):
            raise ValueError(f"{name} must be a whole number, got {value}")
    if not _is_finite(clock["first_edge_ps"]):
        raise ValueError(f"first_edge_ps must be finite, got {clock['first_edge_ps']!r}")
    if clock["reversed_codes"] and clock["laser_period_ps"] is None:
        raise ValueError(
            "reversed_codes=True needs laser_period_ps: reversed codes count back from the "
            "next laser pulse"
        )
    code = clock["no_photon_code"]
    if code is not None and not 0 <= whole_number("no_photon_code", code) < n_codes:
        raise ValueError(f"no_photon_code = {code} is not one of the {n_codes} codes")


def _is_finite(value: Any) -> bool:
    """Whether a value is one real number that is neither NaN nor infinite."""
    is_number = isinstance(value, numbers.Real) or (np.ndim(value) == 0 and hasattr(value, "dtype"))
    try:
        return is_number and math.isfinite(value)
    except (TypeError, ValueError, OverflowError):
        return False


def whole_number(name: str, value: Any) -> int:
    """A whole number as int: what is used as an index may not be 1.0.

    Parameters
    ----------
    name : str
        What it is, for the message.
    value : object
        An int, of Python or NumPy.

    Returns
    -------
    int
        The same.

    Raises
    ------
    ValueError
        For anything else.
    """
    try:
        if isinstance(value, bool | np.bool_):
            raise TypeError
        return operator.index(value)
    except TypeError:
        raise ValueError(f"{name} must be a whole number, got {value!r}") from None


def pixels_of_shape(shape: Any) -> tuple[int, int]:
    """(rows, cols) as ints; ValueError for what is no shape of a camera."""
    try:
        rows, cols = shape
    except (TypeError, ValueError):
        raise ValueError(f"shape must be (rows, cols), got {shape!r}") from None
    rows, cols = whole_number("rows in shape", rows), whole_number("cols in shape", cols)
    if rows < 1 or cols < 1:
        raise ValueError(f"shape must be (rows, cols) of at least one pixel, got {shape}")
    return rows, cols


def mask_of_pixels(name: str, mask: Any, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """A mask (rows, cols) as booleans; ValueError for what is no yes or no of each pixel."""
    refuse_masks(name, mask)
    try:
        told = np.asarray(mask)
    except ValueError:
        raise ValueError(f"{name} must be an array of booleans, got {mask!r:.60}") from None
    if told.shape != tuple(shape):
        raise ValueError(f"{name} must have the camera's shape {tuple(shape)}, got {told.shape}")
    # NaN, a text and -1 would all be True, None and a date False.
    if told.dtype.kind not in "buif" or not ((told == 0) | (told == 1)).all():
        raise ValueError(f"{name} must hold True or False (1 or 0) for each pixel")
    return told.astype(bool)


def refuse_masks(name: str, values: object) -> None:
    """Raise ValueError for arrays with masked elements: nothing here looks at masks."""
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise ValueError(
            f"{name} are masked in places: fill them ({name}.filled(0)) and give "
            "reconstruct(exclude_mask=) the pixels to leave out"
        )
