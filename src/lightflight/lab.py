"""The set-up of a lab, as a TOML file and as records: camera, source, medium, detector.

    [camera]
    shape = [32, 32]
    distance_mm = 535.0
    field_of_view_mm = [245.0, 245.0]
    center_mm = [187.5, 37.5]

    [source]
    position_mm = [0.0, 0.0, 0.0]
    pulse_fwhm_ps = 68.0

Reading: `lab_from_toml`, `lab_from_table`. Writing: `table_from_lab`, `toml_from_lab`.
The keys of every section: `SECTIONS` (docs/setup-file.md is made from it).
"""

from __future__ import annotations

import ast
import inspect
import os
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from lightflight import config
from lightflight.camera import Camera
from lightflight.config import Key
from lightflight.errors import ConfigError
from lightflight.flight import Medium, Source
from lightflight.simulate.detector import Detector

_UNKNOWN = "none"
"""How a set-up file says None where that is not the default."""

_per_axis = config.either(config.number, config.numbers(3))

CAMERA_KEYS = (
    Key(
        "file",
        "set-up file of a calibrated camera (from `lightflight calibrate camera`), beside this "
        "one; stands in place of all other keys",
        config.text,
    ),
    Key("shape", "(rows, cols) of the pixel array", config.integers(2)),
    Key(
        "distance_mm",
        "entrance pupil to the plane z = 0 that the camera faces, mm",
        config.number,
    ),
    Key(
        "field_of_view_mm",
        "(width, height) on z = 0 between the outer edges of the outer pixels, mm",
        config.numbers(2),
    ),
    Key("center_mm", "(x, y) that the pupil stands above, mm", config.numbers(2)),
    Key(
        "matrix",
        "OpenCV's camera matrix K, px; with it, world_from_camera stands in place of "
        "distance_mm, field_of_view_mm and center_mm",
        config.table_of_numbers(3, rows=3),
    ),
    Key("distortion", "OpenCV's k1 k2 p1 p2 k3 ...", config.numbers()),
    Key(
        "world_from_camera",
        "rigid pose, mm; camera axes x right, y down, z forward",
        config.table_of_numbers(4, rows=4),
    ),
    Key("position_std_mm", "one-sigma error of the pupil's place, one or three, mm", _per_axis),
    Key(
        "rotation_std_deg",
        "one-sigma error of the pose's rotation about the world axes, one or three, deg",
        _per_axis,
    ),
    Key(
        "pose_covariance",
        "in place of the two above: rotation (rad), then place (mm), world axes",
        config.table_of_numbers(6, rows=6),
    ),
)

SOURCE_KEYS = (
    Key("position_mm", "(x, y, z) where the pulse leaves the laser, mm", config.numbers(3)),
    Key("position_std_mm", "its one-sigma error, one or three, mm; 0: exact", _per_axis),
    Key(
        "emission_time_ps",
        "when the pulse leaves the source, on the calibrated clock, ps; left out: fitted",
        config.number,
    ),
    Key("emission_time_std_ps", "its one-sigma error, ps; 0: exact", config.number),
    Key("pulse_fwhm_ps", "full width at half maximum of the laser pulse, ps", config.number),
)

MEDIUM_KEYS = (
    Key("path_group_index", "group index along the path (fibre: about 1.47)", config.number),
    Key("return_group_index", "group index from the path to the camera", config.number),
)

TIMING_KEYS = (
    Key(
        "flat_arrival_ps",
        "when the light of the flat recording reached the camera, on the clock it defines, ps",
        config.number,
    ),
    Key(
        "dead_codes",
        "whether the time of the dead codes is absorbed by the first live ones or lost",
        config.choice("absorbed", "lost"),
    ),
    Key(
        "assumed_skew_std_ps",
        "spread of the pixels' own delays to assume where no flat was recorded, ps",
        config.number,
    ),
    Key(
        "flat_tilt_std_ps",
        "how far the flat's beam may have been tilted, as time from edge to edge of the array, ps",
        config.number,
    ),
    Key(
        "flat_pulse",
        "shape of the flat's pulse, and of the recordings' where it is a tail",
        config.choice("gaussian", "tail", "mean"),
    ),
)

RECONSTRUCT_KEYS = (
    Key("method", "estimator", config.choice("joint", "paper", "photon")),
    Key("n_legs", "number of legs, where it is known; left out: found", config.integer),
    Key(
        "waypoints",
        "known places of vertices, one row (vertex, x, y, z, std) each, mm",
        config.table_of_numbers(5),
    ),
)

SCENE_KEYS = (
    Key("vertices_mm", "source, mirrors and end of the path, mm", config.table_of_numbers(3)),
    Key(
        "source_direction",
        "in place of vertices_mm: in which the pulse leaves [source] position_mm; of any length",
        config.numbers(3),
    ),
    Key(
        "mirrors",
        "plane mirrors that the pulse may meet, in any order; one row (x, y, z of the middle, x, "
        "y, z of the normal, diameter) each, mm; diameter 0: no rim",
        config.table_of_numbers(7),
    ),
    Key("exit_length_mm", "length of the last leg of a path by way of mirrors, mm", config.number),
    Key(
        "most_reflections",
        "where a path by way of mirrors ends at the latest (a cavity); 100",
        config.integer,
    ),
    Key(
        "photons_per_pixel",
        "expected signal counts in the brightest pixel (code_density, flat: mean counts)",
        config.number,
    ),
    Key("brightness", "relative scattering strength of each leg", config.numbers()),
    Key(
        "dust_contrast",
        "in place of brightness: uneven scattering; standard deviation of its logarithm",
        config.number,
    ),
    Key("dust_correlation_mm", "path length over which dust stays alike, mm; 10", config.number),
    Key("dust_seed", "decides the pattern of the dust; 0", config.integer),
    Key("background", "expected background counts per pixel", config.number),
    Key(
        "true_emission_time_ps",
        "when the pulse starts, where [source] does not say, ps",
        config.number,
    ),
    Key(
        "true_pulse_fwhm_ps",
        "width of the laser pulse, where [source] does not say, ps",
        config.number,
    ),
    Key("beam_diameter_mm", "1/e^2 diameter of the beam, mm; 0: a line", config.number),
    Key("scattering", "angular law of the scattering", config.choice("uniform", "rayleigh")),
    Key(
        "polarization", "direction of the field on the first leg; left out: none", config.numbers(3)
    ),
    Key("inverse_square", "light thins with the distance to the camera", config.flag),
    Key("cos4_falloff", "the lens darkens towards the rim of its field", config.flag),
    Key(
        "vignetting",
        "share of light that the lens's mount holds back in the corner of the picture, 0 to 1",
        config.number,
    ),
)


@cache
def field_meanings(record: type) -> dict[str, str]:
    """The docstring under each field of a dataclass, by field name."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(record))).body[0]
    assert isinstance(tree, ast.ClassDef)
    meanings = {}
    for statement, below in zip(tree.body, tree.body[1:], strict=False):
        if (
            isinstance(statement, ast.AnnAssign)
            and isinstance(statement.target, ast.Name)
            and isinstance(below, ast.Expr)
            and isinstance(below.value, ast.Constant)
        ):
            meanings[statement.target.id] = " ".join(str(below.value.value).split())
    return meanings


_CHECK_FROM_ANNOTATION = {
    "bool": config.flag,
    "int": config.integer,
    "float": config.number,
    "tuple[float, ...]": config.numbers(),
    "tuple[float, float]": config.numbers(2),
    "ArrayLike": config.nested_numbers,
}


def _keys_from_fields(record: type) -> tuple[Key, ...]:
    """Keys of a section that mirrors a dataclass field by field."""
    keys = []
    for item in fields(record):
        annotation, may_be_none = (
            str(item.type).removesuffix(" | None"),
            " | None" in str(item.type),
        )
        check = _CHECK_FROM_ANNOTATION[annotation]
        if may_be_none and item.default is not None:
            check = config.either(check, config.word_for_none(_UNKNOWN))
        keys.append(Key(item.name, field_meanings(record).get(item.name, ""), check))
    return tuple(keys)


DETECTOR_KEYS = (
    Key("preset", "a detector to start from; the other keys change it", config.text),
    *_keys_from_fields(Detector),
)

SECTIONS: Mapping[str, Sequence[Key] | None] = {
    "camera": CAMERA_KEYS,
    "source": SOURCE_KEYS,
    "medium": MEDIUM_KEYS,
    "detector": DETECTOR_KEYS,
    "recording": None,
    "timing": TIMING_KEYS,
    "reconstruct": RECONSTRUCT_KEYS,
    "scene": SCENE_KEYS,
}
"""Keys of each section; None: the section is passed on, and checked by `lightflight.read`."""


@dataclass(frozen=True, eq=False)
class Lab:
    """What is known of a lab; sections that a command does not need may be missing."""

    camera: Camera | None = None
    """None: unknown, or not known well enough (`camera_needs`)."""

    source: Source = field(default_factory=Source)
    """Where and when the pulse starts."""

    medium: Medium = field(default_factory=Medium)
    """What the light crosses."""

    detector: Detector | None = None
    """The detector to simulate."""

    recording: Mapping[str, Any] = field(default_factory=dict)
    """What recordings do not say themselves: hints for `lightflight.read`."""

    timing: Mapping[str, Any] = field(default_factory=dict)
    """Options of `calibrate_timing`."""

    reconstruct: Mapping[str, Any] = field(default_factory=dict)
    """Options of `reconstruct`."""

    scene: Mapping[str, Any] = field(default_factory=dict)
    """The path to simulate, and its light."""

    camera_needs: tuple[str, ...] = ()
    """Keys of [camera] that are missing before there is a camera."""


# --- reading ---------------------------------------------------------------------------------


def lab_from_toml(path: str | os.PathLike[str] | None, *, assignments: Iterable[str] = ()) -> Lab:
    """Lab from a set-up file, with `section.key=value` assignments laid over it.

    Without a file (`path` None) the assignments alone count.

    Raises
    ------
    ConfigError
        For a missing or broken file, an unknown section or key (it names the nearest valid
        one), and values that do not fit together.
    """
    table = {} if path is None else config.table_from_toml(path)
    where = "--set" if path is None else os.fspath(path)
    return lab_from_table(config.override_table(table, assignments), where=where)


def lab_from_table(table: Mapping[str, Any], *, where: str = "set-up") -> Lab:
    """Lab from the tables of a set-up; see `lab_from_toml`."""
    sections = config.checked_sections(table, SECTIONS, where=where)
    camera_table = _with_camera_file(sections.get("camera", {}), where)
    needs = _missing_camera_keys(camera_table)
    with _naming(where, "camera"):
        camera = None if needs else _camera_from_table(camera_table)
    with _naming(where, "source"):
        source = Source(**sections.get("source", {}))
    with _naming(where, "medium"):
        medium = Medium(**sections.get("medium", {}))
    with _naming(where, "detector"):
        detector = _detector_from_table(sections["detector"]) if "detector" in sections else None
    options = {
        name: sections.get(name, {}) for name in ("recording", "timing", "reconstruct", "scene")
    }
    return Lab(
        camera=camera,
        source=source,
        medium=medium,
        detector=detector,
        camera_needs=needs,
        **options,
    )


def _with_camera_file(table: Mapping[str, Any], where: str) -> Mapping[str, Any]:
    """[camera], or that of the file it names (from the folder of this one)."""
    if "file" not in table:
        return table
    if len(table) > 1:
        raise ConfigError(f"{where}: [camera] give either file or the other keys, not both")
    path = Path(where).parent / table["file"]
    sections = config.checked_sections(
        config.table_from_toml(path), SECTIONS, where=os.fspath(path)
    )
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


def _missing_camera_keys(table: Mapping[str, Any]) -> tuple[str, ...]:
    wanted = (
        ("shape", "matrix", "world_from_camera")
        if "matrix" in table or "world_from_camera" in table
        else ("distance_mm", "field_of_view_mm")
    )
    return tuple(name for name in wanted if name not in table)


def _camera_from_table(table: Mapping[str, Any]) -> Camera:
    given = dict(table)
    covariance = _pose_covariance(given)
    if "matrix" in given:
        stray = {"distance_mm", "field_of_view_mm", "center_mm"} & given.keys()
        if stray:
            raise ValueError(f"give either matrix or {', '.join(sorted(stray))}, not both")
        return Camera(
            np.array(given["matrix"]),
            np.array(given.get("distortion", ())),
            np.array(given["world_from_camera"]),
            given["shape"],
            covariance,
        )
    if "distortion" in given:
        raise ValueError("distortion needs matrix and world_from_camera")
    camera = Camera.facing_plane(**given)
    return Camera(
        camera.matrix, camera.distortion, camera.world_from_camera, camera.shape, covariance
    )


def _pose_covariance(given: dict[str, Any]) -> Any:
    """Pose covariance from whichever keys state it (taken out of `given`); None: exact."""
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
    std = np.concatenate(
        (
            np.broadcast_to(np.deg2rad(0.0 if turn is None else turn), 3),
            np.broadcast_to(0.0 if place is None else place, 3),
        )
    )
    if (std < 0).any():
        raise ValueError("position_std_mm and rotation_std_deg must not be negative")
    return np.diag(std**2)


def _detector_from_table(table: Mapping[str, Any]) -> Detector:
    given = dict(table)
    name = given.pop("preset", None)
    if name is None:
        return Detector(**given)
    from lightflight.simulate.presets import PRESETS

    if name not in PRESETS:
        hint = config.unknown_name_sentence(name, list(PRESETS))
        raise ValueError(f"preset {name!r} is unknown; {hint}")
    return replace(PRESETS[name](), **given)


# --- writing ---------------------------------------------------------------------------------


def table_from_lab(lab: Lab) -> dict[str, dict[str, Any]]:
    """Tables of a set-up file that gives the same lab again, every default spelled out."""
    table: dict[str, dict[str, Any]] = {}
    if lab.camera is not None:
        table["camera"] = _table_from_camera(lab.camera)
    table["source"] = _table_from_record(lab.source)
    table["medium"] = _table_from_record(lab.medium)
    if lab.detector is not None:
        table["detector"] = _table_from_record(lab.detector)
    for name in ("recording", "timing", "reconstruct", "scene"):
        if getattr(lab, name):
            table[name] = {key: _toml_value(v) for key, v in getattr(lab, name).items()}
    return table


def toml_from_lab(lab: Lab) -> str:
    """Text of a set-up file that gives the same lab again; lists in one line, tables row by row."""
    lines = []
    for section, values in table_from_lab(lab).items():
        lines += ["", f"[{section}]"]
        lines += [f"{key} = {_toml_text(value)}" for key, value in values.items()]
    return "\n".join(lines[1:]) + "\n"


def toml_from_camera(camera: Camera) -> str:
    """Text of a set-up file with this camera alone."""
    lines = [f"{key} = {_toml_text(value)}" for key, value in _table_from_camera(camera).items()]
    return "\n".join(["[camera]", *lines]) + "\n"


def _toml_text(value: Any) -> str:
    if isinstance(value, list):
        nested = any(isinstance(item, list) for item in value)
        items = map(_toml_text, value)
        return "[\n    " + ",\n    ".join(items) + ",\n]" if nested else f"[{', '.join(items)}]"
    import tomli_w

    return tomli_w.dumps({"value": value}).removeprefix("value = ").rstrip("\n")


def _table_from_camera(camera: Camera) -> dict[str, Any]:
    table = {
        "shape": list(camera.shape),
        "matrix": camera.matrix.tolist(),
        "distortion": camera.distortion.tolist(),
        "world_from_camera": camera.world_from_camera.tolist(),
    }
    if camera.pose_covariance is not None:
        table["pose_covariance"] = camera.pose_covariance.tolist()
    return table


def _table_from_record(record: Any) -> dict[str, Any]:
    """Fields as TOML values; None is left out where it is the default, else the word for it."""
    table = {}
    for item in fields(record):
        value = getattr(record, item.name)
        if value is not None:
            table[item.name] = _toml_value(value)
        elif item.default is not None and item.default is not MISSING:
            table[item.name] = _UNKNOWN
    return table


def _toml_value(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_toml_value(item) for item in value]
    return value
