"""Any file or folder, written so that it appears whole or not at all: `atomic_path`.

Knows nothing of what is written.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from lightflight.files.litter import maker, sweep

# Of renameat2(2): paths from the current folder on, and "exchange".
_HERE, _EXCHANGE = -100, 2
_DISK_ERRORS = {errno.ENOSPC, errno.EFBIG, errno.EIO, getattr(errno, "EDQUOT", errno.ENOSPC)}


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str], *, directory: bool = False) -> Iterator[Path]:
    """Give a path to write to that takes the place of `path` only when all went well.

    The new file is written beside the old one, flushed to the disk and renamed over it. After
    an exception, a full disk or Ctrl-C nothing of it remains, and an old file stays as it was.

    Parameters
    ----------
    path : path
        Where the file shall appear. A symbolic link is followed, unless somebody else put it into
        a folder for all (/tmp).
    directory : bool
        Write a folder (Zarr) instead of a file. An old folder is moved aside first, and moved
        back if the new one cannot take its place.

    Yields
    ------
    pathlib.Path
        An empty file (or folder) in the same folder, with the suffix of `path`, since many
        writers look at it.

    Raises
    ------
    OSError
        If the folder of `path` is missing or cannot be written, if `path` exists and is not a
        regular file (or not a folder), leads through somebody else's link, or if the disk is full.
    """
    _refuse_planted_links(Path(path).absolute())
    # A link stays a link: what it points at is replaced.
    target = Path(os.path.realpath(path))
    _check_target(target, directory=directory)
    fresh = _fresh_beside(target, directory=directory)
    try:
        yield fresh
        if directory:
            _replace_folder(fresh, target)
        else:
            # Renamed before its bytes are on the disk, a crash could leave an empty file of that
            # name.
            _flush_to_disk(fresh)
            fresh.chmod(_permissions_for(target, 0o666))
            fresh.replace(target)
    # Ctrl-C too: nothing half written may stay.
    except BaseException as error:
        _remove(fresh)
        code = error.errno if isinstance(error, OSError) else None
        if code is not None and code in _DISK_ERRORS:
            raise OSError(
                code,
                f"cannot write, {os.strerror(code)}: free some space or write elsewhere",
                os.fspath(path),
            ) from error
        raise
    # The name lies in the folder, and is on the disk once the folder is.
    _flush_to_disk(target.parent)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a page of text whole or not at all: UTF-8, its lines ending alike everywhere."""
    with atomic_path(path) as fresh:
        # What came from a name that is no UTF-8 must not stop the page.
        fresh.write_text(text, encoding="utf-8", errors="replace", newline="\n")


def _refuse_planted_links(path: Path) -> None:
    """Raise PermissionError where somebody else's link in a folder for all leads elsewhere.

    Linux refuses to open through such links, but not to rename over what they point at.
    """
    if os.name == "nt":
        return
    for part in (path, *path.parents):
        if part.is_symlink() and _is_planted(part.lstat(), part.parent.stat(), os.geteuid()):
            raise PermissionError(
                errno.EACCES,
                "is a link that somebody else put into a folder for all; nothing is written "
                "through it: choose another name",
                str(part),
            )


def _is_planted(link: os.stat_result, folder: os.stat_result, user: int) -> bool:
    """Whether a link in a folder like /tmp is neither the user's nor that of the folder's owner."""
    is_for_all = folder.st_mode & stat.S_ISVTX and folder.st_mode & stat.S_IWOTH
    return bool(is_for_all) and link.st_uid not in (user, folder.st_uid)


def _check_target(target: Path, *, directory: bool) -> None:
    """Raise OSError where nothing can take the place of `target`."""
    if not target.parent.is_dir():
        raise FileNotFoundError(
            errno.ENOENT, f"cannot write {target.name}: make its folder first", str(target.parent)
        )
    if not target.exists():
        return
    if directory and not target.is_dir():
        raise NotADirectoryError(
            errno.ENOTDIR, "cannot put a folder in place of a file: choose a new name", str(target)
        )
    if not directory and target.is_dir():
        raise IsADirectoryError(
            errno.EISDIR, "cannot put a file in place of a folder: choose a new name", str(target)
        )
    if not directory and not target.is_file():
        raise OSError(
            errno.EINVAL, "cannot write to a pipe or device: choose a regular file", str(target)
        )


def _fresh_beside(target: Path, *, directory: bool) -> Path:
    """An empty file or folder in the folder of `target`."""
    sweep(target.parent, ".lightflight-")
    if directory:
        return Path(tempfile.mkdtemp(target.suffix, f".lightflight-{maker()}-", target.parent))
    # In the folder of the target: within one file system a rename is whole or not at all.
    handle, name = tempfile.mkstemp(target.suffix, f".lightflight-{maker()}-", target.parent)
    os.close(handle)
    return Path(name)


def _permissions_for(target: Path, everything: int) -> int:
    """Permissions of what is replaced, or what the umask leaves of `everything`."""
    if target.exists():
        return stat.S_IMODE(target.stat().st_mode)
    # The umask can be read only by setting it.
    mask = os.umask(0)
    os.umask(mask)
    return everything & ~mask


def _flush_to_disk(path: Path) -> None:
    """Sync one file, or one folder where the system can (Windows and some networks cannot)."""
    is_folder = path.is_dir()
    if is_folder and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
    try:
        os.fsync(handle)
    except OSError as error:
        if not (is_folder and error.errno in (errno.EINVAL, errno.ENOTSUP)):
            raise
    finally:
        os.close(handle)


def _replace_folder(fresh: Path, target: Path) -> None:
    """Put one folder in the place of another; the old one comes back where that fails."""
    for folder, _, names in os.walk(fresh):
        for name in names:
            _flush_to_disk(Path(folder, name))
    fresh.chmod(_permissions_for(target, 0o777))
    if not target.exists():
        fresh.rename(target)
        return
    if _exchanged(fresh, target):
        _remove(fresh)  # the old one, now
        return
    # A folder cannot be renamed over one that holds files: the old one steps aside.
    aside = Path(tempfile.mkdtemp(target.suffix, f".lightflight-{maker()}-old-", target.parent))
    try:
        target.rename(aside / target.name)
        fresh.rename(target)
    except BaseException:
        if not target.exists():
            (aside / target.name).rename(target)
        raise
    finally:
        _remove(aside)


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two folders at once, where the system can; a crash finds the one or the other."""
    if sys.platform != "linux":
        return False
    import ctypes

    try:
        rename = ctypes.CDLL(None).renameat2
    except (OSError, AttributeError):  # a C library other than GNU's
        return False
    return int(rename(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE)) == 0


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
