"""Raw frames of a Photon Force PF32: uint16 codes, row by row, with or without 16-byte footers.

Such a file says nothing about itself. Its size tells whether there are footers; where both fit,
the content tells: a PF32 knows 1,024 codes, and footers do not look like codes. Frames are
mapped, not loaded.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import ConfigError, FileFormatError
from lightflight.files.filecheck import record_error_as_format_error
from lightflight.files.mapped import mapped, rows_of
from lightflight.files.whole_file import atomic_path
from lightflight.formats.clock import PF32_CODES, pf32_clock
from lightflight.formats.cubes import checked_shape
from lightflight.formats.registry import Format
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

_FOOTER_BYTES = (0, 16)
_FRAMES_LOOKED_AT = 256


def read(
    path: Path,
    clock: Mapping[str, Any],
    *,
    shape: tuple[int, int] = (32, 32),
    footer_bytes: int | None = None,
    n_codes: int = PF32_CODES,
) -> Recording:
    """Read raw frames; they are mapped, not loaded.

    Parameters
    ----------
    path : Path
        A file of uint16 codes, frame by frame.
    clock : mapping of str
        Hints about the clock; a PF32 is assumed beyond them (`clock.pf32_clock`).
    shape : (int, int)
        (rows, cols) of one frame.
    footer_bytes : int, optional
        Bytes after each frame; None: found from the size and the codes.
    n_codes : int
        Codes of the TDC.

    Returns
    -------
    Recording
        Of dense frames, with the footers beside them.

    Raises
    ------
    FileFormatError
        Where the size is no whole number of frames, or footers can neither be seen nor excluded.
    ConfigError
        Where a hint is none.
    """
    rows, cols = checked_shape(shape)
    frame_bytes = 2 * rows * cols
    if footer_bytes is None:
        footer_bytes = _found_footer(path, frame_bytes, n_codes)
    elif footer_bytes < 0 or footer_bytes % 2:
        raise ConfigError(f"hint footer_bytes must be an even number of bytes, got {footer_bytes}")
    stride = frame_bytes + footer_bytes
    n_frames, left = divmod(path.stat().st_size, stride)
    if left or n_frames == 0:
        raise _odd_size(path, rows, cols, (footer_bytes,))
    words = mapped(path, "<u2", (n_frames, stride // 2), order="C")
    frames = words[:, : rows * cols].reshape(n_frames, rows, cols)
    footers = words[:, rows * cols :].view(np.uint8) if footer_bytes else None
    fields, notes = pf32_clock(clock)
    with record_error_as_format_error(path):
        return Recording(
            (rows, cols),
            n_codes=n_codes,
            frames=frames,
            footers=footers,
            settings={"camera": "PF32", "footer_bytes": footer_bytes, "notes": notes},
            **fields,
        )


def _found_footer(path: Path, frame_bytes: int, n_codes: int) -> int:
    """Bytes after each frame: what the size allows, else what the content allows."""
    size = path.stat().st_size
    fitting = [footer for footer in _FOOTER_BYTES if size % (frame_bytes + footer) == 0]
    if not fitting:
        raise _odd_size(path, frame_bytes // 2, 1, _FOOTER_BYTES)
    if len(fitting) == 1:
        return fitting[0]
    n_words = frame_bytes // 2
    plain = _last_frames(path, n_words)
    framed = _last_frames(path, n_words + _FOOTER_BYTES[1] // 2)
    if (plain >= n_codes).any():
        return _FOOTER_BYTES[1]
    # Every code is possible. Footers would be constant or count upwards; codes do neither.
    steps = np.diff(framed[:, n_words:].astype(int), axis=0)
    if (framed[:, :n_words] >= n_codes).any() or (steps < 0).any():
        return 0
    raise FileFormatError(
        f"may or may not hold {_FOOTER_BYTES[1]}-byte footers after its frames: give "
        f"footer_bytes=0 or footer_bytes={_FOOTER_BYTES[1]}",
        path=path,
    )


def _last_frames(path: Path, n_words: int) -> NDArray[np.uint16]:
    """(frames, n_words), the end of the file cut into frames of so many words."""
    there = path.stat().st_size // 2
    first = max(0, there - n_words * _FRAMES_LOOKED_AT)
    frames: NDArray[np.uint16] = np.fromfile(path, "<u2", offset=2 * first)
    return frames.reshape(-1, n_words)


def _odd_size(path: Path, rows: int, cols: int, footers: tuple[int, ...]) -> FileFormatError:
    """Error that says where the last whole frame ends."""
    size = path.stat().st_size
    strides = [2 * rows * cols + footer for footer in footers]
    whole = max(size // stride * stride for stride in strides)
    lengths = " or ".join(f"{stride} bytes" for stride in strides)
    return FileFormatError(
        f"holds {size} bytes, which is no whole number of frames of {lengths}: it is truncated, "
        "or shape= or footer_bytes= are others",
        path=path,
        offset=whole,
    )


def write(record: Recording | Histograms, path: Path) -> None:
    """Write dense frames without footers, as the camera does; the clock is not kept.

    Parameters
    ----------
    record : Recording or Histograms
        Only a recording of frames can be written.
    path : Path
        The file; it appears whole or not at all.

    Raises
    ------
    ValueError
        For events and histograms.
    """
    if not isinstance(record, Recording) or record.frames is None:
        raise ValueError("raw files hold dense frames: write .h5 to keep events or histograms")
    with atomic_path(path) as fresh, fresh.open("wb") as file:
        for first in range(0, record.frames.shape[0], 4096):
            block = np.asarray(rows_of(record.frames, first, first + 4096))
            file.write(np.ascontiguousarray(block, dtype="<u2").data)


FORMATS = (
    Format(
        name="pf32-frames",
        summary="raw uint16 frames of a PF32, with or without 16-byte footers",
        suffixes=(".bin", ".raw"),
        matches=None,
        read=read,
        write=write,
    ),
)
