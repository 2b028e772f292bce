"""Records as small HTML for notebooks, and numbers as words for every picture.

Takes any record by its fields (nothing of the package is imported but `flags`), gives text:
`number`, `with_error`, and `html_from_record`, which records call in `_repr_html_`. A card has a
title, a few facts and one small picture, made here as PNG or SVG: no plotting package is loaded.
"""

from __future__ import annotations

import base64
import html
import struct
import zlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags as fl

if TYPE_CHECKING:
    from lightflight import (
        Arrivals,
        Bounds,
        Camera,
        Histograms,
        LightPath,
        Pulses,
        Recording,
        TimingCalibration,
    )

Facts = list[tuple[str, str]]

_PICTURE_PX = 128
"""Longest side of a picture's data; larger ones are thinned by their mean."""

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


def html_from_record(record: Any) -> str:
    """A record as a card of HTML: title, facts, a small picture; a few kB, no scripts.

    Parameters
    ----------
    record : object
        One that has a card.

    Raises
    ------
    TypeError
        For anything but the package's records.
    """
    name = type(record).__name__
    if name not in _CARDS:
        raise TypeError(f"there is no card for {name}: choose one of {', '.join(_CARDS)}")
    facts, picture, caption = _CARDS[name](record)
    rows = "".join(
        f'<tr><th style="{_TERM}">{html.escape(term)}</th>'
        f'<td style="text-align:left">{html.escape(text)}</td></tr>'
        for term, text in facts
    )
    figure = ""
    if picture:
        figure = (
            f'<figure style="margin:0">{picture}<figcaption style="font-size:85%;opacity:.7">'
            f"{html.escape(caption)}</figcaption></figure>"
        )
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:8px 28px;align-items:flex-start">'
        f'<div style="max-width:36em"><b>{name}</b><table>{rows}</table></div>{figure}</div>'
    )


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


def _picture(image: ArrayLike, *, percent: float = 99.0) -> str:
    data = base64.b64encode(png_from_image(image, percent=percent)).decode("ascii")
    return (
        f'<img src="data:image/png;base64,{data}" alt="" '
        'style="width:128px;image-rendering:pixelated"/>'
    )


def _path_picture(path: LightPath) -> str:
    """Front (x, y) and top (x, z) view of the vertices, one scale, as SVG."""
    vertices = np.asarray(path.vertices_mm, dtype=float)
    vertices = vertices[np.isfinite(vertices).all(axis=1)]
    if len(vertices) < 2:
        return ""
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0)
    scale = 240.0 / max(size[0], 2 * (size[1] + size[2]), 1e-9)
    height = (size[1] + size[2]) * scale + 40.0
    lines = []
    for axis, floor in ((1, 10.0 + size[1] * scale), (2, 30.0 + (size[1] + size[2]) * scale)):
        x = 10.0 + (vertices[:, 0] - low[0]) * scale
        y = floor - (vertices[:, axis] - low[axis]) * scale
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        lines.append(
            f'<polyline points="{points}" fill="none" stroke="#c8440a" stroke-width="2"/>'
            f'<circle cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="3.5" fill="currentColor"/>'
        )
    return f'<svg width="260" height="{height:.0f}" role="img">{"".join(lines)}</svg>'


# --- one card per record ------------------------------------------------------------------------

Card = tuple[Facts, str, str]


def _ps(value: float | None) -> str:
    return "unknown" if value is None else f"{number(value, 5)} ps"


def _count(n: float) -> str:
    return f"{n:,.0f}".replace(",", "\u2009")


def _size(record: Any) -> str:
    rows, cols = record.shape
    return f"{rows} \u00d7 {cols} pixels"


def _clock_facts(record: Histograms | Recording | TimingCalibration) -> Facts:
    direction = "backwards" if record.reversed_codes else "forwards"
    return [
        ("codes", f"{record.n_codes}, running {direction}"),
        ("time per code", _ps(record.bin_width_ps)),
        ("laser period", _ps(record.laser_period_ps)),
    ]


def _flag_facts(words: NDArray[np.uint32]) -> Facts:
    counted = ", ".join(
        f"{count} {name.replace('_', ' ')}" for name, count in fl.count_flags(words).items()
    )
    return [("flagged", counted or "none")]


def _histograms_card(hist: Histograms) -> Card:
    photons = np.asarray(hist.photons, dtype=float)
    facts = [
        ("camera", _size(hist)),
        *_clock_facts(hist),
        ("photons", _count(float(photons.sum()))),
        ("brightest pixel", _count(float(photons.max()))),
    ]
    if hist.n_frames is not None:
        facts.append(("frames", _count(hist.n_frames)))
    # A tenth of the pixels may scream; they must not hide the others.
    picture = _picture(np.sqrt(np.maximum(photons, 0.0)), percent=90.0)
    return facts, picture, "photons by pixel (square root)"


def _recording_card(recording: Recording) -> Card:
    facts = [("camera", _size(recording)), ("kind", recording.kind), *_clock_facts(recording)]
    if recording.n_frames is not None:
        facts.append(("frames", _count(recording.n_frames)))
    if recording.n_photons is not None:
        facts.append(("photon events", _count(recording.n_photons)))
    # Counting it could take minutes: no picture.
    return facts, "", ""


def _calibration_card(timing: TimingCalibration) -> Card:
    facts = [
        ("camera", _size(timing)),
        *_clock_facts(timing),
        ("error of the time scale", f"{number(100 * timing.scale_std, 2)} %"),
        *_flag_facts(timing.flags),
        *(("" if k else "notes", note) for k, note in enumerate(timing.notes)),
    ]
    skew = np.asarray(timing.skew_ps, dtype=float)
    known = skew[np.isfinite(skew)]
    if len(known) and np.ptp(known) > 0:
        return facts, _picture(skew), "delay by pixel"
    return facts, _picture(timing.gain), "gain by pixel"


def _camera_card(camera: Camera) -> Card:
    x, y, z = camera.center_mm
    axis = camera.backward_axis
    facts = [
        ("camera", _size(camera)),
        ("entrance pupil", f"({number(x, 5)}, {number(y, 5)}, {number(z, 5)}) mm"),
        ("looks along", f"({', '.join(number(-a, 3) for a in axis)})"),
        ("focal length", f"{number(camera.matrix[0, 0], 5)} px"),
        ("lens", "with distortion" if np.any(camera.distortion) else "without distortion"),
    ]
    if camera.pose_covariance is None:
        facts.append(("pose", "taken as exact"))
    else:
        std = np.sqrt(np.diag(camera.pose_covariance))[3:]
        facts.append(("pose known to", f"{', '.join(number(s, 2) for s in std)} mm"))
    return facts, "", ""


def _path_card(path: LightPath) -> Card:
    good = path.goodness
    facts = [
        ("verdict", path.verdict.headline),
        *(("", str(finding)) for finding in path.verdict.findings),
    ]
    if path.explained is not None:
        facts.append(("explains", str(path.explained)))
    facts += [
        ("estimator", path.method),
        ("prior", path.prior or "not said"),
        ("length", f"{number(sum(leg.length_mm for leg in path.legs), 5)} mm, {path.n_legs} legs"),
        ("emission time", f"{with_error(path.emission_time_ps, path.vertex_std[0, 3])} ps"),
    ]
    facts += [
        (f"elevation of leg {k}", f"{with_error(leg.angle_deg, leg.angle_std_deg)}\u00b0")
        for k, leg in enumerate(path.legs[:6], start=1)
    ]
    if path.n_legs > 6:
        facts.append(("", f"and {path.n_legs - 6} legs more"))
    facts.append(("\u03c7\u00b2 / dof", good.chi2_in_words))
    if good.error_floor_ps > 0:
        facts.append(("extra scatter", good.floor_in_words))
    if not good.converged:
        facts.append(("converged", "NO: do not trust the errors"))
    return facts, _path_picture(path), "from the front, and from above"


def _table_card(table: Arrivals | Pulses, column: str, what: str) -> Card:
    usable = np.asarray(table.usable)
    values = np.asarray(getattr(table, column), dtype=float)[usable]
    values = values[np.isfinite(values)]
    facts = [("camera", _size(table)), ("pulses", f"{len(table.row)}, {int(usable.sum())} usable")]
    if values.size:
        facts.append((what, f"{number(values.min(), 6)} \u2026 {number(values.max(), 6)} ps"))
        facts.append(("photons", _count(float(np.nansum(table.photons[usable])))))
    return [*facts, *_flag_facts(table.flags)], _picture(table.image(column)), f"{what} by pixel"


def _bounds_card(bounds: Bounds) -> Card:
    angles = ", ".join(f"{number(a, 2)}\u00b0" for a in bounds.angle_std_deg)
    facts = [
        ("prior", bounds.prior),
        ("photons", f"{number(bounds.photons, 4)} in {bounds.n_pixels} pixels"),
        ("position, rms in view", f"{number(bounds.position_rms_mm, 3)} mm"),
        ("event time, rms in view", f"{number(bounds.event_time_rms_ps, 3)} ps"),
        ("elevation of the legs", angles),
        *(("", sentence) for sentence in bounds.statements),
    ]
    return facts, _path_picture(bounds.path), "from the front, and from above"


_CARDS: dict[str, Callable[[Any], Card]] = {
    "Arrivals": lambda table: _table_card(table, "arrival_ps", "arrival time"),
    "Bounds": _bounds_card,
    "Camera": _camera_card,
    "Histograms": _histograms_card,
    "LightPath": _path_card,
    "Pulses": lambda table: _table_card(table, "delay_ps", "delay"),
    "Recording": _recording_card,
    "TimingCalibration": _calibration_card,
}
