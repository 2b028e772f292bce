"""Sentences of the package in the words of the command line: `timing=` is `--timing` there."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from functools import partial

import click

_ARGUMENT = re.compile(
    r"(?<![-\w./\\])(?P<hint>--hint )?(?P<name>[a-z][a-z_0-9]*)="
    r"(?P<value>'[^']*'|\([^()]*\)|\[[^\]]*\]|\.\.\.|[\w.+-]*[\w+-])?"
)
"""A name, an equals sign and perhaps a value, as Python writes an argument."""

_HINTS = frozenset(
    {"axes", "bin_width_ps", "first_edge_ps", "footer_bytes", "format", "laser_period_ps",
     "n_codes", "n_frames", "no_photon_code", "periods_per_frame", "poisson", "reversed_codes",
     "shape", "variable"}
)  # fmt: skip
"""What `--hint` takes, of that which sentences speak of."""

_ELSEWHERE = {
    "camera": "--lab with [camera]",
    "source": "--lab with [source]",
    "medium": "--lab with [medium]",
    "start": "start= in Python",
}
"""Arguments that no option stands for, and what does."""


def in_options(text: str, options: Collection[str]) -> str:
    """A sentence with the arguments of Python's functions as a command's options.

    Parameters
    ----------
    text : str
        What an error or a warning says.
    options : collection of str
        Names of the command's options as Python has them, such as "n_legs".

    Examples
    --------
    >>> in_options("give timing=, or try reversed_codes=False", {"timing", "hint"})
    'give --timing, or try --hint reversed_codes=false'
    >>> in_options("n_legs=3 was given: use method='joint'", {"n_legs", "method"})
    '--n-legs 3 was given: use --method joint'
    """
    told = _ARGUMENT.sub(partial(_option_of, options), text)
    # What was told for both, as in "--trust (trust=True)", is said once.
    return re.sub(r"(--[\w-]+) \(\1\)", r"\1", told)


def _option_of(options: Collection[str], found: re.Match[str]) -> str:
    name, value = found["name"], found["value"] or ""
    # What stands after --hint is in order, and names of files are left as they are.
    if (
        found["hint"]
        or re.search(r"\.[A-Za-z]", value)
        or found.string[found.end() : found.end() + 1] in ("/", "\\")
    ):
        return found[0]
    if name in options:
        said = value.strip("'") if value.startswith("'") else value
        said = "" if said == "True" else said
        return f"--{name.replace('_', '-')} {said}".rstrip()
    if name in _HINTS and "hint" in options:
        if value.startswith("("):
            value = f"[{value[1:-1]}]"
        value = {"True": "true", "False": "false"}.get(value, value.strip("'"))
        return f"--hint {name}={value}"
    return _ELSEWHERE.get(name, found[0]) if "lab" in options and not value else found[0]


def options_of(group: click.Group, words: Sequence[str]) -> frozenset[str]:
    """Names of the options of the command that some words ask for.

    Parameters
    ----------
    group : click.Group
        All commands.
    words : sequence of str
        Of the command line.

    Returns
    -------
    frozenset of str
        As Python would call them; empty without a command.
    """
    command, _ = _command_of(group, words)
    return frozenset(
        name.removeprefix("--").replace("-", "_")
        for parameter in command.params
        for name in parameter.opts
        if name.startswith("--")
    )


def name_of_command(group: click.Group, words: Sequence[str]) -> str:
    """What the command is called that some words ask for, as "lightflight calibrate camera".

    Parameters
    ----------
    group : click.Group
        All commands.
    words : sequence of str
        Of the command line.

    Returns
    -------
    str
        "lightflight" without a command.
    """
    return " ".join(("lightflight", *_command_of(group, words)[1]))


def _command_of(group: click.Group, words: Sequence[str]) -> tuple[click.Command, list[str]]:
    """The command that some words ask for, and those of them that name it."""
    command: click.Command = group
    names: list[str] = []
    for word in words:
        if not isinstance(command, click.Group) or word not in command.commands:
            break
        command = command.commands[word]
        names.append(word)
    return command, names
