"""What is asked of an estimator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from lightflight.path.light_path import LightPath
    from lightflight.reconstruct.model.setting import Setting
    from lightflight.reconstruct.model.sighting import Sighting
    from lightflight.timing.clock.code_clock import CodeClock


@dataclass(frozen=True, eq=False)
class Request:
    """One flight, what was recorded of it, and what the user says of its path.

    Attributes
    ----------
    sightings : list of Sighting
        Recordings of the flight, on the clock and with their pulses found.
    setting : Setting
        Camera, source, medium and waypoints.
    timing : TimingCalibration or None
        The clock as calibrated; None: nominal codes.
    n_legs : int or None
        How many legs there are, where the user knows it; None: as many as the data show.
    start : LightPath, array_like or None
        A path or its vertices in mm to start from; None: the search for legs.
    may_bend : bool
        Whether legs may be curves, and all else is as it was told.
    arms_first : bool
        Whether arms that take up most of what a path leaves are taken before other light is
        looked for.
    """

    sightings: list[Sighting]
    setting: Setting
    timing: CodeClock | None = None
    n_legs: int | None = None
    start: LightPath | ArrayLike | None = None
    may_bend: bool = False
    arms_first: bool = False
