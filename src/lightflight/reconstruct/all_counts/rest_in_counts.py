"""Light more uneven than splines: the rest that pulses of a joint fit showed, in the counts.

How strong it is, and over how much of a leg it is alike, the pulses say; how it runs along the leg
the counts find with all else. What is alike over the root of two spots once it is seen through one
is without any scale before: noise of the light, cell by cell. A pixel sees the cells of its
footprint; where a leg begins or ends it sees fewer, and its light is the less certain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from lightflight.flight import Medium
from lightflight.reconstruct.model.footing import corner_distances
from lightflight.reconstruct.model.forward import LightModes, Pixels
from lightflight.reconstruct.model.geometry import PathState, footprints
from lightflight.reconstruct.model.unknowns import Light

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.reconstruct.fit.uneven import RestAlong

Floats = NDArray[np.float64]

_CELL_SPOTS = 0.2
"""Length of a cell, in standard deviations of the spot: light and slopes vary as they should to
0.5 %; of a half longer one to 1.1 %."""
_REACH_SPOTS = 4.0
"""Of a footprint."""
_LEAST_LIT = 1e-6
"""Share of a footprint below which it is dark."""
_LEAST_SHARE = 1e-2
"""Of the largest mode: smaller ones are left out."""


def with_rest_of_light(
    pixels: Pixels,
    rests: Sequence[RestAlong],
    light: Light,
    state: PathState,
    camera: Camera,
    medium: Medium,
) -> Pixels:
    """Pixels of one camera with what its legs may be uneven by.

    Parameters
    ----------
    pixels : Pixels
    rests : sequence of RestAlong
        Of that camera.
    light : Light
        Spot, and whether the light begins and stops at the ends of the path.
    state : PathState
        The path, whose corners cut footprints.
    camera : Camera
    medium : Medium

    Returns
    -------
    Pixels
        With the modes of it.
    """
    both = []
    for leg in {one.leg for one in rests}:
        here = np.flatnonzero(pixels.near[:, leg])
        prints = footprints(
            state, camera=camera, medium=medium, legs=leg, rows=pixels.rows[here],
            cols=pixels.cols[here],
        )  # fmt: skip
        corners = corner_distances(state, prints, leg, camera=camera, cut_ends=light.cut_ends)
        spot = np.full(len(here), np.exp(light.log_spot_px))
        if light.spots:
            drawn, _ = light.lines[leg].along_across(pixels.points_px[here])
            spot *= np.exp(light.spots[leg].log_at(drawn))
        lit = corners.before, corners.after
        own = [one for one in rests if one.leg == leg]
        along, _ = own[0].line.along_across(pixels.points_px[here])
        ln, late_px, wider_px2 = modes_of_rest(own, along, spot, lit)
        slope = prints.slope_ps_per_px[:, np.newaxis]
        placed = np.zeros((3, *pixels.near.shape, ln.shape[1]))
        placed[:, here, leg] = ln, slope * late_px, slope**2 * wider_px2
        both.append(placed)
    return replace(pixels, uneven=LightModes(*np.concatenate(both, axis=3)))


def modes_of_rest(
    rests: Sequence[RestAlong], along_px: Floats, spot_px: Floats, lit_px: tuple[Floats, Floats]
) -> tuple[Floats, Floats, Floats]:
    """What the rest along a leg may do to n pixels, one standard deviation a column.

    Parameters
    ----------
    rests : sequence of RestAlong
        Stretches of the leg.
    along_px : array of float, shape (n,)
        Feet of the pixels on its line.
    spot_px : array of float, shape (n,)
        Standard deviation of the spot there.
    lit_px : (array of float, array of float), shape (n,) each
        Where the leg begins and stops, from those feet.

    Returns
    -------
    ln : array of float, shape (n, k)
        Log of the light.
    late_px : array of float, shape (n, k)
        By how much further along the leg its middle is.
    """
    reach, cell = _REACH_SPOTS * spot_px.max(), _CELL_SPOTS * float(np.median(spot_px))
    edges = np.arange(along_px.min() - reach, along_px.max() + reach + cell, cell)
    ends = np.clip(edges - along_px[:, np.newaxis], *(end[:, np.newaxis] for end in lit_px))
    ends = ends / spot_px[:, np.newaxis]
    share = np.diff(ndtr(ends), axis=1)
    whole = share.sum(axis=1, keepdims=True)
    share = np.divide(share, whole, where=whole > _LEAST_LIT, out=np.zeros_like(share))
    height = np.exp(-0.5 * ends**2) / np.sqrt(2.0 * np.pi)
    lit = whole > _LEAST_LIT
    first = np.divide(-np.diff(height, axis=1), whole, where=lit, out=np.zeros_like(share))
    # s² G has the integral of G less s G.
    edge = np.divide(np.diff(ends * height, axis=1), whole, where=lit, out=np.zeros_like(share))
    middle = first.sum(axis=1, keepdims=True)
    off2 = share - edge - 2.0 * middle * first + middle**2 * share
    late, wider = first - middle * share, off2 - off2.sum(axis=1, keepdims=True) * share
    noise = _noise_of_cells(rests, 0.5 * (edges[1:] + edges[:-1]))
    noise /= np.sqrt(cell)
    # Lengths in spots: both count alike.
    _, sizes, to_cells = np.linalg.svd(np.vstack((share, late, wider)) * noise, full_matrices=False)
    to_cells = (to_cells * noise)[sizes > _LEAST_SHARE * sizes[0]].T
    spot = spot_px[:, np.newaxis]
    return share @ to_cells, spot * (late @ to_cells), spot**2 * (wider @ to_cells)


def _noise_of_cells(rests: Sequence[RestAlong], middles_px: Floats) -> Floats:
    """(c,), noise of the light at places of a leg, times the root of the length it is a mean of."""
    centres = np.array([0.5 * sum(one.span_px) for one in rests])
    nearest = np.abs(middles_px[:, np.newaxis] - centres).argmin(axis=1)
    density = np.empty(len(middles_px))
    for n, one in enumerate(rests):
        own = nearest == n
        # Noise of density S has a variance of S / (2 sqrt(pi) spot) through a Gaussian.
        spot = one.rest.alike_px / np.sqrt(2.0)
        density[own] = 2.0 * np.sqrt(np.pi) * spot * one.rest.variance(middles_px[own])
    return np.sqrt(density)
