"""Names that a package loads when they are first used (PEP 562), so that importing it is free."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Mapping
from typing import Any


def lazy_names(
    package: str,
    names_of: Mapping[str, tuple[str, ...]],
    *,
    moved: Mapping[str, str] | None = None,
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package, from the modules its names live in.

    Parameters
    ----------
    package : str
        `__name__` of the package.
    names_of : mapping of str to tuple of str
        Modules, and the public names that each defines.
    moved : mapping of str to str, optional
        Names that this package had once, and the modules where they are now: they still work,
        with a DeprecationWarning, and are not listed.

    Returns
    -------
    get : callable
        Loads a name; AttributeError where the package has none such.
    directory : callable
        The public names, sorted.
    names : list of str
        The same.
    """
    homes = {name: module for module, names in names_of.items() for name in names}
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

    return get, lambda: sorted(homes), sorted(homes)
