"""Changes of a world that take more than a number: geometry, the user's mistakes, other light."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from tests.oracles.worlds.clock import Clock, pf32_clock
from tests.oracles.worlds.light import scaled_to
from tests.oracles.worlds.view import View
from tests.oracles.worlds.world import C, World


def slopes(view: View, points: np.ndarray) -> np.ndarray:
    """(n, 3): right and down per depth in half pictures (±1 at the edges), and depth in mm."""
    right, down, depth = view.axes @ (np.asarray(points, dtype=float) - view.centre).T
    half_down, half_right = (n / f / 2 for n, f in zip(view.shape, view.focal_px, strict=True))
    return np.column_stack([right / depth / half_right, down / depth / half_down, depth])


def points_at(view: View, seen: np.ndarray) -> np.ndarray:
    """The inverse of `slopes`."""
    half_down, half_right = (n / f / 2 for n, f in zip(view.shape, view.focal_px, strict=True))
    seen = np.asarray(seen, dtype=float)
    rays = np.column_stack([seen[:, 0] * half_right, seen[:, 1] * half_down, np.ones(len(seen))])
    return np.asarray(view.centre + (rays * seen[:, 2:]) @ view.axes)


def _across(seen: np.ndarray) -> int:
    """The picture's axis that the legs cross: 0 right, 1 down."""
    return int(np.ptp(seen[:, 1]) > np.ptp(seen[:, 0]))


def walled(behind_mm: float) -> Callable[[World, float], World]:
    """A wall so far behind the deepest vertex mirrors a share of the beam."""

    def change(world: World, share: float) -> World:
        deepest = float(slopes(world.view, world.vertices)[:, 2].max())
        return world.but(wall=share, wall_depth_mm=deepest + behind_mm)

    return change


def glinting(world: World, share: float) -> World:
    """A screw beside the path, lit from the first mirror (one leg: from the source)."""
    seen = slopes(world.view, world.vertices)
    side = 1 - _across(seen)
    at = np.array([[0.3, 0.3, float(seen[:, 2].mean())]])
    at[0, side] = -0.75 if seen[:, side].mean() > 0 else 0.75
    place = points_at(world.view, at)[0]
    corner = min(1, world.n_legs - 1)
    way = float(np.linalg.norm(place - world.vertices[corner]))
    left = float(world.vertex_times_ps()[corner]) + world.path_index * way / C
    return world.but(glint=share, glint_mm=place, glint_ps=left)


def bent(world: World, in_picture_mm: float, in_depth_mm: float) -> World:
    """The middle leg sags."""
    bends = [(0.0, 0.0)] * world.n_legs
    bends[world.n_legs // 2] = (in_picture_mm, in_depth_mm)
    return world.but(bends_mm=tuple(bends))


def detoured(world: World, mm: float) -> World:
    """Two mirrors where one is told: from the first corner (one leg: from the source) the light
    first goes on outwards by so much, unseen."""
    corner = min(1, world.n_legs - 1)
    seen = slopes(world.view, world.vertices)
    axis = _across(seen)
    outwards = np.sign(seen[corner, axis]) * world.view.axes[axis] + 0.5 * world.view.axes[2]
    mirror = world.vertices[corner] + mm * outwards / np.linalg.norm(outwards)
    return world.but(vertices=np.insert(world.vertices, corner + 1, mirror, axis=0))


def half_out(world: World, half_pictures: float) -> World:
    """The last leg climbs out of the picture's side before it has crossed it."""
    seen = slopes(world.view, world.vertices)
    side = 1 - _across(seen)
    up = np.sign(seen[-1, side] - seen[:, side].mean()) or 1.0
    seen[-1, side] = up * (1.0 + half_pictures)
    return _with_vertices(world, points_at(world.view, seen))


def outside(world: World, half_pictures: float) -> World:
    """The middle of three legs runs beyond the picture's side; one leg: runs partly out."""
    if world.n_legs < 3:
        return half_out(world, half_pictures)
    seen = slopes(world.view, world.vertices)
    side = 1 - _across(seen)
    seen[1:3, side] = 1.0 + half_pictures
    return _with_vertices(world, points_at(world.view, seen))


def _with_vertices(world: World, vertices: np.ndarray) -> World:
    """Another path, as bright; the source is still where it is told to be."""
    return scaled_to(world.but(vertices=vertices), world.photons)


def piled_up(periods: int, told: int) -> Callable[[World, float], World]:
    """Frames of so few laser periods that pulses are cut off behind; the data sheet says more."""

    def change(world: World, occupancy: float) -> World:
        brightest = world.photons + world.background_per_ps * world.clock.period_ps
        frames = max(round(brightest / -math.log1p(-occupancy)), 1)
        world = world.but(frames=float(frames), periods_per_frame=periods)
        return world.told_but(n_frames=frames, periods_per_frame=told)

    return change


@cache
def _mixed(own: Clock, other: Clock, share: float) -> Clock:
    assert own.edges_ps is not None
    assert other.edges_ps is not None
    assert own.skew_ps is not None
    assert other.skew_ps is not None
    edges = (1.0 - share) * own.edges_ps + share * other.edges_ps
    return replace(own, edges_ps=edges, skew_ps=(1.0 - share) * own.skew_ps + share * other.skew_ps)


def with_pf32(world: World, number: int) -> World:
    """On a PF32's clock, calibrated from its own recordings."""
    clock = pf32_clock(number, world.view.shape)
    return world.but(clock=clock).told_but(clock=clock)


def another_calibration(
    world: World, share: float, *, own: Clock | None = None, number: int = 1
) -> World:
    """Calibrated on a camera whose clock is by `share` that of another one."""
    own = pf32_clock(world.pixel_seed, world.view.shape) if own is None else own
    other = pf32_clock(10_000 + world.pixel_seed + number, world.view.shape)
    return world.but(clock=own).told_but(clock=_mixed(own, other, share))


def wrong_distance(world: World, share: float) -> World:
    """Told farther away by a share, with the field of view in mm as it is."""
    view = world.told.view
    far = share * float(slopes(view, world.vertices)[:, 2].mean())
    return world.told_but(view=view.moved(np.array([0.0, 0.0, -far])).zoomed(share))


def swapped_field(world: World, aspect: float) -> World:
    """A picture wider than it is high, told with its width and height swapped."""
    rows, cols = world.view.focal_px
    true = replace(world.view, focal_px=(rows, cols / aspect))
    told = replace(world.told.view, focal_px=(world.told.view.focal_px[1] / aspect, rows))
    vertices = points_at(true, slopes(world.view, world.vertices))
    source = world.told.source_mm + vertices[0] - world.vertices[0]
    world = world.but(view=true).told_but(view=told, source_mm=source)
    return _with_vertices(world, vertices)


def turned_picture(world: World, which: float) -> World:
    """1: transposed, 2: turned by 90°, 3: by 180°. The first two want as many rows as columns."""
    names = ("transposed", "turned 90", "turned 180")
    square = world.view.shape[0] == world.view.shape[1]
    return world.but(picture=names[int(which) - 1] if square else "turned 180")


def mirrored_picture(world: World, which: float) -> World:
    """1: left and right swapped; 2: up and down; 3: up and down, and the number of legs is told."""
    world = world.but(picture="left right" if int(which) == 1 else "up down")
    return world.told_but(n_legs=world.n_legs) if int(which) == 3 else world


def legs_told_wrong(world: World, more: float) -> World:
    """A number of legs that is not the path's; what cannot be fewer is more."""
    told = world.n_legs + int(more)
    return world.told_but(n_legs=told if told > 0 else world.n_legs - int(more))


def in_metres(world: World, which: float) -> World:
    """1: source and camera told in m; 2: the source alone; 3: the camera alone."""
    told, kind = world.told, int(which)
    view = replace(told.view, centre=told.view.centre / 1000.0) if kind != 2 else told.view
    source = told.source_mm / 1000.0 if kind != 3 else told.source_mm
    return world.told_but(view=view, source_mm=source)


def emission_in_other_units(world: World, which: float) -> World:
    """1: told in ns; 2: in codes; 3: in s."""
    unit = (1e3, world.clock.width_ps, 1e12)[int(which) - 1]
    return world.told_but(emission_ps=world.told.emission_ps / unit)
