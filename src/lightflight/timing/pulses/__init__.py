"""Pulses: where the light stands in each pixel's histogram, and when it arrived.

- `pulses` (`Pulses`, `fit_pulses`), run by `fits`, judged by `checks`; `pile_up`, `sync`
- fits of any shape and number of pulses: `batch`, on the `bins` of pixels
- on the clock: `arrivals` (`Arrivals`, `find_arrivals`)
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.timing.pulses.arrivals import (
        Arrivals as Arrivals,
        arrivals_from_pulses as arrivals_from_pulses,
        find_arrivals as find_arrivals,
    )
    from lightflight.timing.pulses.pulses import (
        METHODS as METHODS,
        Pulses as Pulses,
        fit_pulses as fit_pulses,
    )


__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.timing.pulses.arrivals": ("Arrivals", "arrivals_from_pulses", "find_arrivals"),
        "lightflight.timing.pulses.pulses": ("METHODS", "Pulses", "fit_pulses"),
    },
)
