"""Becker & Hickl `.spc`: photon events of the SPC-130, 140, 150, 160, 830 (4-byte records).

Each record holds a 12-bit macro time, 4 routing bits, a 12-bit ADC value and flags; the ADC
runs backwards (4095 - ADC is the time). The routing channel becomes the column. The width of a
code is in the `.set` file that the vendor's program writes beside it.

Layout: Becker & Hickl, "The bh TCSPC Handbook", FIFO data of the SPC-130/140/150/830. It holds
no size and no count, so that a reader of our own is shorter than a guarded one of others.
"""

from __future__ import annotations

import bisect
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lightflight.errors import FileFormatError
from lightflight.files.filecheck import blame, check_memory, record_error_as_format_error
from lightflight.formats.registry import Format
from lightflight.recording.recording import Recording

_CODES = 4096
_INVALID, _OVERFLOW, _MARK = 1 << 31, 1 << 30, 1 << 28
_RECORDS_AT_ONCE = 1 << 20
# Shorter files are read once and held; longer ones twice, and never whole.
_HELD_BYTES = 1 << 26
_TAC_WIDTH = re.compile(rb"\[SP_TAC_TC,F,([0-9.eE+-]+)\]")
_LARGEST_SET_FILE = 1 << 24


def read(path: Path, clock: Mapping[str, object]) -> Recording:
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
    header = int(np.fromfile(path, "<u4", 1)[0])
    if not header & _INVALID or header & _OVERFLOW:
        raise FileFormatError(
            f"does not start with the header of an SPC-130 ... 830 file but with {header:#010x}",
            path=path,
            offset=0,
        )
    starts, n_channels, held = [0], 0, []
    for block in range(-(-(size // 4 - 1) // _RECORDS_AT_ONCE)):
        photons = _photons_of_block(os.fspath(path), block)
        channels = _channels_of(photons)
        starts.append(starts[-1] + photons.size)
        n_channels = max(n_channels, int(channels.max(initial=0)) + 1)
        if size <= _HELD_BYTES:
            held.append((channels, _codes_of(photons)))
    if starts[-1] == 0:
        raise FileFormatError("holds no photon", path=path)
    photons_of_file = _Photons(os.path.abspath(path), tuple(starts))  # noqa: PTH100
    pixel: Any = _Column(photons_of_file, "channel")
    code: Any = _Column(photons_of_file, "code")
    if held:
        pixel, code = (np.concatenate(parts) for parts in zip(*held, strict=True))
    # Who told the width is obeyed, and the file beside it not asked.
    width, notes = (None, []) if clock.get("bin_width_ps") is not None else _code_width_ps(path)
    told: dict[str, Any] = {} if width is None else {"bin_width_ps": width}
    settings = {"macro_clock_ns": (header & 0xFFFFFF) / 10, "notes": notes}
    with record_error_as_format_error(path):
        return Recording(
            (1, n_channels),
            n_codes=_CODES,
            pixel=pixel,
            code=code,
            settings=settings,
            **(told | dict(clock)),
        )


def _photons_of_block(path: str, block: int) -> NDArray[np.uint32]:
    """Records of one block that are photons: overflows of the macro time and marks are none."""
    first = 4 * (1 + block * _RECORDS_AT_ONCE)
    records: NDArray[np.uint32] = np.fromfile(path, "<u4", _RECORDS_AT_ONCE, offset=first)
    photons: NDArray[np.uint32] = records[records & (_INVALID | _MARK) == 0]
    return photons


def _channels_of(records: NDArray[np.uint32]) -> NDArray[np.uint16]:
    return (records >> 12 & 0xF).astype(np.uint16)


def _codes_of(records: NDArray[np.uint32]) -> NDArray[np.uint16]:
    # The ADC runs backwards.
    return ((_CODES - 1) - (records >> 16 & 0xFFF)).astype(np.uint16)


@dataclass(eq=False)
class _Photons:
    """Photons that stay in the file; those that were asked for last are kept."""

    path: str
    starts: tuple[int, ...]
    _kept: tuple[int, int, NDArray[np.uint32]] | None = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "_kept": None}

    def part(self, first: int, last: int) -> NDArray[np.uint32]:
        """Records of photons first ... last - 1."""
        # Channel and code of the same photons are asked for one after the other.
        kept = self._kept
        if kept is None or kept[:2] != (first, last):
            kept = self._kept = first, last, self._read(first, last)
        return kept[2]

    def _read(self, first: int, last: int) -> NDArray[np.uint32]:
        found, block = [], max(0, bisect.bisect_right(self.starts, first) - 1)
        while block < len(self.starts) - 1 and self.starts[block] < last:
            start, end = self.starts[block : block + 2]
            try:
                photons = _photons_of_block(self.path, block)
            except OSError as error:
                raise FileFormatError(blame(error), path=self.path) from error
            if photons.size != end - start:
                raise FileFormatError(
                    "was changed while it was read: wait until it is written, and read it again",
                    path=self.path,
                )
            found.append(photons[max(0, first - start) : last - start])
            block += 1
        return np.concatenate(found) if found else np.empty(0, np.uint32)


@dataclass(frozen=True, eq=False)
class _Column:
    """Channel or code of each photon, as a list that is read in parts."""

    photons: _Photons
    name: str

    @property
    def path(self) -> str:
        """The file, for errors about its content."""
        return self.photons.path

    @property
    def shape(self) -> tuple[int]:
        """(photons,)."""
        return (self.photons.starts[-1],)

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """Of both."""
        return np.dtype(np.uint16)

    def __getitem__(self, key: slice) -> NDArray[np.uint16]:
        first, last, _ = key.indices(self.shape[0])
        records = self.photons.part(first, max(first, last))
        return _channels_of(records) if self.name == "channel" else _codes_of(records)

    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[np.generic]:
        """All of it, after checking that it fits into memory."""
        check_memory(2 * self.shape[0], path=self.path, what=f"{self.name} of all photons")
        return np.asarray(self[:], dtype)


def _code_width_ps(path: Path) -> tuple[float | None, list[str]]:
    """Width of a code from the .set file beside the recording, and a note that says so."""
    beside = path.with_suffix(".set")
    if not beside.is_file() or beside.stat().st_size > _LARGEST_SET_FILE:
        return None, []
    found = _TAC_WIDTH.search(beside.read_bytes())
    if found is None:
        return None, []
    try:
        width = float(found[1]) * 1e12
    except ValueError:
        width = float("nan")
    if not 0 < width < float("inf"):
        raise FileFormatError(
            f"{beside.name} beside it gives {found[1][:40].decode()!r} as the width of a code: say "
            "bin_width_ps=, or take that file away",
            path=path,
        )
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
