"""Paths: where a pulse was and when, its file, its errors, and how it looks.

- the record and its file: `light_path` (`LightPath`), `leg` (`Leg`), `file`, `card`; its tables:
  `tables`
- paths that fork: which leg follows which, branches: `tree`
- legs that are curves: `bends` (`Bend`), and what follows on them: `on_bends`
- stretches that no picture showed: `gaps` (`Gap`)
- light to and fro between two mirrors: `cavity` (`RoundTrip`)
- a second pulse on the same path: `second_pulse` (`SecondPulse`)
- other paths that explain the recording as well: `alternative` (`Alternative`)
- how far a path is from the truth: `error` (`path_error`)
- points along it with both times: `trace`; `apparent_speed`
- what another camera would see of it: `second_view` (`observe`, `camera_towards`)
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.path.alternative import Alternative as Alternative
    from lightflight.path.bends import Bend as Bend
    from lightflight.path.cavity import RoundTrip as RoundTrip
    from lightflight.path.error import path_error as path_error
    from lightflight.path.gaps import Gap as Gap
    from lightflight.path.light_path import (
        Leg as Leg,
        LightPath as LightPath,
        paper_angle_from_leg as paper_angle_from_leg,
    )
    from lightflight.path.on_legs import extrapolated_position as extrapolated_position
    from lightflight.path.second_pulse import SecondPulse as SecondPulse
    from lightflight.path.second_view import camera_towards as camera_towards, observe as observe
    from lightflight.path.tables import (
        RESIDUAL_DTYPE as RESIDUAL_DTYPE,
        SAMPLE_DTYPE as SAMPLE_DTYPE,
        Explained as Explained,
        Goodness as Goodness,
    )


__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.path.alternative": ("Alternative",),
        "lightflight.path.bends": ("Bend",),
        "lightflight.path.cavity": ("RoundTrip",),
        "lightflight.path.error": ("path_error",),
        "lightflight.path.gaps": ("Gap",),
        "lightflight.path.light_path": (
            "Leg",
            "LightPath",
            "paper_angle_from_leg",
        ),
        "lightflight.path.on_legs": ("extrapolated_position",),
        "lightflight.path.second_pulse": ("SecondPulse",),
        "lightflight.path.second_view": ("camera_towards", "observe"),
        "lightflight.path.tables": ("Explained", "Goodness", "RESIDUAL_DTYPE", "SAMPLE_DTYPE"),
    },
)
