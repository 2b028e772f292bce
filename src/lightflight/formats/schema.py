"""The layout of our own HDF5 files, as data (`schema.toml`), and files held against it."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

from lightflight.errors import FileFormatError
from lightflight.recording.recording import SlicedArray


@cache
def file_schema() -> dict[str, Any]:
    """The contents of `schema.toml`, read once.

    Returns
    -------
    dict of str
        By kind of record ("histograms", "recording"): what its arrays and attributes are.
    """
    text = resources.files("lightflight.formats").joinpath("schema.toml").read_text("utf-8")
    return tomllib.loads(text)


def check_arrays(
    kind: str, arrays: Mapping[str, SlicedArray], *, path: str | os.PathLike[str]
) -> None:
    """Hold the arrays of a file against the schema of its kind.

    Parameters
    ----------
    kind : str
        "histograms" or "recording".
    arrays : mapping of str to array
        Anything with a shape and a dtype.
    path : path
        The file, for the message.

    Raises
    ------
    FileFormatError
        If an array is missing, unknown, of another type or number of axes, or if two lengths
        that must agree do not.
    """
    known = file_schema()[kind]["arrays"]
    lengths: dict[str, tuple[int, str]] = {}
    for name, rule in known.items():
        if rule.get("required") and name not in arrays:
            raise FileFormatError(f"holds no {name}: the file is damaged", path=path)
    for name, array in arrays.items():
        if name not in known:
            raise FileFormatError(
                f"holds an unknown array {name!r}: upgrade lightflight", path=path
            )
        rule = known[name]
        if array.dtype.kind not in rule["types"] or len(array.shape) != len(rule["shape"]):
            wanted, found = ", ".join(rule["shape"]), tuple(array.shape)
            raise FileFormatError(
                f"array {name!r} is {array.dtype} {found}, not ({wanted}): the file is damaged",
                path=path,
            )
        for label, length in zip(rule["shape"], array.shape, strict=True):
            other, where = lengths.setdefault(label, (length, name))
            if other != length:
                raise FileFormatError(
                    f"arrays {where!r} and {name!r} disagree on the number of {label}, {other} and "
                    f"{length}: the file is damaged",
                    path=path,
                )
