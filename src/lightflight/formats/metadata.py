"""Everything of histograms that is not the cube, as one text that other formats carry along."""

from __future__ import annotations

import json
import os
from typing import Any

from lightflight.errors import FileFormatError
from lightflight.histogram import Histograms
from lightflight.recording import CLOCK_FIELDS

_NAMES = (*CLOCK_FIELDS, "poisson")


def text_from_histograms(hist: Histograms) -> str:
    """JSON of the clock, `poisson` and the settings."""
    from lightflight.store import json_text

    known = {name: getattr(hist, name) for name in _NAMES}
    return json_text({**known, "settings": dict(hist.settings)})


def fields_from_text(
    text: str | None, path: str | os.PathLike[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """(fields of the record, settings) from such a text; both empty where there is none."""
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
