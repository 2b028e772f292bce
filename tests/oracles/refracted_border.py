"""Where the refracting oracle meets the package: its recordings, and what a user tells of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import lightflight as lf
from tests.oracles.refracted import AIR, RefractedScene, block_faces, recording


def histograms(scene: RefractedScene, seed: int) -> lf.Histograms:
    """The recording that a scene's camera wrote."""
    clock = scene.clock
    return lf.Histograms(
        recording(scene, seed), bin_width_ps=clock.width, laser_period_ps=clock.period
    )


def camera_told(scene: RefractedScene, distance_std_mm: float = 0.0) -> lf.Camera:
    """The oracle's camera and planes as a user tells them."""
    seen = scene.camera
    pose = np.eye(4)
    pose[:3] = np.column_stack((seen.right, seen.down, seen.forward, seen.center))
    matrix = np.eye(3)
    matrix[0, [0, 2]] = seen.px_per_slope_col, seen.col_of_axis
    matrix[1, [1, 2]] = seen.px_per_slope_row, seen.row_of_axis
    faces = tuple(
        lf.Interface(
            plane.point_mm, plane.normal, lf.Material(plane.phase_beyond, plane.group_beyond)
        )
        for plane in scene.planes
    )
    if faces:
        faces = (replace(faces[0], distance_std_mm=distance_std_mm), *faces[1:])
    return lf.Camera(matrix, np.empty(0), pose, (seen.rows, seen.cols), interfaces=faces)


def block_told(tilt_deg: float = 0.0, **changes: Any) -> lf.Block:
    """The block of `block_world` as a user tells it, but for `changes`."""
    front, back = block_faces(tilt_deg)
    told = {
        "center_mm": (front.point_mm + back.point_mm) / 2,
        "normal": front.normal,
        "thickness_mm": 20.0,
        "diameter_mm": 25.0,
        "glass": lf.Material(front.phase_beyond, front.group_beyond),
    }
    return lf.Block(**told | changes)


def what_the_user_tells(
    scene: RefractedScene,
    hist: lf.Histograms,
    *,
    emission_known: bool = True,
    index_share: float = 0.0,
    distance_std_mm: float = 0.0,
) -> dict[str, Any]:
    """Arguments of `reconstruct`: all as it is, with the errors that are stated.

    `index_share` is that of the scene's index, out and back, as a share of it.
    """
    index = float(np.atleast_1d(scene.path_group_index)[0])
    back = scene.planes[-1].group_beyond if scene.planes else AIR
    return {
        "camera": camera_told(scene, distance_std_mm),
        "source": lf.Source(
            tuple(scene.vertices_mm[0]),
            emission_time_ps=scene.emission_time_ps if emission_known else None,
        ),
        "medium": lf.Medium(
            index,
            back,
            path_group_index_std=index_share * index,
            return_group_index_std=index_share * back,
        ),
        "timing": lf.TimingCalibration.nominal(hist),
    }
