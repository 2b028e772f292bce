"""A small scene, and what its recordings hold."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightflight import Camera
from lightflight.recording.recording import Recording
from lightflight.simulate import Scene, ideal

SMALL = Camera.facing_plane((8, 8), distance_mm=535.0, field_of_view_mm=(61.25, 61.25))
QUIET: dict[str, Any] = {"dark_rate_hz": 0.0, "screaming_fraction": 0.0}


def small_scene(detector=None, **changes):
    """One leg across an 8 x 8 camera."""
    return Scene(
        [(-60.0, -3.0, 0.0), (60.0, 5.0, 8.0)],
        camera=SMALL,
        detector=ideal() if detector is None else detector,
        **changes,
    )


def photons_of_events(raw: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frame, row and column of each photon."""
    starts, pixel = (np.asarray(v, dtype=int) for v in (raw.frame_starts, raw.pixel))
    frame = np.repeat(np.arange(raw.n_frames), np.diff(starts))
    row, col = np.divmod(pixel, raw.shape[1])
    return frame, row, col
