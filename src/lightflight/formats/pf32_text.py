"""Histograms printed by the PF32 vendor's sample program (also gzipped).

A line `Pixel <n>` and a line of counts for each pixel, n = 32 row + col; then, where the output
was kept whole, the sync frequency in Hz and `frames = <n>`.
"""

from __future__ import annotations

import gzip
import logging
import math
import re
import time
from collections.abc import Iterator, Mapping
from io import BufferedIOBase
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import FileFormatError
from lightflight.files.filecheck import check_memory, is_trusted
from lightflight.formats.clock import pf32_clock
from lightflight.formats.cubes import checked_shape, record_from_array
from lightflight.formats.registry import Format
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

_PIXEL_LINE = re.compile(rb"^Pixel (\d+)\s*$", re.MULTILINE)
_COUNTS_LINE = re.compile(rb"\s*\d{1,18}(?:\s+\d{1,18})*\s*")
_LONGEST_LINE = 1 << 20
_MOST_EMPTY_LINES = 10_000
_MOST_BYTES = 2_000_000_000
"""A 32 x 32 camera prints some megabytes, a megapixel one two gigabytes."""
_TELL_EVERY_S = 5.0
_log = logging.getLogger(__name__)
_GZIP_MAGIC = b"\x1f\x8b"


def read(
    path: Path, clock: Mapping[str, object], *, shape: tuple[int, int] = (32, 32)
) -> Recording | Histograms:
    """Read printed histograms, plain or gzipped.

    Parameters
    ----------
    path : Path
        What the vendor's sample program printed.
    clock : mapping of str
        Hints about the clock; a PF32 is assumed beyond them (`clock.pf32_clock`).
    shape : (int, int)
        (rows, cols), where the camera is no 32 x 32 one.

    Returns
    -------
    Recording or Histograms
        Histograms; n_frames where every pixel adds up to the same number.

    Raises
    ------
    FileFormatError
        Where a pixel is missing, out of turn, or has other codes than the one before.
    """
    rows, cols = checked_shape(shape)
    with _opened(path) as file:
        counts, tail = _counts_and_tail(file, path, rows * cols)
    totals = counts.sum(axis=1, dtype=np.uint64)
    told: dict[str, object] = {}
    settings: dict[str, object] = {"camera": "PF32"}
    sync = [int(line) for line in tail if line.isdigit() and int(line) > 0]
    if sync:
        settings["sync_hz"] = sync[-1]
    notes = []
    # The vendor counts frames without a photon in code 0: all pixels then have one sum.
    if (totals == totals[0]).all() and counts[:, 0].any():
        told["n_frames"] = int(totals[0])
        notes.append(f"n_frames = {totals[0]}: what every pixel adds up to, empty frames included")
    fields, pf32_notes = pf32_clock(
        told | dict(clock), laser_period_ps=1e12 / sync[-1] if sync else None
    )
    settings["notes"] = pf32_notes + notes
    counts.setflags(write=False)
    cube = counts.reshape(rows, cols, -1)
    return record_from_array(cube, "yxt", fields, path=path, settings=settings)


def _opened(path: Path) -> BufferedIOBase:
    """The file, unpacked where it is gzipped."""
    with path.open("rb") as file:
        zipped = file.read(2) == _GZIP_MAGIC
    return gzip.open(path, "rb") if zipped else path.open("rb")


def _counts_and_tail(
    file: BufferedIOBase, path: Path, n_pixels: int
) -> tuple[NDArray[np.generic], list[str]]:
    """Counts (pixels, codes) in the order of the pixel numbers, and the lines after them."""
    counts: NDArray[np.unsignedinteger] | None = None
    seen = 0
    tail: list[str] = []
    lines = _lines(file, path)
    told = time.monotonic()
    for line in lines:
        if time.monotonic() > told + _TELL_EVERY_S:
            _log.info("%s: pixel %d of %d", path.name, seen, n_pixels)
            told = time.monotonic()
        pixel = _PIXEL_LINE.match(line)
        if pixel is None:
            # Sync frequency and number of frames are among the last lines.
            tail = [*tail[-8:], line.decode("ascii", "replace").strip()]
            continue
        if int(pixel[1]) != seen:
            raise FileFormatError(
                f"pixel {int(pixel[1])} follows on pixel {seen - 1}: the file is damaged", path=path
            )
        row = _counts_of_line(next(lines, b""), path, seen)
        if counts is None:
            what = f"{n_pixels} pixels of {row.size} codes"
            check_memory(4 * n_pixels * row.size, path=path, what=what)
            counts = np.zeros((n_pixels, row.size), np.uint32)
        if seen >= n_pixels:
            raise FileFormatError(
                f"holds more than {n_pixels} pixels: give shape=(rows, cols)", path=path
            )
        if row.size != counts.shape[1]:
            raise FileFormatError(
                f"pixel {seen} has {row.size} codes, those before it {counts.shape[1]}: the file "
                "is truncated or damaged",
                path=path,
            )
        if row.max() > np.iinfo(counts.dtype).max:
            check_memory(8 * counts.size, path=path, what=f"counts beyond 32 bits, {counts.shape}")
            counts = counts.astype(np.uint64)
        counts[seen] = row
        seen += 1
        tail = []
    if counts is None:
        raise FileFormatError("holds no line 'Pixel <n>': it is no PF32 histogram", path=path)
    if seen < n_pixels:
        raise FileFormatError(
            f"holds {seen} pixels of {n_pixels}: it is truncated, or give shape=(rows, cols)",
            path=path,
        )
    return counts, tail


def _lines(file: BufferedIOBase, path: Path) -> Iterator[bytes]:
    """Lines of bounded length, alone and together: packed text swells a thousandfold."""
    n_bytes = n_empty = 0
    most = max(_MOST_BYTES, path.stat().st_size) if not is_trusted() else math.inf
    while line := file.readline(_LONGEST_LINE):
        if len(line) == _LONGEST_LINE:
            raise FileFormatError("has a line of over a million characters", path=path)
        n_bytes += len(line)
        n_empty = 0 if line[:1].isalnum() else n_empty + 1
        if n_bytes > most or n_empty > _MOST_EMPTY_LINES:
            raise FileFormatError(
                f"is no histogram, or more than {_MOST_BYTES / 1e9:g} GB of text: unpack it, or "
                "say --trust (trust=True)",
                path=path,
            )
        yield line


def _counts_of_line(line: bytes, path: Path, pixel: int) -> NDArray[np.uint64]:
    """(codes,), counts of one printed line."""
    # 18 digits always fit into 64 bits.
    if _COUNTS_LINE.fullmatch(line) is None:
        raise FileFormatError(
            f"the line after 'Pixel {pixel}' is no list of counts: the file is damaged or cut",
            path=path,
        )
    return np.fromstring(line.decode("ascii"), np.uint64, sep=" ")


def _matches(path: Path, start: bytes) -> bool:
    if start.startswith(_GZIP_MAGIC):
        with gzip.open(path, "rb") as file:
            start = file.read(4096)
    return _PIXEL_LINE.search(start) is not None


FORMATS = (
    Format(
        name="pf32-text",
        summary="histograms printed by the PF32 vendor's sample program, also .gz",
        suffixes=(".txt", ".dat", ".txt.gz", ".dat.gz"),
        matches=_matches,
        read=read,
    ),
)
