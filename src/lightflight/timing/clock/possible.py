"""Whether the fields of a calibration can be those of a clock, whoever made them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.arguments import array_of_numbers, pixels_of_shape

_NUMBERS = (
    "first_edge_ps", "bin_width_ps", "laser_period_ps", "scale_std", "assumed_skew_std_ps",
    "code_length_std", "code_width_std", "response_place_ps",
)  # fmt: skip
_CODES = ("n_codes", "first_live_code", "no_photon_code")
_YES_OR_NO = ("reversed_codes", "period_end_seen")
_OR_NONE = ("laser_period_ps", "no_photon_code", "response_place_ps")
_POSITIVE = ("bin_width_ps", "laser_period_ps", "n_codes")
_NOT_NEGATIVE = (
    "scale_std", "assumed_skew_std_ps", "code_length_std", "code_width_std", "gain", "phases",
    "code_widths", "gain_std", "phase_std", "misfit_std", "skew_std_ps", "response_std_ps",
)  # fmt: skip
_WHOLE = ("code_widths", "end_widths", "flat_modes_ps", "response_curve")
"""Arrays without a pixel that is not known: NaN has no place in them."""
_FARTHEST = 1e16
"""ps, codes, or times a nominal one: what is more has no picoseconds left."""


def check_plain_values(values: Mapping[str, Any]) -> None:
    """Check the numbers, codes and answers of a calibration; absent ones are passed over.

    Parameters
    ----------
    values : mapping
        Fields of a `TimingCalibration` by name.

    Raises
    ------
    ValueError
        Where one is of another kind, or out of range.
    """
    for name in (*_NUMBERS, *_CODES, *_YES_OR_NO):
        if name not in values or (name in _OR_NONE and values[name] is None):
            continue
        value = values[name]
        if name in _YES_OR_NO:
            fits = isinstance(value, bool | np.bool_)
        elif name in _CODES:
            fits = isinstance(value, Integral) and _is_number(value)
            fits = fits and 0 <= value <= values["n_codes"]
        else:
            fits = _is_number(value) and not (name in _NOT_NEGATIVE and value < 0)
        if not fits or (name in _POSITIVE and value <= 0):
            raise ValueError(f"{name} cannot be {value!r:.60}")


def check_texts(values: Mapping[str, Any]) -> None:
    """Raise ValueError where the shape, the names, the notes or the provenance are of other kinds.

    Parameters
    ----------
    values : mapping
        Fields of a `TimingCalibration` by name.
    """
    pixels_of_shape(values["shape"])
    for name in ("notes", "flat_mode_names"):
        told = values[name]
        if not isinstance(told, tuple | list) or not all(isinstance(one, str) for one in told):
            raise ValueError(f"{name} cannot be {told!r:.60}: a tuple of texts")
    if not isinstance(values["provenance"], Mapping):
        raise ValueError(f"provenance cannot be {values['provenance']!r:.60}: a mapping")


def possible_array(name: str, values: Any) -> NDArray[np.float64]:
    """A field of a calibration as an array, after checking that a clock may have such values.

    Parameters
    ----------
    name : str
        Of the field.
    values : array_like
        What it is to hold.

    Returns
    -------
    array of float
        A copy.

    Raises
    ------
    ValueError
        For what is no number, masked, infinite, or below zero where nothing is.
    """
    array = array_of_numbers(name, values).astype(np.float64)
    # An error may be infinite: not known at all.
    unbounded = name in _NOT_NEGATIVE and name.removesuffix("_ps").endswith("_std")
    far = np.abs(array) > _FARTHEST
    if unbounded:
        far &= array != np.inf
    if far.any():
        raise ValueError(f"{name} must be below {_FARTHEST:g}, got {array[far][0]}")
    if name in _NOT_NEGATIVE and (array < 0).any():
        raise ValueError(f"{name} must not be below zero, got {array.min()}")
    if name in _WHOLE and np.isnan(array).any():
        raise ValueError(f"{name} must not hold NaN")
    return array


def possible_flags(values: Any) -> NDArray[np.uint32]:
    """Flags of pixels as an array, after checking that they are whole numbers of 32 bits."""
    array = array_of_numbers("flags", values)
    if array.dtype.kind not in "bui" or (
        array.size and not 0 <= array.min() <= array.max() < 2**32
    ):
        raise ValueError("flags must be whole numbers of 32 bits, as lightflight.flags names them")
    return array.astype(np.uint32)


def _is_number(value: object) -> bool:
    plain = isinstance(value, Real) and not isinstance(value, bool)
    return plain and math.isfinite(value) and abs(value) <= _FARTHEST  # type: ignore[arg-type]
