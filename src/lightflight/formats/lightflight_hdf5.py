"""Our own HDF5: histograms as one cube, recordings as photon events.

Kind "histograms": array `counts`. Kind "recording": arrays `pixel` and `code`, 4 bytes per
photon, and `photons_per_frame`; dense frames that have no code for "no photon" stay `frames`.
The fields of the record that are no arrays are JSON attributes, as are the settings. The truth
of a simulation comes back as a plain namespace. `schema.toml` is the layout as data, `store` the
container.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import ConfigError, FileFormatError
from lightflight.files.filecheck import check_memory, record_error_as_format_error
from lightflight.files.mapped import rows_of
from lightflight.files.store import (
    RecordWriter,
    kind_of_record,
    load_record,
    new_record,
    open_record,
    read_array,
)
from lightflight.formats.photons import photon_blocks
from lightflight.formats.registry import Format
from lightflight.formats.schema import check_arrays
from lightflight.formats.stored import StoredArray
from lightflight.provenance import provenance_record
from lightflight.recording.clock_fields import CLOCK_FIELDS, clock_fields_of
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording, SlicedArray

_TRUTH = "truth/"
_FRAMES_PER_APPEND = 4096


# --- reading ----------------------------------------------------------------------------


def read(
    path: Path, clock: Mapping[str, object], *, poisson: bool | None = None
) -> Recording | Histograms:
    """Read what `write` wrote.

    Parameters
    ----------
    path : Path
        A file of ours, of kind "histograms" or "recording".
    clock : mapping of str
        Hints about the clock; they go before what the file says.
    poisson : bool, optional
        False for scaled intensities; None: as the file says. Of histograms alone.

    Returns
    -------
    Recording or Histograms
        The arrays of a recording stay in the file.

    Raises
    ------
    FileFormatError
        Where it is no file of ours, of another kind, or damaged.
    ConfigError
        For `poisson` of a recording.
    """
    kind = kind_of_record(path)
    if kind == "histograms":
        return _read_histograms(path, clock, poisson)
    if kind is None:
        raise FileFormatError("is not an HDF5 file of lightflight: check the name", path=path)
    if kind != "recording":
        raise FileFormatError(f"holds a {kind}, no recording: name the recording", path=path)
    if poisson is not None:
        raise ConfigError("hint poisson is for histograms: this is a recording of photons")
    return _read_recording(path, clock)


def _read_histograms(path: Path, clock: Mapping[str, object], poisson: bool | None) -> Histograms:
    arrays, attributes = load_record(path, kind="histograms")
    fields = _fields_from(attributes, path) | dict(clock)
    own = {name: array for name, array in arrays.items() if not name.startswith(_TRUTH)}
    check_arrays("histograms", own, path=path)
    if poisson is None:
        poisson = bool(attributes.get("poisson", True))
    counts = arrays["counts"]
    # Nobody else can write to it now, so the record takes it without a copy.
    counts.setflags(write=False)
    truth = _truth_from(arrays, attributes)
    with record_error_as_format_error(path):
        return Histograms(counts, **fields, poisson=poisson, truth=truth)


def _read_recording(path: Path, clock: Mapping[str, object]) -> Recording:
    """Recording whose arrays stay in the file; of frames, their starts are summed here."""
    with open_record(path, kind="recording") as (file, attributes):
        # Arrays of a recording stay in the file; the truth is small and read whole.
        own = [name for name in file if name not in ("attributes", "truth")]
        stored: dict[str, Any] = {name: StoredArray.of(file[name], path=path) for name in own}
        check_arrays("recording", stored, path=path)
        starts = None
        if "photons_per_frame" in stored:
            counted = stored.pop("photons_per_frame")
            check_memory(16 * counted.shape[0], path=path, what="a list of all frames")
            per_frame = np.asarray(counted)
            starts = np.zeros(per_frame.size + 1, np.uint64)
            np.cumsum(per_frame, dtype=np.uint64, out=starts[1:])
        truth = {
            f"{_TRUTH}{name}": read_array(node, path=path)
            for name, node in (file["truth"].items() if "truth" in file else ())
        }
    fields = _fields_from(attributes, path) | dict(clock)
    shape = attributes.get("shape")
    n_codes = attributes.get("n_codes")
    if not (isinstance(shape, list) and isinstance(n_codes, int)):
        raise FileFormatError("does not tell shape and n_codes: the file is damaged", path=path)
    with record_error_as_format_error(path):
        return Recording(
            tuple(shape),
            n_codes=n_codes,
            frame_starts=starts,
            truth=_truth_from(truth, attributes),
            **stored,
            **fields,
        )


def _fields_from(attributes: Mapping[str, object], path: Path) -> dict[str, Any]:
    """The clock's fields and the settings, by name, from the attributes of a file."""
    settings = attributes.get("settings", {})
    if not isinstance(settings, dict):
        raise FileFormatError("its settings are not readable: the file is damaged", path=path)
    fields = {name: attributes[name] for name in CLOCK_FIELDS if name in attributes}
    return {**fields, "settings": settings}


def _truth_from(arrays: Mapping[str, NDArray[np.generic]], attributes: Mapping[str, Any]) -> Any:
    """Truth of a simulation as a plain namespace; None where the file has none."""
    values = dict(attributes.get("truth") or {})
    values |= {
        name.removeprefix(_TRUTH): array
        for name, array in arrays.items()
        if name.startswith(_TRUTH)
    }
    return SimpleNamespace(**values) if values else None


# --- writing ----------------------------------------------------------------------------


def write(
    record: Recording | Histograms,
    path: Path,
    *,
    provenance: Mapping[str, object] | None = None,
) -> None:
    """Write histograms or a recording.

    Parameters
    ----------
    record : Recording or Histograms
        Dense frames become photon events, about 4 bytes per photon, unless they have no code for
        "no photon".
    path : Path
        The file; it appears whole or not at all.
    provenance : mapping of str, optional
        `provenance.provenance_record(...)`; without it the versions and the date are kept.

    Raises
    ------
    OSError
        Where the file cannot be written.
    """
    truth_arrays, truth_values = _arrays_and_values(record.truth)
    attributes: dict[str, object] = clock_fields_of(record)
    attributes |= {
        "settings": dict(record.settings),
        "truth": truth_values,
        "provenance": dict(provenance or provenance_record()),
    }
    if isinstance(record, Histograms):
        attributes["poisson"] = record.poisson
        kind = "histograms"
    else:
        attributes |= {"shape": list(record.shape), "n_codes": record.n_codes}
        kind = "recording"
    with new_record(path, kind=kind, attributes=attributes) as out:
        if isinstance(record, Histograms):
            out.write("counts", record.counts)
        elif record.frames is not None and record.no_photon_code is None:
            _append_all(out, "frames", record.frames)
        else:
            _write_photons(out, record)
        if isinstance(record, Recording) and record.footers is not None:
            _append_all(out, "footers", record.footers)
        for name, array in truth_arrays.items():
            out.write(f"{_TRUTH}{name}", array)


def _write_photons(out: RecordWriter, recording: Recording) -> None:
    # Pixel numbers beyond 16 bits hold many zero bits; compressed they need two bytes as well.
    """Write `pixel`, `code` and, where frames are known, `photons_per_frame`."""
    many_pixels = recording.shape[0] * recording.shape[1] > 1 << 16
    pixel_type = np.uint32 if many_pixels else np.uint16
    out.append("pixel", np.empty(0, pixel_type), compress=many_pixels)
    out.append("code", np.empty(0, np.uint16))
    if recording.n_frames is not None and (
        recording.kind == "frames" or recording.frame_starts is not None
    ):
        out.append("photons_per_frame", np.empty(0, np.uint32), compress=True)
    for block in photon_blocks(recording):
        out.append("pixel", block.pixel.astype(pixel_type, copy=False))
        out.append("code", block.code.astype(np.uint16, copy=False))
        if block.photons_per_frame is not None:
            out.append("photons_per_frame", block.photons_per_frame)


def _append_all(out: RecordWriter, name: str, source: SlicedArray) -> None:
    """Copy frames or footers (n, ...) in blocks, so that memory does not grow with them."""
    out.append(name, np.empty((0, *source.shape[1:]), source.dtype), compress=True)
    for first in range(0, source.shape[0], _FRAMES_PER_APPEND):
        out.append(name, np.asarray(rows_of(source, first, first + _FRAMES_PER_APPEND)))


def _arrays_and_values(truth: object) -> tuple[dict[str, NDArray[np.generic]], dict[str, object]]:
    """Fields of a truth: arrays, and whatever else JSON can say."""
    if dataclasses.is_dataclass(truth) and not isinstance(truth, type):
        fields = {f.name: getattr(truth, f.name) for f in dataclasses.fields(truth)}
    else:
        fields = dict(getattr(truth, "__dict__", {}))
    arrays, values = {}, {}
    for name, value in fields.items():
        if isinstance(value, np.ndarray):
            arrays[name] = value
        else:
            values[name] = _plain(value)
    return arrays, values


def _plain(value: object) -> object:
    """Numbers, text, lists and dictionaries of `value`; its text where it is none of them."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return repr(value)


def _matches(path: Path, start: bytes) -> bool:
    return bool(start) and kind_of_record(path) is not None


FORMATS = (
    Format(
        name="lightflight",
        summary="lightflight's own HDF5: histograms, or photon events with their frames",
        suffixes=(".h5", ".hdf5"),
        matches=_matches,
        read=read,
        write=write,
        turn=-2,
    ),
)
