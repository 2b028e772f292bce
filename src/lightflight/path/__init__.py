"""Paths: where a pulse was and when, its file, its errors, and how it looks.

- the record and its file: `light_path` (`LightPath`), `file`, `card`; its tables: `tables`
- how far a path is from the truth: `error` (`path_error`)
- points along it with both times: `trace`; `apparent_speed`
- what another camera would see of it: `second_view` (`observe`, `camera_towards`)
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.path.error import path_error
    from lightflight.path.light_path import (
        Leg,
        LightPath,
        extrapolated_position,
        paper_angle_from_leg,
    )
    from lightflight.path.second_view import camera_towards, observe
    from lightflight.path.tables import RESIDUAL_DTYPE, SAMPLE_DTYPE, Explained, Goodness

__all__ = [
    "RESIDUAL_DTYPE",
    "SAMPLE_DTYPE",
    "Explained",
    "Goodness",
    "Leg",
    "LightPath",
    "camera_towards",
    "extrapolated_position",
    "observe",
    "paper_angle_from_leg",
    "path_error",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "Explained": "lightflight.path.tables",
        "Goodness": "lightflight.path.tables",
        "Leg": "lightflight.path.light_path",
        "LightPath": "lightflight.path.light_path",
        "RESIDUAL_DTYPE": "lightflight.path.tables",
        "SAMPLE_DTYPE": "lightflight.path.tables",
        "camera_towards": "lightflight.path.second_view",
        "extrapolated_position": "lightflight.path.light_path",
        "observe": "lightflight.path.second_view",
        "paper_angle_from_leg": "lightflight.path.light_path",
        "path_error": "lightflight.path.error",
    },
)
