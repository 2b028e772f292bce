"""Light more uneven than splines: the rest that pulses of a joint fit showed, in the counts.

How strong it is, and over how much of a leg it is alike, the pulses say; how it runs along the leg
the counts find with all else. What is alike over the root of two spots once it is seen through one
is without any scale before: noise of the light, cell by cell. A pixel sees the cells of its
footprint; where a leg begins or ends it sees fewer, and its light is the less certain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from lightflight.errors import NothingFoundError
from lightflight.flight import Medium
from lightflight.reconstruct.model.footing import corner_distances
from lightflight.reconstruct.model.forward import LightModes, Pixels
from lightflight.reconstruct.model.geometry import Indices, PathState, footprints
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
_LEAST_SHARE = 0.05
"""Of the largest mode: smaller ones are left out, of which the variance has 0.1 %."""
_BLOCK = 64
"""Cells that are made into modes at once, as many as twelve spots: a leg of any length costs as
much for its length."""
_MOST_MODES = 300
"""What all legs may take: a climb's steps cost the square of it. Of more the ends of legs are told
alone: along so much light the errors of times average out."""
_ENDS_SPOTS = 6.0
"""Light so near to an end of a leg."""


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

    Raises
    ------
    NothingFoundError
        Where the spot of a leg runs off.
    """
    told = [
        _Leg.of(leg, [one for one in rests if one.leg == leg], pixels, light, state, camera, medium)
        for leg in sorted({one.leg for one in rests})
    ]
    told = [one for one in told if len(one.here)]
    if not told:
        return pixels
    modes = [modes_of_rest(one.rests, one.along_px, one.spot_px, one.lit_px) for one in told]
    if sum(ln.shape[1] for ln, _, _ in modes) > _MOST_MODES:
        modes = [
            modes_of_rest(one.rests, one.along_px, one.spot_px, one.lit_px, ends_alone=True)
            for one in told
        ]
    both = []
    for one, (ln, late_px, wider_px2) in zip(told, modes, strict=True):
        slope = one.slope_ps_per_px[:, np.newaxis]
        placed = np.zeros((3, *pixels.near.shape, ln.shape[1]))
        placed[:, one.here, one.leg] = ln, slope * late_px, slope**2 * wider_px2
        both.append(placed)
    return replace(pixels, uneven=LightModes(*np.concatenate(both, axis=3)))


@dataclass(frozen=True, eq=False)
class _Leg:
    """A leg in the k pixels near it.

    Attributes
    ----------
    leg : int
    rests : list of RestAlong
        Its stretches.
    here : array of int, shape (k,)
        Which pixels.
    along_px, spot_px, slope_ps_per_px : array of float, shape (k,)
    lit_px : (array of float, array of float), shape (k,) each
        As `modes_of_rest` takes them.
    """

    leg: int
    rests: list[RestAlong]
    here: Indices
    along_px: Floats
    spot_px: Floats
    slope_ps_per_px: Floats
    lit_px: tuple[Floats, Floats]

    @classmethod
    def of(
        cls,
        leg: int,
        rests: list[RestAlong],
        pixels: Pixels,
        light: Light,
        state: PathState,
        camera: Camera,
        medium: Medium,
    ) -> _Leg:
        here = np.flatnonzero(pixels.near[:, leg])
        prints = footprints(
            state, camera=camera, medium=medium, legs=leg, rows=pixels.rows[here],
            cols=pixels.cols[here],
        )  # fmt: skip
        corners = corner_distances(state, prints, leg, camera=camera, cut_ends=light.cut_ends)
        points = pixels.points_px[here]
        spot = np.full(len(here), np.exp(light.log_spot_px))
        if light.spots:
            spot *= np.exp(light.spots[leg].log_at(light.lines[leg].along_across(points)[0]))
        if spot.max(initial=0.0) > max(camera.shape):
            raise NothingFoundError(
                f"too little light: the spot of leg {leg + 1} grows beyond the picture; record "
                "longer, or give a starting path (start=)"
            )
        along, _ = rests[0].line.along_across(points)
        lit = corners.before, corners.after
        return cls(leg, rests, here, along, spot, prints.slope_ps_per_px, lit)


def modes_of_rest(
    rests: Sequence[RestAlong],
    along_px: Floats,
    spot_px: Floats,
    lit_px: tuple[Floats, Floats],
    *,
    ends_alone: bool = False,
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
    ends_alone : bool, optional
        Whether light away from these is left to its spline.

    Returns
    -------
    ln : array of float, shape (n, k)
        Log of the light.
    late_px : array of float, shape (n, k)
        By how much further along the leg its middle is.
    wider_px2 : array of float, shape (n, k)
        By how much larger the variance about that is.
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
    middles = 0.5 * (edges[1:] + edges[:-1])
    noise = _noise_of_cells(rests, middles) / np.sqrt(cell)
    if ends_alone:
        noise *= _near_ends(middles, along_px, lit_px, _ENDS_SPOTS * float(np.median(spot_px)))
    # Lengths in spots: all three count alike.
    to_cells = _to_cells(np.stack((share, late, wider)) * noise) * noise[:, np.newaxis]
    spot = spot_px[:, np.newaxis]
    return share @ to_cells, spot * (late @ to_cells), spot**2 * (wider @ to_cells)


def _to_cells(effects: Floats) -> Floats:
    """(c, k), modes of c cells of unit noise, by their effects (3, n, c) on pixels."""
    n_cells = effects.shape[2]
    modes = []
    for first in range(0, n_cells, _BLOCK):
        block = slice(first, min(first + _BLOCK, n_cells))
        own = effects[:, :, block]
        own = own[:, own.any(axis=(0, 2))].reshape(-1, own.shape[2])
        _, sizes, to_cells = np.linalg.svd(own, full_matrices=False)
        placed = np.zeros((n_cells, len(sizes)))
        placed[block] = to_cells.T
        modes.append((sizes, placed))
    sizes = np.concatenate([size for size, _ in modes])
    found: Floats = np.hstack([placed for _, placed in modes])[
        :, sizes > _LEAST_SHARE * sizes.max(initial=0.0)
    ]
    return found


def _near_ends(
    places_px: Floats, along_px: Floats, lit_px: tuple[Floats, Floats], reach_px: float
) -> NDArray[np.bool_]:
    """(c,), whether places lie near to where a leg begins or stops."""
    near = np.zeros(len(places_px), dtype=bool)
    for end in lit_px:
        if np.isfinite(end).any():
            at = float(np.median((along_px + end)[np.isfinite(end)]))
            near |= np.abs(places_px - at) < reach_px
    return near


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
