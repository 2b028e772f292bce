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
        BLOCK_KEYS as BLOCK_KEYS,
        CAMERA_KEYS as CAMERA_KEYS,
        DETECTOR_KEYS as DETECTOR_KEYS,
        MEDIUM_KEYS as MEDIUM_KEYS,
        RECONSTRUCT_KEYS as RECONSTRUCT_KEYS,
        SCENE_KEYS as SCENE_KEYS,
        SECTIONS as SECTIONS,
        SOURCE_KEYS as SOURCE_KEYS,
        TIMING_KEYS as TIMING_KEYS,
        WINDOW_KEYS as WINDOW_KEYS,
        field_meanings as field_meanings,
    )
    from lightflight.lab.lab import (
        Lab as Lab,
        lab_from_table as lab_from_table,
        lab_from_toml as lab_from_toml,
        reconstruct_options as reconstruct_options,
    )
    from lightflight.lab.scene import resolved_lab as resolved_lab, scene_from_lab as scene_from_lab
    from lightflight.lab.write import (
        table_from_lab as table_from_lab,
        toml_from_camera as toml_from_camera,
        toml_from_lab as toml_from_lab,
    )


__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.lab.keys": (
            "BLOCK_KEYS",
            "CAMERA_KEYS",
            "DETECTOR_KEYS",
            "MEDIUM_KEYS",
            "RECONSTRUCT_KEYS",
            "SCENE_KEYS",
            "SECTIONS",
            "SOURCE_KEYS",
            "TIMING_KEYS",
            "WINDOW_KEYS",
            "field_meanings",
        ),
        "lightflight.lab.lab": ("Lab", "lab_from_table", "lab_from_toml", "reconstruct_options"),
        "lightflight.lab.scene": ("resolved_lab", "scene_from_lab"),
        "lightflight.lab.write": ("table_from_lab", "toml_from_camera", "toml_from_lab"),
    },
)
