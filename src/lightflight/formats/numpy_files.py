"""NumPy files: `.npy` (one array, mapped, not loaded) and `.npz` (several, with metadata).

Three kinds of .npz state their own axes: those `write` makes, the parsed vendor histograms of a
PF32 (`hist` with `sync_hz`, `mode` ...), and any that holds an `axes` text. Never unpickles.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import ConfigError, FileFormatError
from lightflight.filecheck import (
    check_claim,
    check_memory,
    damage_as_format_error,
    readable_file,
)
from lightflight.formats.clock import pf32_clock
from lightflight.formats.cubes import (
    axes_needed,
    checked_shape,
    record_from_array,
    shapes_text,
    stated_axes,
)
from lightflight.formats.metadata import fields_from_text, text_from_histograms
from lightflight.formats.registry import Format
from lightflight.histogram import Histograms
from lightflight.recording import Recording

_LARGEST_HEADER = 1 << 16
_PF32_KEYS = {"hist", "sync_hz", "mode"}


# --- .npy -------------------------------------------------------------------------------


def read_npy(
    path: Path,
    clock: Mapping[str, Any],
    *,
    axes: str | None = None,
    shape: tuple[int, int] | None = None,
    n_codes: int | None = None,
    poisson: bool = True,
) -> Recording | Histograms:
    """Read one array: a cube (axes "yxt", "tyx" ...) or frames (axes "fyx", with n_codes)."""
    with path.open("rb") as file:
        found, fortran, dtype = _npy_header(file, path)
        offset = file.tell()
    _check_length(found, dtype, path, offset)
    if axes is None:
        raise axes_needed({"array": found}, path)
    values = np.memmap(path, dtype, "r", offset, found, "F" if fortran else "C")
    return record_from_array(
        values if "f" in axes else np.asarray(values),
        axes,
        clock,
        path=path,
        shape=checked_shape(shape) if shape is not None else None,
        n_codes=n_codes,
        poisson=poisson,
    )


def _check_length(found: tuple[int, ...], dtype: np.dtype[Any], path: Path, offset: int) -> None:
    needed, there = math.prod(found) * dtype.itemsize, path.stat().st_size - offset
    if there < needed:
        raise FileFormatError(
            f"is truncated: an array {found} of {dtype} needs {needed} bytes, {there} are there",
            path=path,
            offset=offset + there,
        )


def _npy_header(
    file: BinaryIO | IO[bytes], path: Path, *, kinds: str = "uifb"
) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """(shape, Fortran order, dtype) of a .npy; the file stands at the first byte of the array."""
    try:
        version = np.lib.format.read_magic(file)
        reader = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        found, fortran, dtype = reader(file, max_header_size=_LARGEST_HEADER)
    except (ValueError, KeyError, OSError, SyntaxError, RecursionError) as error:
        raise FileFormatError(f"has no readable .npy header: {error}", path=path) from error
    if dtype.hasobject or dtype.kind not in kinds:
        raise FileFormatError(
            f"holds {dtype}, not numbers: save a plain array (Python objects are never loaded)",
            path=path,
        )
    if any(length < 0 for length in found):
        raise FileFormatError(f"claims the shape {found}: the file is damaged", path=path)
    return found, fortran, dtype


# --- .npz -------------------------------------------------------------------------------


def read_npz(
    path: Path,
    clock: Mapping[str, Any],
    *,
    key: str | None = None,
    axes: str | None = None,
    shape: tuple[int, int] | None = None,
    n_codes: int | None = None,
    poisson: bool | None = None,
) -> Recording | Histograms:
    """Read one array of several; `key` names it where there is more than one candidate."""
    with zipfile.ZipFile(path) as archive:
        found = _npz_headers(archive, path)
        key = _chosen_key(key, found, path)
        values = _npz_array(archive, key, path)
        small = {
            name: _npz_array(archive, name, path)
            for name, (lengths, _) in found.items()
            if lengths == ()
        }
    texts = {name: str(array) for name, array in small.items() if array.dtype.kind == "U"}
    settings = {name: array.item() for name, array in small.items()}
    fields: dict[str, Any] = {}
    if "lightflight" in texts:
        fields, settings = fields_from_text(texts["lightflight"], path)
        poisson = bool(fields.pop("poisson", True)) if poisson is None else poisson
    elif found.keys() >= _PF32_KEYS and key == "hist":
        clock, settings = _pf32_metadata(clock, settings)
        axes = axes or "yxt"
    axes = axes or stated_axes(texts.get("axes"))
    if axes is None:
        raise axes_needed({key: values.shape}, path)
    return record_from_array(
        values,
        axes,
        fields | dict(clock),
        path=path,
        shape=checked_shape(shape) if shape is not None else None,
        n_codes=n_codes,
        poisson=True if poisson is None else poisson,
        settings=settings,
    )


def arrays_from_file(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of numbers or text in a .npz, or the one of a .npy under the name "".

    Raises FileFormatError for a file that is missing, damaged, or holds none.
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


_Headers = Mapping[str, tuple[tuple[int, ...], np.dtype[Any]]]


def _npz_headers(archive: zipfile.ZipFile, path: Path) -> _Headers:
    """Shape and type of all arrays of numbers or text, held against what the archive holds."""
    headers = {}
    for member in archive.infolist():
        name = member.filename.removesuffix(".npy")
        with archive.open(member) as file:
            try:
                lengths, _, dtype = _npy_header(file, path, kinds="uifbU")
            except FileFormatError:
                continue  # not an array, or one of Python objects: not ours to read
        needed = math.prod(lengths) * dtype.itemsize
        if needed > member.file_size:
            raise FileFormatError(
                f"array {name!r} {lengths} needs {needed} bytes, the archive holds "
                f"{member.file_size}: the file is damaged",
                path=path,
            )
        headers[name] = lengths, dtype
    return headers


def _chosen_key(key: str | None, headers: _Headers, path: Path) -> str:
    arrays = {
        name: lengths
        for name, (lengths, dtype) in headers.items()
        if lengths != () and dtype.kind != "U"
    }
    if key is not None:
        if key not in arrays:
            raise ConfigError(f"key={key!r} is not in {path.name}: it holds {shapes_text(arrays)}")
        return key
    cubes = [name for name, found in arrays.items() if len(found) == 3]
    if len(cubes) == 1:
        return cubes[0]
    if len(arrays) == 1:
        return next(iter(arrays))
    if not arrays:
        raise FileFormatError("holds no array", path=path)
    raise FileFormatError(
        f"holds several arrays ({shapes_text(arrays)}): name one with key=", path=path
    )


def _npz_array(archive: zipfile.ZipFile, key: str, path: Path) -> NDArray[Any]:
    member = archive.getinfo(f"{key}.npy")
    check_claim(member.file_size, member.compress_size, path=path, what=f"array {key!r}")
    check_memory(member.file_size, path=path, what=f"array {key!r}")
    with archive.open(member) as file:
        values: NDArray[Any] = np.lib.format.read_array(
            file, allow_pickle=False, max_header_size=_LARGEST_HEADER
        )
    return values


def _pf32_metadata(
    clock: Mapping[str, Any], settings: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
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
    """Write histograms as `hist`, with `axes` and all metadata as texts."""
    from lightflight.store import atomic_path

    if not isinstance(record, Histograms):
        raise ValueError(
            "npz holds histograms: use histogram() first, or write .h5 to keep photons"
        )
    text = text_from_histograms(record)
    save = np.savez_compressed if compress else np.savez
    with atomic_path(path) as fresh, fresh.open("wb") as file:
        save(file, hist=record.counts, axes=np.array("yxt"), lightflight=np.array(text))


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
