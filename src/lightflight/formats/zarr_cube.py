"""Zarr folders (versions 2 and 3): one array as a cube or as frames.

Axes are stated by dimension names (version 3), `_ARRAY_DIMENSIONS` (version 2, as xarray
writes), or an attribute `axes`; otherwise by hint.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from lightflight.errors import ConfigError, SuspectDataWarning, optional_package
from lightflight.files.filecheck import ANY_MOST, check_claim, check_memory
from lightflight.files.whole_file import atomic_path
from lightflight.formats.cubes import (
    axes_of,
    only_array,
    record_from_array,
    shapes_text,
    stated_axes,
)
from lightflight.formats.metadata import (
    DIGEST,
    TEXT,
    check_texts,
    fields_from_texts,
    texts_from_histograms,
)
from lightflight.formats.registry import Format
from lightflight.formats.zarr_store import checked_arrays, checked_chunks
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

_MARKS = ("zarr.json", ".zarray", ".zgroup")
_CHUNK_COUNTS = 1 << 20


def read(
    path: Path,
    clock: Mapping[str, Any],
    *,
    array: str | None = None,
    axes: str | None = None,
    shape: tuple[int, int] | None = None,
    n_codes: int | None = None,
    poisson: bool | None = None,
) -> Recording | Histograms:
    """Read one array, as a cube or as frames.

    Parameters
    ----------
    path : Path
        A Zarr folder, version 2 or 3.
    clock : mapping of str
        Hints about the clock (`clock.CLOCK_HINTS`).
    array : str, optional
        Its path in the group, where the folder is a group; None: the one of three axes.
    axes : str, optional
        Order of its axes; None: as the folder states it.
    shape : (int, int), optional
        (rows, cols), where pixels are stored row by row.
    n_codes : int, optional
        TDC codes, for frames.
    poisson : bool, optional
        False for scaled intensities; None: as the folder says, else counts.

    Returns
    -------
    Recording or Histograms
        Frames ("fyx") stay in the folder.

    Raises
    ------
    FileFormatError
        Where a size cannot be, or which array or what order is not clear.
    ConfigError
        Where `array` is not there, or a hint is none.
    MissingExtraError
        Without zarr.
    """
    zarr = _zarr()
    # Nothing of the folder is believed by zarr before we do: codecs run programs.
    arrays = checked_arrays(path)
    name = _chosen({key: tuple(one["shape"]) for key, one in arrays.items()}, array, path)
    stored = checked_chunks(path, name, arrays[name])
    node = zarr.open_array(str(path / name), mode="r", zarr_format=stored.zarr_format)
    attributes = dict(node.attrs)
    texts = {key: str(attributes[key]) for key in (TEXT, DIGEST) if key in attributes}
    if texts:  # where the axes are ours too, they are in the digest
        texts["axes"] = _stated_axes(node) or ""
    fields, settings = fields_from_texts(texts, path)
    axes = axes_of(name or path.name, node.shape, axes or _stated_axes(node), path=path)
    what = f"array {name or path.name} {node.shape}"
    n_bytes = math.prod(node.shape) * node.dtype.itemsize
    # Streamed frames take no memory, but time: for ever, where they are a claim alone.
    if "f" in axes:
        check_claim(n_bytes, stored.stored_bytes, path=path, what=what, most=ANY_MOST)
    chunk = math.prod(node.chunks) * node.dtype.itemsize
    check_memory(2 * chunk, path=path, what=f"a chunk of {what}")
    record = record_from_array(
        np.asarray(node[...]) if "f" in axes and axes != "fyx" else node,
        axes,
        fields | dict(clock),
        path=path,
        shape=shape,
        n_codes=n_codes,
        poisson=poisson,
        settings=settings,
    )
    check_texts(texts, record, lambda: np.asarray(node[...]), path)
    # Ours have been held against their digest: they are complete, whatever is not there.
    if stored.n_found < stored.n_expected and DIGEST not in texts:
        warnings.warn(
            f"{path}: {stored.n_expected - stored.n_found} of {stored.n_expected} chunks are not "
            f"there and are read as {node.fill_value}: copy the folder again, unless it was "
            "written without its empty chunks",
            SuspectDataWarning,
            stacklevel=2,
        )
    return record


def _zarr() -> ModuleType:
    return optional_package("zarr", otherwise="Zarr needs zarr: pip install 'lightflight[batch]'")


def _chosen(shapes: Mapping[str, tuple[int, ...]], wanted: str | None, path: Path) -> str:
    """Name of the array to read; "" where the folder itself is one."""
    if "" in shapes:
        if wanted is not None:
            raise ConfigError(f"array={wanted!r}: {path.name} is one array, not a group")
        return ""
    if wanted is None:
        return only_array(shapes, option="array", path=path)
    if wanted not in shapes:
        raise ConfigError(f"array={wanted!r} is not in {path.name}: {shapes_text(shapes)}")
    return wanted


def _stated_axes(node: Any) -> str | None:
    """Order of the axes as the folder states it; None where it does not."""
    named = getattr(node.metadata, "dimension_names", None) or node.attrs.get("_ARRAY_DIMENSIONS")
    for order in (named, node.attrs.get("axes")):
        named_so = isinstance(order, list | tuple | str)
        axes = stated_axes("".join(map(str, order))) if named_so else None
        if axes is not None and len(axes) == len(node.shape):
            return axes
    return None


def write(record: Recording | Histograms, path: Path) -> None:
    """Write histograms as one compressed Zarr 3 array in blocks of rows, metadata beside it.

    Parameters
    ----------
    record : Recording or Histograms
        Only histograms can be written.
    path : Path
        The folder; it appears whole or not at all.

    Raises
    ------
    ValueError
        For a recording.
    MissingExtraError
        Without zarr.
    """
    if not isinstance(record, Histograms):
        raise ValueError("zarr holds histograms: use histogram(), or write .h5 to keep photons")
    rows, cols, codes = record.counts.shape
    block = max(1, min(rows, _CHUNK_COUNTS // (cols * codes)))
    zarr, texts = _zarr(), texts_from_histograms(record)
    with atomic_path(path, directory=True) as fresh:
        node = zarr.create_array(
            store=str(fresh),
            shape=record.counts.shape,
            chunks=(block, cols, codes),
            dtype=record.counts.dtype,
            dimension_names=("y", "x", "t"),
            attributes={key: texts[key] for key in (TEXT, DIGEST)},
            overwrite=True,
        )
        # One chunk at a time: Zarr's own threads would go on writing after an error.
        for first in range(0, rows, block):
            node[first : first + block] = record.counts[first : first + block]


def _matches(path: Path, start: bytes) -> bool:
    return path.is_dir() and any((path / mark).is_file() for mark in _MARKS)


FORMATS = (
    Format(
        name="zarr",
        summary="Zarr array in a folder (needs zarr)",
        suffixes=(".zarr",),
        matches=_matches,
        read=read,
        write=write,
    ),
)
