"""Everything of histograms that is not the cube, as one text that other formats carry along."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

from lightflight.errors import FileFormatError
from lightflight.files.digest import (
    digest_of_values,
    is_digest_of,
    not_as_written,
    say_no_digest,
)
from lightflight.files.store import json_text
from lightflight.recording.clock_fields import CLOCK_FIELDS
from lightflight.recording.histograms import Histograms

_NAMES = (*CLOCK_FIELDS, "poisson")
TEXT, DIGEST = "lightflight", "lightflight_digest"
"""Names under which a file of another format carries our metadata, and the digest over all."""


def text_from_histograms(hist: Histograms, **more: object) -> str:
    """JSON of the clock, `poisson` and the settings.

    Parameters
    ----------
    hist : Histograms
        Its counts are not looked at.
    **more : object
        What the text says beside them.

    Returns
    -------
    str
        For `fields_from_texts`.
    """
    known = {name: getattr(hist, name) for name in _NAMES}
    return json_text({**known, "settings": dict(hist.settings), **more})


def texts_from_histograms(hist: Histograms) -> dict[str, str]:
    """Texts that another format carries along with the counts: ours, the axes, the digest.

    Parameters
    ----------
    hist : Histograms
        What is stored, in the order "yxt".

    Returns
    -------
    dict of str to str
        By name, for `fields_from_texts` and `check_texts`.
    """
    texts = {TEXT: text_from_histograms(hist, sealed=True), "axes": "yxt"}
    return {**texts, DIGEST: digest_of_values(texts, hist.counts)}


def fields_from_texts(
    texts: Mapping[str, str], path: str | os.PathLike[str]
) -> tuple[dict[str, object], dict[str, object]]:
    """What those texts say.

    Parameters
    ----------
    texts : mapping of str to str
        Texts of the file by name; others than ours are passed over.
    path : path
        The file, for the message.

    Returns
    -------
    fields, settings : dict of str
        Of the record, `poisson` among the fields; empty without a text.

    Raises
    ------
    FileFormatError
        Where the text is damaged.
    """
    fields, settings, _ = _parsed(texts.get(TEXT), path)
    return fields, settings


def check_texts(
    texts: Mapping[str, str], record: object, stored: Any, path: str | os.PathLike[str]
) -> None:
    """Raise FileFormatError where counts and texts are not what their digest says.

    Parameters
    ----------
    texts : mapping of str to str
        As for `fields_from_texts`.
    record : Recording or Histograms
        What was made of them.
    stored : callable
        Gives the counts as they are stored; asked where the record was told other axes.
    path : path
        The file, for the message.
    """
    sealed = _parsed(texts.get(TEXT), path)[2]
    if not (sealed or DIGEST in texts):
        if TEXT in texts:
            say_no_digest(os.fspath(path))
        return
    covered = {name: texts[name] for name in (TEXT, "axes") if name in texts}
    if isinstance(record, Histograms) and is_digest_of(texts.get(DIGEST), covered, record.counts):
        return
    if not is_digest_of(texts.get(DIGEST), covered, stored()):
        raise not_as_written(path)


def _parsed(
    text: str | None, path: str | os.PathLike[str]
) -> tuple[dict[str, object], dict[str, object], bool]:
    """Fields of the record, its settings, and whether the text says that there is a digest."""
    if text is None:
        return {}, {}, False
    try:
        known = json.loads(text)
        settings = dict(known["settings"])
        fields = {name: known[name] for name in _NAMES if name in known}
        return fields, settings, "sealed" in known
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileFormatError(
            "its metadata are not readable: the file is damaged", path=path
        ) from error
