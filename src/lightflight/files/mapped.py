"""Arrays mapped from files, whose rows are read and not touched where they lie.

A file that is cut while it is mapped (a camera starts again under the same name, a share goes
away) ends the process that touches what is gone: the system sends SIGBUS. Whoever works through a
mapped array therefore takes its rows by `rows_of`, which reads them from the same open file.
"""

from __future__ import annotations

import mmap
import os
import weakref
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lightflight.errors import FileFormatError

_SPREAD = 2
"""Rows that lie further apart than so many times their own bytes are not read at once."""

# Of each map: the open file, and where in it the map starts.
_FILES: weakref.WeakKeyDictionary[mmap.mmap, tuple[int, int]] = weakref.WeakKeyDictionary()


def mapped(
    path: Path,
    dtype: DTypeLike,
    shape: tuple[int, ...],
    *,
    offset: int = 0,
    order: Literal["C", "F"],
) -> np.memmap[tuple[int, ...], np.dtype[np.generic]]:
    """Map an array; `rows_of` reads from it.

    Parameters
    ----------
    path : Path
        A regular file.
    dtype : dtype
        Of its elements.
    shape : tuple of int
        Of the array.
    offset : int
        Bytes before it.
    order : "C" or "F"
        Which axis varies last.

    Returns
    -------
    np.memmap
        Read-only.

    Raises
    ------
    OSError, ValueError
        Where the file is not there, or shorter than the array.
    """
    with path.open("rb") as file:
        array: np.memmap[tuple[int, ...], np.dtype[np.generic]] = np.memmap(
            file, dtype, "r", offset, shape, order
        )
        whole = map_of(array)
        if whole is not None and hasattr(os, "preadv"):
            handle = os.dup(file.fileno())
            _FILES[whole] = handle, offset - offset % mmap.ALLOCATIONGRANULARITY
            weakref.finalize(whole, os.close, handle).atexit = False
    return array


def map_of(source: object) -> mmap.mmap | None:
    """What an array is mapped by.

    Parameters
    ----------
    source : object
        Any array, or a view of one.

    Returns
    -------
    mmap.mmap or None
        None for what is in memory.
    """
    base = source
    while isinstance(base, np.ndarray):
        base = base.base
    return base if isinstance(base, mmap.mmap) else None


def rows_of(source: Any, first: int, last: int) -> Any:
    """Elements first ... last - 1 of the first axis.

    Parameters
    ----------
    source : array
        Anything that can be sliced; only what `mapped` gave, or a view of it, is read anew.
    first, last : int
        Which.

    Returns
    -------
    array
        As slicing gives them.

    Raises
    ------
    FileFormatError
        Where the file has been cut meanwhile, or the disk fails.
    """
    part, whole = source[first:last], map_of(source)
    if whole is None or whole not in _FILES or part.size == 0:
        return part
    handle, start = _FILES[whole]
    low, high = np.lib.array_utils.byte_bounds(part)
    at = start + low - np.frombuffer(whole, np.uint8).ctypes.data
    path = str(source.filename)
    if high - low > _SPREAD * part.nbytes:
        if os.fstat(handle).st_size < at + high - low:
            raise _cut(path)
        return part
    block = np.empty(high - low, np.uint8)
    _fill(block, handle, at, path)
    return np.ndarray(part.shape, part.dtype, block.data, part.ctypes.data - low, part.strides)


def _fill(block: NDArray[np.uint8], handle: int, at: int, path: str) -> None:
    done = 0
    while done < block.size:
        try:
            n = os.preadv(handle, [block.data[done:]], at + done)
        except OSError as error:
            raise FileFormatError(
                f"cannot be read ({error.strerror}): see to the disk or the network", path=path
            ) from None
        if n == 0:
            raise _cut(path)
        done += n


def _cut(path: str) -> FileFormatError:
    return FileFormatError(
        "was cut while it was read: wait until the camera has written it, and read it again",
        path=path,
    )
