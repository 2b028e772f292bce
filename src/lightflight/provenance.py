"""How a result was made: versions, inputs, settings and seed, stored in every output file."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from lightflight._version import __version__

NUMERIC_PACKAGES = ("numpy", "scipy", "numba", "h5py")
"""The packages whose version can change a number in a result."""


def version_of(package: str) -> str | None:
    """Installed version of a distribution, without importing it.

    Parameters
    ----------
    package : str
        Its name in the index.

    Returns
    -------
    str or None
        None where it is missing.
    """
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def sha256_of_file(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file's bytes; read in pieces, so any size will do.

    Parameters
    ----------
    path : path
        A regular file.

    Returns
    -------
    str
        Hex digits.
    """
    with Path(path).open("rb") as file:
        # Recordings may be larger than memory.
        return hashlib.file_digest(file, "sha256").hexdigest()


def input_record(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Name, size and SHA-256 of one input file; its folder stays on the machine it lies on.

    Parameters
    ----------
    path : path
        Of a folder (Zarr): the SHA-256 of its files' names and SHA-256, in the order of their
        names.

    Returns
    -------
    dict of str
        name, bytes, sha256.

    Raises
    ------
    OSError
        Where it cannot be read.
    """
    file = Path(path)
    if not file.is_dir():
        return {"name": file.name, "bytes": file.stat().st_size, "sha256": sha256_of_file(file)}
    parts = sorted(part for part in file.rglob("*") if part.is_file())
    lines = [f"{sha256_of_file(part)}  {part.relative_to(file).as_posix()}\n" for part in parts]
    return {
        "name": file.name,
        "bytes": sum(part.stat().st_size for part in parts),
        "sha256": hashlib.sha256("".join(lines).encode()).hexdigest(),
    }


def provenance_record(
    *,
    command: str | None = None,
    inputs: Iterable[str | os.PathLike[str]] = (),
    settings: Mapping[str, Any] | None = None,
    seed: int | None = None,
) -> dict[str, Any]:
    """Everything needed to say how a result came to be; plain JSON types throughout.

    Parameters
    ----------
    command : str, optional
        The command or function that made the result.
    inputs : iterable of path
        Files it was made from; their names and SHA-256 are kept, not their folders.
    settings : mapping of str, optional
        The resolved set-up (see `lightflight.lab`); must be JSON-compatible.
    seed : int, optional
        The random seed, where one was used.

    Returns
    -------
    dict of str
        With the versions of Python, of this package and of `NUMERIC_PACKAGES`, and the date.

    Raises
    ------
    OSError
        Where an input cannot be read.
    """
    return {
        "lightflight": __version__,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "packages": {name: version_of(name) for name in NUMERIC_PACKAGES},
        "made_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": command,
        "inputs": [input_record(path) for path in inputs],
        "settings": dict(settings or {}),
        "seed": seed,
    }
