"""Options that several commands share, and the checks that go with them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])

debug_option = click.option(
    "--debug",
    is_flag=True,
    expose_value=False,
    help="Show the full traceback of an error, and the warnings of libraries.",
)

json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print JSON to stdout instead of tables."
)

seed_option = click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Random seed."
)


RECORD_SUFFIXES = (".h5", ".hdf5")
FIGURE_SUFFIXES = (".png", ".pdf", ".svg")


def outputs_option(meaning: str, *, required: bool = False) -> Callable[[Command], Command]:
    """Add the option -o / --output, which may be given more than once."""
    return click.option(
        "-o",
        "--output",
        "outputs",
        type=click.Path(path_type=Path),
        multiple=True,
        required=required,
        help=meaning,
    )


def lab_options(command: Command) -> Command:
    """Add the options --lab, --set and --dry-run."""
    for option in (
        click.option(
            "--dry-run",
            is_flag=True,
            help="Print what was understood of the set-up, as TOML, and stop.",
        ),
        click.option(
            "--set",
            "assignments",
            metavar="SECTION.KEY=VALUE",
            multiple=True,
            help="Change one key of the set-up; may be given more than once.",
        ),
        click.option(
            "--lab",
            "lab_path",
            type=click.Path(path_type=Path),
            help="Set-up file in TOML: [camera], [source], [medium] ...",
        ),
    ):
        command = option(command)
    return command


def _hints_from_texts(
    _context: click.Context, _option: click.Parameter, texts: Iterable[str]
) -> dict[str, Any]:
    """Reading hints from `key=value` texts; values are written as in TOML."""
    from lightflight.config import value_from_text

    hints = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not (equals and key.strip()):
            raise click.UsageError(f"--hint {text!r}: write key=value, for example bin_width_ps=55")
        hints[key.strip()] = value_from_text(value)
    return hints


def hint_option(command: Command) -> Command:
    """Add the option --hint, which says what a file does not say about itself."""
    return click.option(
        "--hint",
        "hints",
        metavar="KEY=VALUE",
        multiple=True,
        callback=_hints_from_texts,
        help="What the recording does not say itself, for example bin_width_ps=55 or axes=tyx; "
        "stands over [recording] of the set-up.",
    )(command)


def check_outputs(
    outputs: Iterable[Path],
    *,
    inputs: Iterable[Path],
    suffixes: Iterable[str],
    kinds: tuple[str, ...] = (),
    option: str = "-o",
) -> None:
    """Refuse, before any work, outputs that cannot or must not be written.

    Parameters
    ----------
    kinds : what an HDF5 file may hold that is replaced.
    option : what the outputs were given by.

    Raises
    ------
    click.UsageError
        For an unknown suffix, a folder that does not exist, an output that is an input, and a
        file in the place of an HDF5 output that is not an earlier result of the same kind.
    """
    allowed, read = list(suffixes), list(inputs)
    for output in outputs:
        given = f"{option} {output}"
        if output.suffix.lower() not in allowed:
            raise click.UsageError(f"{given}: the name must end in {' or '.join(allowed)}")
        if not output.parent.is_dir():
            raise click.UsageError(f"{given}: make the folder {output.parent} first")
        if output.is_dir():
            raise click.UsageError(f"{given}: is a folder, name a file in it")
        if not output.exists():
            continue
        if any(path.exists() and output.samefile(path) for path in read):
            raise click.UsageError(f"{given}: is an input too, choose another name")
        if output.suffix.lower() in RECORD_SUFFIXES and not _may_be_replaced(output, kinds):
            raise click.UsageError(
                f"{given}: exists and is no earlier result of this command, choose another name"
            )


def _may_be_replaced(path: Path, kinds: tuple[str, ...]) -> bool:
    """True for results of ours of these kinds; a recording must be a simulated one."""
    from lightflight.errors import FileFormatError
    from lightflight.recording import read
    from lightflight.store import kind_of_record

    try:
        kind = kind_of_record(path)
        return kind in kinds and (
            kind not in ("histograms", "recording") or read(path).truth is not None
        )
    except FileFormatError:
        return False
