"""One sentence on stderr and a documented exit code for everything that can go wrong."""

from __future__ import annotations

import dis
import io
import logging
import os
import sys
import traceback
import warnings
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import click

from lightflight.cli.language import in_options, name_of_command, options_of
from lightflight.cli.progress import forget_written, interrupted, say
from lightflight.files.names import harmless

EXIT_CODES = {
    0: "done",
    1: "a fault of lightflight itself: please report it",
    2: "the command, an option or the set-up file is wrong",
    3: "an input file is missing, empty, damaged or foreign, or an output cannot be written",
    4: "the clock cannot be calibrated, or the calibration does not fit the recording",
    5: "nothing could be reconstructed",
    6: '--strict: all was written, and there is no verdict of "trust" on it',
    130: "interrupted",
}
"""Every exit code of the command line and what it means; `lightflight --help` prints them."""


_OURS = {
    "is not a valid integer range": "is no whole number",
    "is not a valid integer": "is no whole number",
    "is not a valid float range": "is no number",
    "is not a valid float": "is no number",
}
"""What click says of a word that is no number, and what we say."""


class NotTrustedError(Exception):
    """Under --strict: all was done, and a verdict is "check" or "contradicted"."""

    exit_code = 6


def one_line(text: str) -> str:
    """Text with its line breaks and runs of blanks turned into single blanks.

    Examples
    --------
    >>> one_line("a sentence\\n  that was wrapped")
    'a sentence that was wrapped'
    """
    return " ".join(text.split())


def sentence_and_code(error: BaseException, *, command: str = "lightflight") -> tuple[str, int]:
    """What to print for an exception, and the exit code.

    Parameters
    ----------
    error : BaseException
        What ended the command.
    command : str, optional
        Whose help may say more, where the error does not know it.

    Returns
    -------
    text : str
        One sentence: of the error itself where it was foreseen, else that it is our fault.
    code : int
        A key of `EXIT_CODES`: the error's own `exit_code`, where it has one.
    """
    code = getattr(error, "exit_code", None)
    match error:
        case click.UsageError():
            command = error.ctx.command_path if error.ctx else command
            said = one_line(error.format_message())
            for clicks, ours in _OURS.items():
                said = said.replace(clicks, ours)
            return f"{said} (see {command} --help)", 2
        case click.FileError():
            return one_line(error.format_message()), 3
        case click.ClickException():
            # 1 is click's own default, and says here that the fault is ours.
            return one_line(error.format_message()), 2 if code in (None, 1) else int(code)
        case click.Abort() | KeyboardInterrupt():
            return interrupted(error), 130
        # Errors of ours that are an OSError or MemoryError too have a better sentence.
        case FileNotFoundError() if error.filename is None and not _here_is_a_folder():
            return "the folder that this was started in is gone: go to another one", 3
        case OSError() if not isinstance(code, int):
            reason = error.strerror or str(error) or type(error).__name__
            named = os.fsdecode(error.filename) if error.filename is not None else ""
            return one_line(f"{named}: {reason}" if named else reason), 3
        case MemoryError() if not isinstance(code, int):
            return "not enough memory for this recording", 3
    if isinstance(code, int):
        return one_line(str(error)), code
    if isinstance(error, ValueError | TypeError) and _raised_at_a_door(error):
        return one_line(str(error)), 2
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return (
        f"internal error, {one_line(what)} (run again with --debug and report the traceback)",
        1,
    )


def _here_is_a_folder() -> bool:
    """Whether the current folder is there: another program may have taken it away."""
    try:
        os.getcwd()  # noqa: PTH109
    except OSError:
        return False
    return True


def _raised_at_a_door(error: BaseException) -> bool:
    """True where a `raise` statement of this package refused a call; a slip of ours is not that."""
    # The innermost frame: where NumPy, or a slip such as int("x"), raised, no `raise` stands there.
    place = error.__traceback__
    while place is not None and place.tb_next is not None:
        place = place.tb_next
    if place is None:
        return False
    code = place.tb_frame.f_code
    module = str(place.tb_frame.f_globals.get("__name__", ""))
    is_ours = module == "lightflight" or module.startswith("lightflight.")
    return is_ours and dis.opname[code.co_code[place.tb_lasti]] == "RAISE_VARARGS"


def show_warnings_in_one_line(options: Collection[str] = ()) -> None:
    """Print each of this package's warnings once, as one line; leave out those of libraries.

    Parameters
    ----------
    options : collection of str, optional
        The command's, see `in_options`.
    """
    shown: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        text = harmless(in_options(one_line(str(message)), options))
        if text not in shown:
            shown.add(text)
            say(f"warning: {text}")

    # Imported here: `lightflight --help` gives no warnings.
    from lightflight.errors import LightflightWarning

    warnings.simplefilter("ignore")
    warnings.simplefilter("always", LightflightWarning)
    warnings.showwarning = show


def keep_algebra_to_one_thread() -> None:
    """Tell the linear algebra below NumPy, before it is loaded, not to start threads.

    The matrices of a fit are small: more threads wait for each other, and take more CPU time and
    more time by the clock. Who sets the variables is obeyed.
    """
    if "numpy" not in sys.modules:
        for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
            os.environ.setdefault(name, "1")


def draw_without_a_window() -> None:
    """Forget MPLBACKEND: no command opens a window, and Matplotlib stops at a wrong name."""
    if "matplotlib" not in sys.modules:
        os.environ.pop("MPLBACKEND", None)


class _ToStderr(logging.Handler):
    """Log records as lines on stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one."""
        say(harmless(record.getMessage()))


@contextmanager
def _news_on_stderr() -> Iterator[None]:
    """Show what the package logs, such as which kernel it compiles just now."""
    logger, handler = logging.getLogger("lightflight"), _ToStderr()
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


class SpeakingGroup(click.Group):
    """A click group whose errors are one sentence, with tracebacks only under `--debug`."""

    def main(  # type: ignore[override]
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        **extra: Any,
    ) -> Any:
        """Run a command and exit.

        Parameters
        ----------
        args : sequence of str, optional
            Words of the command line; None: those of the process. Without any: the help.
        prog_name : str, optional
            What the program is called in the help.
        **extra
            As for `click.Group.main`.

        Raises
        ------
        SystemExit
            Always, with one of `EXIT_CODES`.
        """
        keep_algebra_to_one_thread()
        draw_without_a_window()
        # Names of files need not be UTF-8; stderr spells such out by itself.
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")
        words = list(sys.argv[1:] if args is None else args) or ["--help"]
        debug = "--debug" in words
        extra["standalone_mode"] = False
        options = options_of(self, words)
        forget_written()
        with warnings.catch_warnings(), _news_on_stderr():
            try:
                if not debug:
                    show_warnings_in_one_line(options)
                code = super().main(args=words, prog_name=prog_name, **extra)
                sys.stdout.flush()  # here, where a broken pipe is still caught
            except BrokenPipeError:
                # The reader of our output (`| head`) has seen enough. What is still buffered goes
                # nowhere, or Python would complain at the exit.
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                code = 0
            except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  (the last door)
                if debug and not isinstance(error, click.ClickException | click.Abort):
                    traceback.print_exception(error)
                text, code = sentence_and_code(error, command=name_of_command(self, words))
                if not isinstance(error, click.ClickException):
                    text = in_options(text, options)
                click.echo(f"lightflight: {harmless(text)}", err=True)
        sys.exit(code if isinstance(code, int) else 0)
