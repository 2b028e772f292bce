"""Reconstruction: from arrival times and counts to the path (x, y, z, t).

- `chain`: the way of a recording to a `LightPath` (`reconstruct`); `answer`: the path that is told,
  an estimator's or another where tests contradict it; `from_arrivals`: from pulses that were found
  elsewhere; `laser`: the pulse's own length; `calls`: what is checked before; `sightings`:
  recordings on the clock
- `estimators`: what `method=` names, each with its file in `ways`
- rooms, each above the one before: `model` (what every pixel should have counted), `legs` (in the
  picture), `fit` (one path), `all_counts` (the likelihood of every count), `other_light` (haze,
  mirrors, second pulses), `trials` (other numbers of legs) beside `limits` (bounds, planning),
  `verdict` (is it right?), `ways` (a file for each estimator)
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.reconstruct.chain import reconstruct as reconstruct
    from lightflight.reconstruct.laser import LaserPulse as LaserPulse, laser_pulse as laser_pulse
    from lightflight.reconstruct.legs.find import ImageLeg as ImageLeg, find_legs as find_legs
    from lightflight.reconstruct.limits.bounds import Bounds as Bounds, bounds as bounds
    from lightflight.reconstruct.limits.planning import Plan as Plan, plan as plan


FREE_NAMES = (
    "source", "emission_time", "pose", "focal_length", "aspect", "axis", "distortion",
    "decentering", "index", "window", "clock_offset", "clock_scale", "clock_drift", "calibration",
    "bend",
)  # fmt: skip
"""What `reconstruct(free=)` takes; their plausible sizes are `model.sizes.PLAUSIBLE`."""

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.reconstruct.chain": ("reconstruct",),
        "lightflight.reconstruct.laser": ("LaserPulse", "laser_pulse"),
        "lightflight.reconstruct.legs.find": ("ImageLeg", "find_legs"),
        "lightflight.reconstruct.limits.bounds": ("Bounds", "bounds"),
        "lightflight.reconstruct.limits.planning": ("Plan", "plan"),
    },
)
