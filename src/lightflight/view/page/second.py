"""What the page needs to show a second camera's view of the same path.

Takes a LightPath, a Camera and the page's trace, gives packed arrays: the picture from `observe`,
the trace on that camera's clock.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lightflight.files.json_values import json_value
from lightflight.path.apparent_speed import apparent_speed_along
from lightflight.path.second_view import Observation, observe
from lightflight.path.trace import Trace, trace_from_path
from lightflight.view.page.packing import camera_part, packed
from lightflight.view.types import Floats, Json

if TYPE_CHECKING:
    from lightflight import Camera, LightPath


def second_view(path: LightPath, camera: Camera, trace: Trace) -> Json:
    """Everything in the page that depends on who looks.

    Parameters
    ----------
    path : LightPath
        The path.
    camera : Camera
        Who looks.
    trace : Trace
        Dense points along the path.

    Raises
    ------
    GeometryError
        Where the camera sees no part of the path.
    """
    seen = observe(path, camera)
    per_leg = int(np.count_nonzero(trace.leg == 0))
    other = trace_from_path(path, camera=camera, per_leg=per_leg)
    first = float(other.arrival_ps[0])
    row, col = camera.pixels_from_points(other.points_mm)
    speed = apparent_speed_along(other, camera=camera, medium=getattr(path, "medium", None))
    return {
        "camera": camera_part(camera, path),
        "first_arrival_ps": json_value(first),
        "trace": {
            "back_ps": None,
            "arrival_ps": packed(other.arrival_ps - first, "f4"),
            "pixel": packed(np.stack((row, col), axis=1), "f4"),
            "in_view": packed(other.in_view, "u1"),
            "apparent_speed": packed(speed, "f4"),
        },
        "lights": _lights(seen, first, float(other.event_time_ps[0])),
    }


def _lights(seen: Observation, first_ps: float, start_ps: float) -> Json:
    """One row per pixel and leg: light, mean times, width of the pulse as that pixel sees it."""
    rows, cols = seen.camera.shape
    # One number per leg and pixel: where legs cross, their light stays apart.
    key, where = np.unique(seen.leg * rows * cols + seen.pixel, return_inverse=True)

    def mean(values: Floats) -> Floats:
        return np.bincount(where, weights=seen.strength * values) / light

    light = np.bincount(where, weights=seen.strength)
    arrival = mean(seen.arrival_ps)
    transit = mean((seen.arrival_ps - arrival[where]) ** 2)
    return {
        "row": packed(key // cols % rows, "u2"),
        "col": packed(key % cols, "u2"),
        "leg": packed(key // (rows * cols), "u2"),
        "arrival_ps": packed(arrival - first_ps, "f4"),
        "event_ps": packed(mean(seen.event_time_ps) - start_ps, "f4"),
        "photons": packed(light / light.max(), "f4"),
        "width_ps": packed(np.sqrt(seen.pulse_std_ps**2 + transit), "f4"),
    }
