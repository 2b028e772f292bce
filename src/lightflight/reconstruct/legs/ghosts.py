"""Light that is not the flight's: what a pulse on one path cannot do, a ghost does.

Light of one flight reaches the camera in the order in which it was scattered, so at any one
arrival time it comes from one place. A pulse in a pixel far from there at the same time, and
dimmer, is a reflection, a reconstruction's ghost or a neighbour's stray light. Light all about, at
once in many places, is that of a wall or a fog which the flight lights up.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_ELSEWHERE_PX = 5.0
"""Two pixels farther apart than this do not share one spot, px."""
_TOGETHER_STD = 1.0
"""Pulses nearer in time than this many pulse widths come from one moment."""
_DIM = 0.125
"""A pulse weaker than this share of another at the same moment elsewhere is a ghost's."""
_ABOUT_PX = (3.5, 6.5)
"""About a leg, this far from it, are pixels without light of its own, but for those along it."""
_ALIKE = 0.5
"""A pulse at least this share as strong as another is like it."""
_FILLED = 0.6
"""More than this share of the pixels about a pulse hold one like it on a surface: a leg lights a
quarter of them, two that cross a half."""
_LEAST_PHOTONS = 20.0
"""Dimmer pulses may be chance, which fills a picture as well, and hides no leg that is as dim."""
_AT_ONCE = 12
"""More such pulses than this come from elsewhere at the same moment: passes of a cavity fill a
picture too, but light is in one of them at a time."""
_BESIDE_PX, _BESIDE_STDS, _FEW = 8.0, 3.0, 3
"""Near so many of these, px and pulse widths, others are of the surface: where it ends few come at
once."""
_BLOCK_PULSES = 512
"""Pulses compared with their rivals at once, so that the table of pairs stays small."""


def overshone(points: Floats, times: Floats, photons: Floats, std_ps: float) -> NDArray[np.bool_]:
    """True for pulses that far brighter light elsewhere shows to be no part of the flight.

    Parameters
    ----------
    points : array of float, shape (n, 2)
        Picture, px.
    times : array of float, shape (n,)
        Arrival times, ps (or codes).
    photons : array of float, shape (n,)
        Strength of the pulses.
    std_ps : float
        Typical standard deviation of the pulses, ps (or codes).
    """
    ghost = np.zeros(len(times), dtype=bool)
    for own, others, elsewhere in _at_one_moment(points, times, std_ps):
        rivals = np.where(elsewhere, photons[others], 0.0)
        # Only a far brighter rival counts: of two alike neither is known to be the ghost.
        ghost[own] = photons[own] < _DIM * rivals.max(axis=1, initial=0.0)
    return ghost


def _at_one_moment(
    points: Floats, times: Floats, std_ps: float
) -> Iterator[tuple[Indices, Indices, NDArray[np.bool_]]]:
    """Pulses (n,) block by block, others (k,) of about their time, and which come from elsewhere.

    The last is (n, k): True where the other comes at the moment of the one, far from it.
    """
    # Sorted, rivals of one moment stand in one run, and blocks see only their own.
    order = np.argsort(times, kind="stable")
    p, t = points[order], times[order]
    reach = _TOGETHER_STD * std_ps
    first = np.searchsorted(t, t - reach, side="left")
    last = np.searchsorted(t, t + reach, side="right")
    for start in range(0, len(t), _BLOCK_PULSES):
        stop = min(start + _BLOCK_PULSES, len(t))
        low, high = int(first[start]), int(last[stop - 1])
        gap = np.hypot(
            p[start:stop, np.newaxis, 0] - p[np.newaxis, low:high, 0],
            p[start:stop, np.newaxis, 1] - p[np.newaxis, low:high, 1],
        )
        together = np.abs(t[start:stop, np.newaxis] - t[np.newaxis, low:high]) < reach
        yield order[start:stop], order[low:high], together & (gap > _ELSEWHERE_PX)


def on_surfaces(
    row: NDArray[np.int32],
    col: NDArray[np.int32],
    shape: tuple[int, int],
    times: Floats,
    photons: Floats,
    std_ps: float,
) -> NDArray[np.bool_]:
    """True for pulses of a wall or a fog that lights up all about.

    Parameters
    ----------
    row, col : array of int, shape (n,)
        Pixels.
    shape : (int, int)
        Of the picture.
    times : array of float, shape (n,)
        Arrival times, ps (or codes).
    photons : array of float, shape (n,)
        Strength of the pulses.
    std_ps : float
        Typical standard deviation of the pulses, ps (or codes).
    """
    surface = np.zeros(len(times), dtype=bool)
    if min(shape) < 2.0 * _ABOUT_PX[0]:
        # In a row of pixels, too, a leg fills those about it.
        return surface
    filled = np.flatnonzero(_share_alike_about(row, col, shape, photons) > _FILLED)
    if len(filled) <= _AT_ONCE:
        return surface
    places, strong = np.column_stack((row, col))[filled].astype(np.float64), photons[filled]
    at_once = _alike_elsewhere(places, times[filled], strong, std_ps) > _AT_ONCE
    at_once &= strong > _LEAST_PHOTONS
    if at_once.any():
        near = [_BESIDE_PX, _BESIDE_PX, _BESIDE_STDS * std_ps]
        where = np.column_stack((places, times[filled])) / near
        beside = cKDTree(where[at_once]).query_ball_point(where, 1.0, return_length=True)
        surface[filled] = at_once | (beside >= _FEW)
    return surface


def _share_alike_about(
    row: NDArray[np.int32], col: NDArray[np.int32], shape: tuple[int, int], photons: Floats
) -> Floats:
    """(n,), of the pixels about each pulse that the picture has, how many hold one like it."""
    brightest = np.zeros(shape)
    np.maximum.at(brightest, (row, col), photons)
    reach = int(_ABOUT_PX[1])
    aside = np.stack(np.meshgrid(*2 * [np.arange(-reach, reach + 1)], indexing="ij"), axis=-1)
    away = np.hypot(*aside.reshape(-1, 2).T)
    about = aside.reshape(-1, 2)[(away >= _ABOUT_PX[0]) & (away < _ABOUT_PX[1])]
    seen, alike = np.zeros((2, len(row)))
    for down, across in about:
        r, c = row + down, col + across
        inside = (r >= 0) & (r < shape[0]) & (c >= 0) & (c < shape[1])
        seen += inside
        alike[inside] += brightest[r[inside], c[inside]] >= _ALIKE * photons[inside]
    return alike / np.maximum(seen, 1.0)


def _alike_elsewhere(
    places: Floats, times: Floats, photons: Floats, std_ps: float
) -> NDArray[np.intp]:
    """(n,), how many pulses like each come at the same moment from elsewhere."""
    number = np.zeros(len(times), dtype=np.intp)
    for own, others, elsewhere in _at_one_moment(places, times, std_ps):
        alike = photons[others] >= _ALIKE * photons[own, np.newaxis]
        number[own] = np.count_nonzero(alike & elsewhere, axis=1)
    return number


def on_border(
    row: NDArray[np.int32], col: NDArray[np.int32], shape: tuple[int, int]
) -> NDArray[np.bool_]:
    """True for the two outermost rows and columns; a computed cube piles up there what is left."""
    edge: NDArray[np.int32] = np.minimum(
        np.minimum(row, shape[0] - 1 - row), np.minimum(col, shape[1] - 1 - col)
    )
    outermost: NDArray[np.bool_] = edge < 2
    return outermost
