"""Flights that leave the picture and come back: a roof mirror or a corner cube beside it.

Scenes of the refracting oracle with nothing before the camera. The light crosses the picture, turns
beside it over two mirrors (a roof: one leg that nobody sees) or three (a cube: two), comes back
beside its own way, and in two of three scenes crosses once more after a mirror on the other side.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.oracles.refracted import RefractedScene, in_picture, paper_scene


@dataclass(frozen=True, eq=False)
class UnseenWay:
    """A flight and which of its legs no picture shows."""

    scene: RefractedScene
    unseen: tuple[int, ...]

    @property
    def seen(self) -> tuple[int, ...]:
        """Legs in the picture, in the order of flight; of 500 scenes five lack the last."""
        scene, share = self.scene, np.linspace(0.0, 1.0, 200)
        legs = [k for k in range(scene.n_legs) if k not in self.unseen]
        return tuple(k for k in legs if in_picture(scene, scene.points_on(k, share)).any())

    @property
    def delay_between_mirrors_ps(self) -> float:
        """From the first mirror of the unseen way to its last."""
        times = self.scene.vertex_times_ps
        return float(times[self.unseen[-1] + 1] - times[self.unseen[0]])


def roof_or_cube(seed: int, *, photons: float = 4_000.0) -> UnseenWay:
    """A scene drawn anew by each seed: odd ones have a cube, every third only two legs in view."""
    rng = np.random.default_rng([1742, seed])
    cube, third = seed % 2 == 1, seed % 3 != 0
    up, away = np.deg2rad(rng.uniform((-8.0, -25.0), (8.0, 25.0)))
    along = np.array([np.cos(up) * np.cos(away), np.sin(up), np.cos(up) * np.sin(away)])
    source = np.array(
        [rng.uniform(-20.0, 30.0), rng.uniform(-20.0, 70.0), rng.uniform(-30.0, 50.0)]
    )
    # The picture's edge is where x = 187.5 + 0.229 (535 - z): the first mirror stands beyond it.
    edge = (310.0 - 0.229 * (source[2] - source[0] * along[2] / along[0])) / (
        1.0 + 0.229 * along[2] / along[0]
    )
    first = source + (edge + rng.uniform(40.0, 120.0) - source[0]) / along[0] * along
    # Two directions square to the flight, one of them level with the picture.
    level = np.cross([0.0, 0.0, 1.0], along)
    level /= np.linalg.norm(level)
    turn = np.deg2rad(rng.uniform(-50.0, 50.0)) + np.pi * rng.integers(2)
    aside = rng.uniform(25.0, 65.0) * (np.cos(turn) * level + np.sin(turn) * np.cross(along, level))
    vertices = [source, first]
    if cube:
        vertices.append(first + 0.5 * aside + rng.uniform(15.0, 40.0) * along)
    vertices.append(first + aside)
    back = vertices[-1] - (vertices[-1][0] - rng.uniform(0.0, 40.0)) / along[0] * along
    if third:
        vertices.append(back)
        turned = np.deg2rad(rng.uniform(6.0, 20.0)) * rng.choice((-1.0, 1.0))
        deeper = np.deg2rad(rng.uniform(-20.0, 20.0))
        onwards = np.array([np.cos(turned), np.sin(turned), np.sin(deeper)])
        vertices.append(back + (360.0 - back[0]) / onwards[0] * onwards)
    else:
        vertices.append(back)
    scene = replace(paper_scene(), vertices_mm=np.array(vertices), photons=photons)
    return UnseenWay(scene, (1, 2) if cube else (1,))
