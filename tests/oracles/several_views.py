"""One flight before several cameras: the refracting oracle's scenes, with nothing in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import lightflight as lf
from tests.oracles.brute_force import BruteCamera, camera_over_plane
from tests.oracles.refracted import RefractedScene, paper_scene
from tests.oracles.refracted_border import camera_told, histograms
from tests.oracles.refracted_bound import Freedom

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


LONG_MM = np.array([[0, 0, 0], [260, 20, 60], [290, 270, 10], [20, 300, 70]], dtype=float)
"""A way round three sides of a bench, of which no camera here sees all."""
BESIDE_MM = np.array([[0, 0, 0], [330, 10, 45], [310, 130, 15], [0, 140, 60]], dtype=float)
"""There and back, the turn outside of the first camera's picture."""


def parted(*, photons: float = 40_000.0, turned: bool = False) -> list[RefractedScene]:
    """Two cameras: one sees legs 1 and 2, the other legs 2 and 3; `turned`: the latter is first."""
    first = RefractedScene(
        LONG_MM,
        camera_over_plane(distance=535.0, width=300.0, height=300.0, center=(185.0, 85.0)),
        photons=photons,
    )
    other = moved_to(first.camera, (330.0, 420.0, 500.0), (165.0, 240.0, 40.0))
    scenes = [first, replace(first, camera=other)]
    return scenes[::-1] if turned else scenes


def beside(*, photons: float = 40_000.0, turned: bool = False) -> list[RefractedScene]:
    """Two cameras: one sees nothing of the middle leg, the other little else."""
    first = RefractedScene(
        BESIDE_MM,
        camera_over_plane(distance=535.0, width=245.0, height=245.0, center=(140.0, 70.0)),
        photons=photons,
    )
    closer = camera_over_plane(distance=535.0, width=150.0, height=150.0)
    other = moved_to(closer, (480.0, 190.0, 430.0), (320.0, 70.0, 30.0))
    scenes = [first, replace(first, camera=other)]
    return scenes[::-1] if turned else scenes


def late(scenes: Sequence[RefractedScene], offsets_ps: Sequence[float]) -> list[RefractedScene]:
    """The same as each camera's clock tells it, late by so much: light comes later on all of it."""
    return [
        replace(scene, emission_time_ps=scene.emission_time_ps + offset)
        for scene, offset in zip(scenes, offsets_ps, strict=True)
    ]


def recorded(scenes: Sequence[RefractedScene], seed: int) -> list[lf.Histograms]:
    """What each camera wrote of one flight."""
    return [histograms(scene, 10 * seed + number) for number, scene in enumerate(scenes)]


def late_freedom(camera: BruteCamera, std_ps: float) -> Freedom:
    """The zero of one camera's clock, ps."""

    def later(scene: RefractedScene, amount: float) -> RefractedScene:
        if scene.camera is not camera:
            return scene
        return replace(scene, emission_time_ps=scene.emission_time_ps + amount)

    return Freedom("offset", later, 0.02, std_ps)


def told(
    scenes: Sequence[RefractedScene],
    recordings: Sequence[lf.Histograms],
    *,
    emission_known: bool,
    offset_std_ps: float = 0.0,
) -> dict[str, Any]:
    """Arguments of `reconstruct`: all as it is, the emission time perhaps left out.

    `offset_std_ps` is stated of the clock of every camera but the first.
    """
    first, cameras = scenes[0], [camera_told(scene) for scene in scenes]
    stated = [replace(camera, clock_offset_std_ps=offset_std_ps) for camera in cameras[1:]]
    return {
        "camera": [cameras[0], *stated],
        "source": lf.Source(
            tuple(first.vertices_mm[0]),
            emission_time_ps=first.emission_time_ps if emission_known else None,
        ),
        "timing": [lf.TimingCalibration.nominal(hist) for hist in recordings],
    }
