"""Errors and warnings: each says in one sentence what was found, where, and what to do.

Every type subclasses a builtin, so callers need not know us. `exit_code` is what the
command line returns for it (`lightflight --help` lists them).
"""

from __future__ import annotations

import importlib
import os
from types import ModuleType
from typing import Any

_LONGEST_SENTENCE = 1000


class FileFormatError(ValueError):
    """A file is missing, empty, truncated, foreign or damaged.

    Parameters
    ----------
    message : str
        What is wrong with it and what to do, after the file's name.
    path : path, optional
        The file.
    offset : int, optional
        Byte at which it goes wrong.
    """

    exit_code = 3

    def __init__(
        self, message: str, *, path: str | os.PathLike[str] | None = None, offset: int | None = None
    ) -> None:
        self.path = None if path is None else os.fspath(path)
        self.offset = offset
        if len(message) > _LONGEST_SENTENCE:  # a file may hold a word of any length
            message = (
                f"{message[: _LONGEST_SENTENCE // 2]} ... {message[-_LONGEST_SENTENCE // 4 :]}"
            )
        where = "" if self.path is None else f"{self.path}: "
        at = "" if offset is None else f" (at byte {offset})"
        super().__init__(f"{where}{message}{at}")


class LimitError(ValueError):
    """More than this version takes, of whatever made it: nothing is damaged."""

    exit_code = 3


class ConfigError(ValueError):
    """A set-up file or an option is wrong."""

    exit_code = 2


class CalibrationError(ValueError):
    """The clock cannot be calibrated, or a calibration does not fit the recording."""

    exit_code = 4


class GeometryError(ValueError):
    """Camera, source and path are in a position that cannot be computed.

    Parameters
    ----------
    message : str
        What is wrong and what to do.
    offenders : array or int, optional
        Marks the elements of the input that caused it, where there are several.
    """

    exit_code = 5

    def __init__(self, message: str, *, offenders: Any = None) -> None:
        self.offenders = offenders
        super().__init__(message)


class NothingFoundError(ValueError):
    """The recording holds nothing that can be reconstructed; the text says why."""

    exit_code = 5


class NotConvergedError(RuntimeError):
    """An iteration ended without meeting its tolerance."""

    exit_code = 5


class MissingExtraError(ImportError):
    """An optional package is needed; the text names the extra that brings it."""

    exit_code = 2


def optional_package(name: str, otherwise: str) -> ModuleType:
    """A package that only some users have.

    Parameters
    ----------
    name : str
        What to import.
    otherwise : str
        Sentence for who does not have it: what needs it and which extra brings it.

    Returns
    -------
    module
        The package.

    Raises
    ------
    MissingExtraError
        Without it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError(otherwise) from error


class LightflightWarning(UserWarning):
    """Base of every warning this package gives."""


class UncalibratedWarning(LightflightWarning):
    """A nominal value stands in for a calibration; the text says what that costs."""


class SuspectDataWarning(LightflightWarning):
    """The data are usable but something about them looks wrong."""
