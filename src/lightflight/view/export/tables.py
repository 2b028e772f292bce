"""A path as tables: CSV, Parquet, MATLAB.

Takes a LightPath, gives a file that appears whole or not at all. Columns carry their unit in the
name, as everywhere.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lightflight.files import tables
from lightflight.files.json_values import json_value
from lightflight.files.whole_file import atomic_path
from lightflight.path.tables import Polyline
from lightflight.path.tree import forks_of
from lightflight.view.types import FilePath

if TYPE_CHECKING:
    from lightflight import LightPath

TABLES = ("samples", "pulses", "vertices")
"""What of a path can be a table: points along it, the pulses it was fitted to, its corners."""

SAMPLES = 1000
"""Points along a path in a table, unless asked otherwise."""


def table_from_path(
    light_path: LightPath, what: str = "samples", *, samples: int = SAMPLES
) -> NDArray[Any]:
    """One of `TABLES` as a structured array.

    Parameters
    ----------
    light_path : LightPath
        The path.
    what : str, optional
        One of `TABLES`.
    samples : int, optional
        Points along the path.

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


def _vertex_table(light_path: LightPath) -> NDArray[np.generic]:
    names = ("x_mm", "y_mm", "z_mm", "event_time_ps")
    errors = ("x_std_mm", "y_std_mm", "z_std_mm", "event_time_std_ps")
    n, forked = len(light_path.vertex_times_ps), bool(light_path.forks)
    numbers = ["vertex", *(["from_vertex"] if forked else [])]
    table = np.zeros(
        n,
        dtype=[
            *((name, np.int32) for name in numbers),
            *((name, float) for name in names + errors),
        ],
    )
    table["vertex"] = np.arange(n)
    if forked:
        # Nothing comes before the first.
        table["from_vertex"] = [-1, *(leg.start_vertex for leg in light_path.legs)]
    values = np.column_stack((light_path.vertices_mm, light_path.vertex_times_ps))
    for k in range(4):
        table[names[k]] = values[:, k]
        table[errors[k]] = light_path.vertex_std[:, k]
    return table


def write_csv(
    light_path: LightPath,
    path: FilePath,
    *,
    what: str = "samples",
    samples: int = SAMPLES,
) -> None:
    """Write a table of a path as CSV: one header line, units in the names, UTF-8.

    Parameters
    ----------
    light_path : LightPath
        The path.
    path : path
        Where to write.
    what : str, optional
        "samples" (equal event times, with both clocks and errors), "pulses" or "vertices".
    samples : int, optional
        Points along the path, at least 2.

    Raises
    ------
    ValueError
        For a wrong table, suffix or number of samples.
    """
    target, _ = checked_suffix(path, (".csv",))
    table = table_from_path(light_path, what, samples=samples)
    rows = ([_cell(value) for value in row] for row in table.tolist())
    tables.write_csv(table.dtype.names or (), rows, target)


def _cell(value: float) -> str:
    # Nine digits: a nanometre in a metre, ten femtoseconds in a microsecond.
    return f"{value:.9g}" if isinstance(value, float) else str(int(value))


def write_parquet(
    light_path: LightPath,
    path: FilePath,
    *,
    what: str = "samples",
    samples: int = SAMPLES,
) -> None:
    """Write a table of a path as Parquet; parameters as in `write_csv`.

    The file's metadata holds method, prior and provenance under the key "lightflight".

    Parameters
    ----------
    light_path : LightPath
        The path.
    path : path
        Where to write.
    what : str, optional
        One of `TABLES`.
    samples : int, optional
        Points along the path.

    Raises
    ------
    MissingExtraError
        Without pyarrow.
    """
    target, _ = checked_suffix(path, (".parquet",))
    table = table_from_path(light_path, what, samples=samples)
    columns = {name: np.ascontiguousarray(table[name]) for name in table.dtype.names or ()}
    about = {"what": what, **description_of(light_path)}
    tables.write_parquet([columns], target, about=json.dumps(about))


def write_mat(light_path: LightPath, path: FilePath, *, samples: int = SAMPLES) -> None:
    """Write a path with its tables as a MATLAB file (version 5), one struct `lightflight`.

    Fields: vertices_mm, vertex_times_ps, covariance, samples, pulses, truth (if known), camera,
    forks (where the path has any: leg, and the vertex at which it begins), and the words method,
    prior, statements. MATLAB counts from 1; rows, columns and legs in the tables count from 0, as
    in the file format.

    Parameters
    ----------
    light_path : LightPath
        The path.
    path : path
        Where to write.
    samples : int, optional
        Points along the path.
    """
    from scipy.io import savemat

    target, _ = checked_suffix(path, (".mat",))
    fields: dict[str, object] = {
        "vertices_mm": np.asarray(light_path.vertices_mm, dtype=float),
        "vertex_times_ps": np.asarray(light_path.vertex_times_ps, dtype=float),
        "covariance": np.asarray(light_path.covariance, dtype=float),
        **_forks_of(light_path),
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
            **_forks_of(light_path.truth),
        }
    with atomic_path(target) as fresh:
        savemat(str(fresh), {"lightflight": fields}, oned_as="column", long_field_names=True)


def _forks_of(path: Polyline) -> dict[str, object]:
    """Field `forks` (k, 2), leg and vertex at which it begins, counted from 0; none of a chain."""
    forks = forks_of(path)
    return {"forks": np.array(forks)} if forks else {}


def _struct(table: NDArray[Any]) -> dict[str, NDArray[np.generic]]:
    """Columns of a table; MATLAB knows no Boolean columns in files of this version."""
    return {
        name: table[name].astype(np.uint8) if table[name].dtype == bool else table[name]
        for name in table.dtype.names or ()
    }


def description_of(light_path: LightPath) -> dict[str, object]:
    """Method, prior, statements and provenance, as JSON can hold them."""
    described: dict[str, object] = json_value(
        {
            "method": getattr(light_path, "method", ""),
            "prior": getattr(light_path, "prior", ""),
            "statements": list(getattr(light_path, "statements", ())),
            "provenance": dict(getattr(light_path, "provenance", None) or {}),
        }
    )
    return described


def checked_suffix(path: FilePath, allowed: tuple[str, ...], what: str = "") -> tuple[Path, str]:
    """A file to write and its suffix, in lower case.

    Raises
    ------
    ValueError
        Where the suffix is none of `allowed`.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in allowed:
        raise ValueError(
            f"cannot write {what}to {target.name}: its name must end in {', '.join(allowed)}"
        )
    return target, suffix
