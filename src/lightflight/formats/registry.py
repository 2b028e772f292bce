"""`read` and `write`: which format a file has, and who reads or writes it.

Content decides first, then the suffix, then `format=`; a name given there goes before both.
"""

from __future__ import annotations

import importlib
import inspect
import os
import pkgutil
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from lightflight.arguments import shown
from lightflight.errors import ConfigError, FileFormatError, LightflightWarning
from lightflight.files.filecheck import damage_as_format_error, readable_file, trusting
from lightflight.files.toml_tables import unknown_name_sentence
from lightflight.formats.clock import CLOCK_HINTS, checked_clock
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

ENTRY_POINT_GROUP = "lightflight.formats"

_START_BYTES = 4096


@dataclass(frozen=True)
class Format:
    """One file format.

    `read(path, clock, **hints)` gives a record; its keyword-only parameters are the hints the
    format knows, `clock` holds those of `clock.CLOCK_HINTS` that the user gave. `write(record,
    path, **options)` lets the file appear whole or not at all (`store.atomic_path`). Either
    may be None.

    Attributes
    ----------
    name : str
        Short name, for `format=`.
    summary : str
        One line for the documentation.
    suffixes : tuple of str
        Suffixes in lower case, with the dot; also double ones (".txt.gz").
    matches : Callable[[Path, bytes], bool] or None
        True where the content (path, first 4096 bytes; none for a folder) is surely this. None:
        nothing in the content tells.
    read : Callable[..., Recording or Histograms] or None
        Reader, see above.
    write : Callable[..., None] or None
        Writer, see above.
    turn : int
        Orders those that know their content: below 0 before all others (a kind of HDF5), above 0
        after them (any HDF5).
    """

    name: str

    summary: str

    suffixes: tuple[str, ...]

    matches: Callable[[Path, bytes], bool] | None

    read: Callable[..., Recording | Histograms] | None = None

    write: Callable[..., None] | None = None

    turn: int = field(default=0, kw_only=True)

    @property
    def hints(self) -> tuple[str, ...]:
        """Names of the hints `read` knows, those about the clock included."""
        return (*_options_of(self.read), *CLOCK_HINTS) if self.read else ()

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options `write` knows."""
        return _options_of(self.write) if self.write else ()


def _options_of(function: Callable[..., object]) -> tuple[str, ...]:
    """Names of the keyword-only parameters of a function."""
    parameters = inspect.signature(function).parameters.values()
    return tuple(p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY)


@cache
def known_formats() -> tuple[Format, ...]:
    """All formats: our own, then those of installed plug-ins."""
    return (*own_formats(), *_plugged_in_formats())


def own_formats() -> tuple[Format, ...]:
    """The formats of this package, in the order they are asked in: `FORMATS` of its modules."""
    package = importlib.import_module("lightflight.formats")
    found: list[Format] = []
    for file in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        found += getattr(importlib.import_module(file.name), "FORMATS", ())
    return tuple(sorted(found, key=_place))


def _place(file_format: Format) -> tuple[bool, bool, int, str]:
    """What can be read goes first, of that what knows its content; then by `turn` and name."""
    return file_format.read is None, file_format.matches is None, file_format.turn, file_format.name


def _plugged_in_formats() -> list[Format]:
    """Formats of installed plug-ins; one that is broken costs a warning, nothing else."""
    found = []
    for point in entry_points(group=ENTRY_POINT_GROUP):
        try:
            # Nothing of a plug-in runs before a file is read or written.
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


def read(path: str | os.PathLike[str], **hints: Any) -> Recording | Histograms:
    """Read a recording or histograms from a file of any known format.

    The format is recognised by content first, then by suffix. Large recordings stay on disk
    and are streamed by `histogram`.

    Parameters
    ----------
    path : path
        File (or Zarr folder) to read.
    **hints : object
        What the file does not say; each format lists its own (docs/reference/formats.md). Common
        to all: trust (True: believe what the file claims, up to nearly all of the free memory),
        format, bin_width_ps, laser_period_ps, reversed_codes, first_edge_ps,
        no_photon_code, n_frames, periods_per_frame, poisson. Arrays of unknown order take axes
        ("tyx").

    Returns
    -------
    Recording or Histograms
        Whichever the file holds.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, truncated, foreign, damaged or not understood.
    ConfigError
        If a hint is unknown to the format (the text names the nearest valid one) or is none.
    MissingExtraError
        If the format needs a package that is not installed.
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path cannot be {shown(path)}: give the name of a file")
    try:
        is_folder = Path(path).is_dir()
    except OSError:
        is_folder = False  # its name is too long: told as of a file
    name, trust = hints.pop("format", None), bool(hints.pop("trust", False))
    start = b"" if is_folder else _start_of(readable_file(path))
    file_format = _format_by_name(name) if name is not None else _format_of(Path(path), start)
    if file_format.read is None:
        raise FileFormatError(f"{file_format.name} files can be written, not read", path=path)
    for hint in hints:
        if hint not in file_format.hints:
            guess = unknown_name_sentence(hint, ("format", *file_format.hints))
            raise ConfigError(
                f"{path}: unknown hint {hint!r} for a {file_format.name} file: {guess}"
            )
    clock = checked_clock({key: hints.pop(key) for key in CLOCK_HINTS if key in hints})
    with trusting(trust), damage_as_format_error(path):
        return file_format.read(Path(path), clock, **hints)


def _start_of(path: Path) -> bytes:
    """First bytes of a file, by which formats know it."""
    with path.open("rb") as file:
        return file.read(_START_BYTES)


def _format_by_name(name: str) -> Format:
    """Format that `format=` names."""
    for file_format in known_formats():
        if file_format.name == name:
            return file_format
    names = [file_format.name for file_format in known_formats()]
    raise ConfigError(f"unknown format {name!r}: {unknown_name_sentence(str(name), names)}")


def _format_of(path: Path, start: bytes) -> Format:
    """Format of a file by its content, else by its suffix."""
    readers = [file_format for file_format in known_formats() if file_format.read]
    for file_format in readers:
        if _matches(file_format, path, start):
            return file_format
    by_suffix = _format_by_suffix(path, readers)
    # A suffix may be wrong: it decides only where no content did.
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
        return file_format.matches is not None and file_format.matches(path, start)
    except Exception:  # noqa: BLE001
        return False


# --- writing ----------------------------------------------------------------------------


def write(record: Recording | Histograms, path: str | os.PathLike[str], **options: Any) -> None:
    """Write a recording or histograms; the format follows from the suffix, or `format`.

    The file appears whole or not at all, and an existing one is replaced only at the end.

    Parameters
    ----------
    record : Recording or Histograms
        What to keep; not every format can hold both.
    path : path
        File (or Zarr folder) to write.
    **options : object
        `format`, and what the format takes (docs/reference/formats.md).

    Raises
    ------
    ValueError
        If no format has this suffix, or the format cannot hold such a record.
    TypeError
        If it is neither of the two.
    ConfigError
        If an option is unknown to the format.
    OSError
        If the file cannot be written.
    """
    if not isinstance(record, Recording | Histograms):
        raise TypeError(f"only a Recording or Histograms can be written, got {type(record)}")
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
    """Format that the suffix of a new file asks for.

    Parameters
    ----------
    path : Path
        Nothing need be there.

    Returns
    -------
    Format
        One that can be written.

    Raises
    ------
    ValueError
        Where no format has this suffix.
    """
    writers = [file_format for file_format in known_formats() if file_format.write]
    by_suffix = _format_by_suffix(path, writers)
    if by_suffix is not None:
        return by_suffix
    suffixes = ", ".join(suffix for writer in writers for suffix in writer.suffixes)
    raise ValueError(f"cannot tell the format of {path.name!r}: end its name in one of {suffixes}")
