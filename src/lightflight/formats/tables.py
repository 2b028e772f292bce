"""Tables for other programs: `.csv` and `.parquet`, written only.

Histograms become (row, col, code, counts) of every cell that holds any; recordings become
(frame, row, col, code) of every photon, without `frame` where it is unknown. A Parquet file keeps
the metadata under the key "lightflight"; a CSV file cannot, so its header line is all it says.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.formats.metadata import text_from_histograms
from lightflight.formats.photons import photon_blocks
from lightflight.formats.registry import Format
from lightflight.histogram import Histograms
from lightflight.parquet import pyarrow_modules
from lightflight.recording import CLOCK_FIELDS, Recording

Table = dict[str, NDArray[Any]]

_ROWS_AT_ONCE = 1 << 16


def write_csv(record: Recording | Histograms, path: Path) -> None:
    """Write one line per cell with counts, or per photon."""
    from lightflight.store import atomic_path

    with atomic_path(path) as fresh, fresh.open("w", encoding="utf-8", newline="") as file:
        for number, table in enumerate(_tables(record)):
            if number == 0:
                file.write(",".join(table) + "\r\n")
            columns = np.column_stack(list(table.values()))
            if columns.size:
                form = "%d" if columns.dtype.kind in "iu" else "%.9g"
                np.savetxt(file, columns, fmt=form, delimiter=",", newline="\r\n")


def write_parquet(record: Recording | Histograms, path: Path) -> None:
    """Write one row per cell with counts, or per photon; metadata go along."""
    pa, pq = pyarrow_modules()
    from lightflight.store import atomic_path

    with contextlib.ExitStack() as stack:
        fresh = stack.enter_context(atomic_path(path))
        put: Callable[[Any], None] | None = None
        for table in _tables(record):
            made = pa.table({name: pa.array(column) for name, column in table.items()})
            if put is None:
                schema = made.schema.with_metadata({"lightflight": _metadata(record)})
                put = stack.enter_context(pq.ParquetWriter(fresh, schema)).write_table
            put(made.replace_schema_metadata({"lightflight": _metadata(record)}))


def _metadata(record: Recording | Histograms) -> str:
    from lightflight.store import json_text

    if isinstance(record, Histograms):
        return text_from_histograms(record)
    known = {name: getattr(record, name) for name in CLOCK_FIELDS}
    shape = {"shape": list(record.shape), "n_codes": record.n_codes}
    return json_text({**known, **shape, "settings": dict(record.settings)})


def _tables(record: Recording | Histograms) -> Iterator[Table]:
    """Parts of the table, one after another, the first one even where it is empty."""
    if isinstance(record, Histograms):
        for row in range(record.shape[0]):
            yield _table_of_row(record, row)
        return
    frame_type = np.uint32 if (record.n_frames or 0) < 1 << 32 else np.uint64
    knows_frames = record.kind == "frames" or record.frame_starts is not None
    first = 0
    yield _table_of_photons(record, *(np.empty(0, np.uint16),) * 2, frame=_none(knows_frames))
    for block in photon_blocks(record):
        frame = None
        if block.photons_per_frame is not None:
            numbers = first + np.arange(block.photons_per_frame.size)
            frame = np.repeat(numbers, block.photons_per_frame).astype(frame_type)
            first += block.photons_per_frame.size
        for start in range(0, block.code.size, _ROWS_AT_ONCE):
            part = slice(start, start + _ROWS_AT_ONCE)
            some = None if frame is None else frame[part]
            yield _table_of_photons(record, block.pixel[part], block.code[part], frame=some)


def _none(knows_frames: bool) -> NDArray[np.uint32] | None:
    return np.empty(0, np.uint32) if knows_frames else None


def _table_of_row(hist: Histograms, row: int) -> Table:
    counts = hist.counts[row]
    col, code = np.nonzero(counts * hist.photon_codes)
    return {
        "row": np.full(col.size, row, np.uint32),
        "col": col.astype(np.uint32),
        "code": code.astype(np.uint32),
        "counts": counts[col, code],
    }


def _table_of_photons(
    recording: Recording,
    pixel: NDArray[Any],
    code: NDArray[Any],
    *,
    frame: NDArray[Any] | None,
) -> Table:
    row, col = np.divmod(pixel.astype(np.uint32), np.uint32(recording.shape[1]))
    known = {} if frame is None else {"frame": frame}
    return {**known, "row": row, "col": col, "code": code.astype(np.uint16)}


def _matches(path: Path, start: bytes) -> bool:
    return False


FORMATS = (
    Format(
        name="csv",
        summary="text table of counts or photons (written only)",
        suffixes=(".csv",),
        matches=_matches,
        write=write_csv,
    ),
    Format(
        name="parquet",
        summary="Parquet table of counts or photons (written only; needs pyarrow)",
        suffixes=(".parquet",),
        matches=_matches,
        write=write_parquet,
    ),
)
