"""One flight before several cameras: the refracting oracle's scenes, with nothing in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import lightflight as lf
from tests.oracles.brute_force import BruteCamera
from tests.oracles.refracted import RefractedScene, paper_scene
from tests.oracles.refracted_border import camera_told, histograms

SECOND_MM, THIRD_MM = (560.0, 260.0, 420.0), (-120.0, -230.0, 470.0)
"""Where further cameras stand: both look at the middle of the scene, 40 degrees from the first."""
LOOKED_AT_MM = (187.5, 37.5, 25.0)


def moved_to(
    camera: BruteCamera, center_mm: Sequence[float], towards_mm: Sequence[float]
) -> BruteCamera:
    """The same camera elsewhere, its columns level with x and y."""
    center = np.asarray(center_mm, dtype=float)
    forward = np.asarray(towards_mm, dtype=float) - center
    forward /= np.linalg.norm(forward)
    right = camera.right - (camera.right @ forward) * forward
    right /= np.linalg.norm(right)
    # As the camera had it: a picture seen from behind would be another camera's.
    hand = float(np.linalg.det(np.column_stack((camera.right, camera.down, camera.forward))))
    return replace(
        camera, center=center, right=right, down=hand * np.cross(forward, right), forward=forward
    )


def views(n: int, *, photons: float = 40_000.0) -> list[RefractedScene]:
    """The paper's scene before one, two or three cameras."""
    first = replace(paper_scene(), photons=photons)
    others = [
        replace(first, camera=moved_to(first.camera, place, LOOKED_AT_MM))
        for place in (SECOND_MM, THIRD_MM)
    ]
    return [first, *others][:n]


def recorded(scenes: Sequence[RefractedScene], seed: int) -> list[lf.Histograms]:
    """What each camera wrote of one flight."""
    return [histograms(scene, 10 * seed + number) for number, scene in enumerate(scenes)]


def told(
    scenes: Sequence[RefractedScene], recordings: Sequence[lf.Histograms], *, emission_known: bool
) -> dict[str, Any]:
    """Arguments of `reconstruct`: all as it is, the emission time perhaps left out."""
    first = scenes[0]
    return {
        "camera": [camera_told(scene) for scene in scenes],
        "source": lf.Source(
            tuple(first.vertices_mm[0]),
            emission_time_ps=first.emission_time_ps if emission_known else None,
        ),
        "timing": [lf.TimingCalibration.nominal(hist) for hist in recordings],
    }
