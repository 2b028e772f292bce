"""What a fit is told beside the recordings: camera or cameras, source, medium, waypoints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from lightflight.flight import Medium, Source
from lightflight.reconstruct.freedom import Waypoint

if TYPE_CHECKING:
    from lightflight.camera import Camera


@dataclass(frozen=True, eq=False)
class Setting:
    """What a fit is told beside the recordings."""

    camera: Camera
    """The camera that recorded; of several, the one whose view the path's ends belong to."""
    source: Source
    """What is known of the source."""
    medium: Medium
    """The medium."""
    waypoints: tuple[Waypoint, ...] = ()
    """Vertices measured otherwise."""
    others: tuple[Camera, ...] = ()
    """Further cameras; `Observation.view` counts `camera` as 0 and these from 1."""

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """All cameras."""
        return (self.camera, *self.others)

    def at(self, view: int) -> Setting:
        """The setting of one camera alone."""
        return replace(self, camera=self.cameras[view], others=())
