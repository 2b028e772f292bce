"""A set-up read: camera, source, medium, detector and scene of a lab, from TOML.

    [camera]
    shape = [32, 32]
    distance_mm = 535.0
    field_of_view_mm = [245.0, 245.0]
    center_mm = [187.5, 37.5]

    [source]
    position_mm = [0.0, 0.0, 0.0]
    pulse_fwhm_ps = 68.0

`lab_from_toml` and `lab_from_table` give a `Lab`; which keys there are, `lightflight.lab.keys`
says; `lightflight.lab.write` goes the way back.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.arguments import shown
from lightflight.camera.model import CLOCK_FIELDS, LENS_ERRORS, Camera
from lightflight.camera.rigid import pose_covariance_from_stds
from lightflight.curves import DrawnCurve
from lightflight.display import Shown
from lightflight.errors import ConfigError, SuspectDataWarning
from lightflight.files import toml_tables as config
from lightflight.flight import Medium, Source
from lightflight.lab.block import blocks_from_table
from lightflight.lab.keys import SECTIONS
from lightflight.lab.window import camera_behind, medium_from_table
from lightflight.simulate.detector import Detector

_CLOCK_KEYS = {"n_codes", "bin_width_ps", "code_width_ps", "laser_period_ps", "reversed_codes"}
"""Who writes one of these in [detector] describes a camera of his own."""

OPTION_SECTIONS = ("curve", "recording", "timing", "reconstruct", "scene")
"""Sections that are kept as they were written, as options of what they are named after."""


@dataclass(frozen=True, eq=False, repr=False)
class Lab(Shown):
    """What is known of a lab; sections that a command does not need may be missing.

    Attributes
    ----------
    camera : Camera or None
        None: unknown, or not known well enough (`camera_needs`).
    source : Source
        Where and when the pulse starts.
    medium : Medium
        What the light crosses.
    detector : Detector or None
        The detector to simulate.
    recording : mapping of str
        What recordings do not say themselves: hints for `lightflight.read`.
    timing : mapping of str
        Options of `calibrate_timing`.
    reconstruct : mapping of str
        Options of `reconstruct`.
    scene : mapping of str
        The path to simulate, and its light.
    camera_needs : tuple of str
        Keys of [camera] that are missing before there is a camera.
    curve : mapping of str
        Fields of the `DrawnCurve` that a leg runs along.
    """

    camera: Camera | None = None
    source: Source = field(default_factory=Source)
    medium: Medium = field(default_factory=Medium)
    detector: Detector | None = None
    recording: Mapping[str, Any] = field(default_factory=dict)
    timing: Mapping[str, Any] = field(default_factory=dict)
    reconstruct: Mapping[str, Any] = field(default_factory=dict)
    scene: Mapping[str, Any] = field(default_factory=dict)
    camera_needs: tuple[str, ...] = ()
    curve: Mapping[str, Any] = field(default_factory=dict, kw_only=True)


def lab_from_toml(path: str | os.PathLike[str] | None, *, assignments: Iterable[str] = ()) -> Lab:
    """Lab from a set-up file, with `section.key=value` assignments laid over it.

    Parameters
    ----------
    path : path-like or None
        The file, TOML; None: the assignments alone count.
    assignments : iterable of str, optional
        "section.key=value", the value as TOML would write it.

    Returns
    -------
    Lab
        Records of the sections that are there.

    Raises
    ------
    ConfigError
        For a missing or broken file, an unknown section or key (it names the nearest valid
        one), and values that do not fit together.
    """
    told = list(assignments)
    # What is misspelt on the command line is not the file's fault.
    config.checked_sections(config.override_table({}, told), SECTIONS, where="--set")
    if path is None:
        return lab_from_table(config.override_table({}, told), where="--set")
    table = config.override_table(config.table_from_toml(path), told)
    with config.telling_of(told):
        return lab_from_table(table, where=os.fspath(path))


def lab_from_table(table: Mapping[str, object], *, where: str = "set-up") -> Lab:
    """Lab from the tables of a set-up, as TOML gives them.

    Parameters
    ----------
    table : mapping of str to mapping
        Keys and values by section (`lightflight.lab.SECTIONS`).
    where : str, optional
        What errors call the set-up; the file of [camera] file is looked for beside it.

    Returns
    -------
    Lab
        Records of the sections that are there.

    Raises
    ------
    ConfigError
        As `lab_from_toml`.

    Examples
    --------
    >>> lab = lab_from_table({"source": {"position_mm": [0.0, 0.0, 0.0]}})
    >>> lab.source.position_mm
    (0.0, 0.0, 0.0)
    >>> lab.camera_needs
    ('distance_mm', 'field_of_view_mm')
    """
    sections = config.checked_sections(table, SECTIONS, where=where)
    camera_table = _with_camera_file(sections.get("camera", {}), where)
    needs = _missing_camera_keys(camera_table)
    with _naming(where, "camera"):
        camera = None if needs else _camera_from_table(camera_table)
    with _naming(where, "window"):
        camera = None if camera is None else camera_behind(camera, sections.get("window", {}))
    with _naming(where, "source"):
        source = Source(**sections.get("source", {}))
    with _naming(where, "medium"):
        medium = medium_from_table(sections.get("medium", {}), camera)
    with _naming(where, "block"):
        medium = replace(medium, blocks=blocks_from_table(sections.get("block", {})))
    with _naming(where, "detector"):
        detector = _detector_from_table(sections["detector"]) if "detector" in sections else None
    options = {name: sections.get(name, {}) for name in OPTION_SECTIONS}
    with _naming(where, "curve"):
        _curves_from_table(options["curve"])
    return Lab(camera, source, medium, detector, camera_needs=needs, **options)


def reconstruct_options(lab: Lab) -> dict[str, Any]:
    """[reconstruct] of a set-up as options of `lightflight.reconstruct`.

    Parameters
    ----------
    lab : Lab
        The set-up.

    Returns
    -------
    dict of str
        Its keys; `waypoints` as (vertex, (x, y, z), std) each, `lengths` as (leg, length, std), mm;
        and the curve of [curve].
    """
    options = dict(lab.reconstruct)
    waypoints = [(int(row[0]), row[1:4], row[4]) for row in options.pop("waypoints", ())]
    lengths = [(int(leg), length, std) for leg, length, std in options.pop("lengths", ())]
    curves = _curves_from_table(lab.curve)
    return {**options, "waypoints": waypoints, "lengths": lengths, "curves": curves}


def _curves_from_table(table: Mapping[str, Any]) -> tuple[DrawnCurve, ...]:
    """The curve of [curve]; () where the table is empty."""
    for key in ("points_mm", "point_std_mm"):
        if table and key not in table:
            raise ValueError(f"{key} is missing: where the curve runs, and how well that is known")
    return (DrawnCurve(**table),) if table else ()


def _with_camera_file(table: Mapping[str, Any], where: str) -> Mapping[str, object]:
    """Keys of [camera], or those of the file it names (from the folder of this one)."""
    if "file" not in table:
        return table
    if len(table) > 1:
        raise ConfigError(f"{where}: [camera] give either file or the other keys, not both")
    path = Path(where).parent / table["file"]
    sections = config.checked_sections(
        config.table_from_toml(path), SECTIONS, where=os.fspath(path)
    )
    # One step only: files that name each other would be followed for ever.
    if "file" in sections.get("camera", {"file": ""}):
        raise ConfigError(f"{path}: holds no [camera] of its own")
    return sections["camera"]


@contextmanager
def _naming(where: str, section: str) -> Iterator[None]:
    """Turn what a record's own checks say into a ConfigError that names file and section."""
    try:
        yield
    except (ValueError, TypeError) as error:
        raise ConfigError(f"{where}: [{section}] {error}") from error


def _missing_camera_keys(table: Mapping[str, object]) -> tuple[str, ...]:
    """Keys without which [camera] is no camera, in either way of saying where one stands."""
    wanted = (
        ("shape", "matrix", "world_from_camera")
        if "matrix" in table or "world_from_camera" in table
        else ("distance_mm", "field_of_view_mm")
    )
    return tuple(name for name in wanted if name not in table)


def _camera_from_table(table: Mapping[str, Any]) -> Camera:
    """Camera from a matrix and a pose, or as one that faces the plane z = 0."""
    given = dict(table)
    covariance = _pose_covariance(given)  # first: `facing_plane` takes the other keys alone
    single = (*LENS_ERRORS, *CLOCK_FIELDS)
    lens: dict[str, Any] = {name: float(given.pop(name)) for name in single if name in given}
    if "matrix" in given:
        stray = {"distance_mm", "field_of_view_mm", "center_mm", "field_of_view_std_mm"}
        stray &= given.keys()
        if stray:
            raise ValueError(f"give either matrix or {', '.join(sorted(stray))}, not both")
        return Camera(
            np.array(given["matrix"]),
            np.array(given.get("distortion", ())),
            np.array(given["world_from_camera"]),
            given["shape"],
            covariance,
            **lens,
        )
    if "distortion" in given:
        raise ValueError("distortion needs matrix and world_from_camera")
    if "focal_std_fraction" in lens and "field_of_view_std_mm" in given:
        raise ValueError("give either focal_std_fraction or field_of_view_std_mm, not both")
    return replace(Camera.facing_plane(**given), pose_covariance=covariance, **lens)


def _pose_covariance(given: dict[str, Any]) -> NDArray[np.float64] | None:
    """Pose covariance (6, 6) from the keys that state it (taken out of `given`); None: exact."""
    place = given.pop("position_std_mm", None)
    turn = given.pop("rotation_std_deg", None)
    full = given.pop("pose_covariance", None)
    if full is not None:
        if place is not None or turn is not None:
            raise ValueError(
                "give either pose_covariance or position_std_mm and rotation_std_deg, not both"
            )
        return np.array(full)
    if place is None and turn is None:
        return None
    covariance = pose_covariance_from_stds(
        0.0 if place is None else place, 0.0 if turn is None else turn
    )
    return np.zeros((6, 6)) if covariance is None else covariance


def _detector_from_table(table: Mapping[str, Any]) -> Detector:
    """Detector from its fields, laid over those of a preset."""
    given = dict(table)
    name = given.pop("preset", None)
    if name is None:
        if given and not given.keys() & _CLOCK_KEYS:
            warnings.warn(
                f"[detector] {', '.join(given)} without a preset: this is an ideal camera, not the "
                'default PF32: write preset = "pf32" (or "ideal") beside them',
                SuspectDataWarning,
                stacklevel=2,
            )
        return Detector(**given)
    from lightflight.simulate.presets import PRESETS

    if name not in PRESETS:
        hint = config.unknown_name_sentence(name, list(PRESETS))
        raise ValueError(f"preset {shown(name)} is unknown; {hint}")
    return replace(PRESETS[name](), **given)
