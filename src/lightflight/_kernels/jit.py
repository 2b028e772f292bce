"""The one way to compile a kernel: cached on disk where possible, quietly without elsewhere.

Kernels are serial and release the interpreter lock; whoever calls them owns the threads.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def jit(function: F) -> F:
    """`numba.njit(cache=True, nogil=True)`, or the same without cache.

    Numba refuses to decorate a cached function where neither the package's folder nor the
    user's cache folder can be written (a read-only install, a locked-down cluster node): the
    kernel is then compiled once per process. Types are found at the first call, never here.
    """
    try:
        compiled = numba.njit(cache=True, nogil=True)(function)
    except RuntimeError:
        compiled = numba.njit(cache=False, nogil=True)(function)
    return cast(F, compiled)
