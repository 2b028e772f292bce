"""A beam splitter in view: light comes to it on one leg and leaves it on two.

Three one-leg scenes of the refracting oracle with nothing before the camera, on one clock: what
the arms show of the light is added up before the photons are drawn.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.oracles.brute_force import C, camera_over_plane
from tests.oracles.refracted import (
    AIR,
    RefractedScene,
    caught,
    code_edges_ps,
    light_scale,
    paper_scene,
    signal_counts,
    stations,
)
from tests.oracles.several_views import moved_to


@dataclass(frozen=True, eq=False)
class Splitter:
    """Where light comes from, is split, and leaves the picture; and the share that turns off."""

    source_mm: np.ndarray
    splitter_mm: np.ndarray
    straight_mm: np.ndarray
    """Where the light that goes on leaves the picture."""
    turned_mm: np.ndarray
    """Where the light that turns off leaves it."""
    share: float
    base: RefractedScene
    """Camera, clock, pulse and the photons of the brightest pixel; its own flight is not drawn."""

    @property
    def vertices_mm(self) -> np.ndarray:
        """(4, 3): source, splitter, ends of the two arms."""
        return np.array([self.source_mm, self.splitter_mm, self.straight_mm, self.turned_mm])

    @property
    def arms(self) -> tuple[RefractedScene, RefractedScene, RefractedScene]:
        """The light before the splitter, that which goes on, and that which turns off."""
        source, splitter, straight, turned = self.vertices_mm
        start = self.base.emission_time_ps
        split = start + AIR * float(np.linalg.norm(splitter - source)) / C
        return (
            replace(self.base, vertices_mm=np.array([source, splitter])),
            replace(self.base, vertices_mm=np.array([splitter, straight]), emission_time_ps=split),
            replace(self.base, vertices_mm=np.array([splitter, turned]), emission_time_ps=split),
        )

    def expected(self) -> np.ndarray:
        """(rows, cols, codes)."""
        pairs = [caught(arm, stations(arm)) for arm in self.arms]
        scale = light_scale(self.arms[0], pairs[0])
        counts = self.base.background_per_ps * np.diff(code_edges_ps(self.base.clock))
        for arm, own, share in zip(
            self.arms, pairs, (1.0, 1.0 - self.share, self.share), strict=True
        ):
            counts = counts + signal_counts(arm, own, share * scale)
        camera = self.base.camera
        return np.asarray(counts.reshape(camera.rows, camera.cols, -1))

    def recording(self, seed: int) -> np.ndarray:
        """(rows, cols, codes) Poisson counts, uint32."""
        rng = np.random.default_rng([seed, 53])
        return rng.poisson(self.expected()).astype(np.uint32)


def splitter_world(seed: int, *, share: float = 0.5, photons: float = 4_000.0) -> Splitter:
    """A scene drawn anew by each seed; its splitter turns light by 40 to 110 degrees."""
    rng = np.random.default_rng([1743, seed])
    source = np.array([0.0, rng.uniform(0.0, 60.0), rng.uniform(-20.0, 30.0)])
    splitter = np.array([rng.uniform(150, 220), rng.uniform(10, 60), rng.uniform(-10, 30)])
    along = (splitter - source) / np.linalg.norm(splitter - source)
    turn = np.deg2rad(rng.uniform(40.0, 110.0)) * rng.choice((-1.0, 1.0))
    deep = np.deg2rad(rng.uniform(-20.0, 20.0))
    aside = np.array([np.cos(turn), np.sin(turn), np.sin(deep)])
    return Splitter(
        source,
        splitter,
        splitter + along * rng.uniform(240.0, 300.0),
        splitter + 300.0 * aside / np.linalg.norm(aside),
        share,
        replace(paper_scene(), photons=photons),
    )


def seen_apart(seed: int, *, arm_first: bool = False) -> list[tuple[Splitter, np.ndarray]]:
    """A splitter before two cameras, one of which sees three pixels of the arm that turns off.

    Each with what it recorded of one flight; `arm_first`: the camera that sees it whole is first.
    """
    source, splitter, straight, turned = np.array(
        [[0, 20, 0], [190, 30, 10], [460, 45, 25], [170, 330, 40]], dtype=float
    )
    base = replace(paper_scene(), photons=4_000.0)
    below = camera_over_plane(center=(187.5, -60.0))
    aside = moved_to(base.camera, (560.0, 260.0, 420.0), (187.5, 100.0, 15.0))
    cameras = [aside, below] if arm_first else [below, aside]
    worlds = [
        Splitter(source, splitter, straight, turned, 0.5, replace(base, camera=camera))
        for camera in cameras
    ]
    return [(world, world.recording(10 * seed + k)) for k, world in enumerate(worlds)]
