"""Paths and figures as files that other programs read; they appear whole or not at all."""

from __future__ import annotations

import csv
import os
from typing import TYPE_CHECKING, Any

from lightflight.store import atomic_path

if TYPE_CHECKING:
    from lightflight.path import LightPath

_DIGITS = 9
"""Significant digits in text: a nanometre in a metre, a femtosecond in a microsecond."""


def write_csv(path: LightPath, file: str | os.PathLike[str], *, n: int = 1000) -> None:
    """Write `n` points of a path at equal event times as a table with one header line.

    Columns as in `LightPath.sample`, units in their names; unknown values are left empty.

    Raises
    ------
    OSError
        Where the file cannot be written; an old one stays as it was.
    """
    samples = path.sample(n)
    with atomic_path(file) as fresh, fresh.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(samples.dtype.names or ())
        writer.writerows([_text(value) for value in row.tolist()] for row in samples)


def _text(value: Any) -> str:
    if isinstance(value, bool | int):
        return str(int(value))
    return "" if value != value else f"{value:.{_DIGITS}g}"  # NaN alone differs from itself


def write_figure(figure: Any, file: str | os.PathLike[str], *, dpi: float = 200.0) -> None:
    """Write a Matplotlib figure in the format of the file's suffix (.png, .pdf, .svg)."""
    with atomic_path(file) as fresh:
        figure.savefig(fresh, dpi=dpi)
