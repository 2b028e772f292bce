"""A camera as a flat dictionary of arrays, as files keep it.

`Camera.to_arrays` and `Camera.from_arrays` are the doors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.camera.refraction import Interface
from lightflight.materials import AIR, Material

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

LENS_ERRORS = (
    "focal_std_fraction", "aspect_std", "axis_std_px", "distortion_std", "decentering_std",
)  # fmt: skip
"""Stated errors of a camera's lens."""
CLOCK_FIELDS = ("clock_offset_ps", "clock_offset_std_ps")
"""What is said of a camera's clock."""
_NEEDED = ("matrix", "distortion", "world_from_camera", "shape")
_ERRORS = ("pose_covariance", "intrinsics_per_pose")


def arrays_of_camera(camera: Camera) -> dict[str, NDArray[np.generic]]:
    """Arrays by name; what is exact, or not there, is left out: files without it mean the same."""
    arrays: dict[str, NDArray[np.generic]] = {
        "matrix": np.array(camera.matrix),
        "distortion": np.array(camera.distortion),
        "world_from_camera": np.array(camera.world_from_camera),
        "shape": np.array(camera.shape, dtype=np.int64),
    }
    for name in _ERRORS:
        if getattr(camera, name) is not None:
            arrays[name] = np.array(getattr(camera, name))
    for name in LENS_ERRORS:
        if getattr(camera, name) > 0.0:
            arrays[name] = np.array(getattr(camera, name))
    for name in CLOCK_FIELDS:
        if getattr(camera, name) != 0.0:
            arrays[name] = np.array(getattr(camera, name))
    if camera.interfaces:
        arrays["interfaces"] = np.array([row_of_interface(face) for face in camera.interfaces])
        arrays["stands_in"] = np.array(_indices(camera.stands_in))
    return arrays


def _indices(material: Material) -> tuple[float, float]:
    return material.phase_index, material.group_index


def row_of_interface(face: Interface) -> list[float]:
    """(10,) point, normal, phase and group index beyond, errors of distance and phase index."""
    errors = face.distance_std_mm, face.phase_index_std
    return [*face.point_mm, *face.normal, *_indices(face.beyond), *errors]  # type: ignore[misc]


def interface_of_row(row: NDArray[np.float64]) -> Interface:
    """The interface of what `row_of_interface` gave, (10,)."""
    beyond = Material(row[6], row[7])
    return Interface(row[:3], row[3:6], beyond, distance_std_mm=row[8], phase_index_std=row[9])


def fields_of_arrays(arrays: Mapping[str, ArrayLike]) -> dict[str, object]:
    """Fields of `Camera` from what `arrays_of_camera` gave; ValueError naming a missing array."""
    missing = [name for name in _NEEDED if name not in arrays]
    if missing:
        raise ValueError(f"a stored camera lacks {', '.join(missing)}")
    rows, cols = (int(n) for n in np.asarray(arrays["shape"]).ravel())
    found: dict[str, object] = {"shape": (rows, cols)}
    for name in (*_NEEDED[:3], *_ERRORS):
        if name in arrays:
            found[name] = np.asarray(arrays[name], dtype=np.float64)
    single = (*LENS_ERRORS, *CLOCK_FIELDS)
    found |= {name: float(np.asarray(arrays[name])) for name in single if name in arrays}
    if "interfaces" in arrays:
        table = np.asarray(arrays["interfaces"], dtype=np.float64).reshape(-1, 10)
        found["interfaces"] = tuple(interface_of_row(row) for row in table)
        front = np.asarray(arrays.get("stands_in", _indices(AIR)), dtype=np.float64)
        found["stands_in"] = Material(*front.ravel())
    return found
