"""One number over everything a file of ours holds, written last and checked before all else.

HDF5 keeps a checksum for each chunk of a large array, and none for attributes, small arrays or
for which chunk belongs where: one changed byte there is another number, not an error. The digest
covers names, types, shapes and attributes, small arrays whole, and for each chunk its place, its
length, its filters and its own checksum, which HDF5 holds against the content when it is read.

A file says in two places that it has a digest, so that losing one of them is seen.
"""

from __future__ import annotations

import functools
import hashlib
import io
import logging
import os
from collections.abc import Callable, Mapping

import h5py
import numpy as np

from lightflight.errors import FileFormatError
from lightflight.files.hdf5_tree import entries_of
from lightflight.files.packing import CHECKSUM_BYTES

DIGEST, SEALED = "digest", "sealed"
"""Attributes of the root: the digest as hexadecimal text, and the number 1."""

_MOST_CHECKSUMS = 1 << 16
"""Chunks of an array (a gigabyte of photons) whose checksums are looked up: each costs a read."""

_log = logging.getLogger(__name__)
ReadAt = Callable[[int, int], bytes]
"""Bytes of the file as they are stored: (first byte, how many)."""


# --- HDF5 -------------------------------------------------------------------------------


def seal(file: h5py.File, raw: io.RawIOBase) -> None:
    """Write the digest of an open file of ours, as the last thing.

    Parameters
    ----------
    file : h5py.File
        Everything else has been written.
    raw : io.RawIOBase
        What it is written to.
    """
    file.attrs[SEALED] = 1
    file.flush()

    def read_at(start: int, n: int) -> bytes:
        raw.seek(start)
        return raw.read(n) or b""

    file.attrs[DIGEST] = np.bytes_(_digest_of(file, read_at))


def check_seal(file: h5py.File, path: str | os.PathLike[str]) -> None:
    """Raise FileFormatError where a file of ours is not what its digest says.

    Files of versions that made no digest are let through, and said to have none.

    Parameters
    ----------
    file : h5py.File
        Opened to be read.
    path : path
        The file.
    """
    if DIGEST not in file.attrs and SEALED not in file.attrs:
        say_no_digest(os.fspath(path))
        return
    told = file.attrs[DIGEST] if _is_text(file, DIGEST) else None
    handle = os.open(path, os.O_RDONLY)
    try:
        found = _digest_of(file, lambda start, n: _read_at(handle, start, n))
    finally:
        os.close(handle)
    if told != np.bytes_(found):
        raise not_as_written(path)


def _is_text(node: h5py.HLObject, name: str) -> bool:
    """Whether an attribute is a text of fixed length; others are not safe to read."""
    return name in node.attrs and node.attrs.get_id(name).dtype.kind == "S"


def _read_at(handle: int, start: int, n: int) -> bytes:
    if hasattr(os, "pread"):
        return os.pread(handle, n, start)
    os.lseek(handle, start, os.SEEK_SET)
    return bytes(os.read(handle, n))


def _digest_of(file: h5py.File, read_at: ReadAt) -> str:
    """Digest of all groups and datasets and their attributes, but for the digest itself."""
    nodes: dict[str, h5py.HLObject] = {"": file}
    nodes |= {name: node for name, _, node in entries_of(file) if node is not None}
    whole = hashlib.blake2b(digest_size=32)
    for name in sorted(nodes):
        _add(whole, name, type(nodes[name]).__name__)
        for key in sorted(nodes[name].attrs):
            if (name, key) != ("", DIGEST):
                _add_attribute(whole, nodes[name], key)
        if isinstance(nodes[name], h5py.Dataset):
            _add_dataset(whole, nodes[name], read_at)
    return str(whole.hexdigest())


def _add(whole: hashlib.blake2b, *words: object) -> None:
    """Add words, so that no two lists of them look alike."""
    for word in words:
        block = word if isinstance(word, bytes) else str(word).encode("utf-8", "surrogateescape")
        whole.update(b"%d:" % len(block))
        whole.update(block)


def _add_attribute(whole: hashlib.blake2b, node: h5py.HLObject, key: str) -> None:
    dtype = node.attrs.get_id(key).dtype
    if dtype.hasobject:  # we write none, and they are not safe to read
        _add(whole, key, "object")
        return
    value = np.asarray(node.attrs[key])
    _add(whole, key, dtype.descr, value.shape, value.tobytes())


def _add_dataset(whole: hashlib.blake2b, dataset: h5py.Dataset, read_at: ReadAt) -> None:
    _add(whole, dataset.dtype.descr, dataset.shape, dataset.chunks)
    if dataset.chunks is None:
        if not dataset.dtype.hasobject and dataset.shape is not None and _lies_here(dataset):
            _add(whole, np.asarray(dataset[()]).tobytes())
        return
    with_checksums = dataset.id.get_num_chunks() <= _MOST_CHECKSUMS
    lines: list[bytes] = []

    def note(chunk: h5py.h5d.StoreInfo) -> None:
        lines.append(b"%r %d %d" % (chunk.chunk_offset, chunk.size, chunk.filter_mask))
        if with_checksums:
            last = chunk.byte_offset + chunk.size - CHECKSUM_BYTES
            lines.append(read_at(last, CHECKSUM_BYTES))

    if dataset.id.get_num_chunks():
        dataset.id.chunk_iter(note)
    _add(whole, b"\0".join(lines))


def _lies_here(dataset: h5py.Dataset) -> bool:
    """Whether all bytes of a dataset in one piece are stored, and in this file."""
    size = dataset.size * dataset.dtype.itemsize
    return not (dataset.is_virtual or dataset.external) and dataset.id.get_storage_size() == size


# --- what other formats carry -----------------------------------------------------------


def digest_of_values(texts: Mapping[str, str], values: object) -> str:
    """Digest of an array and the texts beside it, for formats that carry ours along.

    Parameters
    ----------
    texts : mapping of str to str
        By name.
    values : array
        Its type counts, its byte order does not.

    Returns
    -------
    str
        Hexadecimal.
    """
    whole = hashlib.blake2b(digest_size=32)
    for name in sorted(texts):
        _add(whole, name, texts[name])
    array = np.asarray(values)
    _add(whole, array.dtype.newbyteorder("<").str, array.shape)
    for row in np.ascontiguousarray(array).reshape(max(1, len(array)), -1):
        whole.update(np.ascontiguousarray(row, array.dtype.newbyteorder("<")).data)
    return whole.hexdigest()


def is_digest_of(told: object, texts: Mapping[str, str], values: object) -> bool:
    """Whether what a file told is the digest of these texts and values."""
    return told == digest_of_values(texts, values)


def not_as_written(path: str | os.PathLike[str]) -> FileFormatError:
    """The error over a file that is not what its digest says."""
    return FileFormatError(
        "is not as lightflight wrote it (its digest is another): it is damaged or was changed by "
        "another program; copy it again",
        path=path,
    )


@functools.lru_cache(maxsize=1024)
def say_no_digest(path: str) -> None:
    """Say, once, that a file of ours is of a version that made no digest."""
    _log.info("%s has no digest (it is of an earlier version): damage may go unnoticed", path)
