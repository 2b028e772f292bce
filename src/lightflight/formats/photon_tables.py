"""Tables for other programs: `.csv` and `.parquet`, written only.

Histograms become (row, col, code, counts) of every cell that holds any; recordings become
(frame, row, col, code) of every photon, without `frame` where it is unknown. A Parquet file keeps
the metadata under the key "lightflight"; a CSV file cannot, so its header line is all it says.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightflight.files import tables
from lightflight.files.store import json_text
from lightflight.files.whole_file import atomic_path
from lightflight.formats.metadata import text_from_histograms
from lightflight.formats.photons import photon_blocks
from lightflight.formats.registry import Format
from lightflight.recording.clock_fields import clock_fields_of
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

Table = dict[str, NDArray[np.generic]]

_ROWS_AT_ONCE = 1 << 16


def write_counts_csv(record: Recording | Histograms, path: Path) -> None:
    """Write one line per cell with counts, or per photon.

    Parameters
    ----------
    record : Recording or Histograms
        Streamed: memory does not grow with it.
    path : Path
        The file; it appears whole or not at all.
    """
    with atomic_path(path) as fresh, fresh.open("w", encoding="utf-8", newline="") as file:
        for number, table in enumerate(_tables(record)):
            if number == 0:
                file.write(",".join(table) + "\r\n")
            columns = np.column_stack(list(table.values()))
            if columns.size:
                form = "%d" if columns.dtype.kind in "iu" else "%.9g"
                np.savetxt(file, columns, fmt=form, delimiter=",", newline="\r\n")


def write_counts_parquet(record: Recording | Histograms, path: Path) -> None:
    """Write one row per cell with counts, or per photon; metadata go along."""
    tables.write_parquet(_tables(record), path, about=_metadata(record))


def _metadata(record: Recording | Histograms) -> str:
    """JSON of everything that is not in the table."""
    if isinstance(record, Histograms):
        return text_from_histograms(record)
    known = clock_fields_of(record)
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
    # An empty recording is a table too, with its header.
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
    """No frame numbers yet, where they will come; None where frames are unknown."""
    return np.empty(0, np.uint32) if knows_frames else None


def _table_of_row(hist: Histograms, row: int) -> Table:
    """Cells of one row of pixels that hold any counts."""
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
    pixel: NDArray[np.generic],
    code: NDArray[np.generic],
    *,
    frame: NDArray[np.generic] | None,
) -> Table:
    """One row per photon; `pixel` and `code` (n,)."""
    row, col = np.divmod(pixel.astype(np.uint32), np.uint32(recording.shape[1]))
    known = {} if frame is None else {"frame": frame}
    return {**known, "row": row, "col": col, "code": code.astype(np.uint16)}


FORMATS = (
    Format(
        name="csv",
        summary="text table of counts or photons (written only)",
        suffixes=(".csv",),
        matches=None,
        write=write_counts_csv,
    ),
    Format(
        name="parquet",
        summary="Parquet table of counts or photons (written only; needs pyarrow)",
        suffixes=(".parquet",),
        matches=None,
        write=write_counts_parquet,
    ),
)
