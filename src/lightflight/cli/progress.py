"""What the commands say on stderr while they work: what, how far, how long still."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from lightflight.files.names import harmless
from lightflight.news import heard_by

Progress = Callable[[int, int], None]
"""Called with (done, in all) by work that knows how far it is."""

_QUIET_S = 2.0
"""Work that ends sooner than this says nothing, s."""

_moving: list[Any] = []
"""Bars that move on the terminal now."""
_written: list[str] = []
"""Names of files that this command has finished."""


def say(line: str) -> None:
    """Print a line on stderr, above a bar that moves there.

    Parameters
    ----------
    line : str
        Without what a terminal would obey.
    """
    if not _moving:
        click.echo(line, err=True)
        return
    from rich.text import Text

    _moving[-1].console.print(Text(line))


def duration(seconds: float) -> str:
    """A time to wait in the unit one would say it in.

    Parameters
    ----------
    seconds : float
        s.

    Examples
    --------
    >>> duration(12.3), duration(400.0)
    ('12 s', '7 min')
    """
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    if seconds < 5400:
        return f"{round(seconds / 60)} min"
    return f"{seconds / 3600:.1f} h"


@contextmanager
def step(what: str, *, always: bool = False) -> Iterator[Progress]:
    """Say on stderr what is being done, if it takes more than two seconds.

    On a terminal a line with the time that has passed, and a bar with the time that is left once
    the work says how far it is, gone when it is done; elsewhere one line of text.

    Parameters
    ----------
    what : str
        The work, as in "counting flat.h5".
    always : bool, optional
        A line with the time taken stays in either case.

    Yields
    ------
    Progress
        To be called with (done, in all) by work that knows how far it is.

    Raises
    ------
    KeyboardInterrupt
        With `what` as its text where the work itself was interrupted.
    """
    what, started = harmless(what), time.perf_counter()
    reporting = _live(what) if sys.stderr.isatty() else _quiet(what, always=always)
    with reporting as report, heard_by(report):
        try:
            yield report
        except KeyboardInterrupt as error:
            raise error if error.args else KeyboardInterrupt(what) from None
    if always:
        click.echo(f"  {what:<60} {time.perf_counter() - started:6.1f} s", err=True)


@contextmanager
def writing(output: Path, *, verb: str = "writing") -> Iterator[Progress]:
    """A step that writes a file: Ctrl-C after it says that the file is kept.

    Parameters
    ----------
    output : Path
        The file.
    verb : str, optional
        What is done, as in "filming".

    Yields
    ------
    Progress
        As of `step`.
    """
    with step(f"{verb} {output.name}") as report:
        yield report
    _written.append(harmless(output.name))


def forget_written() -> None:
    """Begin a command: nothing is written yet."""
    _written.clear()


def interrupted(error: BaseException) -> str:
    """What Ctrl-C broke off, and what it left, in a sentence.

    Parameters
    ----------
    error : BaseException
        The KeyboardInterrupt that ended the command, or what click made of it.

    Returns
    -------
    str
        As in "interrupted while filming b.gif: a.gif is kept, no half-written file remains".
    """
    what = str(error if isinstance(error, KeyboardInterrupt) else error.__cause__ or "")
    doing = f"interrupted while {what}" if what else "interrupted"
    kept = f"{', '.join(_written)} {'is' if len(_written) == 1 else 'are'} kept"
    return f"{doing}: {f'{kept}, ' if _written else ''}no half-written file remains"


@contextmanager
def moving(*columns: Any) -> Iterator[Any]:
    """Rich's bars on stderr, gone when they are done; what is said meanwhile stands above them.

    Parameters
    ----------
    *columns : str or rich.progress.ProgressColumn
        Of each bar.

    Yields
    ------
    rich.progress.Progress
        To add bars to.
    """
    from rich.console import Console
    from rich.progress import Progress

    console = Console(file=sys.stderr, highlight=False, markup=False)
    with Progress(*columns, console=console, transient=True) as bars:
        _moving.append(bars)
        try:
            yield bars
        finally:
            _moving.remove(bars)


@contextmanager
def _live(what: str) -> Iterator[Progress]:
    """A line on a terminal that moves while the work goes on."""
    from rich.progress import BarColumn, ProgressColumn, SpinnerColumn, Task, TextColumn
    from rich.text import Text

    started = time.monotonic()
    # Of the work in hand: done, in all, and when it was first heard of.
    state: tuple[int, int | None, float] = (0, None, started)

    class HowFar(ProgressColumn):
        """Asked for ten times a second."""

        def render(self, task: Task) -> Text:
            done, total, since = state
            return Text(_how_far(done, total, time.monotonic() - since))

    def report(done: int, total: int) -> None:
        nonlocal state
        is_new = state[1] is None or done < state[0]
        state = (done, total, time.monotonic() if is_new else state[2])
        if done >= total:  # what comes next has not said how far it is
            state = (0, None, started)
        bar.completed, bar.total = state[:2]

    description = TextColumn("{task.description}", markup=False)
    with moving(SpinnerColumn(), description, BarColumn(bar_width=24), HowFar()) as bars:
        bars.add_task(what, total=None)
        (bar,) = bars.tasks
        yield report


def _how_far(done: float, total: float | None, passed_s: float) -> str:
    """Time that has passed, or part of the work and the time that is left, in words.

    Examples
    --------
    >>> _how_far(0, None, 5.0), _how_far(25, 100, 5.0)
    ('5 s', '25 %, about 15 s left')
    """
    if not total:
        return duration(passed_s) if passed_s >= 1 else ""
    words = f"{100 * done / total:.0f} %"
    # A guess from the first moments would jump about.
    if 0 < done < total and passed_s > _QUIET_S:
        words += f", about {duration(passed_s * (total - done) / done)} left"
    return words


@contextmanager
def _quiet(what: str, *, always: bool) -> Iterator[Progress]:
    """One line of text, and only where the work takes long."""
    stream = sys.stderr
    timer = threading.Timer(_QUIET_S, lambda: click.echo(f"{what} ...", file=stream))
    timer.daemon = True  # a command that fails must not wait for it
    if not always:
        timer.start()
    try:
        yield lambda _done, _total: None
    finally:
        timer.cancel()
