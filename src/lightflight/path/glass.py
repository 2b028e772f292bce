"""Polylines that cross blocks of glass: a leg through one is three, with two vertices on its faces.

The vertices on faces are no unknowns: they follow the free vertices on both sides of the glass. The
medium knows the blocks, so that which legs are in glass follows from the vertices alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightflight.blocks import Block, places_on_faces
from lightflight.errors import GeometryError
from lightflight.path.tables import Polyline
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]

Glass = tuple[tuple[int, Block], ...]
"""(leg, block), ascending: legs of a chain that run within glass, from face to face."""

_ON_FACE_MM = 1e-6
"""A vertex this near to a face is on it."""


class Faced(NamedTuple):
    """A chain with the vertices where it meets faces put in."""

    vertices_mm: Floats
    """(m + 2k, 3), world, mm."""
    glass: Glass
    """Its legs within glass."""
    of_leg: NDArray[np.int64]
    """(m - 1 + 2k,), the leg of the chain as it was that each is a piece of."""


class Flown(NamedTuple):
    """Where light was and when, face by face."""

    vertices_mm: Floats
    """(m, 3), world, mm."""
    vertex_times_ps: Floats
    """(m,), ps."""


def flown_path(path: Polyline) -> Polyline:
    """A path with the places where its light meets faces: of a scene its `flown`, else itself."""
    flown: Polyline = getattr(path, "flown", path)
    return flown


def glass_of(vertices_mm: Floats, blocks: Sequence[Block]) -> Glass:
    """Legs of a chain that run from one face of a block to the other.

    Parameters
    ----------
    vertices_mm : array of float, shape (m, 3)
        World, mm.
    blocks : sequence of Block
        Those of the medium.

    Returns
    -------
    tuple of (int, Block)
        Ascending.
    """
    found = []
    for block in blocks:
        height, radius = block.heights_and_radii_mm(vertices_mm)
        on_face = np.abs(np.abs(height) - 0.5 * block.thickness_mm) < _ON_FACE_MM
        on_face &= radius <= block.diameter_mm
        across = on_face[:-1] & on_face[1:] & (height[:-1] * height[1:] < 0.0)
        found += [(int(leg), block) for leg in np.flatnonzero(across)]
    return tuple(sorted(found, key=lambda one: one[0]))


def with_faces(vertices_mm: Floats, blocks: Sequence[Block]) -> Faced:
    """The chain with two vertices more wherever a leg of it crosses a block.

    Parameters
    ----------
    vertices_mm : array of float, shape (m, 3)
        World, mm; vertices on faces may be among them already.
    blocks : sequence of Block
        Those of the medium.

    Returns
    -------
    Faced
        In the order of flight.

    Raises
    ------
    GeometryError
        Where a vertex lies within glass.
    """
    refuse_ends_in_glass(vertices_mm, blocks)
    # A leg that is in glass already meets its middle between its faces.
    had = {leg for leg, _ in glass_of(vertices_mm, blocks)}
    between = [
        [] if leg in had else blocks_between(vertices_mm[leg], vertices_mm[leg + 1], blocks)
        for leg in range(len(vertices_mm) - 1)
    ]
    return with_faces_on(vertices_mm, between, had=glass_of(vertices_mm, blocks))


def with_faces_on(
    vertices_mm: Floats, between: Sequence[Sequence[Block]], *, had: Glass = ()
) -> Faced:
    """The chain with two vertices more for each block that is said to stand in a leg.

    Parameters
    ----------
    vertices_mm : array of float, shape (m, 3)
        World, mm.
    between : sequence of sequence of Block
        Of each leg, the blocks that it crosses, in the order of flight.
    had : tuple of (int, Block), optional
        Legs that are in glass already.

    Returns
    -------
    Faced
        In the order of flight.

    Raises
    ------
    GeometryError
        Where a leg lies on one side of its block.
    """
    in_glass = dict(had)
    vertices, glass = [vertices_mm[:1]], []
    of_leg: list[int] = []
    for leg, blocks in enumerate(between):
        start, end = vertices_mm[leg : leg + 2]
        for block in blocks:
            height, _ = block.heights_and_radii_mm(np.stack((start, end)))
            if not (np.abs(height) >= 0.5 * block.thickness_mm).all() or height.prod() > 0.0:
                raise uncrossed(block)
            glass.append((len(of_leg) + 1, block))
            of_leg += [leg, leg]
        if leg in in_glass:
            glass.append((len(of_leg), in_glass[leg]))
        of_leg.append(leg)
        if blocks:
            vertices.append(places_on_faces(start, end, blocks).points_mm)
        vertices.append(end[np.newaxis])
    return Faced(np.concatenate(vertices), tuple(glass), np.array(of_leg, dtype=np.int64))


def blocks_between(start_mm: Floats, end_mm: Floats, blocks: Sequence[Block]) -> list[Block]:
    """Blocks that the straight way from one place to another crosses, in the order of flight."""
    crossed = [block for block in blocks if block.is_between(start_mm, end_mm)]
    return in_order(crossed, end_mm - start_mm)


def in_order(blocks: Sequence[Block], direction: Floats) -> list[Block]:
    """Blocks as light meets them that flies in a direction (3,)."""
    return sorted(blocks, key=lambda one: float(np.asarray(one.center_mm) @ direction))


def refuse_ends_in_glass(vertices_mm: Floats, blocks: Sequence[Block]) -> None:
    """Raise GeometryError where a vertex lies within a block."""
    for block in blocks:
        inside = np.flatnonzero(block.holds(vertices_mm))
        if len(inside):
            where = ", ".join(f"{x:.4g}" for x in vertices_mm[inside[0]])
            raise GeometryError(
                f"vertex {inside[0]}, at ({where}) mm, lies within a block of glass of "
                f"{block.thickness_mm:g} mm, which light enters and never leaves: a leg crosses "
                "glass from face to face; check center_mm and thickness_mm of the block"
            )


def refuse_other_crossings(vertices_mm: Floats, blocks: Sequence[Block]) -> None:
    """Refuse a path that does not cross each of the blocks in its way, from face to face.

    A block that light meets beyond the last vertex, where the picture shows it no more, is in its
    way, too, and changes nothing.

    Parameters
    ----------
    vertices_mm : array of float, shape (m, 3)
        World, mm, with those on faces.
    blocks : sequence of Block
        Those of the medium.

    Raises
    ------
    GeometryError
        Where no leg crosses a block, or one meets a face beyond its rim, or a vertex is within one.
    """
    refuse_ends_in_glass(vertices_mm, blocks)
    glass = glass_of(vertices_mm, blocks)
    for block in blocks:
        legs = [leg for leg, one in glass if one == block]
        if not legs and way_on_to(vertices_mm, block) is None:
            raise uncrossed(block)
        for leg in legs:
            _, radius = block.heights_and_radii_mm(vertices_mm[leg : leg + 2])
            if radius.max() > 0.5 * block.diameter_mm:
                raise GeometryError(
                    f"light meets a face of the block of glass {radius.max():.3g} mm from its axis "
                    f"and the face is {block.diameter_mm:g} mm wide: check center_mm and "
                    "diameter_mm of the block"
                )


def way_on_to(vertices_mm: Floats, block: Block) -> Floats | None:
    """How light that meets a block beyond the last vertex flies on, (2, 3), mm; None: it does not.

    As if the block stood not there: it moves light aside by less than a pixel.
    """
    start, end = vertices_mm[-2:]
    step = end - start
    away = float(np.linalg.norm(np.asarray(block.center_mm) - end)) + block.diameter_mm
    far = end + 3.0 * (away + block.thickness_mm) * step / np.linalg.norm(step)
    return np.stack((end, far)) if block.is_between(end, far) else None


def out_of(leg_mm: Floats, block: Block) -> Floats | None:
    """Where a leg (2, 3) that ends before or in a block comes out of it, (3,); None: nowhere."""
    height, _ = block.heights_and_radii_mm(leg_mm)
    if height[0] * height[1] < 0.0 and abs(height[1]) > 0.5 * block.thickness_mm:
        return None
    step = leg_mm[1] - leg_mm[0]
    rise = float(step @ block.unit_normal)
    if height[0] * rise >= 0.0:
        return None
    out: Floats = leg_mm[0] + (abs(height[0]) + 0.6 * block.thickness_mm) / abs(rise) * step
    return out if block.is_between(leg_mm[0], out) else None


def uncrossed(block: Block) -> GeometryError:
    """What is said of a block that no light crosses."""
    where = ", ".join(f"{x:.4g}" for x in np.asarray(block.center_mm))
    return GeometryError(
        f"the light that is seen does not cross the block of {block.thickness_mm:g} mm of glass "
        f"about ({where}) mm: check its center_mm, normal and diameter_mm, or leave it out where "
        "it stands elsewhere"
    )


def seated(vertices_mm: Floats, glass: Glass) -> Floats:
    """The vertices with those on faces put where light between the others meets them.

    Parameters
    ----------
    vertices_mm : array of float, shape (m, 3)
        World, mm; those on faces may be anywhere.
    glass : tuple of (int, Block)
        Legs within glass.

    Returns
    -------
    array of float, shape (m, 3)
    """
    if not glass:
        return vertices_mm
    found = vertices_mm.copy()
    for first, last, blocks in _runs(glass):
        places = places_on_faces(vertices_mm[first], vertices_mm[last], blocks)
        found[first + 1 : last] = places.points_mm
    return found


def seat_map(vertices_mm: Floats, glass: Glass) -> Floats:
    """How all vertices follow the free ones; (3m, 3m), columns of those on faces zero."""
    m = len(vertices_mm)
    found = np.eye(3 * m)
    for first, last, blocks in _runs(glass):
        own = slice(3 * first + 3, 3 * last)
        found[own] = 0.0
        by_ends = places_on_faces(vertices_mm[first], vertices_mm[last], blocks).by_ends
        by_ends = by_ends.reshape(-1, 6)
        found[own, 3 * first : 3 * first + 3] = by_ends[:, :3]
        found[own, 3 * last : 3 * last + 3] = by_ends[:, 3:]
    return found


def on_faces(glass: Glass) -> tuple[int, ...]:
    """Vertices that lie on faces, ascending."""
    return tuple(vertex for leg, _ in glass for vertex in (leg, leg + 1))


def ways_in_glass_mm(vertices_mm: Floats, glass: Glass) -> Floats:
    """(m,), way of the light within glass before each vertex, mm."""
    ways = np.zeros(len(vertices_mm))
    for leg, _ in glass:
        ways[leg + 1 :] += np.linalg.norm(vertices_mm[leg + 1] - vertices_mm[leg])
    return ways


def late_ps(vertices_mm: Floats, glass: Glass, path_group_index: float) -> Floats:
    """(m,), by how much light is late at each vertex for the glass before it, ps.

    Late against flight at the path's own group index.
    """
    late = np.zeros(len(vertices_mm))
    for leg, block in glass:
        way = float(np.linalg.norm(vertices_mm[leg + 1] - vertices_mm[leg]))
        late[leg + 1 :] += (block.glass.group_index - path_group_index) * way
    return late / SPEED_OF_LIGHT_MM_PER_PS


def late_jacobian(vertices_mm: Floats, glass: Glass, path_group_index: float) -> Floats:
    """d(`late_ps`) / d(vertices); (m, 3m), ps per mm."""
    m = len(vertices_mm)
    found = np.zeros((m, m, 3))
    for leg, block in glass:
        step = vertices_mm[leg + 1] - vertices_mm[leg]
        more = (block.glass.group_index - path_group_index) * step / np.linalg.norm(step)
        found[leg + 1 :, leg + 1] += more
        found[leg + 1 :, leg] -= more
    return found.reshape(m, 3 * m) / SPEED_OF_LIGHT_MM_PER_PS


def _runs(glass: Glass) -> list[tuple[int, int, list[Block]]]:
    """(free vertex before, free vertex after, blocks between), of legs in glass."""
    runs: list[tuple[int, int, list[Block]]] = []
    for leg, block in glass:
        if runs and runs[-1][1] == leg:
            first, _, blocks = runs.pop()
            runs.append((first, leg + 2, [*blocks, block]))
        else:
            runs.append((leg - 1, leg + 2, [block]))
    return runs
