"""What the plain values of a calibration must be, for a file that says otherwise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

_NUMBERS = (
    "first_edge_ps", "bin_width_ps", "laser_period_ps", "scale_std", "assumed_skew_std_ps",
    "code_length_std", "response_place_ps",
)  # fmt: skip
_CODES = ("n_codes", "first_live_code", "no_photon_code")
_YES_OR_NO = ("reversed_codes", "period_end_seen")
_OR_NONE = ("laser_period_ps", "no_photon_code", "response_place_ps")
_POSITIVE = ("bin_width_ps", "laser_period_ps", "n_codes")


def check_plain_values(values: Mapping[str, Any]) -> None:
    """Check the numbers, codes and answers of a calibration; absent ones are passed over.

    Parameters
    ----------
    values : mapping
        Fields of a `TimingCalibration` by name, as read from a file.

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
            fits = isinstance(value, bool)
        elif name in _CODES:
            fits = _is_number(value) and isinstance(value, int) and 0 <= value <= values["n_codes"]
        else:
            fits = _is_number(value)
        if not fits or (name in _POSITIVE and value <= 0):
            raise ValueError(f"{name} cannot be {value!r:.60}: the file is damaged")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
