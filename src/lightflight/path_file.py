"""A LightPath as a file: our versioned HDF5. (As a table for other programs: view.export.)"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from lightflight.camera import Camera
from lightflight.errors import FileFormatError
from lightflight.filecheck import damage_as_format_error
from lightflight.flight import Medium, Source
from lightflight.path import RESIDUAL_DTYPE, Goodness, LightPath
from lightflight.provenance import provenance_record
from lightflight.store import load_record, save_record

KIND = "path"
"""Kind of record in our HDF5 files."""


def save_path(path: LightPath, file: str | os.PathLike[str]) -> None:
    """Write a path with everything that belongs to it, whole or not at all."""
    arrays: dict[str, Any] = {
        "vertices_mm": path.vertices_mm,
        "vertex_times_ps": path.vertex_times_ps,
        "covariance": path.covariance,
    }
    arrays |= {f"covariance_{name}": part for name, part in path.covariance_parts.items()}
    arrays |= {f"camera_{name}": array for name, array in path.camera.to_arrays().items()}
    arrays |= {f"residuals_{name}": path.residuals[name] for name in RESIDUAL_DTYPE.names or ()}
    if path.truth is not None:
        arrays["truth_vertices_mm"] = np.asarray(path.truth.vertices_mm, dtype=float)
        arrays["truth_vertex_times_ps"] = np.asarray(path.truth.vertex_times_ps, dtype=float)
    attributes = {
        "method": path.method,
        "prior": path.prior,
        "statements": list(path.statements),
        "goodness": asdict(path.goodness),
        "source": asdict(path.source),
        "medium": asdict(path.medium),
        "provenance": dict(path.provenance) or provenance_record(),
    }
    save_record(file, kind=KIND, arrays=arrays, attributes=attributes)


class TruePath:
    """Truth as a path file carries it: where the pulse really was."""

    def __init__(self, vertices_mm: Any, vertex_times_ps: Any) -> None:
        self.vertices_mm = np.asarray(vertices_mm, dtype=float)
        self.vertex_times_ps = np.asarray(vertex_times_ps, dtype=float)


def load_path(file: str | os.PathLike[str], *, try_newer: bool = False) -> LightPath:
    """Read a path written by `save_path`. Raises FileFormatError for any other file.

    `try_newer`: of a file by a newer version, what this one knows; a statement says so.
    """
    try:
        arrays, attributes = load_record(file, kind=KIND)
    except FileFormatError as refused:
        if not try_newer:
            raise
        arrays, attributes = load_record(file, kind=KIND, try_newer=True)
        statements = attributes.get("statements", [])
        reason = str(refused).removeprefix(f"{os.fspath(file)}: ")
        attributes["statements"] = [f"This file {reason}; what is new in it is not shown."]
        attributes["statements"] += statements if isinstance(statements, list) else []
    with damage_as_format_error(file):
        try:
            return _path_from_record(arrays, attributes)
        except KeyError as missing:
            raise FileFormatError(f"lacks {missing}: the file is damaged", path=file) from missing


def _path_from_record(arrays: Mapping[str, Any], attributes: Mapping[str, Any]) -> LightPath:
    table = np.zeros(len(arrays["residuals_row"]), RESIDUAL_DTYPE)
    for name in RESIDUAL_DTYPE.names or ():
        table[name] = arrays[f"residuals_{name}"]
    camera = {k.removeprefix("camera_"): v for k, v in arrays.items() if k.startswith("camera_")}
    parts = {
        k.removeprefix("covariance_"): v for k, v in arrays.items() if k.startswith("covariance_")
    }
    truth = None
    if "truth_vertices_mm" in arrays:
        truth = TruePath(arrays["truth_vertices_mm"], arrays["truth_vertex_times_ps"])
    source = dict(attributes["source"])
    if isinstance(source.get("position_std_mm"), list):
        source["position_std_mm"] = tuple(source["position_std_mm"])
    if not isinstance(attributes["method"], str):
        raise TypeError(f"method is {attributes['method']!r}")
    return LightPath(
        arrays["vertices_mm"],
        arrays["vertex_times_ps"],
        arrays["covariance"],
        camera=Camera.from_arrays(camera),
        source=Source(**source),
        medium=Medium(**attributes["medium"]),
        method=attributes["method"],
        goodness=Goodness(**attributes["goodness"]),
        covariance_parts=parts,
        residuals=table,
        prior=attributes["prior"],
        statements=tuple(attributes["statements"]),
        truth=truth,
        provenance=attributes["provenance"],
    )
