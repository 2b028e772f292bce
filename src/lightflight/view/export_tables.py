"""A path as tables: CSV, Parquet, MATLAB.

Takes a LightPath, gives a file that appears whole or not at all. Columns carry their unit in the
name, as everywhere.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.parquet import pyarrow_modules
from lightflight.store import atomic_path

TABLES = ("samples", "pulses", "vertices")
"""What of a path can be a table: points along it, the pulses it was fitted to, its corners."""

SAMPLES = 1000
"""Points along a path in a table, unless asked otherwise."""


def table_from_path(
    light_path: Any, what: str = "samples", *, samples: int = SAMPLES
) -> NDArray[Any]:
    """One of `TABLES` as a structured array.

    Raises
    ------
    ValueError
        For another table, or fewer than two samples.
    """
    if what == "samples":
        return np.asarray(light_path.sample(samples))
    if what == "pulses":
        return np.asarray(light_path.residuals)
    if what == "vertices":
        return _vertex_table(light_path)
    raise ValueError(f"there is no table {what!r}: choose one of {', '.join(TABLES)}")


def _vertex_table(light_path: Any) -> NDArray[Any]:
    names = ("x_mm", "y_mm", "z_mm", "event_time_ps")
    errors = ("x_std_mm", "y_std_mm", "z_std_mm", "event_time_std_ps")
    n = len(light_path.vertex_times_ps)
    table = np.zeros(n, dtype=[("vertex", np.int32), *((name, float) for name in names + errors)])
    table["vertex"] = np.arange(n)
    values = np.column_stack((light_path.vertices_mm, light_path.vertex_times_ps))
    for k in range(4):
        table[names[k]] = values[:, k]
        table[errors[k]] = light_path.vertex_std[:, k]
    return table


def write_csv(
    light_path: Any, path: str | os.PathLike[str], *, what: str = "samples", samples: int = SAMPLES
) -> None:
    """Write a table of a path as CSV: one header line, units in the names, UTF-8.

    Parameters
    ----------
    light_path : LightPath.
    what : "samples" (equal event times, with both clocks and errors), "pulses" or "vertices".
    samples : points along the path, at least 2.

    Raises
    ------
    ValueError
        For a wrong table, suffix or number of samples.
    """
    target = _checked(path, ".csv")
    table = table_from_path(light_path, what, samples=samples)
    with atomic_path(target) as fresh, fresh.open("w", newline="", encoding="utf-8") as stream:
        stream.write(",".join(table.dtype.names or ()) + "\r\n")
        for row in table.tolist():
            stream.write(",".join(_cell(value) for value in row) + "\r\n")


def _cell(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(int(value))


def write_parquet(
    light_path: Any, path: str | os.PathLike[str], *, what: str = "samples", samples: int = SAMPLES
) -> None:
    """Write a table of a path as Parquet; parameters as in `write_csv`.

    The file's metadata holds method, prior and provenance under the key "lightflight".

    Raises
    ------
    MissingExtraError
        Without pyarrow.
    """
    pa, pq = pyarrow_modules()
    target = _checked(path, ".parquet")
    table = table_from_path(light_path, what, samples=samples)
    columns = {
        name: pa.array(np.ascontiguousarray(table[name])) for name in table.dtype.names or ()
    }
    about = {"what": what, **description_of(light_path)}
    made = pa.table(columns).replace_schema_metadata({"lightflight": json.dumps(about)})
    with atomic_path(target) as fresh:
        pq.write_table(made, fresh)


def write_mat(light_path: Any, path: str | os.PathLike[str], *, samples: int = SAMPLES) -> None:
    """Write a path with its tables as a MATLAB file (version 5), one struct `lightflight`.

    Fields: vertices_mm, vertex_times_ps, covariance, samples, pulses, truth (if known), camera,
    and the words method, prior, statements. MATLAB counts from 1; rows, columns and legs in the
    tables count from 0, as in the file format.
    """
    from scipy.io import savemat

    target = _checked(path, ".mat")
    fields: dict[str, Any] = {
        "vertices_mm": np.asarray(light_path.vertices_mm, dtype=float),
        "vertex_times_ps": np.asarray(light_path.vertex_times_ps, dtype=float),
        "covariance": np.asarray(light_path.covariance, dtype=float),
        "samples": _struct(table_from_path(light_path, "samples", samples=samples)),
        "pulses": _struct(table_from_path(light_path, "pulses")),
        "camera": {name: np.asarray(a) for name, a in light_path.camera.to_arrays().items()},
        "method": light_path.method,
        "prior": light_path.prior,
        "statements": np.array(list(light_path.statements), dtype=object),
    }
    if light_path.truth is not None:
        fields["truth"] = {
            "vertices_mm": np.asarray(light_path.truth.vertices_mm, dtype=float),
            "vertex_times_ps": np.asarray(light_path.truth.vertex_times_ps, dtype=float),
        }
    with atomic_path(target) as fresh:
        savemat(str(fresh), {"lightflight": fields}, oned_as="column", long_field_names=True)


def _struct(table: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Columns of a table; MATLAB knows no Boolean columns in files of this version."""
    return {
        name: table[name].astype(np.uint8) if table[name].dtype == bool else table[name]
        for name in table.dtype.names or ()
    }


def description_of(light_path: Any) -> dict[str, Any]:
    """Method, prior, statements and provenance, as JSON can hold them."""
    from lightflight.view.page.packing import plain

    described: dict[str, Any] = plain(
        {
            "method": getattr(light_path, "method", ""),
            "prior": getattr(light_path, "prior", ""),
            "statements": list(getattr(light_path, "statements", ())),
            "provenance": dict(getattr(light_path, "provenance", None) or {}),
        }
    )
    return described


def _checked(path: str | os.PathLike[str], suffix: str) -> Path:
    target = Path(path)
    if target.suffix.lower() != suffix:
        raise ValueError(f"cannot write to {target.name}: its name must end in {suffix}")
    return target
