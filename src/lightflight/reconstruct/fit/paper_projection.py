"""What the paper takes of a leg: one pixel per position along it, on the line of its light."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.reconstruct.model.image_plane import pixels_of_undistorted, undistorted_px
from lightflight.reconstruct.model.sighting import Sighting

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

PAPER_REACH_PX = 2.5
"""Light this near to a leg's line counts for its centres of mass, px: its spot, no other leg."""
_DARK = flags.NO_PHOTONS | flags.TOO_FEW | flags.NO_PULSE
"""A pixel with one of these is not bad: it saw no light."""


@dataclass(frozen=True, eq=False)
class Projection:
    """What the paper takes of one leg: one pixel per position along it.

    Attributes
    ----------
    rows : array of float, shape (k,)
        Row of the point on the projected leg, px; whole where the leg runs on centres.
    cols : array of float, shape (k,)
        Column of that point, px.
    arrival_ps : array of float, shape (k,)
        Arrival time; interpolated where the pixel was bad, ps.
    interpolated : array of bool, shape (k,)
        True where the neighbours had to stand in.
    photons : array of float, shape (k,)
        Counts in the pulse.
    modes_ps : array of float, shape (k, j)
        One-sigma columns of the clock errors that all pixels share, ps.
    """

    rows: Floats
    cols: Floats
    arrival_ps: Floats
    interpolated: NDArray[np.bool_]
    photons: Floats
    modes_ps: Floats


def projection_of_leg(leg: ImageLeg, sighting: Sighting, camera: Camera) -> Projection:
    """One good pixel per position along a leg, the brightest; gaps are interpolated.

    Parameters
    ----------
    leg : ImageLeg
        The leg as found in the picture.
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    camera : Camera
        The camera that sees it.

    Returns
    -------
    Projection
        One entry per column of the picture (row, for a steep leg).
    """
    arrivals = sighting.arrivals
    members = leg.members[arrivals.photons[leg.members] > 0]
    points = undistorted_px(camera, arrivals.row[members], arrivals.col[members])
    photons = arrivals.photons[members]
    steep = abs(leg.direction_px[1]) > abs(leg.direction_px[0])
    position = (arrivals.row if steep else arrivals.col)[members].astype(int)
    first, k = int(position.min()), int(np.ptp(position)) + 1
    origin, direction = _line_through_centroids(leg, sighting, camera, steep=steep)
    at = np.full(k, -1)
    # The brightest of a position is written last and stays.
    for i in np.argsort(photons):
        at[position[i] - first] = i
    brightest = np.where(at >= 0, photons[np.maximum(at, 0)], 0.0)
    # Far in the wings of a neighbour's spot a position holds light, but not its own.
    bad = (at < 0) | (brightest < 0.05 * np.median(brightest[at >= 0]))
    good = np.flatnonzero(~bad)
    along, times = np.empty(k), np.empty(k)
    along[good] = (points[at[good]] - origin) @ direction
    times[good] = sighting.arrival_ps[members[at[good]]]
    modes = np.empty((k, arrivals.shared_modes_ps.shape[1]))
    modes[good] = arrivals.shared_modes_ps[members[at[good]]]
    for values in (along, times, *modes.T):
        values[bad] = np.interp(np.flatnonzero(bad), good, values[good])
    order = np.argsort(along)
    on_line = origin + along[order, np.newaxis] * direction
    rows, cols = pixels_of_undistorted(camera, on_line)
    return Projection(rows, cols, times[order], bad[order], brightest[order], modes[order])


def _line_through_centroids(
    leg: ImageLeg, sighting: Sighting, camera: Camera, *, steep: bool
) -> tuple[Floats, Floats]:
    """(origin, unit direction) of the line through the light's centres of mass, px."""
    light = _filled_light(leg, sighting, steep=steep)
    rows, cols = np.nonzero(light > 0)
    points = undistorted_px(camera, rows, cols)
    offset = points - leg.origin_px
    across = offset[:, 0] * leg.direction_px[1] - offset[:, 1] * leg.direction_px[0]
    near = np.abs(across) < PAPER_REACH_PX
    rows, cols, points = rows[near], cols[near], points[near]
    photons, position = light[rows, cols], rows if steep else cols
    total = np.bincount(position, photons)
    lit = total > 0.05 * np.median(total[total > 0])
    centroid = np.column_stack(
        [np.bincount(position, photons * points[:, axis])[lit] / total[lit] for axis in (0, 1)]
    )
    origin = centroid.mean(axis=0)
    direction = np.linalg.svd(centroid - origin, full_matrices=False)[2][0]
    return origin, direction if direction @ leg.direction_px > 0 else -direction


def _filled_light(leg: ImageLeg, sighting: Sighting, *, steep: bool) -> Floats:
    """(rows, cols), photons of one leg; bad pixels hold the mean of their neighbours along it."""
    arrivals = sighting.arrivals
    light = np.zeros(arrivals.shape)
    light[arrivals.row[leg.members], arrivals.col[leg.members]] = arrivals.photons[leg.members]
    bad = sighting.blind.copy()
    spoiled = (arrivals.flags & np.uint32(flags.EXCLUDING & ~_DARK)) != 0
    bad[arrivals.row[spoiled], arrivals.col[spoiled]] = True
    axis = 0 if steep else 1
    known = np.pad(np.where(bad, np.nan, light), 1, constant_values=np.nan)
    beside = [np.roll(known, side, axis)[1:-1, 1:-1] for side in (1, -1)]
    count = sum(np.isfinite(value).astype(float) for value in beside)
    mean = sum(np.nan_to_num(value) for value in beside) / np.maximum(count, 1.0)
    filled: Floats = np.where(bad, mean, light)
    return filled


def averaged(seen: Projection, sightings: list[Sighting]) -> Projection:
    """Arrival times averaged over repeats, pixel by pixel.

    Parameters
    ----------
    seen : Projection
        Of the first recording.
    sightings : list of Sighting
        All recordings of the flight.

    Returns
    -------
    Projection
        The same points.
    """
    if len(sightings) == 1:
        return seen
    stacks = [seen.arrival_ps]
    for sighting in sightings[1:]:
        image = np.full(sighting.arrivals.shape, np.nan)
        arrivals = sighting.arrivals
        usable = flags.is_usable(arrivals.flags)
        image[arrivals.row[usable], arrivals.col[usable]] = sighting.arrival_ps[usable]
        rows, cols = np.rint(seen.rows).astype(int), np.rint(seen.cols).astype(int)
        times = image[rows, cols]
        # 100 ps off is another pulse, or another leg's.
        wrong = ~np.isfinite(times) | (np.abs(times - seen.arrival_ps) > 100.0)
        stacks.append(np.where(wrong | seen.interpolated, seen.arrival_ps, times))
    return replace(seen, arrival_ps=np.mean(stacks, axis=0))
