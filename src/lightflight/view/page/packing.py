"""Values as JSON can hold them: packed arrays, plain metadata, a camera."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from lightflight.view.types import Json

if TYPE_CHECKING:
    from lightflight import Camera, LightPath


def packed(array: ArrayLike, kind: str) -> Json:
    """An array as base64 of little-endian numbers: kind "f4", "f8", "u1", "u2", "u4" or "i4".

    Examples
    --------
    >>> packed([1, 2], "u1")
    {'kind': 'u1', 'shape': [2], 'base64': 'AQI='}
    """
    values = np.ascontiguousarray(np.asarray(array), dtype=f"<{kind}")
    return {
        "kind": kind,
        "shape": list(values.shape),
        "base64": base64.b64encode(values.tobytes()).decode("ascii"),
    }


def plain(value: object) -> Any:
    """Any metadata as JSON can hold it: arrays as lists, NaN and inf as null, the rest as text.

    Examples
    --------
    >>> plain({"angle_deg": float("nan"), "legs": (1, 2)})
    {'angle_deg': None, 'legs': [1, 2]}
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    # Before the plain types: a NumPy number is none of them to `json`.
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


def camera_part(camera: Camera | None, path: LightPath) -> Json | None:
    """A camera as the page draws it: place, axis, the field of view where the path is."""
    if camera is None:
        return None
    from lightflight.view.solids import field_of_view

    vertices = np.asarray(path.vertices_mm, dtype=float).reshape(-1, 3)
    finite = vertices[np.isfinite(vertices).all(axis=1)]
    middle = finite.mean(axis=0) if len(finite) else camera.center_mm - camera.backward_axis
    return {
        "shape": list(camera.shape),
        "center_mm": plain(np.asarray(camera.center_mm)),
        "backward_axis": plain(np.asarray(camera.backward_axis)),
        "field_mm": plain(field_of_view(camera, middle)),
    }
