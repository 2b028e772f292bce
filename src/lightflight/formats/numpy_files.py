"""NumPy files: `.npy` (one array, mapped, not loaded) and `.npz` (several, with metadata).

Three kinds of .npz state their own axes: those `write` makes, the parsed vendor histograms of a
PF32 (`hist` with `sync_hz`, `mode` ...), and any that holds an `axes` text. Never unpickles.
"""

from __future__ import annotations

import contextlib
import functools
import math
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import ConfigError, FileFormatError
from lightflight.files.filecheck import check_claim, damage_as_format_error, readable_file
from lightflight.files.mapped import mapped
from lightflight.files.whole_file import atomic_path
from lightflight.formats.clock import pf32_clock
from lightflight.formats.cubes import (
    axes_of,
    check_axes,
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
from lightflight.formats.streamed import StreamedArray
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

# NumPy evaluates the header as Python text: a long one can exhaust the interpreter.
_LARGEST_HEADER = 1 << 16
_PF32_KEYS = {"hist", "sync_hz", "mode"}


# --- .npy -------------------------------------------------------------------------------


def read_npy(
    path: Path,
    clock: Mapping[str, object],
    *,
    axes: str | None = None,
    shape: tuple[int, int] | None = None,
    n_codes: int | None = None,
    poisson: bool = True,
) -> Recording | Histograms:
    """Read one array: a cube (axes "yxt", "tyx" ...) or frames (axes "fyx", with n_codes).

    Parameters
    ----------
    path : Path
        A .npy file.
    clock : mapping of str
        Hints about the clock (`clock.CLOCK_HINTS`).
    axes : str, optional
        Order of the axes; such a file never states it.
    shape : (int, int), optional
        (rows, cols), where pixels are stored row by row.
    n_codes : int, optional
        TDC codes, for frames.
    poisson : bool
        False for scaled intensities.

    Returns
    -------
    Recording or Histograms
        Frames are mapped, not loaded.

    Raises
    ------
    FileFormatError
        Where the file is cut, holds Python objects, or `axes` is missing.
    ConfigError
        Where a hint is none.
    """
    with path.open("rb") as file:
        found, fortran, dtype = _npy_header(file, path)
        offset = file.tell()
    _check_length(found, dtype, path, offset)
    axes = axes_of("array", found, axes, path=path)
    # Mapped, so that frames larger than memory can be counted.
    values: Any = mapped(path, dtype, found, offset=offset, order="F" if fortran else "C")
    if "f" not in axes:
        axes_of_file = axes[::-1] if fortran else axes
        lengths = found[::-1] if fortran else found
        check_axes(axes, found, path)
        opened = functools.partial(_opened_at, path, offset)
        values, axes = StreamedArray(path, lengths, dtype, opened, ends=False), axes_of_file
    return record_from_array(
        values, axes, clock, path=path, shape=shape, n_codes=n_codes, poisson=poisson
    )


@contextlib.contextmanager
def _opened_at(path: Path, offset: int) -> Iterator[BinaryIO]:
    with path.open("rb") as file:
        file.seek(offset)
        yield file


def _check_length(
    found: tuple[int, ...], dtype: np.dtype[np.generic], path: Path, offset: int
) -> None:
    """Raise FileFormatError where the file ends before the array does."""
    needed, there = math.prod(found) * dtype.itemsize, path.stat().st_size - offset
    if there < needed:
        raise FileFormatError(
            f"is truncated: an array {found} of {dtype} needs {needed} bytes, {there} are there",
            path=path,
            offset=offset + there,
        )


def _npy_header(
    file: BinaryIO | IO[bytes], path: Path, *, kinds: str = "uifb"
) -> tuple[tuple[int, ...], bool, np.dtype[np.generic]]:
    """(shape, Fortran order, dtype) of a .npy; the file stands at the first byte of the array."""
    try:
        version = np.lib.format.read_magic(file)
        reader = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        found, fortran, dtype = reader(file, max_header_size=_LARGEST_HEADER)
    except (ValueError, KeyError, OSError, SyntaxError, RecursionError, TokenError) as error:
        raise FileFormatError(f"has no readable .npy header: {error}", path=path) from error
    if dtype.hasobject or dtype.kind not in kinds:
        raise FileFormatError(
            f"holds {dtype}, not real numbers: save a plain array (Python objects are never "
            "loaded)",
            path=path,
        )
    if any(length < 0 for length in found):
        raise FileFormatError(f"claims the shape {found}: the file is damaged", path=path)
    return found, fortran, dtype


# --- .npz -------------------------------------------------------------------------------


def read_npz(
    path: Path,
    clock: Mapping[str, object],
    *,
    key: str | None = None,
    axes: str | None = None,
    shape: tuple[int, int] | None = None,
    n_codes: int | None = None,
    poisson: bool | None = None,
) -> Recording | Histograms:
    """Read one array of several, as a cube or as frames.

    Parameters
    ----------
    path : Path
        A .npz file.
    clock : mapping of str
        Hints about the clock (`clock.CLOCK_HINTS`).
    key : str, optional
        Its name; None: the one array of three axes, or the one there is.
    axes : str, optional
        Order of its axes; None: as the file states it.
    shape : (int, int), optional
        (rows, cols), where pixels are stored row by row.
    n_codes : int, optional
        TDC codes, for frames.
    poisson : bool, optional
        False for scaled intensities; None: as the file says, else counts.

    Returns
    -------
    Recording or Histograms
        Single values beside the array are its settings.

    Raises
    ------
    FileFormatError
        Where the file is damaged, or which array or what order is not clear.
    ConfigError
        Where `key` is not there, or a hint is none.
    """
    with zipfile.ZipFile(path) as archive:
        found = _npz_headers(archive, path)
        key = _chosen_key(key, found, path)
        values = _streamed_member(archive, key, found[key], path)
        small = {
            name: _npz_array(archive, name, path)
            for name, header in found.items()
            if header.shape == ()
        }
    texts = {name: str(array) for name, array in small.items() if array.dtype.kind == "U"}
    settings = {name: array.item() for name, array in small.items()}
    fields: dict[str, Any] = {}
    if TEXT in texts or DIGEST in texts:
        fields, settings = fields_from_texts(texts, path)
    elif found.keys() >= _PF32_KEYS and key == "hist":
        clock, settings = _pf32_metadata(clock, settings)
        axes = axes or "yxt"
    axes = axes_of(key, found[key].shape, axes or stated_axes(texts.get("axes")), path=path)
    check_axes(axes, found[key].shape, path)
    record = record_from_array(
        np.asarray(values) if "f" in axes else values,
        axes[::-1] if found[key].fortran else axes,
        fields | dict(clock),
        path=path,
        shape=shape,
        n_codes=n_codes,
        poisson=poisson,
        settings=settings,
    )
    check_texts(texts, record, lambda: _cube_of(values, found[key]), path)
    return record


def arrays_from_file(path: Path) -> dict[str, NDArray[np.generic]]:
    """All arrays of numbers or text in a .npz, or the one of a .npy under the name "".

    Parameters
    ----------
    path : Path
        A .npz or .npy file.

    Returns
    -------
    dict of str to array
        By name; Python objects are left out and never loaded.

    Raises
    ------
    FileFormatError
        For a file that is missing, damaged, or holds none.
    """
    readable_file(path)
    with damage_as_format_error(path):
        if path.suffix.lower() == ".npy":
            with path.open("rb") as file:
                found, _, dtype = _npy_header(file, path)
                _check_length(found, dtype, path, file.tell())
            return {"": np.load(path, allow_pickle=False)}
        with zipfile.ZipFile(path) as archive:
            return {name: _npz_array(archive, name, path) for name in _npz_headers(archive, path)}


_MOST_MEMBERS = 10_000
"""Each is opened to see what it is."""


class _Header(NamedTuple):
    """What a .npy in an archive says of itself."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[np.generic]


_Headers = Mapping[str, _Header]


def _npz_headers(archive: zipfile.ZipFile, path: Path) -> _Headers:
    """Shape and type of all arrays of numbers or text, held against what the archive holds."""
    headers = {}
    members = archive.infolist()
    if len(members) > _MOST_MEMBERS:
        raise FileFormatError(
            f"is an archive of {len(members)} files, more than {_MOST_MEMBERS}: save the one array",
            path=path,
        )
    for member in members:
        name = member.filename.removesuffix(".npy")
        with archive.open(member) as file:
            try:
                header = _Header(*_npy_header(file, path, kinds="uifbU"))
            except FileFormatError:
                continue  # not an array, or one of Python objects: not ours to read
            start = file.tell()
        needed = math.prod(header.shape) * header.dtype.itemsize
        # Held against the directory of the archive before anything is unpacked.
        if needed + start != member.file_size:
            raise FileFormatError(
                f"array {name!r} {header.shape} needs {needed} bytes, the archive holds "
                f"{member.file_size - start}: the file is damaged",
                path=path,
            )
        if name in headers:
            raise FileFormatError(
                f"holds two arrays of the name {name!r}: save it again", path=path
            )
        headers[name] = header
    return headers


def _chosen_key(key: str | None, headers: _Headers, path: Path) -> str:
    """Name of the array to read; texts and single values are not asked."""
    arrays = {
        name: header.shape
        for name, header in headers.items()
        if header.shape != () and header.dtype.kind != "U"
    }
    if key is not None:
        if key not in arrays:
            raise ConfigError(f"key={key!r} is not in {path.name}: it holds {shapes_text(arrays)}")
        return key
    return only_array(arrays, option="key", path=path)


def _streamed_member(
    archive: zipfile.ZipFile, key: str, header: _Header, path: Path
) -> StreamedArray:
    """One array of an archive, read when it is asked for; Fortran's with its axes backwards."""
    member = archive.getinfo(f"{key}.npy")
    check_claim(member.file_size, member.compress_size, path=path, what=f"array {key!r}")
    shape = header.shape[::-1] if header.fortran else header.shape
    opened = functools.partial(_opened_member, path, member.filename)
    # Read to its end, where zipfile holds it against its checksum.
    return StreamedArray(path, shape, header.dtype, opened, ends=True)


@contextlib.contextmanager
def _opened_member(path: Path, name: str) -> Iterator[IO[bytes]]:
    with zipfile.ZipFile(path) as archive, archive.open(name) as file:
        _npy_header(file, path, kinds="uifbU")
        yield file


def _cube_of(values: StreamedArray, header: _Header) -> NDArray[np.generic]:
    """All of an array, its axes as they are stated."""
    return np.asarray(values).T if header.fortran else np.asarray(values)


def _npz_array(archive: zipfile.ZipFile, key: str, path: Path) -> NDArray[np.generic]:
    """One array of an archive, after checking what it claims."""
    with archive.open(f"{key}.npy") as file:
        header = _Header(*_npy_header(file, path, kinds="uifbU"))
    return _cube_of(_streamed_member(archive, key, header, path), header)


def _pf32_metadata(
    clock: Mapping[str, object], settings: dict[str, Any]
) -> tuple[dict[str, object], dict[str, object]]:
    """Clock of parsed PF32 histograms, from the keys they are kept with."""
    sync_hz = settings["sync_hz"]
    told: dict[str, Any] = {}
    if "n_frames" in settings:
        told["n_frames"] = int(settings["n_frames"])
    if "exposure_us" in settings:
        told["periods_per_frame"] = round(settings["exposure_us"] * 1e-6 * sync_hz)
    if "nominal_bin_s" in settings:
        told["bin_width_ps"] = round(settings["nominal_bin_s"] * 1e12, 6)
    fields, notes = pf32_clock(told | dict(clock), laser_period_ps=1e12 / sync_hz)
    return fields, {**settings, "camera": "PF32", "notes": notes}


# --- writing ----------------------------------------------------------------------------


def write_npz(record: Recording | Histograms, path: Path, *, compress: bool = True) -> None:
    """Write histograms as `hist`, with `axes` and all metadata as texts.

    Parameters
    ----------
    record : Recording or Histograms
        Only histograms can be written.
    path : Path
        The file; it appears whole or not at all.
    compress : bool
        False: larger, and faster to write.

    Raises
    ------
    ValueError
        For a recording.
    """
    if not isinstance(record, Histograms):
        raise ValueError(
            "npz holds histograms: use histogram() first, or write .h5 to keep photons"
        )
    texts: dict[str, Any] = {
        name: np.array(text) for name, text in texts_from_histograms(record).items()
    }
    save = np.savez_compressed if compress else np.savez
    with atomic_path(path) as fresh, fresh.open("wb") as file:
        save(file, hist=record.counts, **texts)


def _is_npy(path: Path, start: bytes) -> bool:
    return start.startswith(b"\x93NUMPY")


def _is_npz(path: Path, start: bytes) -> bool:
    if not start.startswith(b"PK\x03\x04"):
        return False
    with zipfile.ZipFile(path) as archive:
        return any(name.endswith(".npy") for name in archive.namelist())


FORMATS = (
    Format(
        name="npy",
        summary="NumPy array: a cube of counts, or frames of codes",
        suffixes=(".npy",),
        matches=_is_npy,
        read=read_npy,
    ),
    Format(
        name="npz",
        summary="NumPy archive: a cube of counts with metadata",
        suffixes=(".npz",),
        matches=_is_npz,
        read=read_npz,
        write=write_npz,
    ),
)
