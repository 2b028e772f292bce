"""Legs in the picture on both sides of blocks of glass: pieces of one straight leg of the flight.

The picture shows a leg that crosses glass in pieces, each later than the one before it lets expect.
Told what stands there, the first path is found from all pieces as if it stood not there, and then
bent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.blocks import Block
from lightflight.errors import NothingFoundError
from lightflight.path.glass import in_order, out_of, with_faces_on
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.glass import faced
from lightflight.reconstruct.model.image_plane import along_across, undistorted_px

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.timing.pulses.arrivals import Arrivals

Floats = NDArray[np.float64]

_SPOT_PX = 1.5
"""A leg whose line passes a block's image by no more than this may cross it, px."""
_ASIDE_PX = 2.5
"""Two pieces on one line are not farther aside, px: glass moves light by less."""
_SAME_WAY = 0.9
"""Cosine between two pieces of one leg, of which one may be short."""
_LEAST_PIXELS = 4
"""A piece of fewer pixels says nothing of its own."""
_ROUGHLY = 3.0
"""How many times as wide as told a block is taken for, while the path is rough."""
_HIDDEN = (
    "pixels that look at the block of glass hide all but a few of the leg that crosses it: tell no "
    "larger diameter_mm than it has, or look from elsewhere"
)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Legs of the flight as the picture shows them.

    Attributes
    ----------
    shown : tuple of tuple of (ImageLeg or None)
        Of each leg of the flight its pieces, in the order of flight; None: too few pulses.
    between : tuple of tuple of Block
        Of each leg of the flight the blocks between its pieces.
    elsewhere : tuple of Block
        Blocks that stand on no leg in the picture.
    """

    shown: tuple[tuple[ImageLeg | None, ...], ...]
    between: tuple[tuple[Block, ...], ...]
    elsewhere: tuple[Block, ...]

    def through_glass(
        self, state: PathState, cameras: Sequence[Camera]
    ) -> tuple[PathState, tuple[ImageLeg, ...]]:
        """A first path with vertices on faces, and the piece that shows each leg that is seen.

        Blocks that no leg of it crosses are left out: light may meet them where no picture shows it
        any more, and only the fit tells for sure. Raises GeometryError where both vertices lie on
        one side of a block between pieces, NothingFoundError where no leg has a piece to fit.
        """
        state = _through_last_blocks(state, (*self.between[-1], *self.elsewhere), cameras)
        ends = list(pairwise(state.vertices_mm))
        crossed: list[list[Block]] = [[] for _ in ends]
        shown_on = [(k, block) for k, blocks in enumerate(self.between) for block in blocks]
        for shown, block in [*shown_on, *((None, block) for block in self.elsewhere)]:
            leg = _crossing(ends, block, shown)
            if leg is not None:
                crossed[leg].append(block)
        met = [in_order(own, end - start) for own, (start, end) in zip(crossed, ends, strict=True)]
        chain = with_faces_on(state.vertices_mm, met)
        state = faced(state, chain, cameras)
        legs, dark, glass = [], set(state.dark), dict(chain.glass)
        for leg, flown in enumerate(chain.of_leg):
            if leg in dark:
                continue
            before = [b for k, b in glass.items() if k < leg and chain.of_leg[k] == flown]
            piece = self._piece(flown, before, crossed[flown])
            if piece is None:
                dark.add(leg)
            else:
                legs.append(piece)
        if not legs:
            raise NothingFoundError(_HIDDEN)
        return replace(state, dark=tuple(sorted(dark))), tuple(legs)

    def _piece(
        self, flown: int, before: Sequence[Block], crossed: Sequence[Block]
    ) -> ImageLeg | None:
        """What shows a leg of the flight behind some of the blocks that it crosses."""
        own = self.between[flown]
        if all(block in crossed for block in own):
            return self.shown[flown][sum(block in own for block in before)]
        # It was cut at a block that stands in another leg: the most of it will do.
        pieces = [piece for piece in self.shown[flown] if piece is not None]
        return max(pieces, key=lambda piece: piece.n_pixels, default=None)


def _crossing(ends: Sequence[tuple[Floats, Floats]], block: Block, shown: int | None) -> int | None:
    """The leg that crosses a block; `shown`: on which the picture shows it, None: on none.

    Where legs meet at a mirror several pass a block's image, and several pass it in space within
    what a rough path is worth: one goes through its middle.
    """
    if shown is not None and block.is_between(*ends[shown]):
        return shown
    wide = _wide(block)
    near = [k for k, two in enumerate(ends) if wide.is_between(*two)]
    return min(near, key=lambda k: block.aside_mm(*ends[k])) if near else shown


def _wide(block: Block) -> Block:
    """The block, as wide as it is taken for while the path is rough."""
    return replace(block, diameter_mm=_ROUGHLY * block.diameter_mm)


def _through_last_blocks(
    state: PathState, blocks: Sequence[Block], cameras: Sequence[Camera]
) -> PathState:
    """The path, its last vertex beyond blocks out of which a picture shows its last leg come.

    Of what comes out there may be too few pulses to belong to any leg in the picture.
    """
    for block in blocks:
        out = out_of(state.vertices_mm[-2:], _wide(block))
        if out is not None and any(camera.sees(out) for camera in cameras):
            state = replace(state, vertices_mm=np.vstack((state.vertices_mm[:-1], out)))
    return state


def pieces_of(
    legs: Sequence[ImageLeg], blocks: Sequence[Block], camera: Camera, arrivals: Arrivals
) -> Pieces:
    """Legs in the picture, those on one line with a block taken as one leg and cut at it.

    Parameters
    ----------
    legs : sequence of ImageLeg
        As found in the picture, in the order of flight.
    blocks : sequence of Block
        Those of the medium.
    camera : Camera
        Whose picture it is.
    arrivals : Arrivals
        The table of pulses that the legs' members are rows of, on one lap of the clock.

    Returns
    -------
    Pieces
        Each block on the line that passes nearest to its middle.

    Raises
    ------
    NothingFoundError
        Where a line that a block parts has no piece of its own.
    """
    lines = _lines(legs)
    on_line: list[list[tuple[float, Block]]] = [[] for _ in lines]
    elsewhere = []
    for block in blocks:
        image, radius = _image(block, camera)
        aside = [_along_line(line, image, radius) for line in lines]
        best = int(np.argmin([off for _, off in aside]))
        if np.isfinite(aside[best][1]):
            on_line[best].append((aside[best][0], block))
        else:
            elsewhere.append(block)
    shown: list[tuple[ImageLeg | None, ...]] = []
    between: list[tuple[Block, ...]] = []
    for line, met in zip(lines, on_line, strict=True):
        if not met:
            # Legs on one line that no block parts are as they were found.
            shown += [(leg,) for leg in line]
            between += [()] * len(line)
            continue
        met.sort(key=lambda one: one[0])
        parts = _parted(line, [at for at, _ in met], camera, arrivals)
        if not any(parts):
            raise NothingFoundError(_HIDDEN)
        shown.append(parts)
        between.append(tuple(block for _, block in met))
    return Pieces(tuple(shown), tuple(between), tuple(elsewhere))


def _lines(legs: Sequence[ImageLeg]) -> list[list[ImageLeg]]:
    """Legs that follow each other on one line, the same way, together."""
    lines = [[legs[0]]]
    for before, leg in pairwise(legs):
        aside = along_across(leg.origin_px[np.newaxis], before.origin_px, before.direction_px)[1]
        same_way = before.direction_px @ leg.direction_px > _SAME_WAY
        if same_way and abs(float(aside[0])) < _ASIDE_PX:
            lines[-1].append(leg)
        else:
            lines.append([leg])
    return lines


def _image(block: Block, camera: Camera) -> tuple[Floats, float]:
    """Middle (1, 2) of a block's image, undistorted (u, v), and its radius; px."""
    places = np.vstack((np.asarray(block.center_mm), block.rim_mm()))
    image = undistorted_px(camera, *camera.pixels_from_points(places))
    return image[:1], float(np.linalg.norm(image[1:] - image[0], axis=1).max())


def _longest(line: Sequence[ImageLeg]) -> ImageLeg:
    """The leg that says best where a line runs."""
    return max(line, key=lambda leg: leg.n_pixels)


def _along_line(line: Sequence[ImageLeg], image: Floats, radius: float) -> tuple[float, float]:
    """Where on a line a block's image (1, 2) lies, and how far aside, px; inf: not on it."""
    longest = _longest(line)
    along, aside = along_across(image, longest.origin_px, longest.direction_px)
    ends = np.concatenate([leg.points_px(np.array(leg.extent_px)) for leg in line])
    reach, _ = along_across(ends, longest.origin_px, longest.direction_px)
    off = abs(float(aside[0]))
    on_it = reach.min() < along[0] < reach.max() and off < radius + _SPOT_PX
    return float(along[0]), off if on_it else np.inf


def _parted(
    line: Sequence[ImageLeg], cuts_px: list[float], camera: Camera, arrivals: Arrivals
) -> tuple[ImageLeg | None, ...]:
    """Pieces of a line, each with its own pulses and their times.

    A leg as it was found may go on a little beyond glass, where its light is late: what belongs to
    which piece is told by place alone.
    """
    longest = _longest(line)
    members = np.unique(np.concatenate([leg.members for leg in line]))
    pixels = np.column_stack((arrivals.row[members], arrivals.col[members]))
    along, _ = along_across(
        undistorted_px(camera, *pixels.T), longest.origin_px, longest.direction_px
    )
    found: list[ImageLeg | None] = []
    for first, last in pairwise([-np.inf, *cuts_px, np.inf]):
        own = np.flatnonzero((along > first) & (along < last))
        n_pixels = len(np.unique(pixels[own], axis=0))
        if n_pixels < _LEAST_PIXELS or np.ptp(along[own]) < 2.0:
            found.append(None)
            continue
        times = arrivals.arrival_ps[members[own]]
        curve = np.polynomial.Polynomial.fit(along[own], times, 2 if n_pixels > 6 else 1)
        found.append(
            replace(
                longest,
                members=members[own],
                extent_px=(float(along[own].min()), float(along[own].max())),
                time_coefficients=np.asarray(curve.convert().coef, dtype=float),
                n_pixels=n_pixels,
            )
        )
    return tuple(found)
