"""The one way to compile a kernel: cached on disk where possible, quietly without elsewhere.

Kernels are serial and release the interpreter lock; whoever calls them owns the threads. What a
newcomer's first command waits for is their compilation, each function 0.1 s and more. Hence:

- few kernels, each of few lines; what is not done for every pixel is NumPy;
- all pieces of a kernel stand in its own file: Numba compiles again where that has changed, and
  looks at no other;
- room to work in comes from the caller: `np.empty` alone compiles three functions;
- who listens to the logger `lightflight` is told what is waited for.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import event
from numba.extending import register_jitable

# Numba asks the current folder again before each compilation: see `elsewhere`.
numba.core.config._config_fname = os.devnull

F = TypeVar("F", bound=Callable[..., object])

_OPTIONS: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True,
    "fastmath": {"contract", "reassoc", "nsz"},
}  # fmt: skip
"""IEEE division; sums in any order, and fused with multiplications: both make them vectors."""

_KERNELS: set[Callable[..., object]] = set()


class _Announcer(event.Listener):
    """Say which kernel is compiled, while it is."""

    def on_start(self, event: event.Event) -> None:
        kernel = event.data["dispatcher"].py_func
        if kernel in _KERNELS:
            logging.getLogger("lightflight").info(
                "compiling %s (some seconds; only the first time, the result is kept) ...",
                kernel.__name__,
            )

    def on_end(self, event: event.Event) -> None:
        pass


event.register("numba:compile", _Announcer())


def jit(function: F) -> F:
    """`numba.njit(cache=True, nogil=True)`, or the same without cache.

    Numba refuses to decorate a cached function where neither the package's folder nor the
    user's cache folder can be written (a read-only install, a locked-down cluster node): the
    kernel is then compiled once per process, and so it is where others can write there, for
    what is kept is code. Types are found at the first call, never here.
    """
    _KERNELS.add(function)
    with contextlib.suppress(RuntimeError):
        kept = numba.njit(cache=True, **_OPTIONS)(function)
        if _is_ours(kept.stats.cache_path, function.__code__.co_filename):
            return cast(F, kept)
    return cast(F, numba.njit(cache=False, **_OPTIONS)(function))


@functools.cache
def _is_ours(folder: str, source: str) -> bool:
    """Whether nobody may write there but us, the administrator and who owns the package."""
    if not hasattr(os, "geteuid"):  # Windows
        return True
    trusted = {0, os.geteuid(), Path(source).stat().st_uid}
    named: str = getattr(numba.config, "CACHE_DIR", "")
    for place in {folder, named or folder}:
        status = Path(place).stat()
        # A sticky folder for all (`/tmp`) may hold a folder of ours, and nothing else that is kept.
        is_open = bool(status.st_mode & stat.S_IWOTH)
        is_sticky = place != folder and bool(status.st_mode & stat.S_ISVTX)
        if status.st_uid not in trusted or (is_open and not is_sticky):
            logging.getLogger("lightflight").warning(
                "compiled kernels are not kept: other users can write to %s; name a folder of your "
                "own in NUMBA_CACHE_DIR",
                place,
            )
            return False
    return True


def piece(function: F) -> F:
    """Part of the kernels of its own file, compiled with them; plain Python where Python calls it.

    Cheaper than a kernel: it gets no wrapper of its own for Python, and no cache.
    """
    return register_jitable(**_OPTIONS)(function)
