"""Photon-HDF5 (version 0.5): photon events with time stamps and detector numbers.

A detector is a pixel, row by row; its `nanotimes` are the codes. Recordings are written with
the frame as the time stamp, and everything of ours in `/user/lightflight`, from which frames
and clock come back.

Format: https://photon-hdf5.readthedocs.io/en/latest/phdata.html
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from lightflight._version import __version__
from lightflight.errors import FileFormatError
from lightflight.files.filecheck import check_memory, record_error_as_format_error
from lightflight.files.store import (
    json_text,
    new_hdf5,
    read_array,
    refuse_links,
    text_attribute,
)
from lightflight.formats.cubes import checked_shape
from lightflight.formats.photon_hdf5_titles import TITLES
from lightflight.formats.photons import photon_blocks
from lightflight.formats.registry import Format
from lightflight.formats.stored import StoredArray
from lightflight.recording.clock_fields import CLOCK_FIELDS
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording, SlicedArray

_FORMAT = "Photon-HDF5"
_ROOT_TEXTS = {
    "format_name": _FORMAT,
    "format_version": "0.5",
    "format_url": "http://photon-hdf5.org/",
}
_OURS = "user/lightflight"
_TIMESTAMPS_AT_ONCE = 1 << 20


# --- reading ----------------------------------------------------------------------------


def read(
    path: Path, clock: Mapping[str, object], *, shape: tuple[int, int] | None = None
) -> Recording:
    """Read photon events; they stay in the file.

    Parameters
    ----------
    path : Path
        A Photon-HDF5 file of one spot, recorded with TCSPC.
    clock : mapping of str
        Hints about the clock; they go before what the file says.
    shape : (int, int), optional
        (rows, cols), where detectors are the pixels of a camera; None: as the file says, else one
        row of all detectors with photons.

    Returns
    -------
    Recording
        Of events; frames come back where we wrote the file.

    Raises
    ------
    FileFormatError
        Where it is no such file, holds no nanotimes, or is damaged.
    """
    if not h5py.is_hdf5(path):
        raise FileFormatError("is not an HDF5 file: check the name, or copy it again", path=path)
    with h5py.File(path, "r", locking="best-effort") as file:
        refuse_links(file, path)
        if not isinstance(file.get("photon_data"), h5py.Group):
            raise FileFormatError("holds no /photon_data of a single spot", path=path)
        photons = file["photon_data"]
        if "nanotimes" not in photons:
            raise FileFormatError("holds no nanotimes: it was not recorded with TCSPC", path=path)
        code = _unsigned(photons["nanotimes"], path)
        pixel = _detectors(photons, code, path)
        ours = file.get(_OURS)
        attributes = _plain_attributes(ours) if isinstance(ours, h5py.Group) else {}
        settings = _settings_in(ours, path) if attributes else {}
        told = _clock_in(file, path)
        starts = None
        if "n_frames" in attributes:
            told["n_frames"] = int(attributes["n_frames"])
            stamps = StoredArray.streamed(photons.get("timestamps"), path=path)
            if stamps.shape != code.shape:
                raise FileFormatError("has not one time stamp per photon: it is damaged", path=path)
            starts = _frame_starts(stamps, told["n_frames"], path)
    n_codes = told.pop("n_codes")
    shape = _stated_shape(attributes, pixel, path) if shape is None else checked_shape(shape)
    for name in CLOCK_FIELDS:
        if name in attributes:
            # Ours is exact, where the fields of the format are in seconds and Hz.
            told[name] = attributes[name].item()
    with record_error_as_format_error(path):
        return Recording(
            shape,
            n_codes=n_codes,
            pixel=pixel,
            code=code,
            frame_starts=starts,
            settings=settings,
            **(told | dict(clock)),
        )


def _settings_in(ours: h5py.Group, path: Path) -> dict[str, object]:
    """Settings of the recording, from the JSON text we put there."""
    settings = json.loads(str(read_array(ours.get("settings"), path=path)))
    if not isinstance(settings, dict):
        raise FileFormatError("its settings are not readable: it is damaged", path=path)
    return settings


def _stated_shape(attributes: Mapping[str, Any], pixel: SlicedArray, path: Path) -> tuple[int, int]:
    """(rows, cols) as the file says; one row of all pixels with photons where it does not."""
    stated = np.ravel(attributes.get("shape", (1, _largest(pixel) + 1)))
    if len(stated) != 2 or stated.dtype.kind not in "iu":
        raise FileFormatError("does not tell its shape: the file is damaged", path=path)
    return int(stated[0]), int(stated[1])


def _plain_attributes(node: h5py.Group) -> dict[str, Any]:
    """Attributes that are numbers or texts of fixed length (see `store.text_attribute`)."""
    kinds = {name: node.attrs.get_id(name).dtype.kind for name in node.attrs}
    return {name: node.attrs[name] for name, kind in kinds.items() if kind in "iufbS"}


def _number(node: h5py.Dataset, path: Path) -> float:
    """One number that a dataset holds."""
    value = read_array(node, path=path)
    if value.size != 1 or value.dtype.kind not in "iuf":
        raise FileFormatError(f"{node.name} is no number", path=path)
    return float(value.reshape(-1)[0])


def _unsigned(node: h5py.Dataset, path: Path) -> SlicedArray:
    """Array that stays in the file, its integers without a sign."""
    stored = StoredArray.streamed(node, path=path)
    if len(stored.shape) != 1 or stored.dtype.kind not in "ui":
        raise FileFormatError(f"{node.name} is no list of integers", path=path)
    # Recordings hold unsigned numbers; other programs write signed ones.
    if stored.dtype.kind == "u":
        return stored
    for first in range(0, stored.shape[0], _TIMESTAMPS_AT_ONCE):
        values = stored[first : first + _TIMESTAMPS_AT_ONCE]
        if values.min() < 0 or values.max() > np.iinfo(np.uint32).max:
            raise FileFormatError(f"{node.name} holds numbers that cannot be", path=path)
    return _Converted(stored, stored.shape)


def _detectors(photons: h5py.Group, code: SlicedArray, path: Path) -> SlicedArray:
    """(n,), pixel of each photon; all are of pixel 0 where the file knows no detectors."""
    if "detectors" in photons:
        return _unsigned(photons["detectors"], path)
    return _Converted(None, code.shape)


@dataclass(frozen=True, eq=False)
class _Converted:
    """A list of integers as unsigned ones, read in parts; zeros where there is none."""

    whole: StoredArray | None
    shape: tuple[int, ...]

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """Unsigned, of 32 bits."""
        return np.dtype(np.uint32)

    @property
    def path(self) -> str | None:
        """The file, for errors about its content."""
        return None if self.whole is None else self.whole.path

    def __getitem__(self, key: slice) -> NDArray[np.uint32]:
        if self.whole is not None:
            return self.whole[key].astype(np.uint32)
        first, last, _ = key.indices(self.shape[0])
        return np.zeros(max(0, last - first), np.uint32)

    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[np.generic]:
        """All of it."""
        return np.asarray(self[:] if self.whole is None else np.asarray(self.whole), np.uint32)


def _clock_in(file: h5py.File, path: Path) -> dict[str, Any]:
    """Number and width of the codes, and the laser period where one laser is told."""
    specs = file["photon_data"].get("nanotimes_specs")
    if not isinstance(specs, h5py.Group) or "tcspc_num_bins" not in specs:
        raise FileFormatError("does not tell tcspc_num_bins: the file is damaged", path=path)
    told: dict[str, object] = {"n_codes": int(_number(specs["tcspc_num_bins"], path))}
    if "tcspc_unit" in specs:
        told["bin_width_ps"] = _number(specs["tcspc_unit"], path) * 1e12
    rates = file.get("setup/laser_repetition_rates")
    if isinstance(rates, h5py.Dataset) and rates.size == 1:
        told["laser_period_ps"] = 1e12 / _number(rates, path)
    return told


def _largest(pixel: SlicedArray) -> int:
    """Largest pixel number, read in parts."""
    largest = 0
    for first in range(0, pixel.shape[0], _TIMESTAMPS_AT_ONCE):
        largest = max(largest, int(np.asarray(pixel[first : first + _TIMESTAMPS_AT_ONCE]).max()))
    return largest


def _frame_starts(timestamps: SlicedArray, n_frames: int, path: Path) -> NDArray[np.uint64]:
    """(n_frames + 1,) from one frame number per photon, in order."""
    # One list of frames, its running sum, and what is looked up block by block.
    n_bytes = 16 * (n_frames + 1)
    check_memory(n_bytes, path=path, what=f"a list of {n_frames} frames")
    per_frame = np.zeros(n_frames + 1, np.uint64)
    last = 0
    for first in range(0, timestamps.shape[0], _TIMESTAMPS_AT_ONCE):
        frames = np.asarray(timestamps[first : first + _TIMESTAMPS_AT_ONCE])
        if frames[0] < last or (np.diff(frames) < 0).any() or frames[-1] >= n_frames:
            raise FileFormatError("its time stamps are no frames: the file is damaged", path=path)
        last = int(frames[-1])
        found, counts = np.unique(frames, return_counts=True)
        per_frame[found + 1] += counts.astype(np.uint64)
    return np.cumsum(per_frame, dtype=np.uint64)


# --- writing ----------------------------------------------------------------------------


def write(
    record: Recording | Histograms, path: Path, *, frame_duration_ps: float | None = None
) -> None:
    """Write photon events, the frame as time stamp.

    Parameters
    ----------
    record : Recording or Histograms
        Only a recording that knows the frame of each photon can be written.
    path : Path
        The file; it appears whole or not at all.
    frame_duration_ps : float, optional
        ps; needed where the recording does not know its laser period and how many periods a frame
        has.

    Raises
    ------
    ValueError
        For histograms, for events without frames, and where the duration is not known.
    """
    if not isinstance(record, Recording):
        raise ValueError("Photon-HDF5 holds photons: write histograms as .h5, .npz, .mat or .zarr")
    if record.n_frames is None or (record.kind == "events" and record.frame_starts is None):
        raise ValueError("Photon-HDF5 needs the frame of each photon: write .h5 without it")
    if frame_duration_ps is None:
        if record.laser_period_ps is None or record.periods_per_frame is None:
            raise ValueError(
                "how long a frame takes is not known: give laser_period_ps and "
                "periods_per_frame with the recording, or frame_duration_ps"
            )
        frame_duration_ps = record.laser_period_ps * record.periods_per_frame
    with new_hdf5(path) as out:
        out.append("photon_data/timestamps", np.empty(0, np.int64), compress=True)
        out.append("photon_data/detectors", np.empty(0, np.uint32), compress=True)
        out.append("photon_data/nanotimes", np.empty(0, np.uint16), compress=True)
        first_frame = 0
        for block in photon_blocks(record):
            assert block.photons_per_frame is not None
            frames = first_frame + np.arange(block.photons_per_frame.size)
            first_frame += frames.size
            stamps = np.repeat(frames, block.photons_per_frame).astype(np.int64)
            out.append("photon_data/timestamps", stamps)
            out.append("photon_data/detectors", block.pixel.astype(np.uint32))
            out.append("photon_data/nanotimes", block.code.astype(np.uint16))
        _write_metadata(out.file, record, frame_duration_ps)


def _write_metadata(file: h5py.File, record: Recording, frame_duration_ps: float) -> None:
    """Everything that is no list of photons: what the format prescribes, and what is ours."""
    frame_s = frame_duration_ps * 1e-12
    for name, text in _ROOT_TEXTS.items():
        file.attrs[name] = np.bytes_(text)
        file[f"identity/{name}"] = np.bytes_(text)
    file["identity/software"] = np.bytes_("lightflight")
    file["identity/software_version"] = np.bytes_(__version__)
    file["identity/creation_time"] = np.bytes_(f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S}")
    file["acquisition_duration"] = frame_s * (record.n_frames or 0)
    file["description"] = np.bytes_("Photons of a SPAD camera; time stamps are frames.")
    file["photon_data/timestamps_specs/timestamps_unit"] = frame_s
    specs = file.create_group("photon_data/nanotimes_specs")
    specs["tcspc_num_bins"] = record.n_codes
    if record.bin_width_ps is not None:
        specs["tcspc_unit"] = record.bin_width_ps * 1e-12
        specs["tcspc_range"] = record.bin_width_ps * record.n_codes * 1e-12
    setup = file.create_group("setup")
    setup["num_pixels"] = record.shape[0] * record.shape[1]
    for name in ("num_spots", "num_spectral_ch", "num_polarization_ch", "num_split_ch"):
        setup[name] = 1
    setup["lifetime"] = True
    setup["modulated_excitation"] = False
    for name in ("excitation_cw", "excitation_alternated"):
        setup[name] = np.array([False])
    if record.laser_period_ps is not None:
        setup["laser_repetition_rates"] = np.array([1e12 / record.laser_period_ps])
    ours = file.create_group(_OURS)
    ours.attrs["shape"] = record.shape
    ours["settings"] = np.bytes_(json_text(record.settings).encode("utf-8"))
    for name in CLOCK_FIELDS:
        value = getattr(record, name)
        if value is not None:
            ours.attrs[name] = value
    for name, title in TITLES.items():
        if name in file:
            file[name].attrs["TITLE"] = np.bytes_(title)


def _matches(path: Path, start: bytes) -> bool:
    if not start or not h5py.is_hdf5(path):
        return False
    with h5py.File(path, "r") as file:
        return text_attribute(file, "format_name") == _FORMAT


FORMATS = (
    Format(
        name="photon-hdf5",
        summary="Photon-HDF5: photon events with time stamps",
        suffixes=(".photon.h5", ".phdf5", ".photon.hdf5"),
        matches=_matches,
        read=read,
        write=write,
        turn=-1,
    ),
)
