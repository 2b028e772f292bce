"""Which format a file has, and who reads or writes it.

Content decides first, then the suffix, then `format=`; a name given there goes before both.
"""

from __future__ import annotations

import importlib
import inspect
import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from lightflight.config import unknown_name_sentence
from lightflight.errors import ConfigError, FileFormatError, LightflightWarning
from lightflight.filecheck import damage_as_format_error, readable_file
from lightflight.formats.clock import CLOCK_HINTS, checked_clock
from lightflight.histogram import Histograms
from lightflight.recording import Recording

ENTRY_POINT_GROUP = "lightflight.formats"

_START_BYTES = 4096
_MODULES: tuple[str, ...] = (
    "lightflight_hdf5",
    "photon_hdf5",
    "matlab",
    "numpy_files",
    "pf32_text",
    "ptu",
    "sdt",
    "zarr_cube",
    "hdf5_dataset",
    "pf32_frames",
    "spc",
    "tables",
)
"""Asked in this order: formats that know themselves by content before those that cannot."""


@dataclass(frozen=True)
class Format:
    """One file format.

    `read(path, clock, **hints)` gives a record; its keyword-only parameters are the hints the
    format knows, `clock` holds those of `clock.CLOCK_HINTS` that the user gave. `write(record,
    path, **options)` lets the file appear whole or not at all (`store.atomic_path`). Either
    may be None.
    """

    name: str
    """Short name, for `format=`."""

    summary: str
    """One line for the documentation."""

    suffixes: tuple[str, ...]
    """Suffixes in lower case, with the dot; also double ones (".txt.gz")."""

    matches: Callable[[Path, bytes], bool]
    """True where the content (path, first 4096 bytes; none for a folder) is surely this."""

    read: Callable[..., Recording | Histograms] | None = None
    """Reader, see above."""

    write: Callable[..., None] | None = None
    """Writer, see above."""

    @property
    def hints(self) -> tuple[str, ...]:
        """Names of the hints `read` knows, those about the clock included."""
        return (*_options_of(self.read), *CLOCK_HINTS) if self.read else ()

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options `write` knows."""
        return _options_of(self.write) if self.write else ()


def _options_of(function: Callable[..., Any]) -> tuple[str, ...]:
    parameters = inspect.signature(function).parameters.values()
    return tuple(p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY)


@cache
def known_formats() -> tuple[Format, ...]:
    """All formats: our own, then those of installed plug-ins."""
    return (*own_formats(), *_plugged_in_formats())


def own_formats() -> tuple[Format, ...]:
    """The formats of this package, in the order they are asked in."""
    modules = [importlib.import_module(f"lightflight.formats.{name}") for name in _MODULES]
    return tuple(file_format for module in modules for file_format in module.FORMATS)


def _plugged_in_formats() -> list[Format]:
    found = []
    for point in entry_points(group=ENTRY_POINT_GROUP):
        try:
            plugged = point.load()
        except Exception as error:  # noqa: BLE001  (whatever a stranger's package does wrong)
            _warn_of_plugin(point.name, f"cannot be loaded ({error})")
            continue
        if isinstance(plugged, Format):
            found.append(plugged)
        else:
            _warn_of_plugin(point.name, f"is a {type(plugged).__name__}, not a Format")
    return found


def _warn_of_plugin(name: str, what: str) -> None:
    warnings.warn(
        f"format plug-in {name!r} {what}: it is left out", LightflightWarning, stacklevel=2
    )


# --- reading ----------------------------------------------------------------------------


def read_file(path: str | os.PathLike[str], hints: Mapping[str, Any]) -> Recording | Histograms:
    """See `lightflight.recording.read`."""
    hints = dict(hints)
    name = hints.pop("format", None)
    start = b"" if Path(path).is_dir() else _start_of(readable_file(path))
    file_format = _format_by_name(name) if name is not None else _format_of(Path(path), start)
    if file_format.read is None:
        raise FileFormatError(f"{file_format.name} files can be written, not read", path=path)
    for hint in hints:
        if hint not in file_format.hints:
            guess = unknown_name_sentence(hint, ("format", *file_format.hints))
            raise ConfigError(f"unknown hint {hint!r} for a {file_format.name} file: {guess}")
    clock = checked_clock({key: hints.pop(key) for key in CLOCK_HINTS if key in hints})
    with damage_as_format_error(path):
        return file_format.read(Path(path), clock, **hints)


def _start_of(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_START_BYTES)


def _format_by_name(name: str) -> Format:
    for file_format in known_formats():
        if file_format.name == name:
            return file_format
    names = [file_format.name for file_format in known_formats()]
    raise ConfigError(f"unknown format {name!r}: {unknown_name_sentence(str(name), names)}")


def _format_of(path: Path, start: bytes) -> Format:
    readers = [file_format for file_format in known_formats() if file_format.read]
    for file_format in readers:
        if _matches(file_format, path, start):
            return file_format
    by_suffix = _format_by_suffix(path, readers)
    if by_suffix is not None and not path.is_dir():
        return by_suffix
    if path.is_dir():
        raise FileFormatError("is a folder, and no Zarr array: name a file in it", path=path)
    names = ", ".join(file_format.name for file_format in readers)
    raise FileFormatError(
        f"is of no known format (it starts with {start[:8]!r}): say which with format= ({names})",
        path=path,
    )


def _format_by_suffix(path: Path, formats: Iterable[Format]) -> Format | None:
    """Format with the longest suffix that `path` ends in (".photon.h5" before ".h5")."""
    name = path.name.lower()
    fitting = [
        (len(suffix), file_format)
        for file_format in formats
        for suffix in file_format.suffixes
        if name.endswith(suffix)
    ]
    return max(fitting, key=lambda pair: pair[0])[1] if fitting else None


def _matches(file_format: Format, path: Path, start: bytes) -> bool:
    """A format that stumbles over the content does not recognise it; its reader will say why."""
    try:
        return file_format.matches(path, start)
    except Exception:  # noqa: BLE001
        return False


# --- writing ----------------------------------------------------------------------------


def write_file(
    record: Recording | Histograms, path: str | os.PathLike[str], options: Mapping[str, Any]
) -> None:
    """See `lightflight.recording.write`."""
    if not isinstance(record, Recording | Histograms):
        raise TypeError(f"only a Recording or Histograms can be written, got {type(record)}")
    options = dict(options)
    name = options.pop("format", None)
    file_format = _format_by_name(name) if name is not None else format_to_write(Path(path))
    if file_format.write is None:
        raise ValueError(f"{file_format.name} files can be read, not written")
    for option in options:
        if option not in file_format.options:
            guess = unknown_name_sentence(option, ("format", *file_format.options))
            raise ConfigError(f"unknown option {option!r} for a {file_format.name} file: {guess}")
    file_format.write(record, Path(path), **options)


def format_to_write(path: Path) -> Format:
    """Format that the suffix of a new file asks for; ValueError where none does."""
    writers = [file_format for file_format in known_formats() if file_format.write]
    by_suffix = _format_by_suffix(path, writers)
    if by_suffix is not None:
        return by_suffix
    suffixes = ", ".join(suffix for writer in writers for suffix in writer.suffixes)
    raise ValueError(f"cannot tell the format of {path.name!r}: end its name in one of {suffixes}")
