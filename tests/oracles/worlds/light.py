"""Where the light of a world falls and when: stations along the path, spread over pixels.

The pulse is walked along its legs, straight or bent, in steps; each step's light goes to the pixels
by the spot's overlap with their active areas, at the time it takes on that way. A pixel's light
is kept as the Fourier series of its arrival times over one laser period, in which delays and
responses are products.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import rfft
from scipy.special import erf

from tests.oracles.worlds.world import NODE_MM, Arm, C, World

Weights = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Stations:
    """Steps of the walk: middle (n, 3), event time, arrival time, light at the camera, length."""

    place: np.ndarray
    event_ps: np.ndarray
    arrival_ps: np.ndarray
    light: np.ndarray
    walked_mm: np.ndarray


def _leg_points(world: World, leg: int, cuts: np.ndarray) -> np.ndarray:
    """Points of a leg at shares (n,) of its chord, bent as the world says."""
    start, end = np.asarray(world.vertices[leg], float), np.asarray(world.vertices[leg + 1], float)
    if world.jumps is not None:
        start = start + world.jumps[leg, :3]
    points = start + cuts[:, None] * (end - start)
    if not world.bends_mm:
        return points
    ahead = (end - start) / np.linalg.norm(end - start)
    away = (start + end) / 2 - world.view.centre
    away -= (away @ ahead) * ahead
    away /= np.linalg.norm(away)
    in_picture, in_depth = world.bends_mm[leg]
    sag = in_picture * np.cross(away, ahead) + in_depth * away
    return np.asarray(points + (4.0 * cuts * (1.0 - cuts))[:, None] * sag)


def stations(world: World, stride: float = 0.5, weights: Weights | None = None) -> Stations:
    """The walk along all legs; `weights` (of the length walked) multiplies the light."""
    walked, late, parts = 0.0, 0.0, []
    for leg in range(world.n_legs):
        chord = float(np.linalg.norm(world.vertices[leg + 1] - world.vertices[leg]))
        n = max(math.ceil(chord / stride), 1)
        cuts = np.linspace(0.0, 1.0, 2 * n + 1)
        points = _leg_points(world, leg, cuts)
        steps = np.linalg.norm(np.diff(points[::2], axis=0), axis=1)
        ends = walked + np.cumsum(steps)
        late += 0.0 if world.jumps is None else float(world.jumps[leg, 3])
        gain = math.exp(world.leg_log_flux[leg]) if world.leg_log_flux else 1.0
        parts.append((points[1::2], gain * steps, ends - steps / 2, np.full(n, late)))
        walked = float(ends[-1])
    place, step, length, delay = (np.concatenate(part) for part in zip(*parts, strict=True))
    event = world.emission_ps + world.path_index * length / C + delay
    light = world.flux * step
    if world.log_brightness.size:
        nodes = NODE_MM * np.arange(world.log_brightness.size)
        light = light * np.exp(np.interp(length, nodes, world.log_brightness))
    if weights is not None:
        light = light * weights(length)
    return _seen(world, place, event, light, length)


def _seen(
    world: World, place: np.ndarray, event: np.ndarray, light: np.ndarray, length: np.ndarray
) -> Stations:
    way = np.linalg.norm(place - world.view.centre, axis=1)
    return Stations(place, event, event + world.return_index * way / C, light / way**2, length)


def mirrored(world: World, beam: Stations) -> Stations:
    """The beam as a wall behind it shows it: its mirror image in the wall's plane."""
    forward = world.view.axes[2]
    depth = (beam.place - world.view.centre) @ forward
    image = beam.place + 2.0 * (world.wall_depth_mm - depth)[:, None] * forward
    way2 = ((beam.place - world.view.centre) ** 2).sum(axis=1)
    return _seen(world, image, beam.event_ps, world.wall * beam.light * way2, beam.walked_mm)


def along_arm(world: World, arm: Arm) -> Stations:
    """The walk of the light that a splitter sends elsewhere."""
    other = replace(
        world, vertices=arm.vertices, emission_ps=arm.start_ps, flux=arm.share * world.flux,
        bends_mm=(), jumps=None, leg_log_flux=(), log_brightness=np.zeros(0),
    )  # fmt: skip
    return stations(other)


def glint(world: World, total: float) -> Stations:
    """One bright point that sends `total` photons per px² to the camera."""
    at = np.asarray(world.glint_mm, dtype=float)[None, :]
    way2 = float(((at - world.view.centre) ** 2).sum())
    one = np.ones(1)
    return _seen(world, at, world.glint_ps * one, total * way2 * one, 0.0 * one)


def n_harmonics(world: World) -> int:
    """Beyond which a pulse of this width has nothing (1e-12)."""
    return math.ceil(7.5 * world.clock.period_ps / (2.0 * math.pi * world.std_ps)) + 1


def n_fine(world: World) -> int:
    """Fine time bins in a period: about a tenth of the pulse's width each."""
    return 1 << math.ceil(math.log2(10.0 * world.clock.period_ps / world.std_ps))


def spot_of(world: World, beam: Stations) -> np.ndarray:
    """(stations,), std of the spot where each is seen, px."""
    _, col = world.view.image(beam.place)
    half = world.view.shape[1] / 2
    tilted = np.exp(world.spot_tilt_ln * np.nan_to_num((col - half + 0.5) / half))
    depth = (beam.place - world.view.centre) @ world.view.axes[2]
    return np.hypot(world.spot_std_px * tilted, world.defocus_px_per_mm * (depth - world.focus_mm))


def _overlap(at: np.ndarray, n: int, std: np.ndarray, side: float) -> np.ndarray:
    """(stations, n), part of a spot at `at` that falls into active areas of that side."""
    gap, std = np.arange(n)[None, :] - at[:, None], std[:, None]
    far, near = (gap + side / 2) / (math.sqrt(2) * std), (gap - side / 2) / (math.sqrt(2) * std)
    return np.asarray(0.5 * (erf(far) - erf(near)))


def _spline(part: np.ndarray) -> np.ndarray:
    """(n, 4), cubic B-spline weights of the bins from one before to two after."""
    rest = 1.0 - part
    inner, outer = 2 / 3 - part**2 * (2 - part) / 2, 2 / 3 - rest**2 * (2 - rest) / 2
    return np.stack([rest**3 / 6, inner, outer, part**3 / 6], axis=1)


def spread(world: World, beam: Stations, spot_std_px: float | np.ndarray) -> np.ndarray:
    """(pixels, harmonics) Fourier series of each pixel's arrival times, light as its zeroth."""
    rows, cols = world.view.shape
    row, col = world.view.image(beam.place)
    spot_std_px = np.broadcast_to(spot_std_px, row.shape)
    reach = 8.0 * spot_std_px + 1.0
    near = (row > -reach) & (row < rows + reach) & (col > -reach) & (col < cols + reach)
    fine = n_fine(world)
    series = np.zeros((rows * cols, n_harmonics(world)), dtype=complex)
    if not near.any():
        return series
    down = _overlap(row[near], rows, spot_std_px[near], world.active_side_px)
    across = _overlap(col[near], cols, spot_std_px[near], world.active_side_px)
    caught = (beam.light[near, None] * down)[:, :, None] * across[:, None, :]
    caught = caught.reshape(len(caught), -1)
    station, pixel = np.nonzero(caught > 1e-11 * caught.max())
    lit, place = np.unique(pixel, return_inverse=True)
    when = beam.arrival_ps[near][station] / world.clock.period_ps * fine
    first = np.floor(when).astype(np.int64)
    bins = (first[:, None] + np.arange(-1, 3)) % fine + place[:, None] * fine
    shares = caught[station, pixel][:, None] * _spline(when - first)
    held = np.bincount(bins.ravel(), weights=shares.ravel(), minlength=lit.size * fine)
    harmonics = np.arange(series.shape[1])
    found = rfft(held.reshape(lit.size, fine), axis=1)[:, : series.shape[1]]
    series[lit] = found / np.sinc(harmonics / fine) ** 4
    return series


def _neighbours(world: World, series: np.ndarray) -> np.ndarray:
    """A share of every pixel's light given in equal parts to the four around it."""
    rows, cols = world.view.shape
    cube = series.reshape(rows, cols, -1)
    given = np.zeros_like(cube)
    part = world.crosstalk / 4.0
    given[1:] += part * cube[:-1]
    given[:-1] += part * cube[1:]
    given[:, 1:] += part * cube[:, :-1]
    given[:, :-1] += part * cube[:, 1:]
    return np.asarray(((1.0 - world.crosstalk) * cube + given).reshape(series.shape))


def light_series(world: World, weights: Weights | None = None) -> np.ndarray:
    """(pixels, harmonics): all light of the beam and what it meets, before clock and response."""
    omega = angular(world)
    beam = stations(world, weights=weights)
    spot = spread(world, beam, spot_of(world, beam))
    held = 1.0 - world.halo - world.late_halo - world.glare
    series = held * spot
    if world.glare:
        series = series + world.glare * spot.mean(axis=0)
    broad = stations(world, stride=3.0, weights=weights) if world.halo or world.late_halo else beam
    if world.halo:
        series = series + world.halo * spread(world, broad, world.halo_std_px)
    if world.late_halo:
        late = exponential(omega, world.late_halo_ps)
        series = series + world.late_halo * spread(world, broad, world.late_halo_std_px) * late
    if world.wall:
        series = series + spread(world, mirrored(world, beam), world.spot_std_px)
    if world.ghost:
        blurred = spread(world, beam, world.ghost_std_px)
        # Row by row a picture turned by half a turn is its pixels in the other order.
        series = series + world.ghost * blurred[::-1] * np.exp(-1j * omega * world.ghost_ps)
    for arm in world.arms:
        series = series + spread(world, along_arm(world, arm), world.spot_std_px)
    if world.glint:
        area = world.active_side_px**2
        bright = glint(world, world.glint * float(spot[:, 0].real.sum()) / area)
        series = series + spread(world, bright, world.spot_std_px)
    return _neighbours(world, series) if world.crosstalk else series


def angular(world: World) -> np.ndarray:
    """(harmonics,), rad/ps."""
    return 2.0 * np.pi * np.arange(n_harmonics(world)) / world.clock.period_ps


def exponential(omega: np.ndarray, mean_ps: float) -> np.ndarray:
    """Fourier series of an exponential wait of that mean."""
    return np.asarray(1.0 / (1.0 + 1j * omega * mean_ps))


def scaled_to(world: World, photons: float) -> World:
    """With the flux at which the brightest pixel expects `photons` of the beam's own light."""
    spot = spread(world, stations(world), world.spot_std_px)[:, 0].real.max()
    if not spot > 0.0:
        raise ValueError("no light of this world reaches a pixel")
    return replace(world, flux=world.flux * photons / spot, photons=photons)
