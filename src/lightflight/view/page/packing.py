"""What JSON can hold: packed arrays, a camera."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from lightflight.files.json_values import json_value
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
        "center_mm": json_value(np.asarray(camera.center_mm)),
        "backward_axis": json_value(np.asarray(camera.backward_axis)),
        "field_mm": json_value(field_of_view(camera, middle)),
    }
