"""Pulses that are wide because light is slow through their pixels, and not for being two.

A pulse much wider than the array's is taken for no single one. In a large room, or on a leg that
runs along the line of sight, flight through the spot makes it as wide: its neighbours are as wide
then, and come as much later from pixel to pixel as that takes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.timing.pulses.checks import WIDTH_FACTOR

_NEAR_PX = 1.5
"""Neighbours lie beside a pixel, or across its corner."""
_AS_WIDE_LN = 0.25
"""They are as wide, within this; the mixed light of two legs is as wide as its share of each."""
_NEIGHBOURS = 2
"""So many come as much earlier or later: one before and one after, or both on one side of it."""
_WIDEST_SPOT_PX = 1.0
"""Light that is spread more is no leg's: a spot is 0.25 to 0.75 px."""


def with_steep_pulses(sighting: Sighting) -> Sighting:
    """The recording, pulses that flight makes wide no longer called too wide.

    Parameters
    ----------
    sighting : Sighting
        On the clock and with its pulses found, times folded to where light can come from.

    Returns
    -------
    Sighting
        The same where no pulse is.
    """
    arrivals = sighting.arrivals
    plain = arrivals.flags & ~np.uint32(flags.TOO_WIDE)
    usable = sighting.usable_pulses
    wide = np.flatnonzero(
        (arrivals.flags & np.uint32(flags.TOO_WIDE) > 0)
        & flags.is_usable(plain)
        & np.isfinite(sighting.arrival_ps + arrivals.std_ps)
    )
    if len(wide) <= _NEIGHBOURS or not len(usable):
        return sighting
    typical = float(np.median(arrivals.std_ps[usable]))
    slope = _slopes(sighting, wide, np.concatenate((wide, usable)))
    most = np.hypot(WIDTH_FACTOR * typical, _WIDEST_SPOT_PX * slope)
    steep = wide[arrivals.std_ps[wide] < most]
    cleared = arrivals.flags.copy()
    cleared[steep] = plain[steep]
    return replace(sighting, arrivals=replace(arrivals, flags=cleared))


def _slopes(
    sighting: Sighting, of: NDArray[np.intp], among: NDArray[np.intp]
) -> NDArray[np.float64]:
    """How fast times change from some pulses to those about them that are as wide, ps/px.

    The second largest of each; 0: it has fewer such neighbours.
    """
    from scipy.spatial import cKDTree

    arrivals, times = sighting.arrivals, sighting.arrival_ps
    places = np.column_stack((arrivals.row, arrivals.col)).astype(np.float64)
    width = np.log(arrivals.std_ps)
    found = np.zeros(len(of))
    near = cKDTree(places[among]).query_ball_point(places[of], _NEAR_PX)
    for k, (own, about) in enumerate(zip(of, near, strict=True)):
        others = among[np.array(about, dtype=np.intp)]
        apart = np.hypot(*(places[others] - places[own]).T)
        alike = (apart > 0.0) & (np.abs(width[others] - width[own]) < _AS_WIDE_LN)
        slopes = np.abs(times[others] - times[own])[alike] / apart[alike]
        if len(slopes) >= _NEIGHBOURS:
            found[k] = np.sort(slopes)[-_NEIGHBOURS]
    return found
