"""One straight piece of a path, and its angle as the paper measures it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.display import with_error

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Leg:
    """One straight piece of a path.

    Attributes
    ----------
    start_mm : array of float, shape (3,)
        World, mm.
    end_mm : array of float, shape (3,)
        World, mm.
    start_time_ps : float
        Event time at the start, ps.
    end_time_ps : float
        Event time at the end, ps.
    angle_deg : float
        Elevation towards the camera: asin(d.n), n the backward optical axis; deg. NaN, as the next
        two, where the leg was not seen.
    angle_std_deg : float
        One-sigma error of `angle_deg`, deg.
    paper_angle_deg : float
        The paper's alpha, measured in the plane through camera and leg; deg.
    seen : bool
        False: it ran outside of every picture, and both its ends may lie elsewhere.
    number : int
        Its place in `LightPath.legs`.
    parent : int or None
        Number of the leg before, whose light it carries on; None of the first.
    start_vertex : int
        Number of the vertex at which it begins.
    end_vertex : int
        Number of the vertex at which it ends.
    """

    start_mm: Floats
    end_mm: Floats
    start_time_ps: float
    end_time_ps: float
    angle_deg: float
    angle_std_deg: float
    paper_angle_deg: float
    seen: bool = field(default=True, kw_only=True)
    number: int = field(default=0, kw_only=True)
    parent: int | None = field(default=None, kw_only=True)
    start_vertex: int = field(default=0, kw_only=True)
    end_vertex: int = field(default=1, kw_only=True)

    def __repr__(self) -> str:
        if not self.seen:
            return f"Leg(not seen, {self.start_time_ps:.1f} to {self.end_time_ps:.1f} ps)"
        elevation = with_error(self.angle_deg, self.angle_std_deg)
        times = f"{self.start_time_ps:.1f} to {self.end_time_ps:.1f} ps"
        return f"Leg({self.length_mm:.1f} mm, elevation {elevation}\u00b0, {times})"

    @property
    def direction(self) -> Floats:
        """(3,), unit, world, in the direction of flight; NaN where that was not seen."""
        step = self.end_mm - self.start_mm
        unit: Floats = step / np.linalg.norm(step)
        return unit if self.seen else np.full(3, np.nan)

    @property
    def length_mm(self) -> float:
        """Length of the leg, mm; of one that was not seen, between mirrors as drawn."""
        return float(np.linalg.norm(self.end_mm - self.start_mm))


def paper_angle_from_leg(
    start_mm: ArrayLike, end_mm: ArrayLike, *, camera_center_mm: ArrayLike, normal: ArrayLike
) -> float:
    """The paper's alpha of a leg: its angle out of the reference plane, in the viewing plane.

    The reference plane is normal to `normal` and holds the start of the leg; the viewing plane
    holds camera and leg (Zheng et al. 2020, Fig. 3).

    Parameters
    ----------
    start_mm, end_mm : array of float, shape (3,)
        Ends of the leg, world, mm.
    camera_center_mm : array of float, shape (3,)
        World, mm.
    normal : array of float, shape (3,)
        Unit vector towards the camera, world.

    Returns
    -------
    float
        rad; NaN for a leg that points at the camera, where there is no viewing plane.
    """
    start = np.asarray(start_mm, dtype=float)
    step = np.asarray(end_mm, dtype=float) - start
    n = np.asarray(normal, dtype=float)
    plane_normal = np.cross(np.asarray(camera_center_mm, dtype=float) - start, step)
    trace = np.cross(plane_normal, n)
    size = np.linalg.norm(trace)
    if size < 1e-12 * max(1.0, float(np.linalg.norm(plane_normal))):
        return float("nan")
    trace = trace / size
    upright = n - (n @ plane_normal) * plane_normal / (plane_normal @ plane_normal)
    upright /= np.linalg.norm(upright)
    along = float(step @ trace)
    return float(np.arctan2(step @ upright, abs(along)))
