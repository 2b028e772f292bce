"""Names of files as texts that can be written: a name is bytes to the system, UTF-8 or not."""

from __future__ import annotations

import os


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
