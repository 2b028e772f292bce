"""How chunks of HDF5 are packed, held against what HDF5 does with them: it believes every chunk.

It unpacks a stream of DEFLATE to its end, however little the chunk may hold (4 MB took 4 GB), and
some of its packings follow parameters of the file beyond any buffer (a segmentation fault).
"""

from __future__ import annotations

import itertools
import math
import os
import zlib

import h5py

from lightflight.errors import FileFormatError
from lightflight.files.filecheck import DEFLATE_MOST, check_memory

LZF = 32000
_OTHERS = 256
"""Filters from this number on are plug-ins, which whoever installed them trusts."""
_IN_ORDER = (h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE, LZF, h5py.h5z.FILTER_FLETCHER32)
"""Packings that h5py, MATLAB, netCDF and this package write, in the order in which they do."""
_LZF_MOST = 90
_SPARE_BYTES = 200_000_000
"""A chunk may take that much more than it holds: what every reader may take beside its cube."""
CHECKSUM_BYTES = 4
"""Of a chunk with a checksum: it stands at its end."""


def check_packing(dataset: h5py.Dataset, *, path: str | os.PathLike[str]) -> None:
    """Raise FileFormatError where HDF5 does not unpack the chunks of an array safely.

    Parameters
    ----------
    dataset : h5py.Dataset
        Of an open file.
    path : path
        The file, for the message.
    """
    numbers = _filters(dataset)
    if not _are_usual(numbers):
        raise FileFormatError(
            f"array {dataset.name!r} is packed in an unusual way (HDF5 filters {numbers}), which "
            "can end the reader: repack it (h5repack -f GZIP=4) if it is not damaged",
            path=path,
        )
    if not dataset.chunks:
        return
    # What does not pack at all becomes a thousandth longer. Shorter than its checksum, HDF5 would
    # read far beyond its end.
    most = 1.01 * _held_bytes(dataset) + 1024
    least = CHECKSUM_BYTES if dataset.fletcher32 else 0
    wrong = dataset.id.chunk_iter(lambda one: None if least <= one.size <= most else one.size)
    if wrong is not None:
        how = "cut short" if wrong < least else "longer than what it holds"
        raise FileFormatError(
            f"a chunk of array {dataset.name!r} {dataset.shape} is {how}: the file is damaged",
            path=path,
        )


def _are_usual(numbers: list[int]) -> bool:
    """Whether chunks are packed as usual programs do: each way once, and in their order."""
    known = [number for number in numbers if number < _OTHERS or number == LZF]
    if not set(known) <= set(_IN_ORDER):
        return False
    places = [_IN_ORDER.index(number) for number in known]
    return all(before < after for before, after in itertools.pairwise(places))


def _held_bytes(dataset: h5py.Dataset) -> int:
    """Bytes that a chunk stands for."""
    one: int = dataset.id.get_type().get_size()
    held: int = math.prod(dataset.chunks) * one
    return held


def check_chunks_read(dataset: h5py.Dataset, ranges: tuple[tuple[int, int], ...]) -> None:
    """Raise FileFormatError where a chunk of this part unpacks to more than it may hold.

    Parameters
    ----------
    dataset : h5py.Dataset
        Of an open file, after `check_packing`.
    ranges : tuple of (int, int)
        First and last of each axis.
    """
    numbers = _filters(dataset)
    most = (
        DEFLATE_MOST if h5py.h5z.FILTER_DEFLATE in numbers else _LZF_MOST if LZF in numbers else 0
    )
    holds = math.prod(dataset.chunks) * dataset.id.get_type().get_size()
    # No packed chunk is much longer than what it holds, and small ones cannot do harm.
    if not most or most * holds < _SPARE_BYTES:
        return
    along = (
        range(first // length * length, last, length)
        for (first, last), length in zip(ranges, dataset.chunks, strict=True)
    )
    for corner in itertools.product(*along):
        stored = dataset.id.get_chunk_info_by_coord(corner)
        if stored.byte_offset is None or most * stored.size <= holds + _SPARE_BYTES:
            continue
        if most == _LZF_MOST:
            what = f"a chunk of array {dataset.name!r}"
            check_memory(most * stored.size, path=dataset.file.filename, what=what)
        elif _is_longer(dataset, corner, holds + CHECKSUM_BYTES):
            raise FileFormatError(
                f"a chunk of array {dataset.name!r} unpacks to more than the {holds} bytes that it "
                "may hold: the file is damaged or hostile",
                path=dataset.file.filename,
            )


def _filters(dataset: h5py.Dataset) -> list[int]:
    """Numbers of the filters, in the order in which they were applied."""
    created = dataset.id.get_create_plist()
    return [created.get_filter(k)[0] for k in range(created.get_nfilters())]


def _is_longer(dataset: h5py.Dataset, corner: tuple[int, ...], most: int) -> bool:
    """Whether a chunk's stream of DEFLATE goes on beyond so many bytes."""
    skipped, packed = dataset.id.read_direct_chunk(corner)
    if skipped >> _filters(dataset).index(h5py.h5z.FILTER_DEFLATE) & 1:
        return False
    try:
        return len(zlib.decompressobj().decompress(packed, most + 1)) > most
    except zlib.error:
        return False  # HDF5 says so itself
