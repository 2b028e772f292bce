"""Files that one task keeps for a later one, or for the next run: of whose job, and whether whole.

Each carries the key of the job it was made for. What fits the key is taken up, anything else is
made again over it: there is no journal that could get out of step with the files.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import FileFormatError


def kept_arrays(file: Path, kind: str, key: str) -> dict[str, NDArray[np.generic]]:
    """Arrays of a file that a task of the same job made.

    Parameters
    ----------
    file : Path
        Where the task keeps its result.
    kind : str
        What sort of result it is.
    key : str
        The job's (`Job.key`).

    Returns
    -------
    dict of str to array
        Arrays by name.

    Raises
    ------
    FileFormatError
        Where there is none: no file, a damaged one, or one of another job.
    """
    from lightflight.files.store import load_record

    arrays, attributes = load_record(file, kind=kind)
    if attributes.get("key") != key:
        raise FileFormatError(
            "is of another recording or set-up: run the campaign again", path=file
        )
    return arrays


def is_kept(file: Path, kind: str, key: str) -> bool:
    """Whether a task of the same job made this file: a look at its head, however large it is.

    Parameters
    ----------
    file, kind, key
        As for `kept_arrays`.

    Returns
    -------
    bool
        False for a damaged head too.
    """
    from lightflight.files.store import open_record

    try:
        with open_record(file, kind=kind) as (_, attributes):
            return bool(attributes.get("key") == key)
    except FileFormatError:
        return False


def is_kept_whole(file: Path, kind: str, key: str) -> bool:
    """Whether a task of the same job made this file, and all of it can be read.

    Parameters
    ----------
    file, kind, key
        As for `kept_arrays`.

    Returns
    -------
    bool
        False for a damaged file too.
    """
    try:
        kept_arrays(file, kind, key)
    except FileFormatError:
        return False
    return True
