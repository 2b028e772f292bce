"""Tables for other programs, CSV and Parquet; each file appears whole or not at all."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from types import ModuleType
from typing import TYPE_CHECKING

from lightflight.errors import optional_package
from lightflight.files.whole_file import atomic_path

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_WITHOUT_PYARROW = (
    'Parquet needs pyarrow, which is not installed: pip install "lightflight[batch]", '
    "or write a .csv"
)


def pyarrow() -> ModuleType:
    """The package `pyarrow`.

    Raises
    ------
    MissingExtraError
        Where it is not installed.
    """
    return optional_package("pyarrow", _WITHOUT_PYARROW)


def write_csv(
    names: Sequence[str], rows: Iterable[Iterable[str]], file: str | os.PathLike[str]
) -> None:
    r"""Write text cells as CSV: one header line, lines end in \r\n (RFC 4180), UTF-8.

    Parameters
    ----------
    names : sequence of str
        Of the columns.
    rows : iterable of iterables of str
        Cells, in the order of `names`. Texts that a spreadsheet would run start with an apostrophe.
    file : path
        Where to.
    """
    with atomic_path(file) as fresh, fresh.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(names)
        writer.writerows([_harmless(cell) for cell in row] for row in rows)


_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
_NUMBER = re.compile(
    r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?( [^\W\d_]{1,4}| ?[%°])?|[+-]?(inf|nan)"
)
"""A number, with a unit or without: "-4 deg" is a name that calls nothing."""


def _harmless(cell: str) -> str:
    """A cell that no spreadsheet runs: a text that starts like a formula gets an apostrophe."""
    if not cell.startswith(_FORMULA_STARTS) or _NUMBER.fullmatch(cell):
        return cell
    return f"'{cell}"


def write_parquet(
    blocks: Iterable[Mapping[str, ArrayLike]], file: str | os.PathLike[str], *, about: str = ""
) -> None:
    """Write a table as Parquet, part after part.

    Parameters
    ----------
    blocks : iterable of mappings
        Columns by name, arrays of one length in a block; at least one block, and the same names
        and types in each.
    file : path
        Where to.
    about : str, optional
        JSON that goes into the file's metadata under the key "lightflight".

    Raises
    ------
    MissingExtraError
        Without pyarrow.
    """
    pa, pq = pyarrow(), optional_package("pyarrow.parquet", _WITHOUT_PYARROW)
    with atomic_path(file) as fresh, ExitStack() as stack:
        writer = None
        for columns in blocks:
            table = pa.table(dict(columns))
            if about:
                table = table.replace_schema_metadata({"lightflight": about})
            # The columns' types are known with the first block only.
            writer = writer or stack.enter_context(pq.ParquetWriter(fresh, table.schema))
            writer.write_table(table)
