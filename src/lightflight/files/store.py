"""Our own versioned HDF5: records as files that appear whole or not at all (`whole_file`).

Every record of the package (`Histograms`, `Recording`, `TimingCalibration`, `Pulses`,
`Arrivals`, `LightPath`) is kept the same way: named NumPy arrays plus one JSON text.

- a record at once: `save_record`, `load_record`, `kind_of_record`
- a record piece by piece (recordings larger than memory): `new_record`, `open_record`
- any HDF5 file, safe against a full disk: `new_hdf5`

Layout of a file (schema version 1): root attributes `format` = "lightflight", `kind` and
`schema_version`; the root dataset `attributes` holds everything that is not an array as JSON
text (non-finite numbers as NaN, Infinity, -Infinity); every other dataset is one array, and a
`/` in its name makes a group. The root attributes `sealed` and `digest` hold a digest over all of
it (`digest`); files of earlier versions have none.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from lightflight.errors import FileFormatError
from lightflight.files.chunked import check_chunks, read_in_parts
from lightflight.files.digest import check_seal, seal
from lightflight.files.disk_file import DiskFile, interrupts_to
from lightflight.files.filecheck import (
    DEFLATE_MOST,
    check_claim,
    check_memory,
    damage_as_format_error,
    readable_file,
)
from lightflight.files.hdf5_tree import entries_of
from lightflight.files.names import readable
from lightflight.files.packing import check_packing
from lightflight.files.whole_file import atomic_path as atomic_path  # many take it from here

FORMAT_NAME = "lightflight"
SCHEMA_VERSION = 1
"""Schema of every record that needs no newer one: older versions read it as well."""
NEWEST_SCHEMA = {"path": 4}
"""Highest schema this version reads, by kind of record; `SCHEMA_VERSION` where it is not named. It
reads every lower one too."""

_ATTRIBUTES = "attributes"
# Smaller arrays lie in one piece: a chunk has its own entry in an index.
_CHUNKED_FROM_BYTES = 4096
_CHUNK_BYTES = 1 << 20
_GROWING_CHUNK_BYTES = 1 << 14
_SLAB_BYTES = 16 << 20


# --- writing records --------------------------------------------------------------------


def save_record(
    path: str | os.PathLike[str],
    *,
    kind: str,
    arrays: Mapping[str, NDArray[np.generic]],
    attributes: Mapping[str, object],
    schema: int = SCHEMA_VERSION,
) -> None:
    """Write one record, whole or not at all.

    Parameters
    ----------
    path : path
        File to write; an existing one is replaced only at the end.
    kind : str
        What the record is: "histograms", "recording", "calibration", "pulses", "arrivals",
        "path" ...
    arrays : mapping of str to array
        Any shape; booleans, numbers, structured numbers or text. A `/` makes a group.
    attributes : mapping of str to JSON values
        Everything else; NumPy scalars and arrays become numbers and lists, tuples lists.
    schema : int, optional
        The lowest that says all of it: versions that know only lower ones refuse the file.

    Raises
    ------
    OSError
        If the file cannot be written (no folder, no permission, disk full).
    TypeError
        If an array holds Python objects or an attribute is not JSON.
    """
    with new_record(path, kind=kind, attributes=attributes, schema=schema) as record:
        for name, array in arrays.items():
            record.write(name, array)


@contextlib.contextmanager
def new_record(
    path: str | os.PathLike[str],
    *,
    kind: str,
    attributes: Mapping[str, object],
    schema: int = SCHEMA_VERSION,
) -> Iterator[RecordWriter]:
    """Open a record for writing piece by piece; it appears at `path` when the block ends well.

    Parameters
    ----------
    path : path
        File to write; an existing one is replaced only at the end.
    kind : str
        What the record is, as for `save_record`.
    attributes : mapping of str to JSON values
        Everything that is no array.
    schema : int, optional
        As for `save_record`.

    Yields
    ------
    RecordWriter
        Arrays are written, or grown, by it.

    Raises
    ------
    OSError, TypeError
        As `save_record` does.
    """
    text = json_text(attributes).encode("utf-8")
    with new_hdf5(path) as record:
        record.file.attrs["format"] = np.bytes_(FORMAT_NAME)
        record.file.attrs["kind"] = np.bytes_(kind)
        record.file.attrs["schema_version"] = schema
        # Of fixed length: see `text_attribute` for what texts of variable length can do.
        record.write(_ATTRIBUTES, np.array(text, h5py.string_dtype("utf-8", len(text))))
        yield record
        record.seal()


@contextlib.contextmanager
def new_hdf5(path: str | os.PathLike[str]) -> Iterator[RecordWriter]:
    """Open any HDF5 file for writing; it appears at `path` when the block ends well.

    Parameters
    ----------
    path : path
        File to write; an existing one is replaced only at the end.

    Yields
    ------
    RecordWriter
        With the open file.

    Raises
    ------
    OSError
        Where the file cannot be written.
    """
    with atomic_path(path) as fresh, DiskFile(fresh) as disk, interrupts_to(disk):
        with h5py.File(disk, "w", track_order=True) as file:
            yield RecordWriter(file, disk)
        disk.check()


def json_text(attributes: Mapping[str, object]) -> str:
    """JSON of attributes that may hold NumPy values.

    Parameters
    ----------
    attributes : mapping of str
        NumPy scalars and arrays become numbers and lists.

    Returns
    -------
    str
        Non-finite numbers as NaN, Infinity, -Infinity.

    Raises
    ------
    TypeError
        For what JSON cannot say.
    """
    text = json.dumps(dict(attributes), default=_json_value, ensure_ascii=False)
    # Names of files need not be UTF-8: Python keeps their bytes as halves of characters.
    return text if readable(text) == text else json.dumps(dict(attributes), default=_json_value)


class RecordWriter:
    """Puts arrays into a file that is being written; made by `new_record` and `new_hdf5`.

    Attributes
    ----------
    file : h5py.File
        The open file.
    """

    def __init__(self, file: h5py.File, disk: DiskFile) -> None:
        self.file = file
        self._disk = disk

    def write(self, name: str, array: NDArray[np.generic]) -> None:
        """Write one array, compressed and with checksums where it is not small.

        Parameters
        ----------
        name : str
            A `/` makes a group.
        array : array
            Of any shape.

        Raises
        ------
        OSError
            Where the disk is full.
        TypeError
            For Python objects.
        """
        values = _storable(name, np.asarray(array))
        if values.ndim == 0 or values.nbytes < _CHUNKED_FROM_BYTES:
            self.file.create_dataset(name, data=values)
        else:
            chunks = _chunk_shape(values.shape, values.dtype.itemsize)
            dataset = self.file.create_dataset(
                name, values.shape, values.dtype, chunks=chunks, **_FILTERS
            )
            row_bytes = values[0].nbytes
            # Whole chunks at a time, so that none is packed twice, and a full disk is seen between
            # them.
            step = math.ceil(_SLAB_BYTES / row_bytes / chunks[0]) * chunks[0]
            for start in range(0, values.shape[0], step):
                dataset[start : start + step] = values[start : start + step]
                self._disk.check()
        self._disk.check()

    def seal(self) -> None:
        """Write the digest over all that has been written, as the last thing."""
        seal(self.file, self._disk)
        self._disk.check()

    def append(self, name: str, values: NDArray[np.generic], *, compress: bool = False) -> None:
        """Grow an array along its first axis; it is made on first use.

        Parameters
        ----------
        name : str
            A `/` makes a group.
        values : array
            What is added; the first time, its type and other axes are those of the array.
        compress : bool
            Where it is made: compressed, not only with checksums.

        Raises
        ------
        OSError
            Where the disk is full.
        TypeError
            For Python objects.
        """
        values = _storable(name, np.asarray(values))
        if name not in self.file:
            chunks = _chunk_shape(
                (1 << 62, *values.shape[1:]), values.dtype.itemsize, _GROWING_CHUNK_BYTES
            )
            self.file.create_dataset(
                name,
                (0, *values.shape[1:]),
                values.dtype,
                maxshape=(None, *values.shape[1:]),
                chunks=chunks,
                **(_FILTERS if compress else {"fletcher32": True}),
            )
        dataset = self.file[name]
        n_old = dataset.shape[0]
        dataset.resize(n_old + values.shape[0], axis=0)
        dataset[n_old:] = values
        self._disk.check()


_FILTERS: dict[str, object] = {
    "compression": "gzip",
    "compression_opts": 1,
    "shuffle": True,
    "fletcher32": True,
}


def _storable(name: str, values: NDArray[Any]) -> NDArray[np.generic]:
    """The array as HDF5 takes it: texts as UTF-8 bytes."""
    if values.dtype.hasobject:
        raise TypeError(f"array {name!r} holds Python objects: give numbers, booleans or text")
    if values.dtype.kind == "U":
        return np.strings.encode(values, "utf-8")
    return values


def _chunk_shape(
    shape: tuple[int, ...], item_bytes: int, chunk_bytes: int = _CHUNK_BYTES
) -> tuple[int, ...]:
    """Blocks of about `chunk_bytes` that are whole in the last axes."""
    # The last axes (the codes of a pixel) stay whole where they can.
    left = max(1, chunk_bytes // item_bytes)
    chunks: list[int] = []
    for length in reversed(shape):
        chunks.append(max(1, min(length, left)))
        left = max(1, left // chunks[-1])
    return tuple(reversed(chunks))


def _json_value(value: object) -> object:
    """What JSON can say instead of a NumPy value or a path."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"attribute of type {type(value).__name__} cannot be stored: {value!r}")


# --- reading records --------------------------------------------------------------------


def load_record(
    path: str | os.PathLike[str], *, kind: str, try_newer: bool = False
) -> tuple[dict[str, NDArray[np.generic]], dict[str, Any]]:
    """Read one record written by `save_record`.

    Parameters
    ----------
    path : path
        File to read.
    kind : str
        What it must hold.
    try_newer : bool
        Read what can be read of a file that a newer version wrote, instead of refusing it.

    Returns
    -------
    arrays : dict of str to array
        Fresh arrays in native byte order, under the names they were saved with.
    attributes : dict
        The JSON values.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, truncated, foreign or damaged, of another kind, or
        written by a newer version.
    """
    with open_record(path, kind=kind, try_newer=try_newer) as (file, attributes):
        arrays = {
            name: read_array(node, path=path)
            for name, _, node in entries_of(file)
            if isinstance(node, h5py.Dataset) and name != _ATTRIBUTES
        }
    return arrays, attributes


@contextlib.contextmanager
def open_record(
    path: str | os.PathLike[str], *, kind: str, try_newer: bool = False
) -> Iterator[tuple[h5py.File, dict[str, object]]]:
    """Open a record to read its arrays in parts.

    Parameters
    ----------
    path : path
        File to read.
    kind : str
        What it must hold.
    try_newer : bool
        Read what can be read of a file that a newer version wrote, instead of refusing it.

    Yields
    ------
    file : h5py.File
        The open file.
    attributes : dict
        The JSON values.

    Raises
    ------
    FileFormatError
        As `load_record` does, for what happens inside the block too.
    """
    file_path = readable_file(path)
    _check_is_hdf5(file_path, path)
    with damage_as_format_error(path), h5py.File(file_path, "r", locking="best-effort") as file:
        version = _check_header(file, path, kind, try_newer=try_newer)
        refuse_links(file, path, within_too=True)
        # What a newer version's digest is over is not known here.
        if version <= _newest(kind):
            check_seal(file, file_path)
        yield file, _attributes_from(file, path)


def kind_of_record(path: str | os.PathLike[str]) -> str | None:
    """What one of our files holds.

    Parameters
    ----------
    path : path
        Any file or folder.

    Returns
    -------
    str or None
        "histograms", "path" ...; None where it is not ours.

    Raises
    ------
    FileFormatError
        For a missing, empty or damaged file.
    """
    if Path(path).is_dir():
        return None
    file_path = readable_file(path)
    if not h5py.is_hdf5(file_path):
        return None
    with damage_as_format_error(path), h5py.File(file_path, "r", locking="best-effort") as file:
        return text_attribute(file, "kind") if is_ours(file) else None


def is_ours(file: h5py.File) -> bool:
    """Whether an open HDF5 file says that this package wrote it."""
    return text_attribute(file, "format") == FORMAT_NAME


def text_attribute(node: h5py.HLObject, name: str) -> str | None:
    """Text of a fixed-length attribute.

    A text of variable length is never read: over a damaged one the HDF5 library can loop for ever.

    Parameters
    ----------
    node : h5py object
        File, group or dataset.
    name : str
        Name of the attribute.

    Returns
    -------
    str or None
        None where there is none of that length.
    """
    if name not in node.attrs or node.attrs.get_id(name).dtype.kind != "S":
        return None
    value = node.attrs[name]
    return bytes(value).decode("utf-8", "replace") if isinstance(value, np.bytes_) else None


def read_array(
    dataset: h5py.Dataset, *, path: str | os.PathLike[str], ours: bool = True
) -> NDArray[np.generic]:
    """Read a whole dataset of a record, after `check_dataset`.

    Parameters
    ----------
    dataset : h5py object
        What the file holds under the name.
    path : path
        The file, for the message.
    ours : bool
        As of `check_dataset`.

    Returns
    -------
    array
        Native byte order, texts decoded.

    Raises
    ------
    FileFormatError
        Where `check_dataset` does, or it does not fit into memory.
    """
    check_dataset(dataset, path=path, ours=ours)
    size = dataset.size * dataset.dtype.itemsize
    check_memory(size, path=path, what=f"array {dataset.name!r} {dataset.shape}")
    values = read_in_parts(dataset)
    values = values.astype(values.dtype.newbyteorder("="), copy=False)
    if values.dtype.kind == "S":
        values = np.strings.decode(values, "utf-8")
    return values


def check_dataset(dataset: object, *, path: str | os.PathLike[str], ours: bool = True) -> None:
    """Refuse what is no array of numbers or text, lies in another file, or cannot be its size.

    Parameters
    ----------
    dataset : h5py object
        What the file holds under the name.
    path : path
        The file, for the message.
    ours : bool
        Written by this package: its size is then held against the bytes that are stored.

    Raises
    ------
    FileFormatError
        In each of these cases.
    """
    name = str(getattr(dataset, "name", "?")).lstrip("/")
    if not isinstance(dataset, h5py.Dataset):
        raise FileFormatError(f"{name!r} is not an array", path=path)
    if dataset.is_virtual or dataset.external:
        raise FileFormatError(f"array {name!r} lies in another file: copy it in", path=path)
    if dataset.dtype.hasobject or dataset.shape is None:
        raise FileFormatError(f"array {name!r} holds neither numbers nor text", path=path)
    size = dataset.size * dataset.dtype.itemsize
    what = f"array {name!r} {dataset.shape}"
    # Files of others may leave out chunks that are empty: a ratio alone is no reason.
    if ours:
        check_claim(size, dataset.id.get_storage_size(), path=path, what=what, most=DEFLATE_MOST)
    check_packing(dataset, path=path)
    check_chunks(dataset, path=path)
    chunk = math.prod(dataset.chunks or (0,)) * dataset.dtype.itemsize
    check_memory(chunk, path=path, what=f"a chunk of {what}")


def refuse_links(
    file: h5py.File, path: str | os.PathLike[str], *, within_too: bool = False
) -> None:
    """Raise FileFormatError where something in an HDF5 file is a link to another file.

    Parameters
    ----------
    file : h5py.File
        Opened to be read; no link is followed.
    path : path
        The file, for the message.
    within_too : bool
        Refuse links within the file as well.
    """
    followed = {h5py.h5l.TYPE_HARD} | (set() if within_too else {h5py.h5l.TYPE_SOFT})
    for name, link, _ in entries_of(file):
        if link not in followed:
            raise FileFormatError(
                f"holds a link ({name}), which is not followed: copy what it stands for in",
                path=path,
            )


def _check_is_hdf5(file_path: Path, path: str | os.PathLike[str]) -> None:
    """Raise FileFormatError for what is no HDF5 file, showing how it starts."""
    if not h5py.is_hdf5(file_path):
        with file_path.open("rb") as stream:
            start = stream.read(8)
        raise FileFormatError(
            f"is not a lightflight file (it starts with {start!r}): name a file that "
            "lightflight wrote, or import this one with lightflight.read",
            path=path,
        )


def _newest(kind: str) -> int:
    """Highest schema of a kind of record that this version knows."""
    return NEWEST_SCHEMA.get(kind, SCHEMA_VERSION)


def _check_header(
    file: h5py.File, path: str | os.PathLike[str], kind: str, *, try_newer: bool = False
) -> int:
    """Schema version; FileFormatError for another kind, a newer version, or a file of others."""
    if not is_ours(file):
        raise FileFormatError(
            "is an HDF5 file, but not one of lightflight: import it with lightflight.read",
            path=path,
        )
    version = _number_attribute(file, "schema_version")
    if version is None or version < 1:
        raise FileFormatError(f"has schema version {version!r}: the file is damaged", path=path)
    if version > _newest(kind) and not try_newer:
        raise FileFormatError(
            f"was written by a newer lightflight (schema {version}, this one reads up to "
            f"{_newest(kind)}): upgrade lightflight",
            path=path,
        )
    found = text_attribute(file, "kind")
    if found != kind:
        made_by = {"calibration": "calibrate", "path": "reconstruct"}.get(kind)
        hint = "" if made_by is None else f": make one with lightflight {made_by}"
        raise FileFormatError(f"holds {found!r}, but {kind!r} is needed here{hint}", path=path)
    return version


def _number_attribute(node: h5py.HLObject, name: str) -> int | None:
    """Whole number among the attributes; None where there is none."""
    if name not in node.attrs or node.attrs.get_id(name).dtype.kind not in "iu":
        return None
    value = node.attrs[name]
    return int(value) if np.ndim(value) == 0 else None


def _attributes_from(file: h5py.File, path: str | os.PathLike[str]) -> dict[str, object]:
    """The JSON values of an open record."""
    text = read_array(file.get(_ATTRIBUTES), path=path)
    try:
        attributes = json.loads(str(text))
    # Brackets nested deep enough end in a RecursionError.
    except (ValueError, RecursionError):
        attributes = None
    if not isinstance(attributes, dict):
        raise FileFormatError("its attributes are not readable: the file is damaged", path=path)
    return attributes
