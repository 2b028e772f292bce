"""Checks that come before a file is opened and before memory is taken for what it claims.

Used by `store` and by every reader in `formats`; each failure is one `FileFormatError`.
`readable_file`, `check_claim`, `check_memory` before; `damage_as_format_error` and
`record_error_as_format_error` around.
"""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from lightflight.errors import ConfigError, FileFormatError, LimitError

DEFLATE_MOST = 1100
"""Deflate shrinks at most 1032-fold."""

ANY_MOST = 33_000
"""Zstandard shrinks zeros 32,768-fold (four bytes for a block of 128 KiB), Blosc less."""

MEMORY_SHARE = 0.5
"""Share of the free memory that a file may claim, with the copies that follow."""

TRUSTED_SHARE = 0.95
"""The same for a file that the user trusts."""

_TRUST = "LIGHTFLIGHT_TRUST"

# What claims no more than this can do no harm.
_SMALL_BYTES = 1 << 16
# Windows tells neither /proc/meminfo nor sysconf.
_MEMORY_WHEN_UNKNOWN = 8 << 30


def readable_file(path: str | os.PathLike[str]) -> Path:
    """A path, after checking that it is a regular file with something in it.

    Parameters
    ----------
    path : path
        Any path.

    Returns
    -------
    Path
        The same.

    Raises
    ------
    FileFormatError
        If there is no such file, it is a folder, a pipe or a device, it is empty, or it may
        not be read.
    """
    file = Path(path)
    try:
        status = file.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise FileFormatError("there is no such file: check the name", path=path) from None
    except (OSError, ValueError) as error:
        raise FileFormatError(f"cannot be looked at: {_reason(error)}", path=path) from None
    if stat.S_ISDIR(status.st_mode):
        raise FileFormatError("is a folder, not a file: name a file in it", path=path)
    if not stat.S_ISREG(status.st_mode):
        raise FileFormatError("is a pipe or device: save it to a regular file first", path=path)
    if status.st_size == 0:
        raise FileFormatError("is empty: record or copy it again", path=path)
    try:
        with file.open("rb"):
            pass
    except OSError as error:
        raise FileFormatError(f"cannot be opened: {_reason(error)}", path=path) from None
    return file


def check_memory(n_bytes: int, *, path: str | os.PathLike[str], what: str) -> None:
    """Refuse what a file claims to hold when it would not fit into the free memory.

    Parameters
    ----------
    n_bytes : int
        Bytes that would be taken.
    path : path
        The file, for the message.
    what : str
        What would take them, for the message ("dataset counts (32, 32, 1024) uint16").

    Raises
    ------
    FileFormatError
        Where that is more than `allowed_memory_bytes`.
    """
    if n_bytes > allowed_memory_bytes():
        raise FileFormatError(
            f"{what} needs {n_bytes / 1e9:.3g} GB of memory, {memory_sentence()}", path=path
        )


def allowed_memory_bytes() -> int:
    """Bytes that what a file claims may take: half of the free memory, more where it is trusted."""
    share = TRUSTED_SHARE if is_trusted() else MEMORY_SHARE
    return int(share * free_memory_bytes())


def is_trusted() -> bool:
    """Whether the user believes what files claim (`trusting`)."""
    return os.environ.get(_TRUST) == "1"


def memory_sentence() -> str:
    """How much is free, and what to do, as the second half of a sentence."""
    free = f"{free_memory_bytes() / 1e9:.3g} GB are free"
    if is_trusted():
        return f"{free}: read it in parts, or on a larger machine"
    return (
        f"{free}, half of them for one file: it is damaged or hostile, or say --trust "
        "(trust=True) if it is neither, and else read it in parts"
    )


@contextlib.contextmanager
def trusting(trust: bool) -> Iterator[None]:
    """Believe what files claim meanwhile, in this process and in those it starts.

    Parameters
    ----------
    trust : bool
        False changes nothing.
    """
    before = os.environ.get(_TRUST)
    if trust:
        os.environ[_TRUST] = "1"
    try:
        yield
    finally:
        if trust:
            os.environ.pop(_TRUST)
        if before is not None:
            os.environ[_TRUST] = before


def check_claim(
    n_bytes: int,
    n_stored: int,
    *,
    path: str | os.PathLike[str],
    what: str,
    most: int = DEFLATE_MOST,
) -> None:
    """Refuse an array that claims more bytes than its stored ones can unpack to.

    Parameters
    ----------
    n_bytes : int
        Bytes claimed.
    n_stored : int
        Bytes stored.
    path : path
        The file, for the message.
    what : str
        What claims them, for the message.
    most : int
        Bytes one stored byte can become. Small arrays (64 KiB) are not looked at.

    Raises
    ------
    FileFormatError
        Where the claim cannot be.
    """
    if n_bytes > most * n_stored + _SMALL_BYTES:
        raise FileFormatError(
            f"{what} claims {n_bytes} bytes and stores {n_stored}: the file is damaged", path=path
        )


def free_memory_bytes() -> int:
    """Bytes of memory that can be taken without swapping.

    Returns
    -------
    int
        8 GiB where the system won't tell.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text("ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    with contextlib.suppress(OSError, ValueError, AttributeError):
        return int(os.sysconf("SC_PAGE_SIZE")) * int(os.sysconf("SC_PHYS_PAGES"))
    return _MEMORY_WHEN_UNKNOWN


@contextlib.contextmanager
def damage_as_format_error(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn whatever a library raises over a damaged file into one `FileFormatError`.

    Broad on purpose: on damaged input HDF5, zlib and the vendors' readers raise almost any
    exception. `FileFormatError`, `ConfigError` and `ImportError` pass unchanged.

    Parameters
    ----------
    path : path
        The file, for the message.
    """
    try:
        yield
    except (FileFormatError, ConfigError, ImportError, Warning):  # warnings may be made errors
        raise
    except MemoryError:
        raise  # of this machine, not of the file
    except Exception as error:
        raise FileFormatError(blame(error), path=path) from error


_LOCKED = ("unable to lock file", "resource temporarily unavailable")
_OF_DAMAGE = (ValueError, OSError, EOFError, KeyError, RuntimeError, OverflowError)


def blame(error: Exception) -> str:
    """What was wrong, in words: the file alone where that is sure, else all it may have been.

    Parameters
    ----------
    error : Exception
        What a reader raised.

    Returns
    -------
    str
        A sentence that goes on after the name of the file.
    """
    reason = _reason(error)
    if isinstance(error, LimitError):
        return f"is beyond a limit of this version, not damaged: {reason}"
    if isinstance(error, BlockingIOError) or any(word in str(error).lower() for word in _LOCKED):
        return "is locked: another program has it open; close it there, or wait"
    if isinstance(error, OSError) and error.errno is not None:
        return f"cannot be read ({reason}): see to the disk, the network or the permissions"
    if isinstance(error, _OF_DAMAGE) and not isinstance(
        error, NotImplementedError | RecursionError
    ):
        return f"cannot be read ({reason}): the file is damaged; copy or record it again"
    return (
        f"cannot be read ({type(error).__name__}: {reason}): a fault of lightflight or of a "
        "library, or the file is damaged; please report it if others read it"
    )


@contextlib.contextmanager
def record_error_as_format_error(path: str | os.PathLike[str]) -> Iterator[None]:
    """Name the file where a record refuses what was found in it; its sentence stays.

    Parameters
    ----------
    path : path
        The file, for the message.
    """
    try:
        yield
    except (FileFormatError, ConfigError):
        raise
    except (ValueError, TypeError) as error:
        raise FileFormatError(str(error), path=path) from error


def _reason(error: BaseException) -> str:
    """First line of an exception's text, short enough for a sentence."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    # Libraries put traces and advice of their own into further lines.
    lines = str(error).strip().splitlines()
    first = lines[0].strip() if lines else ""
    return (first[:117] + "...") if len(first) > 120 else first or type(error).__name__
