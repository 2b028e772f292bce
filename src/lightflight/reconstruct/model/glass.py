"""Blocks of glass in the beam, as a fit sees them: where a path crosses, and who looks at them.

What light scatters within glass comes out bent, and what is seen through a block is bent as well:
neither is modelled, so that pixels that look at a block take no part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from lightflight.blocks import Block
from lightflight.errors import GeometryError
from lightflight.path.glass import Faced, way_on_to, with_faces
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.leg_in_picture import pixels_lit_from

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_SPOT_PX = 1.5
"""Pixels this near to the image of a block take no part, px: four stds of a usual spot."""
_PLACES = 401
"""At which a leg is asked whether a picture shows it."""
_LEAST_PX = 4.0
"""A piece of a leg of which a picture shows less, px, says nothing of its own."""


def through_blocks(
    state: PathState, blocks: Sequence[Block], cameras: Sequence[Camera]
) -> PathState:
    """The path with vertices on the faces of every block that it crosses.

    Parameters
    ----------
    state : PathState
        The path; vertices on faces may be among its own already.
    blocks : sequence of Block
        Those of the medium.
    cameras : sequence of Camera
        Whose pictures count.

    Returns
    -------
    PathState
        The same where there are no blocks.

    Raises
    ------
    GeometryError
        Where a vertex lies within glass, or the path is no chain of straight legs.
    """
    if not blocks:
        return state
    if state.forks or state.bends or state.unseen:
        raise GeometryError(
            "a path through blocks of glass is a chain of straight legs, all seen: leave out the "
            "blocks, or the arms, bends and detours"
        )
    return faced(state, with_faces(state.vertices_mm, blocks), cameras)


def faced(state: PathState, chain: Faced, cameras: Sequence[Camera]) -> PathState:
    """The path on a chain with faces; legs that no picture shows, but for a tip, are dark.

    Parameters
    ----------
    state : PathState
        The path.
    chain : Faced
        Its vertices, with those on faces.
    cameras : sequence of Camera
        Whose pictures count.

    Returns
    -------
    PathState
    """
    state = replace(state, vertices_mm=chain.vertices_mm, glass=chain.glass)
    return with_dark_pieces(state, cameras)


def with_dark_pieces(state: PathState, cameras: Sequence[Camera]) -> PathState:
    """The path, of which the pieces beside glass that no picture shows, but for a tip, are dark.

    Parameters
    ----------
    state : PathState
        The path, with vertices on faces; as it is where it has none.
    cameras : sequence of Camera
        Whose pictures count.

    Returns
    -------
    PathState
    """
    if not state.glass:
        return state
    blocks = [block for _, block in state.glass]
    hidden = [looks_at_blocks(camera, blocks) for camera in cameras]
    dark = {leg for leg, _ in state.glass}
    for leg in beside_glass(state):
        ends = state.vertices_mm[leg : leg + 2]
        shown = (_shown_px(ends, camera, own) for camera, own in zip(cameras, hidden, strict=True))
        if max(shown) < _LEAST_PX:
            dark.add(leg)
    return replace(state, dark=tuple(sorted(dark)))


def beside_glass(state: PathState) -> tuple[int, ...]:
    """Legs in air next to one within glass, ascending: what is seen of one may be too little."""
    glass = {leg for leg, _ in state.glass}
    near = {leg + side for leg in glass for side in (-1, 1)} - glass
    return tuple(sorted(near & set(range(state.n_legs))))


def lit_by_short_pieces(
    state: PathState, blocks: Sequence[Block], camera: Camera
) -> NDArray[np.bool_]:
    """Pixels that hold light of a flight through glass which no leg of the fit accounts for.

    Parameters
    ----------
    state : PathState
        The path as fitted, with vertices on faces.
    blocks : sequence of Block
        Those of the medium.
    camera : Camera
        Whose picture it is.

    Returns
    -------
    array of bool, shape (rows, cols)
        True near a piece beside glass that the picture shows too little of to be fitted, and, where
        a block stands beyond the path's last vertex, near the line on which its light goes on.
    """
    glass = {leg for leg, _ in state.glass}
    short = [leg for leg in state.dark if leg not in glass]
    lines = [state.vertices_mm[leg : leg + 2] for leg in short]
    lines += [line for block in blocks if (line := way_on_to(state.vertices_mm, block)) is not None]
    share = np.linspace(0.0, 1.0, _PLACES)[:, np.newaxis]
    lit = np.zeros(camera.shape, dtype=bool)
    for line in lines:
        lit |= pixels_lit_from(line[0] + share * (line[1] - line[0]), camera)
    return lit


def _shown_px(ends_mm: Floats, camera: Camera, hidden: NDArray[np.bool_]) -> float:
    """Length of a leg in the picture, without what pixels that are hidden see; px."""
    share = np.linspace(0.0, 1.0, _PLACES)[:, np.newaxis]
    places = ends_mm[0] + share * (ends_mm[1] - ends_mm[0])
    image = np.column_stack(camera.pixels_from_points(places))
    seen = camera.sees(places)
    pixel = np.clip(np.rint(np.nan_to_num(image)), 0, np.array(camera.shape) - 1).astype(int)
    seen &= ~hidden[pixel[:, 0], pixel[:, 1]]
    steps = np.linalg.norm(np.diff(image, axis=0), axis=1)
    return float(np.sum(steps[seen[1:] & seen[:-1]]))


def looks_at_blocks(camera: Camera, blocks: Sequence[Block]) -> NDArray[np.bool_]:
    """Pixels whose spot may hold light that comes out of, or through, a block.

    Parameters
    ----------
    camera : Camera
        Any.
    blocks : sequence of Block
        Those of the medium.

    Returns
    -------
    array of bool, shape (rows, cols)
        True for pixels that are to take no part.
    """
    pixels = np.moveaxis(np.indices(camera.shape, dtype=float), 0, -1)
    found = np.zeros(camera.shape, dtype=bool)
    for block in blocks:
        outline = np.column_stack(camera.pixels_from_points(block.rim_mm()))
        outline = outline[np.isfinite(outline).all(axis=1)]
        try:
            sides = ConvexHull(outline).equations
        except (QhullError, ValueError):  # behind the camera, or seen from within its plane
            continue
        beyond = pixels @ sides[:, :2].T + sides[:, 2]
        found |= beyond.max(axis=-1) < _SPOT_PX
    return found
