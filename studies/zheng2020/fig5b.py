"""Fig. 5(b): event time against arrival time at several angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.flight import arrival_time_from_event
from lightflight.simulate.presets import angle_scene
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS
from studies.zheng2020 import fig5a
from studies.zheng2020.work import Unit

Floats = NDArray[np.float64]

ANGLES_DEG = (-10.0, -4.0, 0.0, 4.0, 10.0)
"""Angles drawn; the paper does not say which it chose."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Both times along one leg, ps, from the first light in view."""

    angle_deg: float
    """True angle."""
    theory_arrival_ps: Floats
    """(n,), exact."""
    theory_event_ps: Floats
    """(n,), exact."""
    arrival_ps: Floats
    """(m,), measured in the pixels."""
    event_time_ps: Floats
    """(m,), by the paper's chain."""
    time_rms_ps: float
    """rms difference of `event_time_ps` to the truth at the same arrival times."""


@dataclass(frozen=True, eq=False)
class Fig5b:
    """One curve per angle."""

    curves: tuple[Curve, ...]
    """In ascending angle."""


def units(quick: bool) -> tuple[Unit, ...]:
    """Those of Fig. 5(a) at the angles drawn here."""
    return tuple(u for u in fig5a.units(quick) if u.settings["angle_deg"] in ANGLES_DEG)


def record_from_results(results: Sequence[Mapping[str, Any]]) -> Fig5b:
    """The figure from the results of `units`."""
    return Fig5b(tuple(_curve(one) for one in results))


def _curve(result: Mapping[str, Any]) -> Curve:
    scene = angle_scene(result["angle_deg"])
    start, end = np.asarray(scene.vertices_mm, dtype=float)
    length = np.linalg.norm(end - start)
    along = np.linspace(0.0, length, 2001)
    points = start + along[:, np.newaxis] * (end - start) / length
    event = scene.medium.path_group_index * along / SPEED_OF_LIGHT_MM_PER_PS
    arrival = arrival_time_from_event(
        points,
        event,
        camera_center_mm=scene.camera.center_mm,
        return_group_index=scene.medium.return_group_index,
    )
    seen = scene.camera.sees(points)
    first_event, first_arrival = event[seen][0], arrival[seen][0]
    measured = np.array(result["clocks"]["arrival_ps"])
    found = np.array(result["clocks"]["event_time_ps"])
    order = np.argsort(measured)
    error = found - np.interp(measured, arrival, event)
    return Curve(
        result["angle_deg"],
        arrival[seen] - first_arrival,
        event[seen] - first_event,
        measured[order] - first_arrival,
        found[order] - first_event,
        float(np.sqrt(np.mean(error**2))),
    )
