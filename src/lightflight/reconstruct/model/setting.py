"""What a fit is told beside the recordings: camera or cameras, source, medium, waypoints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lightflight.flight import Medium, Source
from lightflight.reconstruct.model.told import ToldLength, Waypoint
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.curves import DrawnCurve


@dataclass(frozen=True, eq=False)
class Setting:
    """What a fit is told beside the recordings.

    Attributes
    ----------
    camera : Camera
        The camera that recorded; of several, the one whose clock all others are told against.
    source : Source
        What is known of the source.
    medium : Medium
        The medium.
    waypoints : tuple of Waypoint
        Vertices measured otherwise.
    others : tuple of Camera
        Further cameras; `Sighting.view` counts `camera` as 0 and these from 1.
    curves : tuple of DrawnCurve
        That legs are told to run along.
    lengths : tuple of ToldLength
        Of legs, measured otherwise.
    """

    camera: Camera
    source: Source
    medium: Medium
    waypoints: tuple[Waypoint, ...] = ()
    others: tuple[Camera, ...] = ()
    curves: tuple[DrawnCurve, ...] = ()
    lengths: tuple[ToldLength, ...] = ()

    @property
    def told_vertices(self) -> frozenset[int]:
        """Vertices, counted as told, that their user knows by number: none of them is needless."""
        ends = (vertex for one in self.lengths for vertex in (one.leg, one.leg + 1))
        return frozenset((*(number for number, _, _ in self.waypoints), *ends))

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """All cameras."""
        return (self.camera, *self.others)

    def at(self, view: int) -> Setting:
        """The setting of one camera alone."""
        return replace(self, camera=self.cameras[view], others=())


def earliest_arrival_ps(setting: Setting) -> float | None:
    """No light can arrive before this time on the clock; None where the source is not known.

    Straight from source to camera is the shortest way there is; a nanosecond and the errors
    stated are allowed for.

    Parameters
    ----------
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    float or None
        On the clock, ps.
    """
    source, medium = setting.source, setting.medium
    if source.position_mm is None or source.emission_time_ps is None:
        return None
    gap = np.linalg.norm(np.asarray(source.position_mm, dtype=float) - setting.camera.center_mm)
    # The faster medium all the way: a bound that no light can beat.
    index = min(medium.path_group_index, medium.return_group_index)
    if setting.camera.interfaces:
        index = min(index, setting.camera.stands_in.group_index)
    camera = setting.camera
    slack = 1000.0 + 5.0 * source.emission_time_std_ps + 5.0 * camera.clock_offset_std_ps
    sent_ps = source.emission_time_ps + camera.clock_offset_ps
    earliest = float(sent_ps + index * gap / SPEED_OF_LIGHT_MM_PER_PS - slack)
    # Of a clock of which nothing is known no time is too early.
    return earliest if np.isfinite(earliest) else None
