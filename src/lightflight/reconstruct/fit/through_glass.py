"""Legs in the picture on both sides of a block of glass: one straight leg of the flight.

The picture shows two pieces of it, and behind the block light is late. Told what stands there, the
first path is found from both pieces as if it stood not there, and then bent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.blocks import Block
from lightflight.path.glass import Faced, in_order, with_faces_on
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.reconstruct.model.image_plane import along_across, undistorted_px

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.timing.pulses.arrivals import Arrivals

Floats = NDArray[np.float64]

_SPOT_PX = 1.5
"""A leg whose line passes a block's image by no more than this may cross it, px."""
_SLACK_PX = 2.5
"""By which a leg must be seen on both sides of a block's middle, px."""
_ASIDE_PX = 2.5
"""Two pieces on one line are not farther aside, px: glass moves light by less."""
_SAME_WAY = 0.9
"""Cosine between two pieces of one leg, of which one may be short."""
_ROUGHLY = 3.0
"""How many times as wide as told a block is taken for, while the path is rough."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Legs in the picture, cut at blocks, and which of them are pieces of one.

    Attributes
    ----------
    legs : tuple of ImageLeg
        In the order of flight.
    after : tuple of tuple of Block
        Of each leg, the blocks between it and the next, whose leg it then is; (): a corner.
    elsewhere : tuple of Block
        Blocks that stand on no leg in the picture.
    """

    legs: tuple[ImageLeg, ...]
    after: tuple[tuple[Block, ...], ...]
    elsewhere: tuple[Block, ...] = ()

    @property
    def groups(self) -> list[list[int]]:
        """Numbers of the pieces of each leg of the flight."""
        found: list[list[int]] = [[0]]
        for number in range(1, len(self.legs)):
            if self.after[number - 1]:
                found[-1].append(number)
            else:
                found.append([number])
        return found

    def faced(self, vertices_mm: Floats) -> Faced:
        """The chain (m, 3) of a first path with the vertices where it meets faces.

        Raises GeometryError where a block is crossed by none of its legs.
        """
        between = [[b for k in group for b in self.after[k]] for group in self.groups]
        ends = list(pairwise(vertices_mm))
        for block in self.elsewhere:
            wide = replace(block, diameter_mm=_ROUGHLY * block.diameter_mm)
            leg = next((k for k, two in enumerate(ends) if wide.is_between(*two)), 0)
            between[leg].append(block)
        met = [in_order(own, end - start) for own, (start, end) in zip(between, ends, strict=True)]
        return with_faces_on(vertices_mm, met)


def pieces_of(
    legs: Sequence[ImageLeg], blocks: Sequence[Block], camera: Camera, arrivals: Arrivals
) -> Pieces:
    """Legs in the picture with those cut that run over a block's image.

    Parameters
    ----------
    legs : sequence of ImageLeg
        As found in the picture, in the order of flight.
    blocks : sequence of Block
        Those of the medium.
    camera : Camera
        Whose picture it is.
    arrivals : Arrivals
        The table of pulses that the legs' members are rows of.

    Returns
    -------
    Pieces
        Each block on the leg whose line passes nearest to its middle.
    """
    found = Pieces(tuple(legs), ((),) * len(legs))
    for block in blocks:
        found = _with_block(found, block, camera, arrivals)
    return found


def _with_block(found: Pieces, block: Block, camera: Camera, arrivals: Arrivals) -> Pieces:
    """The pieces with a block put between two of them, or on one."""
    legs, after = list(found.legs), list(found.after)
    places = np.vstack((np.asarray(block.center_mm), block.rim_mm()))
    image = undistorted_px(camera, *camera.pixels_from_points(places))
    radius = float(np.linalg.norm(image[1:] - image[0], axis=1).max())
    where = [along_across(image[:1], leg.origin_px, leg.direction_px) for leg in legs]
    along = [float(one[0][0]) for one in where]
    aside = [abs(float(one[1][0])) for one in where]
    # The longer piece says better where its line runs; two pieces go before one that is cut.
    pairs = [k for k in range(len(legs) - 1) if _are_one(legs[k], legs[k + 1])]
    near = [
        (aside[max(k, k + 1, key=lambda j: legs[j].n_pixels)], k)
        for k in pairs
        if along[k] > legs[k].extent_px[0] + _SLACK_PX
        and along[k + 1] < legs[k + 1].extent_px[1] - _SLACK_PX
    ]
    near = [one for one in near if one[0] < radius + _SPOT_PX]
    if near:
        k = min(near)[1]
        legs[k : k + 2] = _parted(legs[k], legs[k + 1], along[k], radius, camera, arrivals)
        after[k] = (*after[k], block)
        return replace(found, legs=tuple(legs), after=tuple(after))
    alone = [
        (aside[k], k)
        for k, leg in enumerate(legs)
        if leg.extent_px[0] + _SLACK_PX < along[k] < leg.extent_px[1] - _SLACK_PX
        and aside[k] < radius + _SPOT_PX
    ]
    if not alone:
        return replace(found, elsewhere=(*found.elsewhere, block))
    k = min(alone)[1]
    legs[k : k + 1] = _parted(legs[k], legs[k], along[k], radius, camera, arrivals)
    after[k : k + 1] = [(block,), after[k]]
    return replace(found, legs=tuple(legs), after=tuple(after))


def _are_one(one: ImageLeg, other: ImageLeg) -> bool:
    """Whether two legs in the picture lie on one line and run the same way."""
    aside = along_across(other.origin_px[np.newaxis], one.origin_px, one.direction_px)[1][0]
    return bool(one.direction_px @ other.direction_px > _SAME_WAY and abs(aside) < _ASIDE_PX)


def _parted(
    one: ImageLeg,
    other: ImageLeg,
    at_px: float,
    radius_px: float,
    camera: Camera,
    arrivals: Arrivals,
) -> list[ImageLeg]:
    """The pulses of two legs, or of one, before and behind a place on the first's line.

    A leg as found may go on a little beyond glass, where its light is late.
    """
    members = np.unique(np.concatenate((one.members, other.members)))
    points = undistorted_px(camera, arrivals.row[members], arrivals.col[members])
    found = []
    for leg, sign in ((one, -1.0), (other, 1.0)):
        own = members[sign * (along_across(points, one.origin_px, one.direction_px)[0] - at_px) > 0]
        # The same place on the line of this leg.
        gap = float((one.points_px(at_px) - leg.origin_px) @ leg.direction_px)
        first, last = leg.extent_px
        room = min(radius_px, 0.25 * ((gap - first) if sign < 0 else (last - gap)))
        extent = (first, min(last, gap - room)) if sign < 0 else (max(first, gap + room), last)
        pixels = np.unique(np.column_stack((arrivals.row[own], arrivals.col[own])), axis=0)
        found.append(replace(leg, members=own, extent_px=extent, n_pixels=len(pixels)))
    return found
