"""PicoQuant `.ptu` (T3): scanned images and point measurements, by the package ptufile.

Frames of an image are added up; each detector channel is a histogram of its own. The laser
period is the sync period of the header.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import FileFormatError, optional_package
from lightflight.formats.cubes import record_from_array
from lightflight.formats.isolation import run_isolated
from lightflight.formats.registry import Format
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

if TYPE_CHECKING:
    import ptufile

_RECORD_BYTES = 4
_MARKS = ("ImgHdr_LineStart", "ImgHdr_LineStop", "ImgHdr_Frame")
_MOST_MARKS = 32


def read(
    path: Path, clock: Mapping[str, object], *, channel: int | None = None
) -> Recording | Histograms:
    """Read histograms; the frames of an image are added up.

    Parameters
    ----------
    path : Path
        A PicoQuant file in T3 mode.
    clock : mapping of str
        Hints about the clock; they go before what the header says.
    channel : int, optional
        Number of the detector, where there are several.

    Returns
    -------
    Recording or Histograms
        Histograms, one pixel for a point measurement.

    Raises
    ------
    FileFormatError
        For T2 recordings, files that are cut, and where the channel is not clear.
    MissingExtraError
        Without ptufile.
    """
    arrays, values = run_isolated(f"{__name__}:load", path, {"channel": channel})
    told = {name: values.pop(name) for name in ("bin_width_ps", "laser_period_ps")}
    return record_from_array(
        arrays["counts"], "yxt", told | dict(clock), path=path, settings=values
    )


def load(
    path: Path, *, channel: int | None
) -> tuple[dict[str, NDArray[np.generic]], dict[str, object]]:
    """Counts (rows, cols, codes) and what the header says; runs in a child process."""
    ptufile = optional_package(
        "ptufile", otherwise="reading .ptu needs ptufile: pip install 'lightflight[readers]'"
    )
    with ptufile.PtuFile(path) as ptu:
        _check_claims(ptu, path)
        if not ptu.is_t3:
            raise FileFormatError(
                "is a T2 recording, which has no laser sync: record in T3 mode", path=None
            )
        channels = [int(number) for number in ptu.active_channels]
        index = _chosen_channel(channel, channels)
        if ptu.is_image:
            # frame=-1 adds up all frames.
            image = ptu.decode_image(frame=-1, channel=index, dtype=np.uint32, keepdims=False)
            counts = image.reshape(-1, *image.shape[-2:])
        else:
            counts = ptu.decode_histogram(dtype=np.uint32)[index][None, None, :]
        values = {
            "bin_width_ps": ptu.tcspc_resolution * 1e12,
            "laser_period_ps": ptu.global_resolution * 1e12,
            "hardware": str(ptu.tags.get("HW_Type", "")),
            "record_type": ptu.record_type.name,
            "channel": channels[index],
            "n_records": int(ptu.number_records),
            "n_photons": int(ptu.number_photons),
            "image_frames": int(ptu.number_images) if ptu.is_image else None,
            "comment": str(ptu.comment or ""),
        }
    return {"counts": counts}, values


def _check_claims(ptu: ptufile.PtuFile, path: Path) -> None:
    """Refuse a header that promises more records than there are bytes, or marks that are none."""
    there = path.stat().st_size - int(ptu.record_offset)
    needed = int(ptu.number_records) * _RECORD_BYTES
    if there < needed:
        raise FileFormatError(
            f"is truncated: {ptu.number_records} records need {needed} bytes, {there} are there",
            offset=path.stat().st_size,
        )
    for name in _MARKS:
        # ptufile raises two to this power, in whole numbers of any length.
        number = ptu.tags.get(name, 0)
        if not isinstance(number, int | float) or not -1 <= number <= _MOST_MARKS:
            raise FileFormatError(f"says {name} = {number!r:.40}, which is no number of a mark")


def _chosen_channel(channel: int | None, channels: list[int]) -> int:
    if channel is None and len(channels) == 1:
        return 0
    if channel not in channels:
        found = ", ".join(map(str, channels))
        raise FileFormatError(f"holds the channels {found}: name one with channel=")
    return channels.index(channel)


def _matches(path: Path, start: bytes) -> bool:
    return start.startswith(b"PQTTTR")


FORMATS = (
    Format(
        name="ptu",
        summary="PicoQuant .ptu in T3 mode (needs ptufile)",
        suffixes=(".ptu",),
        matches=_matches,
        read=read,
    ),
)
