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

import logging
import os
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.core import event
from numba.extending import register_jitable

# Numba asks the current folder again before each compilation: see `elsewhere`.
numba.core.config._config_fname = os.devnull

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True,
    "fastmath": {"contract", "reassoc", "nsz"},
}  # fmt: skip
"""IEEE division; sums in any order, and fused with multiplications: both make them vectors."""

_KERNELS: set[Any] = set()


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
    kernel is then compiled once per process. Types are found at the first call, never here.
    """
    _KERNELS.add(function)
    try:
        return cast(F, numba.njit(cache=True, **_OPTIONS)(function))
    except RuntimeError:
        return cast(F, numba.njit(cache=False, **_OPTIONS)(function))


def piece(function: F) -> F:
    """Part of the kernels of its own file, compiled with them; plain Python where Python calls it.

    Cheaper than a kernel: it gets no wrapper of its own for Python, and no cache.
    """
    return register_jitable(**_OPTIONS)(function)
