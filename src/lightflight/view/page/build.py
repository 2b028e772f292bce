"""Put the page together: template, style, scripts and data in one file.

Takes a LightPath and its companions, gives HTML text. A content security policy allows exactly the
script in the file and no request at all.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from lightflight._version import __version__
from lightflight.errors import GeometryError, NothingFoundError
from lightflight.files.whole_file import write_text
from lightflight.view.page import tables
from lightflight.view.page.parts import Frame, asset, page_script, whole_frame
from lightflight.view.page.payload import json_for_html, payload_from_records
from lightflight.view.types import FilePath

if TYPE_CHECKING:
    from lightflight import (
        Arrivals,
        Camera,
        Histograms,
        LightPath,
        Pulses,
        Recording,
        TimingCalibration,
    )


def page_html(
    path: LightPath,
    *,
    recording: Histograms | Recording | None = None,
    timing: TimingCalibration | None = None,
    pulses: Pulses | None = None,
    arrivals: Arrivals | None = None,
    title: str = "",
    second_camera: Camera | None = None,
) -> str:
    """The page about one reconstruction, as text.

    Parameters
    ----------
    path : LightPath
        The path.
    recording : Histograms or Recording, optional
        Histograms (or a Recording) it was made from: gives the pixels' histograms and, where
        `pulses` and `arrivals` are not given, the pulses found in it.
    timing : TimingCalibration, optional
        Calibration it was made with.
    pulses : Pulses, optional
        Pulses fitted to the recording, where they are at hand.
    arrivals : Arrivals, optional
        Their arrival times.
    title : str, optional
        Heading; empty: one is made from the number of legs.
    second_camera : Camera, optional
        Camera anywhere: the page can show what it would see of the path.

    Raises
    ------
    GeometryError
        Where `second_camera` sees no part of the path, or the recording is of another camera.
    """
    return framed_page(
        path,
        whole_frame(asset("page.css"), page_script()),
        recording=recording,
        timing=timing,
        pulses=pulses,
        arrivals=arrivals,
        title=title,
        second_camera=second_camera,
    )


def framed_page(
    path: LightPath,
    frame: Frame,
    *,
    recording: Histograms | Recording | None = None,
    timing: TimingCalibration | None = None,
    pulses: Pulses | None = None,
    arrivals: Arrivals | None = None,
    title: str = "",
    second_camera: Camera | None = None,
) -> str:
    """The page about one reconstruction with its parts in it or beside it.

    Parameters as in `page_html`, and `frame`: `SHARED`, or a `whole_frame`.
    """
    hist = _histograms(recording)
    _check_shape(path, hist)
    pulses, arrivals = _fits(hist, timing, pulses, arrivals)
    heading = title or tables.heading(path)
    payload = payload_from_records(
        path,
        hist=hist,
        timing=timing,
        pulses=pulses,
        arrivals=arrivals,
        title=heading,
        second_camera=second_camera,
    )
    # What comes from outside is escaped here or in `tables`; the payload in `json_for_html`.
    parts = {
        "POLICY": frame.policy,
        "GENERATOR": html.escape(f"lightflight {__version__}", quote=True),
        "TITLE": html.escape(heading),
        "LEAD": html.escape(tables.lead(payload)),
        "LEVEL": payload["verdict"]["level"],
        "VERDICT": tables.verdict_html(payload),
        "STYLE": frame.style,
        "STATEMENTS": tables.statements_html(payload),
        "TABLES": tables.tables_html(payload),
        "PROVENANCE": tables.provenance_html(payload),
        "PAYLOAD": json_for_html(payload),
        "SCRIPT": frame.script,
    }
    return _filled(asset("page.html"), parts)


def _filled(template: str, parts: Mapping[str, str]) -> str:
    """Template with every {{NAME}} replaced once; what was put in is never looked at again."""
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda match: parts[match.group(1)], template)


def _histograms(recording: Histograms | Recording | None) -> Histograms | None:
    from lightflight.recording.counting import histogram
    from lightflight.recording.recording import Recording

    return histogram(recording) if isinstance(recording, Recording) else recording


def _check_shape(path: LightPath, hist: Histograms | None) -> None:
    """Refuse a recording whose pixels cannot be those of the path's camera."""
    camera = getattr(path, "camera", None)
    if hist is None or camera is None or tuple(hist.shape) == tuple(camera.shape):
        return
    raise GeometryError(
        f"the recording has {hist.shape[0]} x {hist.shape[1]} pixels, the path's camera has "
        f"{camera.shape[0]} x {camera.shape[1]}: give the recording that the path was made from"
    )


def _fits(
    hist: Histograms | None,
    timing: TimingCalibration | None,
    pulses: Pulses | None,
    arrivals: Arrivals | None,
) -> tuple[Pulses | None, Arrivals | None]:
    """Pulses and arrivals of a recording; None where it holds none."""
    if hist is None:
        return pulses, arrivals
    from lightflight.timing.pulses.arrivals import arrivals_from_pulses
    from lightflight.timing.pulses.pulses import fit_pulses

    try:
        pulses = fit_pulses(hist, timing=timing) if pulses is None else pulses
    except NothingFoundError:
        # A recording without a pulse still makes a page, which says so among what is missing.
        return None, None
    if arrivals is None:
        arrivals = arrivals_from_pulses(pulses, timing=timing)
    return pulses, arrivals


def write_page(
    path: LightPath,
    file: FilePath,
    *,
    recording: Histograms | Recording | None = None,
    timing: TimingCalibration | None = None,
    pulses: Pulses | None = None,
    arrivals: Arrivals | None = None,
    title: str = "",
    second_camera: Camera | None = None,
) -> None:
    """Write the page about one reconstruction; parameters as in `page_html`.

    The file appears whole or not at all.
    """
    text = page_html(
        path,
        recording=recording,
        timing=timing,
        pulses=pulses,
        arrivals=arrivals,
        title=title,
        second_camera=second_camera,
    )
    write_text(file, text)
