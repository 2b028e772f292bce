"""Datasets of HDF5 in pieces: each chunk of one read costs the library four kilobytes of memory.

A file of some kilobytes can claim any number of chunks that are not there. Each costs 3 µs and, in
one read, that memory: 67 MB of counts cut into pairs of them took 32 GB.
"""

from __future__ import annotations

import math
import os
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from lightflight.errors import FileFormatError
from lightflight.files.packing import check_chunks_read

_MOST_AT_ONCE = 1 << 14
"""Chunks in one read: 64 MB."""

_MOST_ABSENT = 1 << 20
_INDEX_BYTES = 16
"""A chunk that is stored has an address and a length in the file."""

Ranges = tuple[tuple[int, int], ...]


def check_chunks(dataset: h5py.Dataset, *, path: str | os.PathLike[str]) -> None:
    """Raise FileFormatError for an array of more chunks than its file can hold.

    Parameters
    ----------
    dataset : h5py.Dataset
        Of an open file.
    path : path
        The file, for the message.
    """
    n = _n_chunks(tuple((0, length) for length in dataset.shape), dataset.chunks)
    if n > _MOST_ABSENT + dataset.file.id.get_filesize() // _INDEX_BYTES:
        raise FileFormatError(
            f"array {dataset.name!r} {dataset.shape} is cut into {n} pieces, more than the file "
            "can hold: the file is damaged; if it is not, save it in larger ones",
            path=path,
        )


def read_in_parts(dataset: h5py.Dataset, key: object = ()) -> NDArray[Any]:
    """`dataset[key]`, few chunks at a time.

    Parameters
    ----------
    dataset : h5py.Dataset
        Of an open file.
    key : tuple, slice or int
        As for an array; what is no run of whole rows is left to h5py.

    Returns
    -------
    array
        A copy of that part.
    """
    rows = slice(None) if isinstance(key, tuple) and not key else key
    if dataset.chunks is None:
        return np.asarray(dataset[key])
    ranges = _touched(rows, dataset.shape)
    check_chunks_read(dataset, ranges)
    if not isinstance(rows, slice) or rows.step not in (None, 1):
        return np.asarray(dataset[key])
    if _n_chunks(ranges, dataset.chunks) <= _MOST_AT_ONCE:
        return np.asarray(dataset[key])
    out = np.empty([stop - start for start, stop in ranges], dataset.dtype)
    pending = [ranges]
    while pending:
        part = pending.pop()
        if _n_chunks(part, dataset.chunks) > _MOST_AT_ONCE:
            pending += _halves(part, dataset.chunks)
            continue
        into = tuple(slice(a - b[0], z - b[0]) for (a, z), b in zip(part, ranges, strict=True))
        out[into] = dataset[tuple(slice(*one) for one in part)]
    return out


def _touched(key: object, shape: tuple[int, ...]) -> Ranges:
    """First and last of each axis that a key touches; all of an axis where it is no run of it."""
    keys = key if isinstance(key, tuple) else (key,)
    if not all(isinstance(one, slice | int | np.integer) for one in keys):
        keys = ()
    ranges = [(0, length) for length in shape]
    for axis, (one, length) in enumerate(zip(keys, shape, strict=False)):
        first, last, _ = (one if isinstance(one, slice) else _row(one, length)).indices(length)
        ranges[axis] = (first, max(first, last))
    return tuple(ranges)


def _row(number: int, length: int) -> slice:
    """One row as a run."""
    return slice(number % length, number % length + 1)


def _n_chunks(ranges: Ranges, chunks: tuple[int, ...] | None) -> int:
    """Chunks that this part of an array touches."""
    return math.prod(_chunks_along(*one) for one in zip(ranges, chunks or (), strict=False))


def _chunks_along(one: tuple[int, int], length: int) -> int:
    first, last = one
    return -(-last // length) - first // length if last > first else 0


def _halves(part: Ranges, chunks: tuple[int, ...]) -> list[Ranges]:
    """The same in two, cut between chunks along the axis that has most of them."""
    counts = [_chunks_along(*one) for one in zip(part, chunks, strict=True)]
    axis = counts.index(max(counts))
    first, last = part[axis]
    middle = (first // chunks[axis] + counts[axis] // 2) * chunks[axis]
    return [
        (*part[:axis], (first, middle), *part[axis + 1 :]),
        (*part[:axis], (middle, last), *part[axis + 1 :]),
    ]
