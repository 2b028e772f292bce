"""`lightflight init`: a set-up file from a few questions, and a drawing of it."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli.console import Fact, print_facts, print_json, print_written
from lightflight.cli.options import POSITIVE, debug_option, json_option, output_option
from lightflight.cli.progress import writing
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.lab import Lab

_KNOWN_BY = {
    "tape": ("a tape measure", (3.0, 3.0, 10.0), 1.0, 5.0 / 245.0, 1.0),
    "ruler": ("a ruler, with the lens's data sheet", (1.0, 1.0, 1.0), 0.1, 2.0 / 245.0, 1.0),
    "points": ("points of known place", (0.5, 0.5, 0.5), 0.05, 0.2 / 245.0, 0.1),
}
"""By what was measured: its words, errors of the camera's place (mm), its rotation (deg), the field
of view (a share), and of the source (mm); those of docs/how-to/describe-lab.md."""

_MOST_PIXELS = 65_536
"""On a side: row and column of a pulse have so many bits."""

_MEDIA = {"air": 1.00027, "vacuum": 1.0, "water": 1.35, "silica": 1.47}
"""Group indices in the visible and near infrared."""


@click.command("init", short_help="Write a set-up file by answering a few questions.")
@click.option(
    "--shape", nargs=2, type=click.IntRange(1, _MOST_PIXELS), help="Rows and columns of pixels."
)
@click.option("--distance", type=POSITIVE, help="Entrance pupil to the plane z = 0, mm.")
@click.option(
    "--field-of-view",
    nargs=2,
    type=POSITIVE,
    help="Width and height that the camera sees of that plane, mm.",
)
@click.option(
    "--center", nargs=2, type=float, help="Point (x, y) of the plane that the pupil faces, mm."
)
@click.option("--source", nargs=3, type=float, help="Where the beam starts, (x, y, z), mm.")
@click.option("--no-source", is_flag=True, help="The source is not known: it is fitted.")
@click.option("--pulse-fwhm", type=POSITIVE, help="Length of the laser's pulse (FWHM), ps.")
@click.option("--medium", type=click.Choice(list(_MEDIA)), help="What the light crosses.")
@click.option(
    "--known-by",
    type=click.Choice(list(_KNOWN_BY)),
    help="How places were measured, which says how well they are known.",
)
@click.option(
    "--defaults",
    is_flag=True,
    help="Ask nothing: what is not given is as in the paper's experiment (32 x 32 pixels, 535 mm "
    "away, 245 x 245 mm in front of 187.5 37.5; source at 0 0 0, 68 ps; air), known by ruler.",
)
@click.option("--force", is_flag=True, help="Replace a set-up file that is there.")
@click.option("--no-plot", is_flag=True, help="Do not draw the set-up.")
@output_option("Set-up file to write (.toml); its drawing goes beside it.  [default: lab.toml]",
               required=False)  # fmt: skip
@json_option
@debug_option
def command(
    *,
    output: Path | None,
    force: bool,
    no_plot: bool,
    defaults: bool,
    no_source: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Write a set-up file: where camera and source stand, and how well that is known.

    On a terminal it asks for what is not given as an option; an empty answer takes what stands in
    brackets. It draws what was understood, from above and from the front. Distances in mm, x to
    the right, y up, z towards the camera; the plane z = 0 holds the beam, the camera faces it.

    \b
    Examples:
      lightflight init
      lightflight init --distance 535 --field-of-view 245 245 --center 187.5 37.5 --defaults
      lightflight init --no-source --known-by ruler -o my-lab.toml
    """
    from lightflight.lab.lab import lab_from_table

    output = Path("lab.toml") if output is None else output
    if output.suffix != ".toml":
        raise click.UsageError(f"-o {output}: a set-up file ends in .toml")
    if output.exists() and not force:
        raise click.UsageError(f"{output} is there: name another with -o, or replace it by --force")
    if no_source and given["source"] is not None:
        raise click.UsageError("--source and --no-source exclude each other")
    asks = not defaults and _somebody_is_there()
    answers = _answers(given, asks=asks, no_source=no_source, defaults=defaults)
    text = _toml_of(answers)
    import tomllib

    lab = lab_from_table(tomllib.loads(text), where=str(output))
    written = _written(text, lab, output, with_plot=not no_plot)
    facts = _facts(answers)
    if as_json:
        print_json(
            {fact.key: fact.value for fact in facts} | {"written": [str(one) for one in written]}
        )
        return
    print_facts(facts)
    print_written(written)
    click.echo(f"next: lightflight check {output} recording.h5 -o setup.png", err=True)


@dataclass(frozen=True)
class _Answers:
    """What is known of a set-up; lengths in mm, the pulse in ps."""

    shape: tuple[int, int]
    distance: float
    field_of_view: tuple[float, float]
    center: tuple[float, float]
    source: tuple[float, float, float] | None
    pulse_fwhm: float
    medium: str
    known_by: str


@dataclass(frozen=True)
class _Question:
    """One thing to know: words for a person, the paper's value, and whether that may be assumed."""

    words: str
    usual: Any
    needed: bool = False


_QUESTIONS = {
    "shape": _Question("Pixels of the camera: rows columns", (32, 32)),
    "distance": _Question("Distance of the entrance pupil from the plane z = 0, mm", 535.0, True),
    "field_of_view": _Question(
        "What the camera sees of that plane: width height, mm", (245.0, 245.0), True
    ),
    "center": _Question("Point of the plane that it faces: x y, mm", (0.0, 0.0)),
    "source": _Question('Where the beam starts: x y z, mm ("none": not known)', (0.0, 0.0, 0.0)),
    "pulse_fwhm": _Question("Length of the laser's pulse (FWHM), ps", 68.0),
    "medium": _Question(f"The light crosses ({', '.join(_MEDIA)})", "air"),
    "known_by": _Question(f"Places were measured by ({', '.join(_KNOWN_BY)})", "ruler"),
}


_PAPERS_CENTER = (187.5, 37.5)
"""Where the camera of the paper's experiment looks: what --defaults takes. Who describes a lab of
their own rather has the origin there."""


def _somebody_is_there() -> bool:
    return sys.stdin.isatty()


def _answers(given: dict[str, Any], *, asks: bool, no_source: bool, defaults: bool) -> _Answers:
    """Each question answered: by its option, by the person, or as is usual."""
    missing = [name for name, one in _QUESTIONS.items() if one.needed and given[name] is None]
    if missing and not (asks or defaults):
        options = ", ".join(f"--{name.replace('_', '-')}" for name in missing)
        raise click.UsageError(
            f"nobody is there to ask: give {options}, or --defaults for the paper's experiment"
        )
    told: dict[str, Any] = {}
    for name, question in _QUESTIONS.items():
        if name == "source" and no_source:
            told[name] = None
        elif given[name] is not None or not asks:
            told[name] = question.usual if given[name] is None else given[name]
            if name == "center" and defaults and given[name] is None:
                told[name] = _PAPERS_CENTER
        else:
            told[name] = click.prompt(
                question.words,
                default=_shown(question.usual),
                value_proc=partial(_understood, name),
                err=True,
            )
    return _Answers(**told)


def _shown(value: Any) -> str:
    return " ".join(f"{v:g}" for v in value) if isinstance(value, tuple) else f"{value}"


def _understood(name: str, text: str) -> Any:
    """An answer as the option would take it; click asks again after a UsageError."""
    usual = _QUESTIONS[name].usual
    words = text.replace(",", " ").split()
    if name == "source" and text.strip().lower() == "none":
        return None
    if isinstance(usual, str):
        if text not in (known := list(_MEDIA if name == "medium" else _KNOWN_BY)):
            raise click.UsageError(f"one of {', '.join(known)}")
        return text
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        raise click.UsageError("numbers, please, with blanks between them") from None
    wanted = len(usual) if isinstance(usual, tuple) else 1
    if len(numbers) != wanted or not all(map(math.isfinite, numbers)):
        raise click.UsageError(f"{wanted} finite number{'s' if wanted > 1 else ''}, please")
    if name not in ("center", "source") and min(numbers) <= 0:
        raise click.UsageError("above zero, please")
    if name == "shape":
        if any(number != int(number) or number > _MOST_PIXELS for number in numbers):
            raise click.UsageError(f"whole numbers up to {_MOST_PIXELS}, please")
        return tuple(map(int, numbers))
    return tuple(numbers) if isinstance(usual, tuple) else numbers[0]


def _toml_of(told: _Answers) -> str:
    """The set-up file, each line with what it means."""
    by, place, rotation, share, of_source = _KNOWN_BY[told.known_by]
    index = _MEDIA[told.medium]
    source = (
        "# position_mm is not known: it is fitted"
        if told.source is None
        else f"position_mm = {_list(told.source)}  # any point the beam passes before the picture\n"
        f"position_std_mm = {of_source}"
    )
    return f"""\
# Where things stand, and how well that is known (one sigma): by {by}.
# x to the right, y up, z towards the camera, mm; change what you know better.

[camera]
shape = {_list(told.shape)}  # rows, columns
distance_mm = {told.distance!r}  # from the entrance pupil to the plane z = 0
field_of_view_mm = {_list(told.field_of_view)}  # what it sees of that plane, edge to edge
center_mm = {_list(told.center)}  # it stands in front of this point of the plane
position_std_mm = {_list(place)}  # x, y, z
rotation_std_deg = {rotation}
field_of_view_std_mm = {_rounded(share * told.field_of_view[0])}

[source]
{source}
pulse_fwhm_ps = {told.pulse_fwhm!r}

[medium]
path_group_index = {index}  # {told.medium}
return_group_index = {index}
"""


def _list(values: tuple[float, ...]) -> str:
    return f"[{', '.join(map(repr, values))}]"


def _rounded(value: float) -> float:
    """To two digits."""
    return float(f"{value:.2g}")


def _written(text: str, lab: Lab, output: Path, *, with_plot: bool) -> tuple[Path, ...]:
    from lightflight.files.whole_file import write_text

    picture = output.with_suffix(".png")
    if with_plot:
        from lightflight.view.export.files import write_figure
        from lightflight.view.figures.setup import lab_figure

        with writing(picture, verb="drawing"):
            assert lab.camera is not None
            write_figure(lab_figure(lab.camera, lab.source, title=output.name), picture)
    write_text(output, text)
    return (output, picture) if with_plot else (output,)


def _facts(told: _Answers) -> list[Fact]:
    rows, cols = told.shape
    width, height = told.field_of_view
    sides = width / cols, height / rows
    square = "" if max(sides) < 1.2 * min(sides) else ": not square, are width and height swapped?"
    flight = sides[0] / SPEED_OF_LIGHT_MM_PER_PS
    where = (
        "not known: it is fitted"
        if told.source is None
        else f"({_shown(told.source).replace(' ', ', ')}) mm"
    )
    return [
        Fact("camera", "shape", told.shape, f"{rows} x {cols} pixels, {told.distance:g} mm away"),
        Fact("a pixel sees", "pixel_mm", sides, f"{sides[0]:.3g} x {sides[1]:.3g} mm{square}"),
        Fact("light crosses it in", "pixel_flight_ps", flight, f"{flight:.3g} ps"),
        Fact("source", "source_mm", told.source, where),
        Fact("known by", "known_by", told.known_by, _KNOWN_BY[told.known_by][0]),
    ]  # fmt: skip
