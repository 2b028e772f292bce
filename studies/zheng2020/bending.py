"""A self-bending beam (Airy) in many short straight pieces, as the paper's discussion proposes.

The paper's way: the chain on a few pixels at a time, each piece starting where the last one
ended. Ours: the depths of all the pieces' ends in one least-squares fit of all arrival times.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from lightflight.flight import Medium
from lightflight.reconstruct.fit.paper import angles_from_arrivals, plane_axes
from lightflight.simulate import Scene
from lightflight.simulate.presets import angle_scene
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS
from studies.zheng2020.cases import case_of
from studies.zheng2020.laboratory import (
    Chain,
    calibrated_clock,
    chain_of_recording,
    path_of_recording,
    recorded,
)

Floats = NDArray[np.float64]

_TRUE_PIECES = 250
"""The true curve is drawn in pieces of 1.5 mm: 0.1 um from a parabola."""


def bent_scene(bend_mm: float) -> Scene:
    """A beam along x that bends towards the camera by `bend_mm` over the field of view."""
    straight = angle_scene(0.0)
    start, end = np.asarray(straight.vertices_mm, dtype=float)
    x = np.linspace(start[0], end[0], _TRUE_PIECES + 1)
    reach = (x - start[0]) / 245.0
    vertices = np.column_stack([x, np.full_like(x, start[1]), bend_mm * reach**2])
    return replace(straight, vertices_mm=vertices)


def measure_bend(*, bend_mm: float, pieces: int, seed: int) -> dict[str, Any]:
    """Error of the curve in view, by the paper's way and by one fit of all pieces."""
    scene = bent_scene(bend_mm)
    hist = recorded(scene, seed=7_000_000 * (seed + 1))
    timing = calibrated_clock("codes", seed=seed)
    straight = replace(scene, vertices_mm=np.asarray(scene.vertices_mm)[[0, -1]])
    chain = chain_of_recording(hist, straight, timing)
    by_pieces = pieces_of_chain(chain, pieces)
    by_fit = pieces_of_fit(chain, pieces)
    single = path_of_recording(hist, scene, timing, "joint", n_legs=1)
    return {
        "cases": [
            case_of(
                "self-bending beam",
                f"{bend_mm:.0f} mm in {pieces} pieces",
                "distance from the true curve, rms (mm)",
                {
                    "paper": curve_error_mm(by_pieces, scene),
                    "joint": curve_error_mm(by_fit, scene),
                },
                note=(
                    f"one straight leg: {curve_error_mm(single.vertices_mm, scene):.2f} mm; "
                    "parabola in depth"
                ),
            )
        ],
        "true_mm": np.asarray(scene.vertices_mm).tolist(),
        "paper_mm": by_pieces.tolist(),
        "joint_mm": by_fit.tolist(),
    }


def pieces_of_chain(chain: Chain, pieces: int) -> Floats:
    """Vertices of the paper's chain applied to a few pixels at a time; (pieces + 1, 3), mm."""
    camera, medium, source = chain.setting.camera, chain.setting.medium, chain.setting.source
    assert source.emission_time_ps is not None
    seen = chain.projections[0]
    rays = camera.rays_from_pixels(seen.rows, seen.cols)
    parts = np.array_split(np.arange(len(rays)), pieces)
    start, time = np.asarray(source.position_mm, dtype=float), float(source.emission_time_ps)
    vertices = [start]
    along, upright = plane_axes(rays, start, camera)
    for part in parts:
        alphas = angles_from_arrivals(
            rays[part],
            seen.arrival_ps[part],
            start_mm=start,
            start_time_ps=time,
            along=along,
            upright=upright,
            camera_center_mm=camera.center_mm,
            medium=medium,
        )
        alpha = float(np.mean(alphas[np.isfinite(alphas)]))
        direction = np.cos(alpha) * along + np.sin(alpha) * upright
        start, time = _end_on_ray(
            start, time, direction, rays[part[-1]], camera.center_mm, upright, along, medium
        )
        vertices.append(start)
    return np.array(vertices)


def _end_on_ray(
    start: Floats,
    time_ps: float,
    direction: Floats,
    ray: Floats,
    center: Floats,
    upright: Floats,
    along: Floats,
    medium: Medium,
) -> tuple[Floats, float]:
    """Where a piece crosses the viewing ray of its last pixel, and when."""
    normal = np.cross(ray, np.cross(along, upright))
    length = float((center - start) @ normal) / float(direction @ normal)
    step = medium.path_group_index * length / SPEED_OF_LIGHT_MM_PER_PS
    return start + length * direction, time_ps + float(step)


def pieces_of_fit(chain: Chain, pieces: int) -> Floats:
    """Vertices of a polyline fitted to all arrival times at once; (pieces + 1, 3), mm.

    A vertex lies on the viewing ray of the last pixel of its piece (the first is the source);
    its distance from the camera is what is fitted.
    """
    camera, medium, source = chain.setting.camera, chain.setting.medium, chain.setting.source
    assert source.emission_time_ps is not None
    seen = chain.projections[0]
    start = np.asarray(source.position_mm, dtype=float)
    rays = camera.rays_from_pixels(seen.rows, seen.cols)
    along, upright = plane_axes(rays, start, camera)
    piece = np.concatenate(
        [np.full(len(p), k) for k, p in enumerate(np.array_split(np.arange(len(rays)), pieces))]
    )
    last = rays[[np.flatnonzero(piece == k)[-1] for k in range(pieces)]]

    def polyline(distance: Floats) -> Floats:
        return np.vstack([start, camera.center_mm + distance[:, np.newaxis] * last])

    def residual(distance: Floats) -> Floats:
        points = polyline(distance)
        steps = np.diff(points, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        before = np.concatenate(([0.0], np.cumsum(lengths)))[piece]
        normal = np.cross(rays, np.cross(along, upright))
        share = np.sum((camera.center_mm - points[piece]) * normal, axis=1)
        share /= np.sum(steps[piece] * normal, axis=1)
        place = points[piece] + share[:, np.newaxis] * steps[piece]
        out = medium.path_group_index * (before + share * lengths[piece])
        back = medium.return_group_index * np.linalg.norm(place - camera.center_mm, axis=1)
        flight = (out + back) / SPEED_OF_LIGHT_MM_PER_PS
        return np.asarray(seen.arrival_ps - float(source.emission_time_ps or 0.0) - flight)

    axis = camera.backward_axis
    first = np.array(
        [float((camera.center_mm - start) @ axis) / float(-ray @ axis) for ray in last]
    )
    return polyline(np.asarray(least_squares(residual, first, x_scale=1.0).x))


def curve_error_mm(vertices: Floats, scene: Scene) -> float:
    """Rms distance of a polyline from the true curve, at 1,000 places of equal x in view, mm."""
    true = np.asarray(scene.vertices_mm, dtype=float)
    seen = true[scene.camera.sees(true)]
    x = np.linspace(seen[0, 0], seen[-1, 0], 1000)
    x = x[(x >= vertices[0, 0]) & (x <= vertices[-1, 0])]
    offset = [
        np.interp(x, vertices[:, 0], vertices[:, k]) - np.interp(x, true[:, 0], true[:, k])
        for k in (1, 2)
    ]
    return float(np.sqrt(np.mean(offset[0] ** 2 + offset[1] ** 2)))
