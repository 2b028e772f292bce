"""Readers of others, run in a process of their own.

A vendor's reader that meets a damaged or hostile file may hang, crash or take all memory. Here
it does so in a child process with a time limit and a memory limit, and the caller gets one
`FileFormatError`. The reader's function takes the path and keyword arguments and returns
(arrays, values): named NumPy arrays and whatever JSON can say. It runs when the module is
started as `python -m lightflight.formats.isolation`.
"""

from __future__ import annotations

import importlib
import json
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import FileFormatError, MissingExtraError
from lightflight.files.children import run_module
from lightflight.files.filecheck import DEFLATE_MOST, allowed_memory_bytes, blame
from lightflight.files.litter import temporary_folder

TIME_LIMIT_S = 60.0
"""Seconds a reader may take for a small file; large ones get a second per megabyte more."""

_CPU_LIMIT_S = 25
"""Of a processor it may take less than by the clock: who hangs, works; who waits, does not."""

_LIBRARIES_BYTES = 1 << 30
_EMPTY_CUBE_BYTES = 2 << 30
"""Room for the cube of an image with hardly a photon in it, whose file is small."""

_BYTES_PER_S = 1e6
_REFUSED, _MISSING = 3, 4


def run_isolated(
    function: str, path: Path, arguments: Mapping[str, object]
) -> tuple[dict[str, NDArray[np.generic]], dict[str, Any]]:
    """Call `function` ("module:name") on a file in a child process.

    Returns
    -------
    arrays : dict of str to array
    values : dict
        What the function returned.

    Raises
    ------
    FileFormatError
        If the reader refuses the file, crashes, hangs or runs out of memory.
    MissingExtraError
        If the reader is not installed.
    """
    with temporary_folder() as folder:
        limit = TIME_LIMIT_S + path.stat().st_size / _BYTES_PER_S
        try:
            done = run_module(
                __name__,
                [function, str(path.resolve()), str(folder)],
                told=json.dumps(dict(arguments)),
                time_limit_s=limit,
            )
        except subprocess.TimeoutExpired:
            raise FileFormatError(
                f"its reader did not finish in {limit:.0f} s: the file is damaged, or this machine "
                "has too much to do",
                path=path,
            ) from None
        # What a library prints stands before the sentence that `_main` writes last.
        last_line = (done.stderr.strip().splitlines() or [""])[-1]
        if done.returncode == _MISSING:
            raise MissingExtraError(last_line)
        if done.returncode == _REFUSED:
            raise FileFormatError(last_line, path=path)
        if done.returncode == -getattr(signal, "SIGXCPU", 24):
            raise FileFormatError(
                f"its reader did not finish in {_cpu_limit_s(path)} s of a processor: the file is "
                "damaged",
                path=path,
            )
        if done.returncode != 0:
            raise FileFormatError(_why_it_ended(done.returncode), path=path)
        values = json.loads((folder / "values.json").read_text("utf-8"))
        return _arrays_in(folder), values


def _why_it_ended(code: int) -> str:
    """In words, why a child did not come to its end."""
    if code == -getattr(signal, "SIGKILL", 9):
        return "its reader was ended from outside, as the system does for want of memory: try again"
    return f"its reader crashed (exit code {code}): the file is damaged, or the reader is at fault"


def _arrays_in(folder: Path) -> dict[str, NDArray[np.generic]]:
    """Arrays that a child has left, closed to writing: records take such without a copy."""
    arrays = {file.stem: np.load(file, allow_pickle=False) for file in folder.glob("*.npy")}
    for array in arrays.values():
        array.setflags(write=False)
    return arrays


def _cpu_limit_s(path: Path) -> int:
    """Seconds of a processor that the reader of a file may take."""
    return _CPU_LIMIT_S + int(path.stat().st_size / _BYTES_PER_S)


def _limit_time_and_memory(path: Path) -> None:
    """Bound what may be taken: by the free memory, and by what so small a file can hold."""
    try:
        import resource
    except ImportError:  # not on Windows
        return
    unpacked = _EMPTY_CUBE_BYTES + DEFLATE_MOST * path.stat().st_size
    # A header can claim any size; what a file can hold is bounded by its own.
    limit = min(allowed_memory_bytes(), unpacked) + _LIBRARIES_BYTES
    # The hard limit of an administrator may be lower, and cannot be raised.
    for kind, most in ((resource.RLIMIT_AS, limit), (resource.RLIMIT_CPU, _cpu_limit_s(path))):
        _, hard = resource.getrlimit(kind)
        if hard == resource.RLIM_INFINITY or most < hard:
            resource.setrlimit(kind, (most, hard))


def _main(function: str, path: str, folder: str) -> int:
    module, _, name = function.partition(":")
    arguments = json.loads(sys.stdin.read())
    _limit_time_and_memory(Path(path))
    try:
        arrays, values = getattr(importlib.import_module(module), name)(Path(path), **arguments)
    except ImportError as error:
        sys.stderr.write(f"{error}\n")
        return _MISSING
    except FileFormatError as error:
        sys.stderr.write(f"{error}\n")
        return _REFUSED
    except MemoryError:
        sys.stderr.write(
            "cannot be read: it claims more than a file of its size can hold, or than is free "
            "(the file is damaged, or memory is short)\n"
        )
        return _REFUSED
    except Exception as error:  # noqa: BLE001  (whatever the reader of others raises)
        sys.stderr.write(f"{blame(error)}\n")
        return _REFUSED
    try:
        for key, array in arrays.items():
            np.save(Path(folder, f"{key}.npy"), array, allow_pickle=False)
        Path(folder, "values.json").write_text(json.dumps(values), "utf-8")
    except OSError as error:
        sys.stderr.write(f"was read, but not passed on: {folder}: {error.strerror}\n")
        return _REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(_main(*sys.argv[1:]))
