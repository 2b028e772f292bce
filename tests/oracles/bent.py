"""Light on curves: a forward model whose bent legs are marched, apart from the package's.

A bent leg leaves the straight line between its ends by vectors times domes 4 f (1 - f), the second
of them times 2 f - 1. Its length is summed over chords, four thousand of them, so that a sign or a
factor of the package's integral cannot cancel against itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tests.oracles.brute_force import C
from tests.oracles.refracted import RefractedScene, paper_scene
from tests.oracles.refracted_bound import Freedom

CHORDS = 4000
"""That a curve's length is summed over: 20 mm on 400 to 0.1 nm."""
PLAUSIBLE_MM = 20.0
"""Sagitta that nobody would be surprised by: what the package takes as its prior."""


@dataclass(frozen=True, eq=False)
class BentScene(RefractedScene):
    """A scene some of whose legs are curves."""

    bows_mm: dict[int, np.ndarray] = field(default_factory=dict)
    """By leg, (orders, 3): vectors of its domes; the first is the sagitta."""

    def points_on(self, leg: int, shares: np.ndarray) -> np.ndarray:
        points = super().points_on(leg, shares)
        for order, vector in enumerate(self.bows_mm.get(leg, ())):
            dome = 4.0 * shares * (1.0 - shares) * (2.0 * shares - 1.0) ** order
            points = points + dome[:, None] * vector
        return points

    def _chords(self, leg: int) -> tuple[np.ndarray, np.ndarray]:
        """Shares of a leg's chords, and the way to each."""
        shares = np.linspace(0.0, 1.0, CHORDS + 1)
        steps = np.linalg.norm(np.diff(self.points_on(leg, shares), axis=0), axis=1)
        return shares, np.append(0.0, np.cumsum(steps))

    @property
    def leg_lengths_mm(self) -> np.ndarray:
        return np.array([self._chords(leg)[1][-1] for leg in range(self.n_legs)])

    def walked_mm(self, leg: int, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        at, way = self._chords(leg)
        middle = 0.5 * (at[1:] + at[:-1])
        speed = np.interp(shares, middle, np.diff(way) * CHORDS)
        return np.interp(shares, at, way), speed

    def shares_at(self, leg: int, passed: np.ndarray) -> np.ndarray:
        at, way = self._chords(leg)
        inside = np.interp(passed * way[-1], way, at)
        # Beyond its ends a leg runs on straight.
        return np.where((passed < 0.0) | (passed > 1.0), passed, inside)


@dataclass(frozen=True, eq=False)
class ArcScene(BentScene):
    """A scene whose first leg is part of a circle; its vertices are the ends of that."""

    arc_center_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def points_on(self, leg: int, shares: np.ndarray) -> np.ndarray:
        if leg:
            return super().points_on(leg, shares)
        # Turned from start to end, in the plane of both radii; straight on beyond them.
        first, last = np.asarray(self.vertices_mm[:2], dtype=float) - self.arc_center_mm
        radius = np.linalg.norm(first)
        angle = np.arccos(first @ last / (radius * np.linalg.norm(last)))
        ahead = last - (last @ first) * first / radius**2
        ahead *= radius / np.linalg.norm(ahead)
        inside = np.clip(shares, 0.0, 1.0)
        turn = (angle * inside)[:, None]
        along = angle * (np.cos(turn) * ahead - np.sin(turn) * first)
        on_circle = np.cos(turn) * first + np.sin(turn) * ahead
        return self.arc_center_mm + on_circle + (shares - inside)[:, None] * along


def arc_scene(*, sagitta_mm: float, way: str, index: float, photons: float = 40_000.0) -> ArcScene:
    """One leg of a medium of its own across the field, on a circle; parameters as `bent_scene`."""
    base = bent_scene(legs=1, sagitta_mm=sagitta_mm, way=way, photons=photons)
    start, end = np.asarray(base.vertices_mm, dtype=float)
    bow = base.bows_mm[0][0]
    half, size = 0.5 * np.linalg.norm(end - start), np.linalg.norm(bow)
    radius = (half**2 + size**2) / (2.0 * size)
    center = 0.5 * (start + end) + bow - radius * bow / size
    return ArcScene(
        base.vertices_mm, base.camera, clock=base.clock, emission_time_ps=base.emission_time_ps,
        photons=photons, path_group_index=index, arc_center_mm=tuple(center),
    )  # fmt: skip


def fibre_in_view(
    way: str, *, index: float = 1.47, photons: float = 4000.0, end_mm: float = 290.0
) -> BentScene:
    """A fibre of 213 or 215 mm that begins and ends in the picture, bowed by 15 or 20 mm.

    `way`: "picture" or "depth"; `end_mm`: how far along x it ends, the picture does at 310.
    """
    base = paper_scene()
    bow = {"picture": [0.0, 15.0, 0.0], "depth": [0.0, 0.0, 20.0]}[way]
    return BentScene(
        np.array([[85.0, 20.0, 0.0], [end_mm, 55.0, 30.0]]), base.camera, clock=base.clock,
        emission_time_ps=base.emission_time_ps, photons=photons, path_group_index=index,
        bows_mm={0: np.array([bow])},
    )  # fmt: skip


def measured_places(
    scene: BentScene,
    leg: int,
    seed: int,
    *,
    n: int = 21,
    std_mm: float,
    shift_mm: float = 0.0,
    turn_deg: float = 0.0,
) -> np.ndarray:
    """(n, 3), places measured on a leg: each by itself, all shifted and turned on each axis."""
    rng = np.random.default_rng([seed, 61])
    places = scene.points_on(leg, np.linspace(0.0, 1.0, n))
    middle = places.mean(axis=0)
    turn = np.deg2rad(turn_deg) * rng.standard_normal(3)
    size = np.linalg.norm(turn)
    away = places - middle
    if size > 0.0:
        # Rodrigues.
        axis = turn / size
        away = (
            np.cos(size) * away + np.sin(size) * np.cross(axis, away)
            + (1.0 - np.cos(size)) * np.outer(away @ axis, axis)
        )  # fmt: skip
    whole = middle + away + shift_mm * rng.standard_normal(3)
    return whole + std_mm * rng.standard_normal(places.shape)


def bow_freedom(leg: int, order: int, axis: np.ndarray, name: str) -> Freedom:
    """The size of a dome of a leg along an axis, mm, as plausible as the package takes it."""

    def bowed(scene: RefractedScene, amount: float) -> RefractedScene:
        assert isinstance(scene, BentScene)
        bows = {k: v.copy() for k, v in scene.bows_mm.items()}
        bows[leg][order] += amount * np.asarray(axis)
        return replace(scene, bows_mm=bows)

    return Freedom(f"bow{leg}_{order}_{name}", bowed, 0.002, PLAUSIBLE_MM / (order + 1.0) ** 2)


def axes_of_leg(scene: RefractedScene, leg: int) -> tuple[np.ndarray, np.ndarray]:
    """Across a leg: in the picture, and in depth (away from the camera); unit."""
    start, end = np.asarray(scene.vertices_mm[leg : leg + 2], dtype=float)
    along = (end - start) / np.linalg.norm(end - start)
    away = 0.5 * (start + end) - scene.camera.center
    depth = away - (away @ along) * along
    depth /= np.linalg.norm(depth)
    return np.cross(along, depth), depth


def bow_freedoms(scene: BentScene) -> Sequence[Freedom]:
    """Both axes of every dome of a scene."""
    return [
        bow_freedom(leg, order, axis, name)
        for leg, vectors in scene.bows_mm.items()
        for order in range(len(vectors))
        for axis, name in zip(axes_of_leg(scene, leg), ("picture", "depth"), strict=True)
    ]


def bent_scene(*, legs: int, sagitta_mm: float, way: str, photons: float = 40_000.0) -> BentScene:
    """One leg across the field, or the paper's three, whose first is bent.

    Parameters
    ----------
    legs : 1 or 3.
    sagitta_mm : over the field of view of 245 mm, positive up, or towards the camera.
    way : "picture" or "depth".
    photons : that the brightest pixel expects.
    """
    base = paper_scene()
    vertices = np.asarray(base.vertices_mm, dtype=float)[: legs + 1]
    if legs == 1:
        vertices = np.array([[0.0, 20.0, 0.0], [375.0, 55.0, 30.0]])
    straight = BentScene(
        vertices, base.camera, clock=base.clock, emission_time_ps=base.emission_time_ps,
        photons=photons,
    )  # fmt: skip
    picture, depth = axes_of_leg(straight, 0)
    vector = {"picture": picture, "depth": -depth}[way]
    # A parabola's sagitta grows by the square of its chord.
    whole = sagitta_mm * (np.linalg.norm(vertices[1] - vertices[0]) / 245.0) ** 2
    return replace(straight, bows_mm={0: whole * vector[None]})


def curved_arrival_ps(scene: BentScene, leg: int, shares: np.ndarray) -> np.ndarray:
    """(n,) when light from places of a leg reaches the camera: marched out, straight back."""
    index = float(np.broadcast_to(scene.path_group_index, scene.n_legs)[leg])
    walked, _ = scene.walked_mm(leg, shares)
    back = np.linalg.norm(scene.points_on(leg, shares) - scene.camera.center, axis=1)
    event = scene.vertex_times_ps[leg] + index * walked / C
    return np.asarray(event + scene.group_front * back / C)
