"""A leg cut where it is several: at a kink of its arrival times, on a bend in the picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.legs.curves import kink_place
from lightflight.reconstruct.legs.search import (
    SearchSettings,
    bends_down,
    distinct_positions,
    fitted_line,
    time_tolerance,
)
from lightflight.reconstruct.model.image_plane import along_across

Indices = NDArray[np.int64]

Floats = NDArray[np.float64]

_SAGITTA_PX = 0.5
"""Light that runs this far off its chord is on a bend, px."""


def cut_at_kink(
    points: Floats,
    times: Floats,
    errors: Floats,
    weights: Floats,
    members: Indices,
    settings: SearchSettings,
) -> list[Indices]:
    """Members as one leg, or as two where their arrival curve has the kink of a corner.

    Legs that follow one another along one line of the picture are found as one; where their
    slopes fall at the corner, no straight leg can be behind them.

    Parameters
    ----------
    points : array of float, shape (n, 2)
        Undistorted (u, v) in the picture, px.
    times : array of float, shape (n,)
        Arrival times, ps.
    errors : array of float, shape (n,)
        One-sigma errors of the times, ps.
    weights : array of float, shape (n,)
        Photons of the pulses.
    members : array of int, shape (k,)
        Rows of one leg.
    settings : SearchSettings
        Tolerances of the search.

    Returns
    -------
    list of array of int
        One or two sets of rows.
    """
    origin, direction = fitted_line(points[members], weights[members])
    s = (points[members] - origin) @ direction
    tolerance = time_tolerance(errors[members], settings)
    along = s if np.polyfit(s, times[members], 1)[0] > 0 else -s
    # Where media differ the curve may bend either way: a fall of the slope is no sign.
    if not settings.convex:
        return [members]
    if not bends_down(along, times[members], tolerance):
        return _halves_at_kink(along, times[members], errors[members], members, settings)
    order = np.argsort(along)
    positions = np.rint(along[order] - along[order[0]])
    best_cost, best_cut = np.inf, 0
    # Cut between positions, never within one: both halves keep whole pixels.
    for cut in np.flatnonzero(np.diff(positions) > 0) + 1:
        halves = order[:cut], order[cut:]
        if min(distinct_positions(along[half]) for half in halves) < settings.min_pixels:
            continue
        cost = 0.0
        for half in halves:
            line = np.polyfit(along[half], times[members][half], 1)
            cost += float(np.sum((times[members][half] - np.polyval(line, along[half])) ** 2))
        if cost < best_cost:
            best_cost, best_cut = cost, int(cut)
    if not best_cut:
        return [members]
    return [members[order[:best_cut]], members[order[best_cut:]]]


def _halves_at_kink(
    along: Floats, times: Floats, errors: Floats, members: Indices, settings: SearchSettings
) -> list[Indices]:
    """Members cut where the slope of their arrival curve jumps, beyond chance."""
    kink = kink_place(along, times, errors)
    if kink is None:
        return [members]
    halves = [members[along < kink], members[along >= kink]]
    places = (along[along < kink], along[along >= kink])
    if min(distinct_positions(place) for place in places) < settings.min_pixels:
        return [members]
    return halves


def part_where_curved(
    points: Floats, weights: Floats, members: Indices, settings: SearchSettings
) -> list[Indices]:
    """Members as one leg, or as several where their light runs on a bend in the picture.

    Judged by the centres of mass of the light, position by position: a straight leg's lie on a
    line to a small part of a pixel. A leg is cut where two lines fit best, as long as its
    middle is half a pixel off the chord.

    Parameters
    ----------
    points : array of float, shape (n, 2)
        Undistorted (u, v) in the picture, px.
    weights : array of float, shape (n,)
        Photons of the pulses.
    members : array of int, shape (k,)
        Rows of one leg.
    settings : SearchSettings
        Tolerances of the search.

    Returns
    -------
    list of array of int
        One set of rows for each straight piece.
    """
    origin, direction = fitted_line(points[members], weights[members])
    s, across = along_across(points[members], origin, direction)
    position, index = np.unique(np.rint(s), return_inverse=True)
    if len(position) < 2 * max(settings.min_pixels, 5):
        return [members]
    total = np.bincount(index, weights[members])
    # Faint positions are wings of other legs or holes; their centres wander.
    lit = total > 0.1 * np.median(total)
    place, centroid = position[lit], (np.bincount(index, weights[members] * across) / total)[lit]
    if len(place) < 2 * max(settings.min_pixels, 5):
        return [members]
    bend = np.polyfit(place, centroid, 2)
    sagitta = abs(bend[0]) * np.ptp(place) ** 2 / 8
    scatter = float(np.median(np.abs(centroid - np.polyval(bend, place))))
    # A bend must show beyond the scatter of the centroids, or straight legs would be cut.
    if sagitta < max(_SAGITTA_PX, 3.0 * scatter):
        return [members]
    # A line through fewer than five centroids fits too well to be judged.
    least = max(settings.min_pixels, 5)
    costs = [
        sum(_line_misfit(place[half], centroid[half]) for half in (slice(0, k), slice(k, None)))
        for k in range(least, len(place) - least + 1)
    ]
    # Half a position before: no pixel's centre lies on the cut.
    cut = place[least + int(np.argmin(costs))] - 0.5
    halves = members[s < cut], members[s >= cut]
    return [
        piece for half in halves for piece in part_where_curved(points, weights, half, settings)
    ]


def _line_misfit(place: Floats, centroid: Floats) -> float:
    """Sum of squares of centroids about their line, px^2."""
    line = np.polyfit(place, centroid, 1)
    return float(np.sum((centroid - np.polyval(line, place)) ** 2))
