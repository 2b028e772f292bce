"""Records as cards, for terminals and notebooks, and numbers as words for every picture.

Gives text: `number`, `with_error`, and `Card`: a title, a few facts and one small picture, made
here as PNG or SVG (no plotting package is loaded). A record that is `Shown` prints as its card.
Nothing of the package is imported but `flags`.
"""

from __future__ import annotations

import base64
import html
import importlib
import struct
import textwrap
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from types import ModuleType
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags as fl

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

Facts = list[tuple[str, str]]

_PICTURE_PX = 128
"""Longest side of a picture's data; larger ones are thinned by their mean."""

_MOST_LINES = 15
"""Of a record on a terminal: more than that nobody reads."""

_MOST_LETTERS = 100
"""Of a line there."""

_FEW_NUMBERS = 6
"""An array of so many is shown, a larger one only by its shape."""

_TERM = "text-align:left;vertical-align:top;font-weight:normal;opacity:.7;padding:1px 12px 1px 0"


def number(value: float | None, digits: int = 3, *, sign: bool = False) -> str:
    """`value` with so many significant digits, a true minus sign and no exponent for 1e-4…1e6.

    Parameters
    ----------
    value : float or None
        The number.
    digits : int, optional
        Significant digits.
    sign : bool, optional
        True writes + before positive numbers.

    Examples
    --------
    >>> number(1234.5), number(0.085612), number(7.0, sign=True)
    ('1234', '0.0856', '+7.00')
    """
    if value is None or not np.isfinite(value):
        return "\u2013"
    if value == 0:
        return "0"
    size = abs(value)
    if 1e-4 <= size < 1e7:
        places = max(0, digits - 1 - int(np.floor(np.log10(size))))
        text = f"{size:,.{places}f}" if size >= 10_000 else f"{size:.{places}f}"
        text = text.replace(",", "\u2009")
    else:
        text = f"{size:.{digits - 1}e}"
    return ("\u2212" if value < 0 else "+" if sign else "") + text


def with_error(value: float | None, error: float | None) -> str:
    """`value ± error`, the error with two significant digits; without one, six of the value.

    Parameters
    ----------
    value : float or None
        The number.
    error : float or None
        Its standard deviation.

    Examples
    --------
    >>> with_error(60.123, 0.34)
    '60.12 ± 0.34'
    """
    if value is None or not np.isfinite(value):
        return "\u2013"
    if error is None or not np.isfinite(error) or error <= 0:
        return number(value, 6)
    places = min(9, max(0, 1 - int(np.floor(np.log10(error)))))
    text = f"{abs(value):.{places}f} \u00b1 {error:.{places}f}"
    return ("\u2212" if value < 0 else "") + text


def count(n: int, thing: str) -> str:
    """A number of things: a word up to five, so that all outputs say the same.

    Parameters
    ----------
    n : int
        How many.
    thing : str
        What, in the singular; its plural ends in s.

    Examples
    --------
    >>> count(1, "leg"), count(3, "leg"), count(12, "leg")
    ('one leg', 'three legs', '12 legs')
    """
    words = {0: "no", 1: "one", 2: "two", 3: "three", 4: "four", 5: "five"}
    return f"{words.get(n, str(n))} {thing}{'' if n == 1 else 's'}"


@dataclass(frozen=True)
class Card:
    """What a record says of itself.

    Attributes
    ----------
    title : str
        The kind of record.
    facts : list of (str, str)
        Terms and what is said of each; both are text, not HTML. A term may be empty: its text goes
        on with the one before.
    picture : callable, optional
        Makes HTML or SVG; asked for by notebooks alone.
    caption : str
        What the picture shows.
    """

    title: str
    facts: Facts
    picture: Callable[[], str] | None = None
    caption: str = ""

    def text(self) -> str:
        """The card for a terminal: at most 15 lines.

        Examples
        --------
        >>> print(Card("Camera", [("lens", "without distortion"), ("pose", "exact")]).text())
        Camera
          lens  without distortion
          pose  exact
        """
        width = max((len(term) for term, _ in self.facts), default=0)
        lines = [
            line
            for term, text in self.facts
            for line in textwrap.wrap(
                text,
                _MOST_LETTERS,
                initial_indent=f"  {term:<{width}}  ",
                subsequent_indent=" " * (width + 4),
            )
        ]
        return "\n".join(at_most([self.title, *lines], _MOST_LINES))

    def html(self) -> str:
        """The card for a notebook: title, facts, a small picture; a few kB, no scripts.

        Examples
        --------
        >>> Card("Camera", [("lens", "f < 4")]).html().count("f &lt; 4")
        1
        """
        rows = "".join(
            f'<tr><th style="{_TERM}">{html.escape(term)}</th>'
            f'<td style="text-align:left">{html.escape(text)}</td></tr>'
            for term, text in self.facts
        )
        picture, figure = "" if self.picture is None else self.picture(), ""
        if picture:
            figure = (
                f'<figure style="margin:0">{picture}<figcaption style="font-size:85%;opacity:.7">'
                f"{html.escape(self.caption)}</figcaption></figure>"
            )
        return (
            '<div style="display:flex;flex-wrap:wrap;gap:8px 28px;align-items:flex-start">'
            f'<div style="max-width:36em"><b>{self.title}</b><table>{rows}</table></div>'
            f"{figure}</div>"
        )


class Shown:
    """A record that prints as its card, in Python and in a notebook.

    Without a card of its own its fields are told: numbers, and the shapes of arrays.
    """

    __slots__ = ()

    def __repr__(self) -> str:
        return self._card().text()

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return self._card().html()

    def _card(self) -> Card:
        return Card(type(self).__name__, field_facts(self))


class Drawn(Shown):
    """A record that can be drawn."""

    __slots__ = ()

    def plot(self, what: str | None = None) -> Figure:
        """A figure of the record.

        Parameters
        ----------
        what : str, optional
            Which, as `lightflight plot --what` calls it; None: the one that shows most.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it; `savefig` writes it.

        Raises
        ------
        ValueError
            Where no such figure can be drawn of it; the sentence lists those that can.
        """
        figure: Figure = _view().figure_of(self, what)
        return figure


class Tabled(Shown):
    """A record that holds a table."""

    __slots__ = ()

    def to_dataframe(self) -> DataFrame:
        """The table, errors beside the values, units in the names of the columns.

        Returns
        -------
        pandas.DataFrame
            Of a path its corners, of arrivals and pulses one row per pulse, of a plan one per place
            of the camera, of a campaign one per recording.

        Raises
        ------
        MissingExtraError
            Without pandas.
        """
        table: DataFrame = _view().dataframe_of(self)
        return table


class Labelled(Shown):
    """A record that holds arrays with axes and units."""

    __slots__ = ()

    def to_xarray(self) -> Dataset:
        """The arrays with their axes, units and errors.

        Returns
        -------
        xarray.Dataset
            As `lightflight.view.to_xarray` makes it.

        Raises
        ------
        MissingExtraError
            Without xarray.
        """
        labelled: Dataset = _view().to_xarray(self)
        return labelled


def _view() -> ModuleType:
    # The one way up, taken when a user asks: a record knows that it can be drawn, view knows how.
    return importlib.import_module("lightflight.view")


def at_most(lines: list[str], n: int) -> list[str]:
    """The first lines, and how many there are more."""
    return (
        lines if len(lines) <= n else [*lines[: n - 1], f"  \u2026 and {len(lines) - n + 1} more"]
    )


# --- facts that several records have ------------------------------------------------------------


class ReadAsTimes(Protocol):
    """What has codes that are read as times: recordings, histograms, calibrations."""

    @property
    def n_codes(self) -> int:
        """Number of TDC codes."""

    @property
    def bin_width_ps(self) -> float | None:
        """Width of a code, ps; None: unknown."""

    @property
    def laser_period_ps(self) -> float | None:
        """Period of the laser, ps; None: one sweep."""

    @property
    def reversed_codes(self) -> bool:
        """True where a larger code is an earlier photon."""


def size_facts(shape: tuple[int, int]) -> Facts:
    """The camera's pixels, (rows, cols)."""
    return [("camera", f"{shape[0]} \u00d7 {shape[1]} pixels")]


def clock_facts(record: ReadAsTimes) -> Facts:
    """Codes, their width and the laser's period."""
    direction = "backwards" if record.reversed_codes else "forwards"
    return [
        ("codes", f"{record.n_codes}, running {direction}"),
        ("time per code", _ps(record.bin_width_ps)),
        ("laser period", _ps(record.laser_period_ps)),
    ]


def count_facts(**counts: float | None) -> Facts:
    """Large numbers with their digits in threes, by what they count; None is passed over."""
    return [
        (name.replace("_", " "), f"{n:,.0f}".replace(",", "\u2009"))
        for name, n in counts.items()
        if n is not None
    ]


def flag_facts(words: NDArray[np.uint32]) -> Facts:
    """How many of the words have each flag."""
    counted = ", ".join(
        f"{count} {name.replace('_', ' ')}" for name, count in fl.count_flags(words).items()
    )
    return [("flagged", counted or "none")]


def field_facts(record: object) -> Facts:
    """The fields of a dataclass in a few words each; what is None is passed over."""
    facts = []
    for one in fields(record):  # type: ignore[arg-type]
        value = getattr(record, one.name)
        if one.repr and value is not None:
            facts.append((one.name, _in_words(value)))
    return facts


def _in_words(value: object) -> str:
    """A value in one line, whatever it is."""
    if isinstance(value, np.ndarray):
        if value.ndim and value.size > _FEW_NUMBERS:
            return " \u00d7 ".join(map(str, value.shape)) + " numbers"
        return np.array2string(value, precision=6, separator=", ").replace("\n", "")
    if isinstance(value, bool | str):
        return str(value)
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple | list):
        if len(value) <= _FEW_NUMBERS and all(isinstance(v, float | int | str) for v in value):
            return ", ".join(map(_in_words, value)) or "none"
        return f"{len(value)} of them"
    if isinstance(value, Mapping):
        return ", ".join(map(str, value)) or "none"
    if hasattr(value, "__dataclass_fields__"):
        return f"a {type(value).__name__}"
    return type(value).__name__ if callable(value) else str(value)


def _ps(value: float | None) -> str:
    return "unknown" if value is None else f"{number(value, 5)} ps"


# --- pictures -----------------------------------------------------------------------------------


def png_from_image(image: ArrayLike, *, percent: float = 99.0) -> bytes:
    """A grey picture (rows, cols) as PNG: dark is little, NaN is clear; thinned to 128 px.

    The scale runs from the smallest value to the percentile `percent`.

    Parameters
    ----------
    image : array
        Values by pixel, shape (rows, cols); NaN is clear.
    percent : float, optional
        Percentile at which the scale ends.
    """
    values = _thinned(np.asarray(image, dtype=float))
    finite = np.isfinite(values)
    grey = np.zeros(values.shape)
    if finite.any():
        low, high = values[finite].min(), np.percentile(values[finite], percent)
        span = high - low if high > low else 1.0
        grey[finite] = np.clip((values[finite] - low) / span, 0.0, 1.0)
    pixels = np.stack((35 + 220 * grey, np.where(finite, 255, 0)), axis=-1).astype(np.uint8)
    rows, cols = values.shape
    raw = b"".join(b"\0" + pixels[row].tobytes() for row in range(rows))
    header = struct.pack(">IIBBBBB", cols, rows, 8, 4, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(raw, 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )


def _thinned(image: NDArray[np.float64]) -> NDArray[np.float64]:
    # Rounded up, so that no picture is larger than it may be.
    step = -(-max(image.shape) // _PICTURE_PX)
    if step == 1:
        return image
    rows, cols = (step * -(-length // step) for length in image.shape)
    # NaN at the border, which the mean of a block leaves out.
    padded = np.full((rows, cols), np.nan)
    padded[: image.shape[0], : image.shape[1]] = image
    blocks = padded.reshape(rows // step, step, cols // step, step)
    known = np.isfinite(blocks)
    total = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(total / known.sum(axis=(1, 3)))


def picture_from_image(image: ArrayLike, *, percent: float = 99.0) -> str:
    """The picture of `png_from_image` as HTML."""
    data = base64.b64encode(png_from_image(image, percent=percent)).decode("ascii")
    return (
        f'<img src="data:image/png;base64,{data}" alt="" '
        'style="width:128px;image-rendering:pixelated"/>'
    )


def _breaks(told: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Numbers, among the rows that are told, of those that follow one that is not."""
    after = np.flatnonzero(told[1:] & ~told[:-1]) + 1
    breaks: NDArray[np.intp] = np.cumsum(told)[after] - 1
    return breaks


def picture_from_vertices(vertices_mm: ArrayLike) -> str:
    """Front (x, y) and top (x, z) view of a path's vertices (m, 3), one scale, as SVG.

    A row that is not finite parts the line: what follows begins anew.
    """
    rows = np.asarray(vertices_mm, dtype=float)
    told = np.isfinite(rows).all(axis=1)
    vertices = rows[told]
    if len(vertices) < 2:
        return ""
    pieces = [piece for piece in np.split(np.arange(len(vertices)), _breaks(told)) if len(piece)]
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0)
    scale = 240.0 / max(size[0], 2 * (size[1] + size[2]), 1e-9)
    height = (size[1] + size[2]) * scale + 40.0
    lines = []
    for axis, floor in ((1, 10.0 + size[1] * scale), (2, 30.0 + (size[1] + size[2]) * scale)):
        x = 10.0 + (vertices[:, 0] - low[0]) * scale
        y = floor - (vertices[:, axis] - low[axis]) * scale
        for piece in pieces:
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[piece], y[piece], strict=True))
            lines.append(
                f'<polyline points="{points}" fill="none" stroke="#c8440a" stroke-width="2"/>'
            )
        lines.append(f'<circle cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="3.5" fill="currentColor"/>')
    return f'<svg width="260" height="{height:.0f}" role="img">{"".join(lines)}</svg>'
