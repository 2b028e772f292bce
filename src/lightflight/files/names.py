"""Names of files as texts that can be written: a name is bytes to the system, UTF-8 or not."""

from __future__ import annotations

import os
import re

# Control characters, and those that turn the direction of a line.
_COMMANDS = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def readable(name: str | os.PathLike[str]) -> str:
    r"""A name, with what is no UTF-8 spelled out, for tables and messages.

    Parameters
    ----------
    name : str or path
        As Python gives it: bytes that are no UTF-8 are lone surrogates.

    Returns
    -------
    str
        The same where it is UTF-8.

    Examples
    --------
    >>> print(readable("caf\udce9.h5"))
    caf\xe9.h5
    """
    text = os.fspath(name)
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    return text


def harmless(text: str) -> str:
    r"""A text in one line that no terminal obeys, for what came with a file.

    Parameters
    ----------
    text : str
        A name, a setting, a sentence about them.

    Returns
    -------
    str
        Control characters, line ends among them, are spelled out.

    Examples
    --------
    >>> print(harmless("a\x1b[2Jb"))
    a\x1b[2Jb
    """
    return _COMMANDS.sub(lambda one: one[0].encode("unicode_escape").decode(), text)
