"""One piece of a path, straight or bent, and its angle as the paper measures it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.display import with_error
from lightflight.path.bends import BentCourse

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Leg:
    """One piece of a path: straight, or a smooth curve.

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
    course : BentCourse or None
        The curve of a bent leg; its angles are those at its start. None: it is straight.
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
    course: BentCourse | None = field(default=None, kw_only=True, repr=False)

    def __repr__(self) -> str:
        if not self.seen:
            return f"Leg(not seen, {self.start_time_ps:.1f} to {self.end_time_ps:.1f} ps)"
        elevation = with_error(self.angle_deg, self.angle_std_deg)
        times = f"{self.start_time_ps:.1f} to {self.end_time_ps:.1f} ps"
        bent = ", bent" if self.course is not None else ""
        return f"Leg({self.length_mm:.1f} mm{bent}, elevation {elevation}\u00b0, {times})"

    @property
    def direction(self) -> Floats:
        """(3,), unit, world, in the direction of flight, of a bent leg at its start.

        NaN where that was not seen.
        """
        step = self.end_mm - self.start_mm
        if self.course is not None:
            step = self.course.tangents_mm(np.zeros(1))[0]
        unit: Floats = step / np.linalg.norm(step)
        return unit if self.seen else np.full(3, np.nan)

    @property
    def length_mm(self) -> float:
        """Way of the light, mm; of a leg that was not seen, between mirrors as drawn."""
        if self.course is not None:
            return float(self.course.ways_mm(np.ones(1))[0])
        return float(np.linalg.norm(self.end_mm - self.start_mm))

    def direction_at(self, event_times_ps: ArrayLike) -> Floats:
        """Direction of flight at event times.

        Parameters
        ----------
        event_times_ps : array of float, shape (n,)
            ps.

        Returns
        -------
        array of float, shape (n, 3)
            Unit, world; NaN off the leg, and where that was not seen.
        """
        times = np.atleast_1d(np.asarray(event_times_ps, dtype=float))
        found = np.tile(self.direction, (len(times), 1))
        if self.course is not None:
            share = (times - self.start_time_ps) / (self.end_time_ps - self.start_time_ps)
            tangents = self.course.tangents_mm(self.course.fractions_at(share * self.length_mm))
            found = tangents / np.linalg.norm(tangents, axis=1)[:, np.newaxis]
        found[(times < self.start_time_ps) | (times > self.end_time_ps)] = np.nan
        return found


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
