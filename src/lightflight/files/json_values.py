"""Values as JSON can hold them, without importing NumPy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def without_numpy(value: object) -> object:
    """Python numbers and lists for NumPy's."""
    return value.tolist() if hasattr(value, "tolist") else value


def json_value(value: object) -> Any:
    """Strict JSON of nested mappings, sequences and NumPy values.

    Parameters
    ----------
    value : object
        What is to be written.

    Returns
    -------
    object
        The same in dict, list, str, int, float, bool and None; NaN and inf, for which JSON has no
        word, become None, and what is none of these its text.

    Examples
    --------
    >>> json_value({"angle_deg": float("nan"), "legs": (1, 2)})
    {'angle_deg': None, 'legs': [1, 2]}
    """
    # Before the plain types: a NumPy number is none of them to `json`.
    value = without_numpy(value)
    if isinstance(value, Mapping):
        return {str(key): json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [json_value(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
