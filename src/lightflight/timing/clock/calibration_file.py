"""A TimingCalibration as a file: our versioned HDF5, one array or attribute for each field."""

from __future__ import annotations

import os
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from lightflight.errors import FileFormatError
from lightflight.files.filecheck import damage_as_format_error, record_error_as_format_error
from lightflight.files.store import load_record, save_record
from lightflight.timing.clock.possible import check_plain_values

if TYPE_CHECKING:
    from lightflight.timing.clock.calibration import TimingCalibration

_SCHEMA = 3
"""1: pulses stand at the mean of their shape; 2: at `response_place_ps`; 3: codes have an error
that all pixels share (`code_width_std`)."""

_LATER_FIELDS = {"code_length_std", "code_width_std", "response_curve", "response_place_ps"}
"""Fields that files of earlier versions do not have."""


def save_calibration(timing: TimingCalibration, path: str | os.PathLike[str]) -> None:
    """Write a calibration with all its fields, whole or not at all.

    Parameters
    ----------
    timing : TimingCalibration
        What to keep.
    path : path
        HDF5 file; an existing one is replaced only at the end.
    """
    values = {item.name: getattr(timing, item.name) for item in fields(timing)}
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    attributes = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in values.items()
        if name not in arrays
    }
    # Where a file says nothing that is new, earlier versions may go on reading.
    schema = 1 if timing.response_place_ps is None else 2
    attributes["calibration_schema"] = _SCHEMA if timing.code_width_std > 0.0 else schema
    attributes["provenance"] = dict(timing.provenance)
    save_record(path, kind="calibration", arrays=arrays, attributes=attributes)


def load_calibration(
    path: str | os.PathLike[str], *, make: type[TimingCalibration]
) -> TimingCalibration:
    """Read a calibration written by `save_calibration`.

    Parameters
    ----------
    path : path
        HDF5 file.
    make : type
        The class (it stands above this module).

    Returns
    -------
    TimingCalibration
        What was saved; later fields that an old file lacks have their defaults.

    Raises
    ------
    FileFormatError
        For a file that is damaged, no calibration, or one of a later version.
    """
    arrays, attributes = load_record(path, kind="calibration")
    schema = attributes.get("calibration_schema")
    if schema not in range(1, _SCHEMA + 1):
        raise FileFormatError(
            f"calibration schema {schema} is unknown here (this version reads 1 to {_SCHEMA}): "
            "update lightflight or calibrate again",
            path=path,
        )
    known = {item.name for item in fields(make)}
    values = {**attributes, **arrays}
    missing = known - values.keys() - _LATER_FIELDS
    if missing:
        raise FileFormatError(f"calibration lacks {', '.join(sorted(missing))}", path=path)
    with damage_as_format_error(path), record_error_as_format_error(path):
        try:
            check_plain_values(values)
        except ValueError as refused:
            raise ValueError(f"{refused}: the file is damaged") from refused
        for name, kind in (("shape", int), ("notes", str), ("flat_mode_names", str)):
            told = values.get(name, [])
            if not isinstance(told, list) or not all(type(one) is kind for one in told):
                raise ValueError(f"{name} cannot be {told!r:.60}: the file is damaged")
            values[name] = tuple(told)
        return make(**{name: values[name] for name in known if name in values})
