"""The one way to compile a kernel: cached on disk where possible, quietly without elsewhere.

Kernels are serial and release the interpreter lock; whoever calls them owns the threads.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def _stamp_of_kernels() -> tuple[int, int]:
    """Newest change and total size of all kernel files."""
    files = [path.stat() for path in Path(__file__).parent.glob("*.py")]
    return max(file.st_mtime_ns for file in files), sum(file.st_size for file in files)


_STAMP = _stamp_of_kernels()


_OPTIONS: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "_nrt": True,
}  # fmt: skip
"""IEEE division; multiplications and additions may be fused (one rounding instead of two)."""


def jit(function: F) -> F:
    """`numba.njit(cache=True, nogil=True)`, or the same without cache.

    Numba refuses to decorate a cached function where neither the package's folder nor the
    user's cache folder can be written (a read-only install, a locked-down cluster node): the
    kernel is then compiled once per process. Types are found at the first call, never here.

    Numba recompiles where the function's own file has changed, but not where a kernel it calls
    has: every kernel therefore gets the stamp of all kernel files.
    """
    return _compiled(function, _OPTIONS)


def jit_lent(function: F) -> F:
    """Like `jit`, for kernels that make no array and return none: theirs are lent by the caller.

    Numba counts the holders of an array each time it is sliced or passed on, by atomic
    operations: two fifths of the time of a short fit. Here nothing is counted.
    """
    return _compiled(function, {**_OPTIONS, "_nrt": False})


def jit_inlined(function: F) -> F:
    """Like `jit_lent`, compiled into its callers: for short pieces with many arrays."""
    return _compiled(function, {**_OPTIONS, "_nrt": False, "forceinline": True})


def jit_reordered(function: F) -> F:
    """Like `jit_lent`, for sums, least and largest of many floats, none NaN, in any order."""
    in_any_order = {"contract", "reassoc", "nnan", "nsz"}
    return _compiled(function, {**_OPTIONS, "_nrt": False, "fastmath": in_any_order})


def _compiled(function: F, options: dict[str, Any]) -> F:
    try:
        compiled = numba.njit(cache=True, **options)(function)
    except RuntimeError:
        compiled = numba.njit(cache=False, **options)(function)
    index: Any = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if hasattr(index, "_source_stamp"):
        index._source_stamp = _STAMP
    return cast(F, compiled)
