"""A set-up back as tables and as TOML, with everything that was understood spelled out."""

from __future__ import annotations

from dataclasses import MISSING, fields, replace
from typing import Any

import numpy as np

from lightflight.camera.model import CLOCK_FIELDS, LENS_ERRORS, Camera
from lightflight.flight import Medium
from lightflight.lab.block import table_from_blocks
from lightflight.lab.keys import WORD_FOR_NONE
from lightflight.lab.lab import OPTION_SECTIONS, Lab
from lightflight.lab.window import table_from_window


def table_from_lab(lab: Lab) -> dict[str, dict[str, object]]:
    """Tables of a set-up file that gives the same lab again, every default spelled out.

    Parameters
    ----------
    lab : Lab
        The set-up.

    Returns
    -------
    dict of str to dict
        Keys and values by section, as `tomllib` would read them: lists, numbers, texts.
    """
    table: dict[str, dict[str, object]] = {}
    if lab.camera is not None:
        table["camera"] = _table_from_camera(lab.camera)
        table |= {"window": w} if (w := table_from_window(lab.camera)) else {}
    table["source"] = _table_from_record(lab.source)
    table["medium"] = _table_from_medium(lab.medium)
    table |= {"block": b} if (b := table_from_blocks(lab.medium)) else {}
    if lab.detector is not None:
        table["detector"] = _table_from_record(lab.detector)
    for name in OPTION_SECTIONS:
        if getattr(lab, name):
            table[name] = {key: _toml_value(v) for key, v in getattr(lab, name).items()}
    return table


def toml_from_lab(lab: Lab) -> str:
    """Text of a set-up file that gives the same lab again.

    Parameters
    ----------
    lab : Lab
        The set-up.

    Returns
    -------
    str
        TOML; lists in one line, tables row by row.
    """
    lines = []
    for section, values in table_from_lab(lab).items():
        lines += ["", f"[{section}]"]
        lines += [f"{key} = {_toml_text(value)}" for key, value in values.items()]
    return "\n".join(lines[1:]) + "\n"


def toml_from_camera(camera: Camera) -> str:
    """Text of a set-up file with this camera alone, as [camera] file names one.

    Parameters
    ----------
    camera : Camera
        Its matrix, distortion and pose, and the pose's covariance where it has one.

    Returns
    -------
    str
        TOML.
    """
    lines = [f"{key} = {_toml_text(value)}" for key, value in _table_from_camera(camera).items()]
    return "\n".join(["[camera]", *lines]) + "\n"


def _toml_text(value: object) -> str:
    """A value as TOML; unlike tomli-w's, lists of numbers stay in one line."""
    if isinstance(value, list):
        nested = any(isinstance(item, list) for item in value)
        items = map(_toml_text, value)
        return "[\n    " + ",\n    ".join(items) + ",\n]" if nested else f"[{', '.join(items)}]"
    import tomli_w

    return tomli_w.dumps({"value": value}).removeprefix("value = ").rstrip("\n")


def _table_from_camera(camera: Camera) -> dict[str, object]:
    """Keys of [camera]: always the matrix, which says what any camera can be."""
    table = {
        "shape": list(camera.shape),
        "matrix": camera.matrix.tolist(),
        "distortion": camera.distortion.tolist(),
        "world_from_camera": camera.world_from_camera.tolist(),
    }
    if camera.pose_covariance is not None:
        table["pose_covariance"] = camera.pose_covariance.tolist()
    stated = {name: getattr(camera, name) for name in (*LENS_ERRORS, *CLOCK_FIELDS)}
    return table | {name: value for name, value in stated.items() if value != 0.0}


def _table_from_medium(medium: Medium) -> dict[str, object]:
    """Keys of [medium]; errors only where one is stated: campaigns are known by these tables."""
    uniform = replace(medium, blocks=())
    table = _table_from_record(uniform)
    del table["blocks"]
    exact = Medium(medium.path_group_index, medium.return_group_index)
    known = ("path_group_index", "return_group_index")
    return {k: v for k, v in table.items() if uniform != exact or k in known}


def _table_from_record(record: Any) -> dict[str, object]:
    """Fields as TOML values; None is left out where it is the default, else the word for it."""
    table = {}
    for item in fields(record):
        value = getattr(record, item.name)
        # TOML has no null.
        if value is not None:
            table[item.name] = _toml_value(value)
        elif item.default is not None and item.default is not MISSING:
            table[item.name] = WORD_FOR_NONE
    return table


def _toml_value(value: object) -> object:
    """Python numbers and lists for NumPy's values and for tuples."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_toml_value(item) for item in value]
    return value
