"""Pulses: where the light stands in each pixel's histogram, and when it arrived.

- `pulses` (`Pulses`, `fit_pulses`), run by `fits`, judged by `checks`; `pile_up`, `sync`
- fits of any shape and number of pulses: `batch`, on the `bins` of pixels
- on the clock: `arrivals` (`Arrivals`, `find_arrivals`)
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.timing.pulses.arrivals import Arrivals, arrivals_from_pulses, find_arrivals
    from lightflight.timing.pulses.pulses import METHODS, Pulses, fit_pulses

__all__ = [
    "METHODS",
    "Arrivals",
    "Pulses",
    "arrivals_from_pulses",
    "find_arrivals",
    "fit_pulses",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "Arrivals": "lightflight.timing.pulses.arrivals",
        "METHODS": "lightflight.timing.pulses.pulses",
        "Pulses": "lightflight.timing.pulses.pulses",
        "arrivals_from_pulses": "lightflight.timing.pulses.arrivals",
        "find_arrivals": "lightflight.timing.pulses.arrivals",
        "fit_pulses": "lightflight.timing.pulses.pulses",
    },
)
