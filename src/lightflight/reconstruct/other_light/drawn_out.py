"""What flight through a footprint does to the pulse of a leg in a pixel: width, skewness, kurtosis.

Equations in `docs/explanation/method.md`, "Light that is not the legs'".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.lateral import LineFit
from lightflight.reconstruct.model.picture import Picture
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.strength import span_of_knots

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_EVEN_STD = 0.2
"""Of the variance that flight through a footprint adds to a pulse: nobody knows it better."""
_MOST_UNEVEN = 0.7
"""The same, at most, and how much less or more of it light may make that is not even."""
_SURE = 2.0
"""Standard deviations of what counts say of that area."""


def flight_ps(slope_ps: Floats, narrow: Floats, picture: Picture) -> Floats:
    """Standard deviation of times within a footprint, ps; `narrow` as `variance_of_light` says."""
    transit: Floats = np.abs(slope_ps) * picture.spot_std_px * np.sqrt(narrow)
    return transit


def variance_of_light(light: LineFit, along_px: Floats) -> tuple[Floats, Floats]:
    """Of a leg's light within pixels (n,), along it, in the spot's own; and its standard deviation.

    Of light seen through a Gaussian spot s^2 (1 + s^2 (ln I)''), I as pixels see it. The spline
    leaves out what is as uneven as what it shows, at most.
    """
    spot, bend = light.spot_std_at(along_px), light.spline.derivative(2)
    low, high = span_of_knots(light.spline.t)
    everywhere = np.linspace(low, high, 1 + int(np.ceil(high - low)))
    usual = np.sqrt(np.mean((light.spot_std_at(everywhere) ** 2 * bend(everywhere)) ** 2))
    own = spot**2 * bend(along_px) * ((along_px > low) & (along_px < high))
    doubt = np.full(len(along_px), min(float(usual), _MOST_UNEVEN))
    return np.clip(1.0 + own, 1.0 - _MOST_UNEVEN, 1.0 + _MOST_UNEVEN), np.hypot(_EVEN_STD, doubt)


def skewness_of_flight(
    slope_ps: Floats, bend_ps: Floats, std_ps: Floats, picture: Picture
) -> Floats:
    """Of light drawn out through a pixel by a time that does not run evenly along its spot."""
    third: Floats = 3.0 * slope_ps**2 * bend_ps * picture.spot_std_px**4
    return third / std_ps**3


def kurtosis_of_flight(
    slope_ps: Floats, side: Floats, skewness: Floats, std_ps: Floats, picture: Picture
) -> tuple[Floats, Floats]:
    """Of light drawn out through a pixel, and by how much its pulse departs from what that tells.

    A square active area a has the cumulants -a^4 (c^4 + s^4) / 120 and a^6 (c^6 + s^6) / 252 along
    a line that runs at an angle of cosine c and sine s; `side` is c^4 + s^4. The departure is that
    of a Gaussian of third, fourth and sixth cumulant g, k and h from its Gram-Charlier series to
    the fourth order, k off by d: d He_4 / 24 + g^2 He_6 / 72 + h He_6 / 720, rms, as a share of it.
    """
    fourth, off = _fourth_of_active_px(picture)
    per_fourth = -side * (slope_ps / std_ps) ** 4 / 120.0
    sixth = 0.5 * (3.0 * side - 1.0) * fourth**1.5 * (slope_ps / std_ps) ** 6 / 252.0
    departure: Floats = np.sqrt(
        (off * per_fourth) ** 2 / 24.0 + 720.0 * (skewness**2 / 72.0 + sixth / 720.0) ** 2
    )
    return fourth * per_fourth, departure


def _fourth_of_active_px(picture: Picture) -> tuple[float, float]:
    """Fourth power of the side of the active area, and how far it may be off; no more than pitch.

    Half of that where nothing tells.
    """
    areas = [
        light.area for leg, light in zip(picture.legs, picture.fits, strict=True) if not leg.dark
    ]
    told = [area for area in areas if area.fourth_std > 0.0]
    if not told:
        return 0.5, 0.5
    least = min(max(area.side_px**4 - _SURE * area.fourth_std, 0.0) for area in told)
    most = max(min(area.side_px**4 + _SURE * area.fourth_std, 1.0) for area in told)
    return 0.5 * (least + most), 0.5 * (most - least)


def own_std_ps(
    whole: Sighting,
    rows: Indices,
    cols: Indices,
    arrival_ps: Floats,
    transit_ps: Floats,
    std_ps: float,
) -> float:
    """Standard deviation of laser and detector, ps: of pulses without what flight adds to each.

    Pixels (n,), whose legs' light (n, s) comes at `arrival_ps`; NaN: there is none. `std_ps` is
    that of pulses as they are recorded, where none is found there.
    """
    arrivals = whole.arrivals
    own, pixel = whole.pulses_in(whole.usable_pulses, rows, cols)
    gap = np.abs(whole.arrival_ps[own, np.newaxis] - arrival_ps[pixel])
    slot = np.argmin(np.where(np.isnan(gap), np.inf, gap), axis=1)
    at = np.arange(len(own)), slot
    near = gap[at] < std_ps
    squared = (arrivals.std_ps[own] ** 2 - transit_ps[pixel, slot] ** 2)[near]
    if not len(squared):
        return std_ps
    order = np.argsort(squared)
    below = np.cumsum(arrivals.photons[own][near][order])
    middle = squared[order][np.searchsorted(below, 0.5 * below[-1])]
    return float(np.sqrt(max(middle, 0.1 * std_ps**2)))
