"""Options that several commands share, and the checks that go with them.

Each is a decorator of a command, or makes one: `..._option(help)` where the words differ. Files
are never checked by click: whether one can be read or written is said by who reads and writes.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

if TYPE_CHECKING:
    from lightflight.lab import Lab

Command = TypeVar("Command", bound=Callable[..., object])

debug_option = click.option(
    "--debug",
    is_flag=True,
    expose_value=False,
    help="Show the full traceback of an error, and the warnings of libraries.",
)


def _trust(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Believe what files claim until the command ends."""
    from lightflight.files.filecheck import trusting

    context.with_resource(trusting(value))


trust_option = click.option(
    "--trust",
    is_flag=True,
    expose_value=False,
    callback=_trust,
    help="Believe what the files claim to hold, up to nearly all of the free memory; else they may "
    "claim half of it.",
)

json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print JSON to stdout instead of tables."
)

strict_option = click.option(
    "--strict",
    is_flag=True,
    help='End with exit code 6 unless the verdict is "trust"; what was asked for is written.',
)

_OUTPUTS = ("output", "outputs", "plot", "plots")
"""Parameters of commands that name files to write."""

RECORD_SUFFIXES = (".h5", ".hdf5")
"""Of our own files."""

PLOT_SUFFIXES = (".png", ".pdf", ".svg")
"""Of figures: of those that can be written, the three that commands offer."""

POSITIVE = click.FloatRange(min=0, min_open=True)
"""Type of an option that takes a number above zero."""


def path_option(*names: str, **options: Any) -> Callable[[Command], Command]:
    """Option that names a file; for the rest as `click.option`."""
    return click.option(*names, type=click.Path(path_type=Path), **options)


def output_option(meaning: str, *, required: bool = True) -> Callable[[Command], Command]:
    """Option -o / --output that is given once, as `output`.

    Parameters
    ----------
    meaning : str
        Its help.
    required : bool, optional
        Whether the command ends without it.

    Returns
    -------
    callable
        Decorator of a command.
    """
    return path_option("-o", "--output", help=meaning, required=required)


def outputs_option(meaning: str, *, required: bool = False) -> Callable[[Command], Command]:
    """Option -o / --output that may be given more than once, as `outputs`.

    Parameters
    ----------
    meaning : str
        Its help.
    required : bool, optional
        Whether the command ends without it.

    Returns
    -------
    callable
        Decorator of a command.
    """
    return path_option("-o", "--output", "outputs", help=meaning, required=required, multiple=True)


def timing_option(meaning: str) -> Callable[[Command], Command]:
    """Option --timing, a calibration of the clock, as `timing_path`."""
    return path_option("--timing", "timing_path", help=meaning)


def seed_option(default: int = 0) -> Callable[[Command], Command]:
    """Option --seed; the same seed gives the same photons."""
    return click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=default,
        show_default=True,
        help="Random seed.",
    )


def viewpoint_options(of_lab_camera: str, of_place: str) -> Callable[[Command], Command]:
    """Options --from-lab-camera and --viewpoint, another place to look from.

    Parameters
    ----------
    of_lab_camera, of_place : str
        Help of the one and of the other.

    Returns
    -------
    callable
        Decorator of a command, which gets `from_lab_camera` and `viewpoint_mm`; ask
        `check_viewpoint` about them.
    """

    def add(command: Command) -> Command:
        place = click.option(
            "--viewpoint", "viewpoint_mm", nargs=3, type=float, metavar="X Y Z", help=of_place
        )
        return click.option("--from-lab-camera", is_flag=True, help=of_lab_camera)(place(command))

    return add


def check_viewpoint(
    lab: Lab, *, from_lab_camera: bool, viewpoint_mm: tuple[float, float, float] | None
) -> None:
    """Refuse a viewpoint that is given twice, or that the set-up does not know.

    Raises
    ------
    click.UsageError
        Where --from-lab-camera has no camera to look from, or --viewpoint says another.
    """
    if from_lab_camera and lab.camera is None:
        raise click.UsageError("--from-lab-camera needs a camera: --lab with [camera]")
    if from_lab_camera and viewpoint_mm is not None:
        raise click.UsageError("--from-lab-camera and --viewpoint exclude each other")


def refuse_given(*names: str, why: str) -> None:
    """Refuse options of the command that would be ignored, where they were given.

    Parameters
    ----------
    *names : str
        Names of the command's parameters.
    why : str
        What stands after the option in the sentence.

    Raises
    ------
    click.UsageError
        For the first of them that is on the command line.
    """
    context = click.get_current_context()
    for parameter in context.command.params:
        asked = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and asked is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{parameter.opts[-1]} {why}")


def set_option(what: str) -> Callable[[Command], Command]:
    """Option --set, which lays `section.key=value` over a file, as `assignments`.

    Parameters
    ----------
    what : str
        What sort of file, in words.

    Returns
    -------
    callable
        Decorator of a command.
    """
    return click.option(
        "--set",
        "assignments",
        metavar="SECTION.KEY=VALUE",
        multiple=True,
        help=f"Change one key of the {what}; may be given more than once.",
    )


def lab_options(command: Command) -> Command:
    """Options --lab, --set and --dry-run, in this order in the help."""
    dry_run = click.option(
        "--dry-run",
        is_flag=True,
        help="Print what was understood of the set-up, as TOML, and stop.",
    )
    lab = path_option(
        "--lab", "lab_path", help="Set-up file in TOML: [camera], [source], [medium] ..."
    )
    return lab(set_option("set-up")(dry_run(command)))


def with_lab(command: Callable[..., None]) -> Callable[..., None]:
    """The options of `lab_options`, for a command that takes `lab` and is left out by --dry-run."""

    @functools.wraps(command)
    def run(
        *, lab_path: Path | None, assignments: tuple[str, ...], dry_run: bool, **options: object
    ) -> None:
        from lightflight.cli.records import lab_from_options, print_lab

        lab = lab_from_options(lab_path, assignments)
        if dry_run:
            print_lab(lab)
        else:
            command(lab=lab, **options)

    return lab_options(run)


def _hints_from_texts(
    _context: click.Context, _option: click.Parameter, texts: Iterable[str]
) -> dict[str, object]:
    """Reading hints by name, from `key=value` texts; values are written as in TOML.

    Raises
    ------
    click.UsageError
        For a text without a key or an equals sign.
    """
    from lightflight.files.toml_tables import value_from_text

    hints = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not (equals and key.strip()):
            raise click.UsageError(f"--hint {text!r}: write key=value, for example bin_width_ps=55")
        hints[key.strip()] = value_from_text(value)
    return hints


def hint_option(command: Command) -> Command:
    """Option --hint, which says what a file does not say about itself, as `hints`; and --trust."""
    hint = click.option(
        "--hint",
        "hints",
        metavar="KEY=VALUE",
        multiple=True,
        callback=_hints_from_texts,
        help="What the recording does not say itself, for example bin_width_ps=55 or axes=tyx; "
        "stands over [recording] of the set-up.",
    )
    return hint(trust_option(command))


def _inputs_of_command() -> list[Path]:
    """All files that the command was given to read."""
    given = click.get_current_context().params
    read = [value for name, value in given.items() if name not in _OUTPUTS]
    parts = [part for value in read for part in (value if isinstance(value, tuple) else (value,))]
    return [part for part in parts if isinstance(part, Path)]


def check_outputs(
    outputs: Iterable[Path],
    *,
    suffixes: Iterable[str],
    kinds: tuple[str, ...] = (),
    option: str = "-o",
) -> None:
    """Refuse, before any work, outputs that cannot or must not be written.

    Parameters
    ----------
    outputs : iterable of Path
        Files to write.
    suffixes : iterable of str
        What the outputs may end in, lower case.
    kinds : tuple of str, optional
        What an HDF5 file may hold that is replaced.
    option : str, optional
        What the outputs were given by.

    Raises
    ------
    click.UsageError
        For an unknown suffix, a folder that does not exist, an output that the command reads, and
        a file in the place of an HDF5 output that is not an earlier result of the same kind.
    """
    allowed, read = list(suffixes), _inputs_of_command()
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
        # By the file, not by its name: links and "./" name an input too.
        if any(path.exists() and output.samefile(path) for path in read):
            raise click.UsageError(f"{given}: is an input too, choose another name")
        if output.suffix.lower() in RECORD_SUFFIXES and not _may_be_replaced(output, kinds):
            raise click.UsageError(
                f"{given}: exists and is no earlier result of this command, choose another name"
            )


def _may_be_replaced(path: Path, kinds: tuple[str, ...]) -> bool:
    """Whether a file is a result of ours of these kinds.

    A recording must be a simulated one: what a camera saw cannot be made again.
    """
    from lightflight.errors import FileFormatError
    from lightflight.files.store import kind_of_record
    from lightflight.formats.registry import read

    try:
        kind = kind_of_record(path)
        return kind in kinds and (
            kind not in ("histograms", "recording") or read(path).truth is not None
        )
    except FileFormatError:
        return False
