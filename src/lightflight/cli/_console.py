"""How the commands speak: tables and JSON on stdout, progress on stderr."""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import click

_QUIET_S = 2.0
"""Work that ends sooner than this says nothing, s."""


# --- numbers in words ----------------------------------------------------------------------


def with_error(value: float, std: float) -> str:
    """Value and one-sigma error, both to the error's second digit: "12.345 ± 0.012"."""
    if not math.isfinite(value):
        return "–"
    if not math.isfinite(std) or std <= 0:
        return plain(value)
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def _without_numpy(value: Any) -> Any:
    """Python numbers and lists for NumPy's, without importing NumPy."""
    return value.tolist() if hasattr(value, "tolist") else value


def plain(value: Any) -> str:
    """Compact text of one value in a table; a dash for what is unknown."""
    value = _without_numpy(value)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:,.5g}" if abs(value) < 1e6 else f"{value:,.0f}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(plain(item) for item in value) + ")"
    return str(value)


def json_value(value: Any) -> Any:
    """Strict JSON of nested mappings, sequences and NumPy values; NaN and inf become null."""
    value = _without_numpy(value)
    if isinstance(value, Mapping):
        return {str(key): json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [json_value(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_json(value: Any) -> None:
    """Print one JSON document to stdout."""
    click.echo(json.dumps(json_value(value), indent=2, ensure_ascii=False, allow_nan=False))


# --- tables --------------------------------------------------------------------------------


def _console(*, stderr: bool = False) -> Any:
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    # A pipe has no width of its own; 80 columns would cut tables that nobody asked to cut.
    return Console(file=stream, highlight=False, width=None if stream.isatty() else 132)


def print_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    *,
    title: str | None = None,
    n_text_columns: int = 1,
) -> None:
    """Print a table to stdout: the first `n_text_columns` left, the others right-aligned."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i < n_text_columns else "right", overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell if isinstance(cell, str) else plain(cell)) for cell in row))
    _console().print(table)


class Fact(NamedTuple):
    """One thing to say, for people and for programs."""

    label: str
    """What people read."""
    key: str
    """What programs read: a name that ends in its unit."""
    value: Any
    """The value itself."""
    text: str | None = None
    """How people read the value; None: as it is."""


def json_from_facts(facts: Iterable[Fact]) -> dict[str, Any]:
    """Keys and values of facts."""
    return {fact.key: fact.value for fact in facts}


def print_facts(facts: Iterable[Fact], *, title: str | None = None) -> None:
    """Print facts to stdout, one per line."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=title, title_justify="left", title_style="bold", box=box.SIMPLE, show_header=False
    )
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for fact in facts:
        table.add_row(fact.label, Text(plain(fact.value) if fact.text is None else fact.text))
    _console().print(table)


def print_sentences(sentences: Iterable[str]) -> None:
    """Print sentences to stdout, one per paragraph line, wrapped to the terminal."""
    from rich.text import Text

    console = _console()
    for sentence in sentences:
        console.print(Text(sentence), soft_wrap=not console.is_terminal)


# --- progress ------------------------------------------------------------------------------

Progress = Callable[[int, int], None]
"""Called with (done, in all) by work that knows how far it is."""


@contextmanager
def step(what: str, *, always: bool = False) -> Iterator[Progress]:
    """Say on stderr what is being done, if it takes more than two seconds.

    On a terminal a line with the time that has passed, and a bar once the work says how far it
    is, gone when it is done; elsewhere one line of text. With `always`, a line with the time
    taken stays in either case.
    """
    started = time.perf_counter()
    reporting = _live(what) if sys.stderr.isatty() else _quiet(what, always=always)
    with reporting as report:
        yield report
    if always:
        click.echo(f"  {what:<60} {time.perf_counter() - started:6.1f} s", err=True)


@contextmanager
def _live(what: str) -> Iterator[Progress]:
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=_console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


@contextmanager
def _quiet(what: str, *, always: bool) -> Iterator[Progress]:
    stream = sys.stderr
    timer = threading.Timer(_QUIET_S, lambda: click.echo(f"{what} ...", file=stream))
    timer.daemon = True
    if not always:
        timer.start()
    try:
        yield lambda _done, _total: None
    finally:
        timer.cancel()
