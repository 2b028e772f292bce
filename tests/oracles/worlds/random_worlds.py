"""Undisturbed worlds: 24 cameras, paths that zigzag through the picture, light even or uneven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from tests.oracles.worlds.clock import PERFECT, Clock
from tests.oracles.worlds.light import scaled_to
from tests.oracles.worlds.view import View, view_over_plane
from tests.oracles.worlds.world import NODE_MM, PRIORS, Prior, Told, World

N_CAMERAS = 24
CORRELATION_MM = 10.0


def camera(number: int) -> tuple[View, float]:
    """One of the `N_CAMERAS` cameras, and how far away (mm) it looks; every third one has a lens
    that distorts, every fourth stands square to z = 0, the others anywhere."""
    rng = np.random.default_rng([number, 77])
    distance, width = rng.uniform(420.0, 760.0), rng.uniform(190.0, 300.0)
    sizes = [(32, 32)] * 5 + [(24, 32), (32, 40), (48, 48)]
    shape = sizes[number % len(sizes)]
    field = (width, width * shape[0] / shape[1])
    view = view_over_plane(distance, field, (rng.uniform(0, 200), rng.uniform(0, 60)), shape)
    lens = (rng.uniform(-0.3, 0.15), 0.0) if number % 3 == 1 else (0.0, 0.0)
    if number % 4 == 0:
        return replace(view, lens=lens), distance
    turn = Rotation.from_euler("yxz", rng.normal(size=3) * [0.5, 0.35, 0.3])
    middle = np.array([rng.uniform(-200, 300), rng.uniform(-100, 100), rng.uniform(-50, 50)])
    centre = middle + turn.apply([0.0, 0.0, distance])
    return replace(view, centre=centre, axes=turn.apply(view.axes), lens=lens), distance


def zigzag(view: View, distance: float, n_legs: int, rng: np.random.Generator) -> np.ndarray:
    """(n_legs + 1, 3): vertices beyond the picture's sides in turn, as mirrors beside a table."""
    along_rows = rng.uniform() < 0.25
    n_across, n_up = view.shape if along_rows else view.shape[::-1]
    focal = view.focal_px[0] if along_rows else view.focal_px[1]
    half_across, half_up = n_across / focal / 2, n_up / focal / 2
    side = np.where(np.arange(n_legs + 1) % 2 == 0, -1.0, 1.0) * rng.choice([-1.0, 1.0])
    across = side * half_across * rng.uniform(1.25, 1.55, n_legs + 1)
    gap = rng.uniform(0.22, 0.36) if n_legs > 1 else rng.uniform(0.0, 0.4)
    up = half_up * (gap * (np.arange(n_legs + 1) - n_legs / 2) + rng.uniform(-0.15, 0.15))
    up = (up + half_up * rng.normal(size=n_legs + 1) * 0.02) * rng.choice([-1.0, 1.0])
    depth = distance + rng.uniform(-35.0, 35.0, n_legs + 1)
    slopes = np.stack([up, across] if along_rows else [across, up], axis=1)
    seen = np.column_stack([slopes, np.ones(n_legs + 1)]) * depth[:, None]
    return np.asarray(view.centre + seen @ view.axes)


def brightness_covariance(n_nodes: int, std: float) -> np.ndarray:
    """Of the log of the light at nodes `NODE_MM` apart: `std`, alike over `CORRELATION_MM`."""
    gap = NODE_MM * np.subtract.outer(np.arange(n_nodes), np.arange(n_nodes))
    return np.asarray(
        std**2 * (np.exp(-0.5 * (gap / CORRELATION_MM) ** 2) + 1e-4 * np.eye(n_nodes))
    )


def brightness_precision(n_nodes: int, std: float) -> np.ndarray:
    """Inverse of `brightness_covariance`."""
    factor = cho_factor(brightness_covariance(n_nodes, std))
    return np.asarray(cho_solve(factor, np.eye(n_nodes)))


def random_world(
    seed: int,
    n_legs: int = 3,
    photons: float = 40_000.0,
    prior: str | Prior = "known",
    *,
    uneven: float | None = None,
    clock: Clock = PERFECT,
) -> World:
    """A world with nothing wrong: what is told is the truth, but for an error drawn from `prior`.

    Camera `seed % 24`; light is uneven by 20 % (rms) in every other round of the cameras unless
    `uneven` says how much. The recording's codes lie near 30 ns.
    """
    prior = PRIORS[prior] if isinstance(prior, str) else prior
    rng = np.random.default_rng([seed, n_legs, 1914])
    view, distance = camera(seed % N_CAMERAS)
    vertices = zigzag(view, distance, n_legs, rng)
    emission = rng.uniform(24_000.0, 31_000.0)
    uneven = 0.2 * (seed // N_CAMERAS % 2) if uneven is None else uneven
    told = Told(view, vertices[0], emission, clock, prior)
    world = World(
        vertices, view, told, emission, clock=clock, pixel_seed=seed, brightness_std=uneven,
        spot_std_px=rng.uniform(0.3, 0.4), background_per_ps=0.025 * photons / clock.period_ps,
    )  # fmt: skip
    if uneven:
        n_nodes = int(world.length_mm() / NODE_MM) + 2
        spread = np.linalg.cholesky(brightness_covariance(n_nodes, uneven))
        world = replace(world, log_brightness=spread @ rng.normal(size=n_nodes))
    return scaled_to(drawn_from_prior(world, rng), photons)


def drawn_from_prior(world: World, rng: np.random.Generator) -> World:
    """The world off by one draw from what is told to be uncertain; what is told stays."""
    prior, view = world.told.prior, world.view
    draw = rng.normal
    vertices = world.vertices.copy()
    vertices[0] += prior.source_mm * draw(size=3)
    view = view.moved(prior.position_mm * draw(size=3))
    view = view.turned(np.radians(prior.rotation_deg) * draw(size=3))
    view = view.zoomed(prior.focal_share * draw())
    lens = (view.lens[0] + prior.lens * draw(), view.lens[1])
    index = prior.index * draw()
    emission = prior.emission_ps if np.isfinite(prior.emission_ps) else 0.0
    return replace(
        world, vertices=vertices, view=replace(view, lens=lens),
        path_index=world.path_index + index, return_index=world.return_index + index,
        emission_ps=world.emission_ps + emission * draw(),
        offset_ps=world.offset_ps + prior.offset_ps * draw(),
        scale=world.scale + prior.scale * draw(),
    )  # fmt: skip
