"""Fig. 4: the legs one after another, each from the plane its start lies in (RP1, RP2, RP3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.path.light_path import paper_angle_from_leg
from lightflight.simulate.presets import paper_scene
from studies.zheng2020 import fig6
from studies.zheng2020.work import Unit

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fig4:
    """The chain's geometry, leg by leg."""

    starts_mm: Floats
    """(legs, 3), S1, S2, S3 by the paper's chain."""
    ends_mm: Floats
    """(legs, 3), E1, E2, E3."""
    projected_ends_mm: Floats
    """(legs, 3), where the viewing ray to each end meets the leg's reference plane."""
    plane_z_mm: Floats
    """(legs,), depth of each reference plane."""
    angles_deg: Floats
    """(legs,), alpha of each leg, in its viewing plane."""
    true_vertices_mm: Floats
    """(legs + 1, 3), the truth."""
    true_angles_deg: Floats
    """(legs,), alpha of the true legs, in their viewing planes."""


def units(quick: bool) -> tuple[Unit, ...]:
    """The first recording of Fig. 6."""
    return fig6.units(quick)[:1]


def record_from_results(results: Sequence[Mapping[str, Any]]) -> Fig4:
    """The figure from the results of `units`."""
    path, scene = results[0]["paths"]["paper"], paper_scene()
    vertices, true = path.vertices_mm, np.asarray(scene.vertices_mm, dtype=float)
    center = scene.camera.center_mm
    depth = vertices[:-1, 2]
    share = (depth - center[2]) / (vertices[1:, 2] - center[2])
    return Fig4(
        starts_mm=vertices[:-1],
        ends_mm=vertices[1:],
        projected_ends_mm=center + share[:, np.newaxis] * (vertices[1:] - center),
        plane_z_mm=depth,
        angles_deg=np.array([leg.paper_angle_deg for leg in path.legs]),
        true_vertices_mm=true,
        true_angles_deg=np.rad2deg(
            [
                paper_angle_from_leg(
                    true[k],
                    true[k + 1],
                    camera_center_mm=center,
                    normal=scene.camera.backward_axis,
                )
                for k in range(len(true) - 1)
            ]
        ),
    )
