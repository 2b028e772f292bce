"""Apparent speed along a path, for pictures and exports."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.flight import Medium, apparent_speed_from_direction
from lightflight.path.trace import Trace
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

_STRAIGHT = 1e-9
"""Of its length: points that lie farther from the straight line are those of a bent leg."""


def apparent_speed_along(
    trace: Trace, *, camera: Camera | None, medium: Medium | None
) -> NDArray[np.float64]:
    """Length of path seen per unit of arrival time: c / (n_p - n_r d.u).

    Parameters
    ----------
    trace : Trace
        Points along a path.
    camera : Camera or None
        Who looks.
    medium : Medium or None
        None: air.

    Returns
    -------
    array of float, shape (n,)
        In units of c; NaN without a camera.
    """
    if camera is None or len(trace.leg) == 0:
        return np.full(len(trace.leg), np.nan)
    direction = np.empty_like(trace.points_mm)
    for leg in np.unique(trace.leg):
        of_leg = trace.leg == leg
        points = trace.points_mm[of_leg]
        step = points[-1] - points[0]
        # A leg of one point has no direction: 0 / 0, and NaN is the answer.
        with np.errstate(invalid="ignore"):
            direction[of_leg] = step / np.linalg.norm(step)
        away = np.cross(points - points[0], direction[of_leg])
        if len(points) > 2 and np.abs(away).max() > _STRAIGHT * np.abs(step).max():
            steps = np.gradient(points, axis=0)
            direction[of_leg] = steps / np.linalg.norm(steps, axis=1)[:, np.newaxis]
    towards = -camera.sight_directions(trace.points_mm)
    speed = apparent_speed_from_direction(direction, towards, medium=medium)
    return np.asarray(speed / SPEED_OF_LIGHT_MM_PER_PS)
