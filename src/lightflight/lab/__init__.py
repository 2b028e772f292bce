"""The set-up of a lab, as a TOML file and as records: camera, source, medium, detector, scene.

- what a set-up file may say: `keys` (`SECTIONS`, and `..._KEYS` for each section)
- a file read: `lab` (`Lab`, `lab_from_toml`, `lab_from_table`)
- the scene to simulate, by way of mirrors and dust: `scene` (`scene_from_lab`)
- and back to TOML: `write` (`toml_from_lab`, `toml_from_camera`, `table_from_lab`)

Reading TOML strictly is below, in `lightflight.files.toml_tables`, which knows no record.
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.lab.keys import (
        CAMERA_KEYS,
        DETECTOR_KEYS,
        MEDIUM_KEYS,
        RECONSTRUCT_KEYS,
        SCENE_KEYS,
        SECTIONS,
        SOURCE_KEYS,
        TIMING_KEYS,
        field_meanings,
    )
    from lightflight.lab.lab import Lab, lab_from_table, lab_from_toml, reconstruct_options
    from lightflight.lab.scene import resolved_lab, scene_from_lab
    from lightflight.lab.write import table_from_lab, toml_from_camera, toml_from_lab

__all__ = [
    "CAMERA_KEYS",
    "DETECTOR_KEYS",
    "MEDIUM_KEYS",
    "RECONSTRUCT_KEYS",
    "SCENE_KEYS",
    "SECTIONS",
    "SOURCE_KEYS",
    "TIMING_KEYS",
    "Lab",
    "field_meanings",
    "lab_from_table",
    "lab_from_toml",
    "reconstruct_options",
    "resolved_lab",
    "scene_from_lab",
    "table_from_lab",
    "toml_from_camera",
    "toml_from_lab",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "CAMERA_KEYS": "lightflight.lab.keys",
        "DETECTOR_KEYS": "lightflight.lab.keys",
        "MEDIUM_KEYS": "lightflight.lab.keys",
        "RECONSTRUCT_KEYS": "lightflight.lab.keys",
        "SCENE_KEYS": "lightflight.lab.keys",
        "SECTIONS": "lightflight.lab.keys",
        "SOURCE_KEYS": "lightflight.lab.keys",
        "TIMING_KEYS": "lightflight.lab.keys",
        "Lab": "lightflight.lab.lab",
        "field_meanings": "lightflight.lab.keys",
        "lab_from_table": "lightflight.lab.lab",
        "lab_from_toml": "lightflight.lab.lab",
        "reconstruct_options": "lightflight.lab.lab",
        "resolved_lab": "lightflight.lab.scene",
        "scene_from_lab": "lightflight.lab.scene",
        "table_from_lab": "lightflight.lab.write",
        "toml_from_camera": "lightflight.lab.write",
        "toml_from_lab": "lightflight.lab.write",
    },
)
