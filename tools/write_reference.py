"""Write docs/reference/*.md from the code: set-up keys, flags, commands, file formats.

    .venv/bin/python tools/write_reference.py            # writes the pages
    .venv/bin/python tools/write_reference.py --check    # fails where a page is out of date

Nothing on these pages is typed twice: `tests/contracts/test_reference.py` runs the check.
"""

from __future__ import annotations

import argparse
import inspect
from pathlib import Path

import click

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "reference"
_MARK = "<!-- written by tools/write_reference.py; change the code instead -->\n"


def setup_page() -> str:
    """Every section and key of a set-up file."""
    from lightflight.lab import SECTIONS

    lines = [
        _MARK,
        "# The set-up file\n",
        "TOML; every section and key may be left out. An unknown key is an error that names the "
        "nearest valid one. `--dry-run` prints what was understood, `--set section.key=value` "
        'changes one key for one command. Where None is not the default, the word `"none"` says '
        "it.\n",
    ]
    for section, keys in SECTIONS.items():
        lines.append(f"## [{section}]\n")
        if keys is None:
            lines.append(
                "Hints for `lightflight.read`: what recordings do not say themselves, such as "
                "`bin_width_ps`, `laser_period_ps`, `reversed_codes` or `axes`. Which there are "
                "depends on the format.\n"
            )
            continue
        lines += ["| key | meaning |", "|---|---|"]
        lines += [f"| `{key.name}` | {key.meaning.replace('|', chr(92) + '|')} |" for key in keys]
        lines.append("")
    return "\n".join(lines)


def campaign_page() -> str:
    """Sections of a campaign file beside those of a set-up."""
    from lightflight.batch.campaign import CAMPAIGN_SECTIONS, DEFAULTS

    lines = [
        _MARK,
        "# The campaign file\n",
        "What `lightflight batch` takes: TOML, with paths relative to the file. Every section of a "
        "[set-up file](setup-file.md) may stand in it too. `--dry-run` prints what was "
        "understood, every recording by name.\n",
    ]
    for section, keys in CAMPAIGN_SECTIONS.items():
        many = section == "groups"
        lines.append("## [[groups]], one or more\n" if many else f"## [{section}]\n")
        lines += ["| key | meaning | default |", "|---|---|---|"]
        for key in keys:
            default = DEFAULTS.get(key.name) if section == "campaign" else None
            shown = "" if default in (None, "") else f"`{default}`"
            lines.append(f"| `{key.name}` | {key.meaning} | {shown} |")
        lines.append("")
    return "\n".join(lines)


def flags_page() -> str:
    """Everything that can be wrong with a pixel or a pulse."""
    from lightflight.flags import REGISTRY

    lines = [_MARK, "# Flags\n", "| bit | name | meaning | takes no part |", "|---:|---|---|---|"]
    lines += [
        f"| {flag.value.bit_length() - 1} | `{flag.name}` | {flag.meaning} "
        f"| {'yes' if flag.excludes else ''} |"
        for flag in REGISTRY
    ]
    return "\n".join([*lines, ""])


def commands_page() -> str:
    """What every command does and takes, and the exit codes."""
    from lightflight.cli import main
    from lightflight.cli.errors import EXIT_CODES

    lines = [_MARK, "# The command line\n"]
    commands = dict(main.commands)
    for name, command in main.commands.items():
        if isinstance(command, click.Group):
            commands |= {f"{name} {part}": inner for part, inner in command.commands.items()}
    for name, command in sorted(commands.items()):
        lines += [f"## lightflight {name}\n", *_told(inspect.cleandoc(command.help or ""))]
        if not command.params:
            continue
        context = click.Context(command)
        lines += ["| option | meaning |", "|---|---|"]
        lines += [
            f"| {_spelling(option)} | {_meaning(option, context)} |" for option in command.params
        ]
        lines.append("")
    lines += ["## Exit codes\n", "| code | meaning |", "|---:|---|"]
    lines += [f"| {code} | {meaning} |" for code, meaning in EXIT_CODES.items()]
    return "\n".join([*lines, ""])


def _told(text: str) -> list[str]:
    """The help of a command: its paragraphs, what stands in columns as a block."""
    lines = []
    for paragraph in text.split("\n\n"):
        if not paragraph.startswith("\b\n"):
            lines += [paragraph, ""]
            continue
        columns = paragraph.splitlines()[1:]
        examples = columns[0] in ("Example:", "Examples:")
        lines += ["```text", *columns[examples:], "```", ""]
    return lines


def _spelling(parameter: click.Parameter) -> str:
    if isinstance(parameter, click.Argument):
        return f"`{parameter.make_metavar(click.Context(click.Command(None)))}`"
    spelled = ", ".join(f"`{word}`" for word in parameter.opts)
    choices = getattr(parameter.type, "choices", ())
    return spelled + (f" {' &#124; '.join(choices)}" if choices else "")


def _meaning(parameter: click.Parameter, context: click.Context) -> str:
    said = " ".join((getattr(parameter, "help", None) or "").split())
    if isinstance(parameter, click.Option):
        extra = parameter.get_help_extra(context)
        said += f" [default: {extra['default']}]" if "default" in extra else ""
        said += " [required]" if "required" in extra else ""
    return said.replace("|", "&#124;")


def formats_page() -> str:
    """What can be read and written, with which hints; the layout of our own files."""
    from lightflight.formats.clock import CLOCK_HINTS
    from lightflight.formats.registry import own_formats
    from lightflight.formats.schema import file_schema

    lines = [
        _MARK,
        "# File formats\n",
        "`lightflight.read(path, **hints)` knows a format by its content, then by its suffix; "
        "`format=` goes before both. Axes of foreign arrays are never guessed: `axes` names them, "
        "`y` rows, `x` columns, `t` codes, `p` pixels row by row, `f` frames.\n",
        "| format | what | suffixes | hints | written (options) |",
        "|---|---|---|---|---|",
    ]
    for one in own_formats():
        hints = [hint for hint in one.hints if hint not in CLOCK_HINTS]
        written = ", ".join(f"`{option}`" for option in one.options) or "yes" if one.write else ""
        lines.append(
            f"| `{one.name}` | {one.summary} | {' '.join(f'`{end}`' for end in one.suffixes)} | "
            f"{', '.join(f'`{hint}`' for hint in hints)} | {written} |"
        )
    lines += ["\nHints of every format:\n", "| hint | meaning |", "|---|---|"]
    lines += [f"| `{name}` | {meaning} |" for name, meaning in CLOCK_HINTS.items()]
    schema = file_schema()
    lines += ["\n## Our own files\n", _OUR_FILES]
    for kind in ("histograms", "recording"):
        lines += [f"### {kind}\n", schema[kind]["summary"], "", "| array | shape | meaning |"]
        lines.append("|---|---|---|")
        for name, rule in schema[kind]["arrays"].items():
            lines.append(f"| `{name}` | ({', '.join(rule['shape'])}) | {rule['meaning']} |")
        lines += ["", "| attribute | meaning |", "|---|---|"]
        known = {**schema[kind]["attributes"], **schema["attributes"]}
        lines += [f"| `{name}` | {meaning} |" for name, meaning in known.items()]
        lines.append("")
    lines += ["### calibration\n", _CALIBRATIONS, "### path\n", _PATHS]
    lines += ["| array | shape | meaning |", "|---|---|---|"]
    lines += [f"| `{name}` | {shape} | {meaning} |" for name, shape, meaning in PATH_ARRAYS]
    return "\n".join([*lines, ""])


_OUR_FILES = """\
HDF5 with the root attributes `format` = "lightflight", `kind` and `schema_version`, and `sealed`
and `digest` (over all else). The dataset `attributes` is a JSON text, all other datasets are
arrays, those of a simulation's truth in the group `truth`. `schema_version` is 1 but of some paths
(below).
"""
_CALIBRATIONS = """\
Each field of [TimingCalibration](generated/lightflight.TimingCalibration.rst) by its name, arrays
as datasets, all else in `attributes`, with `calibration_schema`: 1, 2 where the pulse's place in
its shape is told (`response_place_ps`), 3 where all pixels share an error of the code widths
(`code_width_std`).
"""
_PATHS = """\
`attributes` holds `method`, `prior`, `statements`, `goodness`, `source`, `medium`, `verdict`,
`explained`, `prices`, `provenance`, and where there are any `unseen_legs` (their numbers), `forks`
(pairs of a leg and the vertex at which it begins), `blocks`, `second_pulse` and `alternatives`.
`schema_version` is 2 with unseen legs, 3 with forks or bends, 4 with blocks of glass or
alternatives, else 1.
"""
PATH_ARRAYS = (
    ("vertices_mm", "(vertices, 3)", "x, y, z, mm"),
    ("vertex_times_ps", "(vertices)", "event times, ps"),
    ("covariance", "(4 vertices, 4 vertices)", "of x, y, z, t of each vertex, mm and ps"),
    ("covariance_*", "the same", "what `photon`, `pixel` and `shared` errors make of it"),
    ("residuals_*", "(pulses)", "`row`, `col`, `leg`, `arrival_ps`, `model_ps`, `residual_ps`, "
     "`std_ps`, `event_time_ps`, `photons`, `used`, `flags`"),
    ("camera_*", "", "`shape`, `matrix`, `distortion`, `world_from_camera`, and its errors"),
    ("truth_*", "", "`vertices_mm` and `vertex_times_ps` of a simulation"),
    ("bends_*", "", "of bent legs: `leg`, `axes`, `orders`, `coefficients_mm`, `covariance`"),
    ("alternative_0_*", "", "all of these of another answer, numbered on"),
)  # fmt: skip
"""Arrays of a path file; * stands for what the meaning lists."""

PAGES = {
    "setup-file.md": setup_page,
    "campaign-file.md": campaign_page,
    "flags.md": flags_page,
    "commands.md": commands_page,
    "formats.md": formats_page,
}


def outdated_pages() -> list[str]:
    """Names of the pages that do not say what the code says."""
    return [
        name
        for name, page in PAGES.items()
        if not (FOLDER / name).is_file() or (FOLDER / name).read_text(encoding="utf-8") != page()
    ]


def main() -> None:
    """Write the pages, or check them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="change nothing")
    if parser.parse_args().check:
        outdated = outdated_pages()
        if outdated:
            raise SystemExit(f"out of date, run tools/write_reference.py: {', '.join(outdated)}")
        return
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, page in PAGES.items():
        (FOLDER / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
