"""What a killed process left behind, taken away by the next one that writes there.

Unfinished files and temporary folders carry their maker in the name: machine, process, and when
it started. Only what a dead process of this machine made is removed.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import os
import platform
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

_MAKER = re.compile(r"([0-9a-f]{8})-(\d+)-(\d+)-(old-)?")
_swept: set[Path] = set()


def maker() -> str:
    """Name part that tells which process made something: machine, number, start."""
    return f"{_machine()}-{os.getpid()}-{_started(os.getpid())}"


@functools.cache
def _machine() -> str:
    # Not by `socket`: a reader asks for this, and has no business with a network.
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def _started(process: int) -> int:
    """When a process started, in ticks since the machine did; 0 where that cannot be told."""
    try:
        line = Path(f"/proc/{process}/stat").read_bytes()
        # The second field is the program's name, which may hold anything.
        return int(line.rpartition(b")")[2].split()[19])
    except (OSError, ValueError, IndexError):
        return 0


def _is_dead(machine: str, process: int, started: int) -> bool:
    """Whether the maker of a name was a process of this machine that is no more."""
    if machine != _machine() or os.name == "nt":
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    # Another process may have its number now.
    return started != 0 and _started(process) not in (0, started)


def sweep(folder: Path, prefix: str) -> None:
    """Remove what dead processes left in a folder; looked at once by each process.

    Parameters
    ----------
    folder : Path
        Where to look.
    prefix : str
        How their names start.
    """
    if folder in _swept:
        return
    _swept.add(folder)
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(folder)):
            found = _MAKER.match(entry.name, len(prefix)) if entry.name.startswith(prefix) else None
            if found and _is_dead(found[1], int(found[2]), int(found[3])):
                _take_away(Path(entry.path), folder, holds_old=found[4] is not None)


def _take_away(path: Path, folder: Path, *, holds_old: bool) -> None:
    """Remove a file or folder; an old folder that nothing has replaced goes back to its place."""
    with contextlib.suppress(OSError):
        if path.is_symlink() or path.lstat().st_uid != os.geteuid():
            return
        for old in path.iterdir() if holds_old else ():
            if not (folder / old.name).exists():
                old.rename(folder / old.name)
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder for the time of the block; what killed processes left is removed first.

    Yields
    ------
    Path
        Empty; nobody else may look into it.
    """
    sweep(Path(tempfile.gettempdir()), "lightflight-")
    with tempfile.TemporaryDirectory(
        prefix=f"lightflight-{maker()}-", ignore_cleanup_errors=True
    ) as folder:
        yield Path(folder)


@functools.cache
def folder_of_process() -> Path:
    """A folder for as long as this process runs; a killed one's is removed by the next.

    Returns
    -------
    Path
        The same for every call; nobody else may look into it.
    """
    sweep(Path(tempfile.gettempdir()), "lightflight-")
    folder = tempfile.mkdtemp(prefix=f"lightflight-{maker()}-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)
