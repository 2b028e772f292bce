"""Names that a package loads when they are first used (PEP 562), so that importing it is free."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Mapping
from typing import Any


def lazy_names(
    package: str, homes: Mapping[str, str], *, moved: Mapping[str, str] | None = None
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package, from the modules its names live in.

    Parameters
    ----------
    package : str
        `__name__` of the package.
    homes : mapping of str to str
        Public name to the module that defines it.
    moved : mapping of str to str, optional
        Names that this package had once, and the modules where they are now: they still work,
        with a DeprecationWarning, and are not listed.

    Returns
    -------
    get : callable
        Loads a name; AttributeError where the package has none such.
    names : callable
        The public names, sorted.
    """
    gone = moved or {}

    def get(name: str) -> Any:
        if name in homes:
            return getattr(importlib.import_module(homes[name]), name)
        if name in gone:
            warnings.warn(
                f"{package}.{name} has moved: import it from {gone[name]}",
                DeprecationWarning,
                stacklevel=2,
            )
            return getattr(importlib.import_module(gone[name]), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        return sorted(homes)

    return get, names
