"""Reconstruction: from arrival times and counts to the path (x, y, z, t).

- `chain`: the way of a recording to a `LightPath` (`reconstruct`); `from_arrivals`: from pulses
  that were found elsewhere; `laser`: the pulse's own length; `calls`: what is checked before;
  `sightings`: recordings on the clock
- `estimators`: what `method=` names, each with its file in `ways`
- rooms, each above the one before: `model`, `legs`, `fit`, `limits`, `ways`
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.reconstruct.chain import reconstruct
    from lightflight.reconstruct.laser import LaserPulse, laser_pulse
    from lightflight.reconstruct.legs.find import ImageLeg, find_legs
    from lightflight.reconstruct.limits.bounds import Bounds, bounds
    from lightflight.reconstruct.limits.planning import Plan, plan

__all__ = [
    "Bounds",
    "ImageLeg",
    "LaserPulse",
    "Plan",
    "bounds",
    "find_legs",
    "laser_pulse",
    "plan",
    "reconstruct",
]

FREE_NAMES = (
    "source", "emission_time", "pose", "focal_length", "distortion", "index", "clock_offset",
    "clock_scale", "clock_drift",
)  # fmt: skip
"""What `reconstruct(free=)` takes; their plausible sizes are `model.sizes.PLAUSIBLE`."""

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "Bounds": "lightflight.reconstruct.limits.bounds",
        "ImageLeg": "lightflight.reconstruct.legs.find",
        "LaserPulse": "lightflight.reconstruct.laser",
        "Plan": "lightflight.reconstruct.limits.planning",
        "bounds": "lightflight.reconstruct.limits.bounds",
        "find_legs": "lightflight.reconstruct.legs.find",
        "laser_pulse": "lightflight.reconstruct.laser",
        "plan": "lightflight.reconstruct.limits.planning",
        "reconstruct": "lightflight.reconstruct.chain",
    },
)
