"""Everything of histograms that is not the cube, as one text that other formats carry along."""

from __future__ import annotations

import json
import os
from typing import Any

from lightflight.errors import FileFormatError
from lightflight.files.store import json_text
from lightflight.recording.clock_fields import CLOCK_FIELDS
from lightflight.recording.histograms import Histograms

_NAMES = (*CLOCK_FIELDS, "poisson")


def text_from_histograms(hist: Histograms) -> str:
    """JSON of the clock, `poisson` and the settings.

    Parameters
    ----------
    hist : Histograms
        Its counts are not looked at.

    Returns
    -------
    str
        For `fields_from_text`.
    """
    known = {name: getattr(hist, name) for name in _NAMES}
    return json_text({**known, "settings": dict(hist.settings)})


def fields_from_text(
    text: str | None, path: str | os.PathLike[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What such a text says.

    Parameters
    ----------
    text : str or None
        None: the file carries none.
    path : path
        The file, for the message.

    Returns
    -------
    fields : dict of str
        Fields of the record, `poisson` included; empty without a text.
    settings : dict of str
        Its settings; empty without a text.

    Raises
    ------
    FileFormatError
        Where the text is damaged.
    """
    if text is None:
        return {}, {}
    try:
        known = json.loads(text)
        settings = dict(known["settings"])
        return {name: known[name] for name in _NAMES if name in known}, settings
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileFormatError(
            "its metadata are not readable: the file is damaged", path=path
        ) from error
