"""Worlds that two paths explain, and their likelihood worked out apart from the package's.

A leg in glass fibre is slower than the light that comes back: two of its directions seem to run
equally fast. Two straight legs that meet at a shallow corner look like one that bends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tests.oracles.bent import bent_scene
from tests.oracles.brute_force import BruteClock, C, camera_over_plane
from tests.oracles.refracted import RefractedScene

FIBRE = 1.47


def fibre_scene(elevation_deg: float, photons: float, width_mm: float = 60.0) -> RefractedScene:
    """One leg across a narrow picture, whose arrival curve hardly bends."""
    first = -0.5 * width_mm - 3.0
    run = 1.1 * width_mm
    rise = run * np.tan(np.deg2rad(elevation_deg))
    return RefractedScene(
        np.array([[first, 2.0, 0.0], [first + run, 4.0, rise]]),
        camera_over_plane(width=width_mm, height=width_mm),
        clock=BruteClock(300, 55.0, 50_000.0),
        path_group_index=FIBRE,
        photons=photons,
    )


def cornered_scene(turn_deg: float, way: str, photons: float) -> RefractedScene:
    """Two straight legs that meet in the middle of the view, turned in the picture or in depth."""
    bent = bent_scene(legs=1, sagitta_mm=1.0, way=way, photons=photons)
    first, last = np.asarray(bent.vertices_mm, dtype=float)
    aside = bent.bows_mm[0][0] / np.linalg.norm(bent.bows_mm[0][0])
    far = 0.5 * np.linalg.norm(last - first) * np.tan(np.deg2rad(0.5 * turn_deg))
    corner = 0.5 * (first + last) + far * aside
    return replace(bent, vertices_mm=np.array([first, corner, last]), bows_mm={})


def light_seems_to_run(direction: np.ndarray, towards_camera: np.ndarray, out: float) -> float:
    """Speed across the line of sight, mm/ps, in air, by two pulses a picosecond apart."""
    step = direction * C / out
    nearer = float(step @ towards_camera)
    # The second is seen later by a picosecond, and sooner by the way it came nearer.
    return float(np.linalg.norm(step - nearer * towards_camera) / (1.0 - 1.00027 * nearer / C))


@dataclass(frozen=True, eq=False)
class Measured:
    """Times and lines of a flight, whitened; errors that pulses share are integrated out."""

    rays: np.ndarray
    """(n, 3), of the pixels in the camera's axes, third component 1."""
    leg: np.ndarray
    arrival_ps: np.ndarray
    anchors: np.ndarray
    """(a, 3), as `rays`."""
    anchor_leg: np.ndarray
    whitening: np.ndarray
    """(n + a, n + a), of residuals in ps and px."""
    focal_px: float

    def log_likelihood(self, curves: Callable[[int], tuple[np.ndarray, np.ndarray]]) -> float:
        """Of legs given as places (k, 3) in the camera's axes, mm, and times (k,) of arrival, ps.

        Up to a constant. A pixel is told the time of the nearest place of its leg's image.
        """
        off = np.empty(len(self.leg) + len(self.anchor_leg))
        for leg in np.unique(self.leg):
            places, arrival = curves(int(leg))
            image = places[:, :2] / places[:, 2:]
            ahead = image[-1] - image[0]
            ahead /= np.linalg.norm(ahead)
            along, across = image @ ahead, image @ [-ahead[1], ahead[0]]
            here = self.leg == leg
            # The images are nearly straight: nearest is where the line's normal meets them.
            off[: len(here)][here] = self.arrival_ps[here] - np.interp(
                self.rays[here, :2] @ ahead, along, arrival
            )
            here = self.anchor_leg == leg
            points = self.anchors[here, :2]
            bowed = np.interp(points @ ahead, along, across)
            off[len(self.leg) :][here] = self.focal_px * (points @ [-ahead[1], ahead[0]] - bowed)
        white = self.whitening @ off
        return -0.5 * float(white @ white)
