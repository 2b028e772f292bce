"""Becker & Hickl `.spc`: photon events of the SPC-130, 140, 150, 160, 830 (4-byte records).

Each record holds a 12-bit macro time, 4 routing bits, a 12-bit ADC value and flags; the ADC
runs backwards (4095 - ADC is the time). The routing channel becomes the column. The width of a
code is in the `.set` file that the vendor's program writes beside it.

Layout: Becker & Hickl, "The bh TCSPC Handbook", FIFO data of the SPC-130/140/150/830. It holds
no size and no count, so that a reader of our own is shorter than a guarded one of others.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lightflight.errors import FileFormatError
from lightflight.files.filecheck import record_error_as_format_error
from lightflight.formats.registry import Format
from lightflight.recording.recording import Recording

_CODES = 4096
_INVALID, _OVERFLOW, _MARK = 1 << 31, 1 << 30, 1 << 28
_RECORDS_AT_ONCE = 1 << 22
_TAC_WIDTH = re.compile(rb"\[SP_TAC_TC,F,([0-9.eE+-]+)\]")
_LARGEST_SET_FILE = 1 << 24


def read(path: Path, clock: Mapping[str, Any]) -> Recording:
    """Read photon events; the routing channel is the column.

    Parameters
    ----------
    path : Path
        A file of 4-byte records.
    clock : mapping of str
        Hints about the clock; the width of a code is taken from the `.set` file beside it.

    Returns
    -------
    Recording
        Of events, (1, channels) pixels; frames are not known.

    Raises
    ------
    FileFormatError
        Where it is cut, of another module, or holds no photon.
    """
    size = path.stat().st_size
    if size % 4 or size < 8:
        raise FileFormatError(
            f"holds {size} bytes, which is no whole number of 4-byte records: it is truncated, or "
            "of another module than SPC-130 ... 830",
            path=path,
            offset=size // 4 * 4,
        )
    records = np.memmap(path, "<u4", "r")
    header = int(records[0])
    if not header & _INVALID or header & _OVERFLOW:
        raise FileFormatError(
            f"does not start with the header of an SPC-130 ... 830 file but with {header:#010x}",
            path=path,
            offset=0,
        )
    codes, channels = [], []
    for first in range(1, records.size, _RECORDS_AT_ONCE):
        part = np.asarray(records[first : first + _RECORDS_AT_ONCE])
        # Overflows of the macro time and marks are records too, and no photons.
        photons = part[part & (_INVALID | _MARK) == 0]
        # The ADC runs backwards.
        codes.append(((_CODES - 1) - (photons >> 16 & 0xFFF)).astype(np.uint16))
        channels.append((photons >> 12 & 0xF).astype(np.uint16))
    code, channel = np.concatenate(codes), np.concatenate(channels)
    if code.size == 0:
        raise FileFormatError("holds no photon", path=path)
    width, notes = _code_width_ps(path)
    told: dict[str, Any] = {} if width is None else {"bin_width_ps": width}
    settings = {"macro_clock_ns": (header & 0xFFFFFF) / 10, "notes": notes}
    with record_error_as_format_error(path):
        return Recording(
            (1, int(channel.max()) + 1),
            n_codes=_CODES,
            pixel=channel,
            code=code,
            settings=settings,
            **(told | dict(clock)),
        )


def _code_width_ps(path: Path) -> tuple[float | None, list[str]]:
    """Width of a code from the .set file beside the recording, and a note that says so."""
    beside = path.with_suffix(".set")
    if not beside.is_file() or beside.stat().st_size > _LARGEST_SET_FILE:
        return None, []
    found = _TAC_WIDTH.search(beside.read_bytes())
    if found is None:
        return None, []
    width = float(found[1]) * 1e12
    return width, [f"a code is {width:.6g} ps wide: {beside.name} beside it"]


FORMATS = (
    Format(
        name="spc",
        summary="Becker & Hickl .spc photon events, SPC-130 ... 830",
        suffixes=(".spc",),
        matches=None,
        read=read,
    ),
)
