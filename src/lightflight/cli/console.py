"""How the commands tell what they found: tables, sentences and JSON on stdout."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from lightflight.files.json_values import json_value, without_numpy
from lightflight.files.names import harmless

if TYPE_CHECKING:
    from lightflight.path.verdict import Verdict

# --- numbers in words ----------------------------------------------------------------------


def with_error(value: float, std: float) -> str:
    """Value and one-sigma error, both to the error's second digit.

    Parameters
    ----------
    value, std : float
        In the same unit.

    Returns
    -------
    str
        A dash where the value is not known; the value alone where its error is not.

    Examples
    --------
    >>> with_error(12.34567, 0.0123)
    '12.346 ± 0.012'
    """
    if not math.isfinite(value):
        return "–"
    if not math.isfinite(std) or std <= 0:
        return plain(value)
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def plain(value: object) -> str:
    """Compact text of one value in a table.

    Parameters
    ----------
    value : object
        A number, text, truth value or a sequence of such, of Python or NumPy.

    Returns
    -------
    str
        A dash for what is unknown (None and NaN).

    Examples
    --------
    >>> plain(40000), plain(0.123456789), plain([1, None]), plain(True)
    ('40,000', '0.12346', '(1, –)', 'yes')
    """
    value = without_numpy(value)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):  # before int, which it is too
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:,.5g}" if abs(value) < 1e6 else f"{value:,.0f}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(plain(item) for item in value) + ")"
    return str(value)


def print_json(value: object) -> None:
    """Print one JSON document to stdout.

    Parameters
    ----------
    value : object
        As for `files.json_values.json_value`.
    """
    click.echo(json.dumps(json_value(value), indent=2, ensure_ascii=False, allow_nan=False))


# --- tables --------------------------------------------------------------------------------


def _console() -> Any:
    """Rich's console on stdout."""
    from rich.console import Console

    class OurConsole(Console):
        def on_broken_pipe(self) -> None:
            # Rich would end with exit code 1, which says that the fault is ours: see `errors`.
            raise BrokenPipeError

    stream = sys.stdout
    # A pipe has no width of its own; 80 columns would cut tables that nobody asked to cut.
    return OurConsole(
        file=stream, highlight=False, markup=False, width=None if stream.isatty() else 132
    )


def _shown(text: str) -> str:
    """Lines without what a terminal would obey."""
    return "\n".join(map(harmless, text.split("\n")))


def print_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    title: str | None = None,
    n_text_columns: int = 1,
) -> None:
    """Print a table to stdout.

    Parameters
    ----------
    columns : sequence of str
        Headings.
    rows : iterable of sequences
        Cells: texts as they are, other values by `plain`.
    title : str, optional
        Stands above.
    n_text_columns : int, optional
        Columns that are flush left; the others hold numbers and are flush right.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i < n_text_columns else "right", overflow="fold")
    for row in rows:
        texts = (cell if isinstance(cell, str) else plain(cell) for cell in row)
        table.add_row(*(Text(_shown(text)) for text in texts))
    _console().print(table)


class Fact(NamedTuple):
    """One thing to say, for people and for programs.

    Attributes
    ----------
    label : str
        What people read.
    key : str
        What programs read: a name that ends in its unit.
    value : object
        The value itself.
    text : str or None
        How people read the value; None: as it is.
    """

    label: str
    key: str
    value: object
    text: str | None = None


def json_from_facts(facts: Iterable[Fact]) -> dict[str, object]:
    """Keys and values of facts, for programs.

    Parameters
    ----------
    facts : iterable of Fact
        In any order; of two with one key the later counts.

    Returns
    -------
    dict of str
        Value by key.
    """
    return {fact.key: fact.value for fact in facts}


def print_facts(facts: Iterable[Fact], *, title: str | None = None) -> None:
    """Print facts to stdout, one per line, for people.

    Parameters
    ----------
    facts : iterable of Fact
        In the order of the lines.
    title : str, optional
        Stands above.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=title, title_justify="left", title_style="bold", box=box.SIMPLE, show_header=False
    )
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for fact in facts:
        text = plain(fact.value) if fact.text is None else fact.text
        table.add_row(Text(_shown(fact.label)), Text(_shown(text)))
    _console().print(table)


def print_sentences(sentences: Iterable[str]) -> None:
    """Print sentences to stdout, each a paragraph.

    Parameters
    ----------
    sentences : iterable of str
        Wrapped to a terminal; a pipe gets each in one line.
    """
    from rich.text import Text

    console = _console()
    for sentence in sentences:
        console.print(Text(_shown(sentence)), soft_wrap=not console.is_terminal)


_COLORS = {"trust": "green", "check": "yellow", "contradicted": "red"}
"""Of a verdict's level on a terminal; the word stands there too."""


def print_headline(verdict: Verdict) -> None:
    """Print the headline of a verdict to stdout."""
    from rich.text import Text

    console = _console()
    line = Text(verdict.headline, style=f"bold {_COLORS[verdict.level]}")
    console.print(line, soft_wrap=not console.is_terminal)


def print_written(files: Iterable[Path]) -> None:
    """Name on stdout the files that were written."""
    print_sentences([f"Written: {', '.join(map(str, files))}"])


def report(
    facts: Iterable[Fact],
    sentences: Sequence[str] = (),
    *,
    as_json: bool,
    title: str | None = None,
    written: Sequence[Path] = (),
    **more: object,
) -> None:
    """Say on stdout what a command found, to people or to a program.

    Parameters
    ----------
    facts : iterable of Fact
        One per line.
    sentences : sequence of str, optional
        For people, below the facts.
    as_json : bool
        One JSON document instead.
    title : str, optional
        For people, above the facts.
    written : sequence of Path, optional
        Files that were written.
    **more
        For programs, beside the facts.
    """
    if as_json:
        files = {"written": [str(file) for file in written]} if written else {}
        print_json(json_from_facts(facts) | more | files)
        return
    print_facts(facts, title=title)
    print_sentences(sentences)
    if written:
        print_written(written)
