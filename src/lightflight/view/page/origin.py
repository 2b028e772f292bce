"""Where a path comes from, in words: names with their units, numbers, lists and what they hold.

Takes provenance (nested mappings of JSON values), gives HTML in which everything is escaped.
"""

from __future__ import annotations

import html
from collections.abc import Mapping

from lightflight.view.types import Json

_UNITS = ("mm", "ps", "deg", "px", "hz", "ns", "c")
"""Ends of names that say the unit of their value."""

_WORDS = {
    "lightflight": "version of lightflight",
    "python": "version of Python",
    "packages": "versions of packages",
    "made_utc": "made (UTC)",
    "sha256": "SHA-256",
    "bytes": "size (bytes)",
}

_FOLDED = 4
"""A part with more entries than this is shown when it is asked for."""


def name_in_words(name: str) -> str:
    """The name of a setting as one would say it, its unit in brackets.

    Parameters
    ----------
    name : str
        As the settings file spells it.

    Examples
    --------
    >>> name_in_words("position_std_mm"), name_in_words("dark_rate_hz")
    ('position std (mm)', 'dark rate (Hz)')
    """
    if name in _WORDS:
        return _WORDS[name]
    stem, _, end = name.rpartition("_")
    if stem and end in _UNITS:
        unit = {"hz": "Hz", "deg": "\u00b0"}.get(end, end)
        return f"{stem.replace('_', ' ')} ({unit})"
    return name.replace("_", " ")


def value_in_words(value: object) -> str:
    """A value without parts of its own names, as text.

    Parameters
    ----------
    value : object
        A JSON value: number, text, list of such.

    Examples
    --------
    >>> value_in_words([[1.0, 0.0], [0.0, 2.5e-07]]), value_in_words(None), value_in_words(True)
    ('1, 0; 0, 2.5e-07', 'none', 'yes')
    """
    if value is None or value == "":
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, (list, tuple)):
        rows = any(isinstance(one, (list, tuple)) for one in value)
        return ("; " if rows else ", ").join(value_in_words(one) for one in value) or "none"
    return str(value)


def origin_html(provenance: Json) -> str:
    """A list of names and values, the longer parts of it folded.

    Parameters
    ----------
    provenance : dict
        Inputs, settings, versions and seed that made a path.
    """
    items = "".join(
        f"<dt>{html.escape(name_in_words(name))}</dt><dd>{_part_html(value)}</dd>"
        for name, value in provenance.items()
    )
    return f'<dl class="origin">{items}</dl>'


def _part_html(value: object) -> str:
    if isinstance(value, Mapping):
        parts = dict(value)
        if not parts:
            return "none"
        listed = origin_html(parts)
        if len(parts) <= _FOLDED:
            return listed
        names = html.escape(", ".join(name_in_words(name) for name in list(parts)[:_FOLDED]))
        return f"<details><summary>{names}, \u2026</summary>{listed}</details>"
    if isinstance(value, (list, tuple)) and any(isinstance(one, Mapping) for one in value):
        return "".join(_part_html(one) for one in value)
    return html.escape(value_in_words(value))
