"""Reading TOML tables strictly: every key is known, every value has the shape it must have.

This module knows no record of ours. `lightflight.lab` states which keys each section of a
set-up file has and builds the records from them.

Reading: `table_from_toml`, `override_table`. Checking: `Key`, `checked_table`, `nearest_name`.
"""

from __future__ import annotations

import difflib
import math
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightflight.arguments import shown
from lightflight.errors import ConfigError

_MOST_WHOLE = 1 << 63
_MOST_BYTES = 4 << 20
_MOST_DOTS = 64
_MOST_LEVELS = 16
"""Tables and lists within each other: a set-up needs four."""

Check = Callable[[Any], Any]
"""Returns the value as it is to be used; raises ValueError with what it must be."""


@dataclass(frozen=True)
class Key:
    """One key of a section.

    Attributes
    ----------
    name : str
        Its name, with the unit.
    meaning : str
        What it means, for the help.
    check : Check
        What it may hold.
    """

    name: str
    meaning: str
    check: Check


# --- what a value may be ---------------------------------------------------------------------


def _is_number(value: object) -> bool:
    # To Python true is a number.
    return isinstance(value, int | float) and not isinstance(value, bool)


def number(value: Any) -> float:
    """Accept any finite number."""
    try:
        is_finite = _is_number(value) and math.isfinite(value)
    except OverflowError:  # a whole number beyond all floats
        is_finite = False
    if not is_finite:
        raise ValueError("must be a number")
    return float(value)


def integer(value: object) -> int:
    """Accept a whole number."""
    if not isinstance(value, int) or isinstance(value, bool):
        raise ValueError("must be a whole number")
    if abs(value) >= _MOST_WHOLE:
        raise ValueError("must be a whole number of 64 bits at most")
    return value


def flag(value: object) -> bool:
    """Accept true or false."""
    if not isinstance(value, bool):
        raise ValueError("must be true or false")
    return value


def text(value: object) -> str:
    """Accept a string."""
    if not isinstance(value, str):
        raise ValueError('must be text in quotes ("...")')
    return value


def choice(*options: str) -> Check:
    """Make a check that accepts one of a few words."""

    def check(value: object) -> str:
        if value not in options:
            raise ValueError(f"must be one of {', '.join(map(repr, options))}")
        return str(value)

    return check


def texts(*options: str) -> Check:
    """Make a check that accepts a list of some of these texts."""

    def check(value: object) -> tuple[str, ...]:
        if not isinstance(value, list | tuple) or not all(one in options for one in value):
            raise ValueError(f"must be a list of {', '.join(map(repr, options))}")
        return tuple(value)

    return check


def numbers(length: int | None = None) -> Check:
    """Make a check that accepts a list of numbers; `length` None: as many as there are."""
    wanted = "numbers" if length is None else f"{length} numbers"

    def check(value: object) -> tuple[float, ...]:
        if (
            not isinstance(value, list | tuple)
            or (length is not None and len(value) != length)
            or not all(map(_is_number, value))
        ):
            raise ValueError(f"must be a list of {wanted}")
        return tuple(map(number, value))

    return check


def integers(length: int) -> Check:
    """Make a check that accepts a list of `length` whole numbers."""

    def check(value: object) -> tuple[int, ...]:
        if not isinstance(value, list | tuple) or len(value) != length:
            raise ValueError(f"must be a list of {length} whole numbers")
        return tuple(map(integer, value))

    return check


def table_of_numbers(columns: int, *, rows: int | None = None) -> Check:
    """Make a check that accepts a list of equally long lists of numbers."""
    wanted = f"{'' if rows is None else f'{rows} '}rows of {columns} numbers"

    def check(value: object) -> tuple[tuple[float, ...], ...]:
        if not isinstance(value, list | tuple) or (rows is not None and len(value) != rows):
            raise ValueError(f"must be a list of {wanted}")
        try:
            return tuple(numbers(columns)(row) for row in value)
        except ValueError:
            raise ValueError(f"must be a list of {wanted}") from None

    return check


def nested_numbers(value: object) -> Any:
    """Accept lists of numbers, nested to any depth, all of one shape at each depth."""
    if _is_number(value):
        return number(value)
    if not isinstance(value, list | tuple) or not value:
        raise ValueError("must be numbers in (nested) lists")
    inner = [nested_numbers(item) for item in value]
    lengths = {len(item) if isinstance(item, tuple) else -1 for item in inner}
    if len(lengths) != 1:
        raise ValueError("must be numbers in lists of one length")
    return tuple(inner)


def word_for_none(word: str) -> Check:
    """Make a check that accepts one word, which stands for None."""

    def check(value: object) -> None:
        if value != word:
            raise ValueError(f"must be {word!r}")

    return check


def either(*checks: Check) -> Check:
    """Make a check that accepts what any one of `checks` accepts."""

    def check(value: object) -> Any:
        wishes = []
        for attempt in checks:
            try:
                return attempt(value)
            except ValueError as error:
                wishes.append(str(error).removeprefix("must be "))
        raise ValueError("must be " + " or ".join(wishes))

    return check


# --- tables ------------------------------------------------------------------------------------


def nearest_name(name: str, valid: Iterable[str]) -> str | None:
    """The valid name that a wrong one was probably meant to be.

    Parameters
    ----------
    name : str
        As it was written.
    valid : iterable of str
        Names there are.

    Returns
    -------
    str or None
        None where nothing is near.

    Examples
    --------
    >>> nearest_name("position", ["position_mm", "emission_time_ps"])
    'position_mm'
    """
    names = list(valid)
    # A name that lacks its unit is nearer than one whose letters are alike.
    starts = [candidate for candidate in names if candidate.startswith(f"{name}_")]
    near = starts or difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return near[0] if near else None


def unknown_name_sentence(name: str, valid: Sequence[str]) -> str:
    """Text that goes on after "unknown key 'x'": the nearest name, else all of them.

    Parameters
    ----------
    name : str
        As it was written.
    valid : sequence of str
        Names there are.

    Returns
    -------
    str
        Without a full stop.
    """
    near = nearest_name(name, valid)
    return f"did you mean {near!r}?" if near else f"it can be one of {', '.join(valid)}"


def checked_table(
    table: Mapping[str, object], keys: Sequence[Key], *, section: str, where: str
) -> dict[str, object]:
    """Values of one section, checked and in the form the records take them.

    Parameters
    ----------
    table : mapping of str
        Keys and values of the section.
    keys : sequence of Key
        Keys there are.
    section : str
        Its name, for the error text.
    where : str
        The file (or option) the table came from, for the error text.

    Returns
    -------
    dict of str
        Keys that are absent are left out.

    Raises
    ------
    ConfigError
        For an unknown key (it names the nearest valid one) and for a value of the wrong form.
    """
    known = {key.name: key for key in keys}
    checked = {}
    for name, value in table.items():
        if name not in known:
            hint = unknown_name_sentence(name, list(known))
            raise ConfigError(f"{where}: unknown key {name!r} in [{section}]; {hint}")
        try:
            checked[name] = known[name].check(value)
        except ValueError as error:
            raise ConfigError(f"{where}: [{section}] {name} {error}, got {shown(value)}") from None
    return checked


@contextmanager
def telling_of(assignments: Sequence[str]) -> Iterator[None]:
    """Let what is refused name the assignments too: the file alone need not be at fault.

    Parameters
    ----------
    assignments : sequence of str
        As for `override_table`.

    Raises
    ------
    ConfigError
        That of the block, with the assignments.
    """
    try:
        yield
    except ConfigError as error:
        if not assignments:
            raise
        told = " ".join(f"--set {one}" for one in assignments)
        raise ConfigError(f"{error} (with {told})") from error


def checked_sections(
    table: Mapping[str, object], sections: Mapping[str, Sequence[Key] | None], *, where: str
) -> dict[str, dict[str, Any]]:
    """All sections of a set-up, checked.

    Parameters
    ----------
    table : mapping of str
        Sections by name.
    sections : mapping of str to (sequence of Key or None)
        Sections there are; one without a list of keys is handed on as it is.
    where : str
        The file (or option) the table came from, for the error text.

    Returns
    -------
    dict of str to dict
        Sections that are absent are left out.

    Raises
    ------
    ConfigError
        For an unknown section, a key outside any section, and whatever `checked_table` raises for.
    """
    checked = {}
    for name, value in table.items():
        if name not in sections:
            what = "section" if isinstance(value, Mapping) else "key"
            # A key above the first section is most often one that lacks its section.
            homes = [s for s, keys in sections.items() if name in {k.name for k in keys or ()}]
            if what == "key" and homes:
                raise ConfigError(f"{where}: {name!r} must stand under [{homes[0]}]")
            hint = unknown_name_sentence(name, list(sections))
            raise ConfigError(f"{where}: unknown {what} {name!r}; {hint}")
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where}: {name!r} must be a section, [{name}], got {shown(value)}")
        keys = sections[name]
        checked[name] = (
            dict(value) if keys is None else checked_table(value, keys, section=name, where=where)
        )
    return checked


def table_from_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Parse a TOML file.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    dict of str
        What it holds, unchecked.

    Raises
    ------
    ConfigError
        Where the file is missing, cannot be read, or is not TOML (the text names the line).
    """
    try:
        if Path(path).exists() and not Path(path).is_file():
            raise ConfigError(f"{path}: cannot be read, it is no regular file: name a set-up file")
        if Path(path).stat().st_size > _MOST_BYTES:
            raise ConfigError(f"{path}: is too large for a set-up file")
        return _table_of(Path(path).read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: there is no such set-up file: check the name") from None
    except UnicodeDecodeError:
        raise ConfigError(
            f"{path}: is not a text file in UTF-8, as TOML is: name a set-up file, or save it so"
        ) from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, _TooDeepError) as error:
        raise ConfigError(f"{path}: is not valid TOML: {error}") from None


class _TooDeepError(ValueError):
    """Tables, lists or numbers beyond what a set-up needs."""


def _table_of(text: str) -> dict[str, object]:
    """Parse TOML; whatever the parser cannot bear is one error of two kinds."""
    # A dotted key takes the parser a time that grows with the square of its parts.
    words = re.split(r"[^\w.\"'-]+", text.replace(" ", "").replace("\t", ""))
    if any(word.count(".") > _MOST_DOTS for word in words):
        raise _TooDeepError(f"a key has more than {_MOST_DOTS} parts")
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    # Brackets nested deep, and whole numbers of thousands of digits, are too much for Python.
    except (RecursionError, ValueError) as error:
        raise _TooDeepError(
            f"its nesting or a number is too long ({type(error).__name__})"
        ) from None
    level: list[Any] = [table]
    for _ in range(_MOST_LEVELS):
        level = [
            inner
            for one in level
            for inner in (one.values() if isinstance(one, dict) else one)
            if isinstance(inner, dict | list)
        ]
    if level:
        raise _TooDeepError(f"its tables lie more than {_MOST_LEVELS} levels deep")
    return table


def override_table(table: Mapping[str, Any], assignments: Iterable[str]) -> dict[str, Any]:
    """Table with `section.key=value` assignments laid over it.

    Parameters
    ----------
    table : mapping of str
        Sections by name; it is not changed.
    assignments : iterable of str
        Values are written as in TOML. One that is no TOML is taken as text, so that quotes may be
        left out on a command line.

    Returns
    -------
    dict of str
        A copy.

    Raises
    ------
    ConfigError
        For an assignment that is not of that form.

    Examples
    --------
    >>> override_table({"source": {"emission_time_ps": 0.0}}, ["source.emission_time_ps=2000"])
    {'source': {'emission_time_ps': 2000}}
    """
    out = deepcopy(dict(table))
    for assignment in assignments:
        address, equals, value = assignment.partition("=")
        section, dot, key = address.strip().partition(".")
        if not (equals and dot and section and key):
            raise ConfigError(
                f"--set {assignment!r}: write section.key=value, "
                "for example source.emission_time_ps=2000"
            )
        if not isinstance(out.setdefault(section, {}), dict):
            raise ConfigError(f"--set {assignment!r}: {section!r} is not a section of the set-up")
        out[section][key] = value_from_text(value)
    return out


def value_from_text(value: str) -> Any:
    """A TOML value from text; text that is no TOML value stays text.

    Parameters
    ----------
    value : str
        Right-hand side of an assignment.

    Returns
    -------
    object
        Number, text, truth value, list or table.

    Examples
    --------
    >>> value_from_text("[1, 2.5]"), value_from_text("pf32")
    ([1, 2.5], 'pf32')
    """
    try:
        return _table_of(f"value = {value.strip()}")["value"]
    except (tomllib.TOMLDecodeError, _TooDeepError):
        return value.strip()
