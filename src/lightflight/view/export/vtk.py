"""A path for ParaView: VTK's XML unstructured grid (.vtu), written by hand.

Takes a LightPath, gives line cells with both times, errors, speed and leg as data. Coordinates
are world mm.
"""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from lightflight._version import __version__
from lightflight.files.whole_file import write_text
from lightflight.path.tables import Polyline
from lightflight.path.trace import trace_from_path
from lightflight.view.export.tables import checked_suffix
from lightflight.view.types import FilePath, Floats, Whole

if TYPE_CHECKING:
    from lightflight import LightPath

_VTK_LINE = 3
_TYPES = {"f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}


def write_vtu(light_path: LightPath, path: FilePath, *, per_leg: int = 65) -> None:
    """Write a path as line cells for ParaView.

    Point data: event_time_ps, arrival_time_ps, length_mm, std_mm (longest semi-axis of the error
    ellipse across the leg), event_time_std_ps, apparent_speed_c, in_view. Cell data: leg, and
    the estimate a cell belongs to (0: the path, 1: the truth, where it is known).

    Parameters
    ----------
    light_path : LightPath
        The path.
    path : path
        Where to write.
    per_leg : int, optional
        Points on each leg.

    Raises
    ------
    ValueError
        For a name that does not end in .vtu, or a path without legs.
    """
    target, _ = checked_suffix(path, (".vtu",), "VTK ")
    points, point_data, cells, cell_data = _grid(light_path, per_leg)
    text = _document(points, point_data, cells, cell_data, _words(light_path))
    write_text(target, text)


def _grid(
    light_path: LightPath, per_leg: int
) -> tuple[Floats, dict[str, NDArray[np.generic]], Whole, dict[str, NDArray[Any]]]:
    """Points, point data, cells (n, 2) and cell data of path and truth together."""
    parts = [_lines_of(light_path, light_path, per_leg)]
    truth = getattr(light_path, "truth", None)
    if truth is not None:
        # A truth carries no camera: times of arrival are by the path's own.
        parts.append(_lines_of(truth, light_path, 2))
    first = 0
    cells, legs, estimate = [], [], []
    for k, (points, _, leg) in enumerate(parts):
        # Ends of legs are there twice: no cell may join the end of one with the start of the next.
        joined = np.flatnonzero(leg[1:] == leg[:-1])
        cells.append(first + np.column_stack((joined, joined + 1)))
        legs.append(leg[joined])
        estimate.append(np.full(len(joined), k))
        first += len(points)
    data = {name: np.concatenate([part[1][name] for part in parts]) for name in parts[0][1]}
    cell_data = {
        "leg": np.concatenate(legs).astype(np.int32),
        "estimate": np.concatenate(estimate).astype(np.int32),
    }
    points = np.concatenate([part[0] for part in parts])
    return points, data, np.concatenate(cells).astype(np.int64), cell_data


def _lines_of(
    path: Polyline, owner: LightPath, per_leg: int
) -> tuple[Floats, dict[str, NDArray[np.generic]], Whole]:
    from lightflight.path.apparent_speed import apparent_speed_along

    camera, medium = getattr(owner, "camera", None), getattr(owner, "medium", None)
    trace = trace_from_path(path, camera=camera, medium=medium, per_leg=per_leg)
    if len(trace.leg) == 0:
        raise ValueError("the path has no legs: there is nothing to export")
    data: dict[str, NDArray[np.generic]] = {
        "event_time_ps": trace.event_time_ps,
        "arrival_time_ps": trace.arrival_ps,
        "length_mm": trace.length_mm,
        "std_mm": trace.std_mm,
        "event_time_std_ps": trace.event_time_std_ps,
        "apparent_speed_c": apparent_speed_along(trace, camera=camera, medium=medium),
        "in_view": trace.in_view.astype(np.uint8),
    }
    return trace.points_mm, data, trace.leg


def _words(light_path: LightPath) -> str:
    parts = [f"lightflight {__version__}, units mm and ps"]
    for name in ("method", "prior"):
        text = str(getattr(light_path, name, "") or "")
        if text:
            parts.append(f"{name}: {text}")
    return "; ".join(parts)


def _array(name: str, values: NDArray[np.generic], *, components: int = 1) -> str:
    """A DataArray element: inline base64, a UInt32 byte count before the numbers."""
    kind = values.dtype.kind + str(values.dtype.itemsize)
    raw = np.ascontiguousarray(values).astype(f"<{kind}").tobytes()
    head = np.array([len(raw)], dtype="<u4").tobytes()
    several = f' NumberOfComponents="{components}"' if components > 1 else ""
    return (
        f"<DataArray type={quoteattr(_TYPES[kind])} Name={quoteattr(name)}{several} "
        f'format="binary">{base64.b64encode(head + raw).decode("ascii")}</DataArray>'
    )


def _document(
    points: Floats,
    point_data: dict[str, NDArray[np.generic]],
    cells: Whole,
    cell_data: dict[str, NDArray[np.generic]],
    words: str,
) -> str:
    # A comment may not hold two dashes in a row.
    comment = escape(words).replace("--", "- -")
    offsets = np.arange(1, len(cells) + 1, dtype=np.int64) * 2
    types = np.full(len(cells), _VTK_LINE, dtype=np.uint8)
    return "\n".join(
        (
            '<?xml version="1.0" encoding="utf-8"?>',
            f"<!-- {comment} -->",
            '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">',
            "<UnstructuredGrid>",
            f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(cells)}">',
            "<Points>" + _array("Points", points, components=3) + "</Points>",
            "<Cells>",
            _array("connectivity", cells.ravel()),
            _array("offsets", offsets),
            _array("types", types),
            "</Cells>",
            '<PointData Scalars="event_time_ps">',
            *(_array(name, values) for name, values in point_data.items()),
            "</PointData>",
            '<CellData Scalars="leg">',
            *(_array(name, values) for name, values in cell_data.items()),
            "</CellData>",
            "</Piece>",
            "</UnstructuredGrid>",
            "</VTKFile>",
            "",
        )
    )
