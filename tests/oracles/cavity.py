"""Light that goes to and fro between two mirrors beside the picture, drawn photon by photon.

A beam comes in through a hole of the first mirror, is thrown back by plane mirrors that are a
little tilted, walks a little with every pass and loses a few per cent. Each photon leaves a place
of the beam, falls somewhere about its image, is caught by an active area or lost, and gets a code.
Nothing is expected or integrated here but how many photons there are in all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erf

from tests.oracles.brute_force import C
from tests.oracles.refracted import AIR, RefractedScene, light_scale, paper_scene

FIRST_X_MM, SECOND_X_MM = 0.0, 375.0
"""Where the mirrors stand: 65 mm beyond the edges of what the camera sees of z = 0."""


@dataclass(frozen=True, eq=False)
class Mirror:
    """A plane mirror."""

    point_mm: np.ndarray
    normal: np.ndarray
    """(3,), unit, into the cavity."""

    def met(self, place: np.ndarray, ahead: np.ndarray) -> np.ndarray:
        """(3,) where a ray meets it."""
        return place + ahead * float((self.point_mm - place) @ self.normal / (ahead @ self.normal))

    def turned(self, ahead: np.ndarray) -> np.ndarray:
        """(3,) direction after it."""
        return ahead - 2.0 * float(ahead @ self.normal) * self.normal


@dataclass(frozen=True, eq=False)
class Cavity:
    """Two mirrors, the way of the light between them, and the camera that sees it."""

    first: Mirror
    second: Mirror
    scene: RefractedScene
    """Camera, clock, pulse, and the flight; `photons` are of the brightest pixel, first pass."""

    @property
    def n_passes(self) -> int:
        """Legs of the flight."""
        return self.scene.n_legs

    @property
    def round_trips_ps(self) -> np.ndarray:
        """(n,) from a mirror to the same one again, for each reflection but the last two."""
        times = self.scene.vertex_times_ps[1:-1]
        return np.asarray(times[2:] - times[:-2])

    @property
    def distance_mm(self) -> float:
        """From where the light meets the first mirror on average to the second, square to both."""
        corners = self.scene.vertices_mm[1:-1]
        axis = self.first.normal - self.second.normal
        axis /= np.linalg.norm(axis)
        return float((corners[0::2].mean(axis=0) - corners[1::2].mean(axis=0)) @ axis)

    def recording(self, seed: int) -> np.ndarray:
        """(rows, cols, codes) counts, uint32, each of a photon of its own."""
        rng = np.random.default_rng([seed, 1745])
        scene = self.scene
        shape = (scene.camera.rows, scene.camera.cols, scene.clock.n_codes)
        counts = np.zeros(math.prod(shape), dtype=np.int64)
        first = replace(scene, vertices_mm=scene.vertices_mm[:2], brightness=scene.brightness[:1])
        scale = light_scale(first)
        for leg in range(scene.n_legs):
            for row, col, code in _caught_photons(scene, leg, scale, rng):
                counts += np.bincount(np.ravel_multi_index((row, col, code), shape),
                                      minlength=counts.size)  # fmt: skip
        dark = scene.background_per_ps * scene.clock.period * shape[0] * shape[1]
        counts += np.bincount(
            rng.integers(counts.size, size=rng.poisson(dark)), minlength=counts.size
        )
        return counts.reshape(shape).astype(np.uint32)


def _caught_photons(
    scene: RefractedScene, leg: int, scale: float, rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Rows, columns and codes of one leg's photons, a million tried at a time."""
    camera, clock = scene.camera, scene.clock
    start, end = scene.vertices_mm[leg : leg + 2]
    length = float(np.linalg.norm(end - start))
    # No place of the leg is nearer to the camera than this: rejection keeps what comes from there.
    ahead = (end - start) / length
    foot = start + ahead * float(np.clip((camera.center - start) @ ahead, 0.0, length))
    nearest = float(np.linalg.norm(foot - camera.center))
    brightest = float(scene.light_per_mm(leg, np.zeros(1))[0])
    # Per axis at most one area catches a photon, with at most this chance.
    most = _chances(np.zeros(1), 2, scene)[0].sum() ** 2
    left = int(rng.poisson(scale * brightest * length / nearest**2 * most))
    while left > 0:
        n = min(left, 1_000_000)
        left -= n
        walked = rng.uniform(0.0, length, n)
        place = start + walked[:, None] * ahead
        way = place - camera.center
        away = np.linalg.norm(way, axis=1)
        kept = rng.random(n) < (nearest / away) ** 2
        way, away, walked = way[kept], away[kept], walked[kept]
        depth = way @ camera.forward
        at_row = camera.row_of_axis + camera.px_per_slope_row * (way @ camera.down) / depth
        at_col = camera.col_of_axis + camera.px_per_slope_col * (way @ camera.right) / depth
        row, chance_row = _area(at_row, scene, rng)
        col, chance_col = _area(at_col, scene, rng)
        event = scene.vertex_times_ps[leg] + AIR * walked / C
        arrival = event + AIR * away / C + scene.pulse_std_ps * rng.standard_normal(len(away))
        code = np.floor(np.mod(arrival, clock.period) / clock.width).astype(np.int64)
        inside = (row >= 0) & (row < camera.rows) & (col >= 0) & (col < camera.cols)
        inside &= rng.random(len(row)) * most < chance_row * chance_col
        inside &= code < clock.n_codes
        yield row[inside], col[inside], code[inside]


def _chances(at: np.ndarray, reach: int, scene: RefractedScene) -> np.ndarray:
    """(n, 2 reach + 1) chances to fall into the areas about the nearest one, one axis."""
    gap = np.rint(at)[:, None] + np.arange(-reach, reach + 1) - at[:, None]
    width = math.sqrt(2.0) * scene.spot_std_px
    half = 0.5 * scene.active_side_px
    return np.asarray(0.5 * (erf((gap + half) / width) - erf((gap - half) / width)))


def _area(
    at: np.ndarray, scene: RefractedScene, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Which active area of one axis catches each photon, if any, and the chance of any; (n,)."""
    chances = _chances(at, 2, scene)
    total = chances.sum(axis=1)
    drawn = rng.random(len(at))[:, None] * total[:, None]
    number = (np.cumsum(chances, axis=1) < drawn).sum(axis=1)
    return np.rint(at).astype(np.int64) + np.minimum(number, 4) - 2, total


def cavity(
    seed: int,
    *,
    passes: int = 20,
    walk_mm: float = 9.0,
    photons: float = 4_000.0,
    loss: float = 0.04,
) -> Cavity:
    """A flight drawn anew by each seed, that walks about `walk_mm` upwards from pass to pass.

    The second mirror is tilted by up to 0.05 degrees, so that the walk changes on its way; the
    middle of the flight lies in the middle of the picture.
    """
    rng = np.random.default_rng([1745, seed])
    tilt = np.deg2rad(rng.uniform(-0.05, 0.05, 2)) * min(1.0, walk_mm / 4.0)
    first = Mirror(np.array([FIRST_X_MM, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    turned = np.array([-1.0, tilt[0], tilt[1]])
    second = Mirror(np.array([SECOND_X_MM, 0.0, 0.0]), turned / np.linalg.norm(turned))
    span = SECOND_X_MM - FIRST_X_MM
    # Each meeting with the tilted mirror adds twice its tilt to the slope.
    slope = np.array([walk_mm * rng.uniform(0.9, 1.1), rng.uniform(-1.5, 1.5)]) / span
    slope -= 0.5 * passes * tilt
    ahead = np.array([1.0, *slope]) / np.linalg.norm([1.0, *slope])
    vertices = [np.zeros(3)]
    for number in range(passes):
        mirror = second if number % 2 == 0 else first
        vertices.append(mirror.met(vertices[-1], ahead))
        ahead = mirror.turned(ahead)
    way = np.array(vertices)
    middle = 0.5 * (way[:, 1:].min(axis=0) + way[:, 1:].max(axis=0))
    shift = np.array([37.5 + rng.uniform(-3.0, 3.0), rng.uniform(0.0, 40.0)]) - middle
    way[:, 1:] += shift
    scene = replace(
        paper_scene(), vertices_mm=way, photons=photons,
        brightness=tuple((1.0 - loss) ** np.arange(passes)),
    )  # fmt: skip
    moved = np.array([0.0, *shift])
    return Cavity(
        replace(first, point_mm=first.point_mm + moved),
        replace(second, point_mm=second.point_mm + moved),
        scene,
    )
