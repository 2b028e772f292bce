"""Counts that each code of each pixel expects in a world, and recordings drawn from them."""

from __future__ import annotations

import math

import numpy as np
from scipy.fft import irfft

from tests.oracles.worlds.clock import Clock
from tests.oracles.worlds.light import Weights, angular, exponential, light_series, n_fine
from tests.oracles.worlds.world import World


def response_series(world: World, omega: np.ndarray, repeat: int) -> np.ndarray:
    """(harmonics,): what haze, a second pulse, drift and the detector do to every pixel."""
    series = np.exp(-0.5 * (omega * world.std_ps) ** 2 - 1j * omega * world.offset_ps)
    for share, wait in ((world.tail, world.tail_ps), (world.haze, world.haze_ps)):
        if share:
            series = series * (1.0 - share + share * exponential(omega, wait))
    if world.second:
        series = series * (1.0 + world.second * np.exp(-1j * omega * world.second_ps))
    if world.drift_ps:
        # Delay grows evenly: this repeat sees the window [repeat, repeat + 1] of `repeats`.
        stretch = world.drift_ps / world.repeats
        series = series * np.sinc(omega * stretch / (2.0 * np.pi))
        series = series * np.exp(-1j * omega * stretch * (repeat + 0.5))
    return series


def pixel_draws(world: World, kind: int) -> np.random.Generator:
    """Numbers that belong to this camera's pixels, the same in every recording."""
    return np.random.default_rng([world.pixel_seed, kind])


def pixel_delays_ps(world: World, light: np.ndarray) -> np.ndarray:
    """(pixels,): electronics, delays nobody calibrated, and walk with brightness."""
    delay = np.zeros(world.n_pixels)
    if world.clock.skew_ps is not None:
        delay += world.clock.skew_ps
    if world.stale_delay_ps:
        delay += world.stale_delay_ps * pixel_draws(world, 1).normal(size=delay.size)
    if any(world.skew_ps):
        delay += askew(world)
    return np.asarray(delay - world.walk_ps * light / world.photons)


def askew(world: World) -> np.ndarray:
    """(pixels,): delays that grow across the picture, ps."""
    rows, cols = world.view.shape
    row, col = np.divmod(np.arange(rows * cols), cols)
    down, across = row - (rows - 1) / 2, col - (cols - 1) / 2
    out = (down**2 + across**2) / ((max(rows, cols) - 1) / 2) ** 2
    by_row, by_col, by_rim = world.skew_ps
    return np.asarray(
        by_row * down / ((rows - 1) / 2) + by_col * across / ((cols - 1) / 2) + by_rim * out
    )


def seen_series(world: World, repeat: int = 0, weights: Weights | None = None) -> np.ndarray:
    """(pixels, harmonics) of recorded delays, before the codes."""
    omega = angular(world)
    series = light_series(world, weights) * response_series(world, omega, repeat)
    if world.efficiency_std:
        efficiency = np.exp(world.efficiency_std * pixel_draws(world, 3).normal(size=len(series)))
        series = series * efficiency[:, None]
    lit = np.flatnonzero(series[:, 0].real != 0.0)
    delay = pixel_delays_ps(world, series[:, 0].real)
    if delay.any():
        series[lit] *= np.exp(-1j * delay[lit, None] * omega)
    if world.jitter:
        wider = 1.0 + world.jitter * pixel_draws(world, 2).uniform(-1.0, 1.0, size=delay.size)
        more = (wider**2 - 1.0) * world.std_ps**2
        series[lit] *= np.exp(-0.5 * omega**2 * more[lit, None])
    return series / world.repeats


def light_before(
    series: np.ndarray, edges_ps: np.ndarray, period_ps: float, fine: int
) -> np.ndarray:
    """(pixels, edges): light between delay 0 and each edge, which may lie beyond the period.

    The series and its integral are laid out on a fine grid; between two points the cubic that
    has both their values and slopes is taken.
    """
    omega = 2.0 * np.pi * np.arange(series.shape[1]) / period_ps
    total = series[:, :1].real
    density = irfft(series, fine, axis=1) * (fine / period_ps)
    wave = np.zeros_like(series)
    wave[:, 1:] = series[:, 1:] / (1j * omega[1:])
    swing = irfft(wave, fine, axis=1) * (fine / period_ps)
    turns, place = np.divmod(edges_ps / period_ps, 1.0)
    at = np.floor(place * fine).astype(np.int64) % fine
    part = place * fine - at
    step = period_ps / fine
    after = (at + 1) % fine

    def picked(values: np.ndarray, index: np.ndarray) -> np.ndarray:
        if index.shape[0] == 1:
            return values[:, index[0]]
        return np.take_along_axis(values, index, axis=1)

    ripple = density - total / period_ps
    low, high = part**2 * (3.0 - 2.0 * part), 1.0 - part**2 * (3.0 - 2.0 * part)
    rise, fall = part * (1.0 - part) ** 2, part**2 * (part - 1.0)
    swung = high * picked(swing, at) + low * picked(swing, after)
    swung += step * (rise * picked(ripple, at) + fall * picked(ripple, after))
    return np.asarray(total * (turns + place) + swung - swing[:, :1])


def background_per_ps(world: World) -> np.ndarray:
    """(pixels,) of light that ignores the laser, the camera's own included."""
    rows, cols = world.view.shape
    slope = world.lamp * (np.arange(cols) / max(cols - 1, 1) - 0.5)
    level = np.tile(world.background_per_ps * (1.0 + slope), rows)
    if world.screaming:
        loud = pixel_draws(world, 3).uniform(size=level.size) < world.screaming
        level = level + loud * 20.0 * world.photons / world.clock.period_ps
    return level / world.repeats


def code_intervals(world: World) -> tuple[np.ndarray, np.ndarray]:
    """Delays (1 or pixels, codes) that each code of the world's clock covers."""
    slow = (world.slow_codes_ps, world.slow_codes_period_ps)
    return world.clock.intervals(world.scale, world.uneven_codes, slow)


def expected_counts(
    world: World, repeat: int = 0, *, weights: Weights | None = None, background: bool = True
) -> np.ndarray:
    """(rows, cols, codes) that one recording, or one of the repeats, expects.

    `weights`, a function of the length walked, takes a part of the beam's light only.
    """
    clock = world.clock
    near, far = code_intervals(world)
    steady = background_per_ps(world) if background else np.zeros(world.n_pixels)
    counts = np.broadcast_to(steady[:, None] * (far - near), (world.n_pixels, clock.n_codes)).copy()
    series = seen_series(world, repeat, weights)
    lit = np.flatnonzero(series[:, 0].real)
    if clock.edges_ps is not None:
        near, far = near[lit], far[lit]
    if lit.size:
        edges = np.concatenate([near, far], axis=1)
        before = light_before(series[lit], edges, clock.period_ps, n_fine(world))
        counts[lit] += before[:, clock.n_codes :] - before[:, : clock.n_codes]
    if math.isfinite(world.frames):
        counts = first_of_each_frame(world, series, steady)
    if background:
        # Ringing of the series, 1e-12 of the light; parts may be negative, recordings may not.
        counts = np.maximum(counts, 0.0)
    if world.dead:
        counts[pixel_draws(world, 4).uniform(size=len(counts)) < world.dead] = 0.0
    if clock.no_photon_code is not None:
        counts[:, clock.no_photon_code] = 0.0
    return as_pictured(counts.reshape(*world.view.shape, -1), world.picture)


def first_of_each_frame(world: World, series: np.ndarray, steady: np.ndarray) -> np.ndarray:
    """(pixels, codes) where only the first photon of a frame counts, and a frame is so many
    laser periods: the photon's period is over with it, and later ones go unseen."""
    clock, frames, periods = world.clock, world.frames / world.repeats, world.periods_per_frame
    near, far = code_intervals(world)
    one = 1.0 / (frames * periods)
    start = np.mod(near, clock.period_ps)
    edges = np.concatenate([start, start + far - near], axis=1)
    light = light_before(series, edges, clock.period_ps, n_fine(world)) + steady[:, None] * edges
    before, within = light[:, : clock.n_codes], light[:, clock.n_codes :]
    within = within - before
    seen = np.exp(-one * before) * -np.expm1(-one * within)
    rate = one * (series[:, 0].real + steady * clock.period_ps)
    with np.errstate(invalid="ignore", divide="ignore"):
        tries = np.where(rate > 0.0, np.expm1(-rate * periods) / np.expm1(-rate), periods)
    return np.asarray(frames * tries[:, None] * seen)


def as_pictured(cube: np.ndarray, picture: str) -> np.ndarray:
    """The cube as a recording with wrong axes holds it."""
    turns = {
        "as seen": lambda c: c,
        "transposed": lambda c: c.transpose(1, 0, 2),
        "left right": lambda c: c[:, ::-1],
        "up down": lambda c: c[::-1],
        "turned 90": lambda c: np.rot90(c),
        "turned 180": lambda c: c[::-1, ::-1],
    }
    return np.ascontiguousarray(turns[picture](cube))


def drawn_counts(world: World, seed: int) -> list[np.ndarray]:
    """Poisson counts of the world's repeats, each (rows, cols, codes) of uint32."""
    rng = np.random.default_rng([seed, 14])
    return [
        rng.poisson(expected_counts(world, repeat)).astype(np.uint32)
        for repeat in range(world.repeats)
    ]


def even_light(clock: Clock, shape: tuple[int, int], photons: float) -> np.ndarray:
    """(rows, cols, codes) expected of light that ignores the laser: a code density recording."""
    near, far = clock.intervals()
    counts = np.broadcast_to(far - near, (shape[0] * shape[1], clock.n_codes)) * (
        photons / clock.period_ps
    )
    return counts.reshape(*shape, -1)


def flat_light(
    clock: Clock, shape: tuple[int, int], photons: float, *, arrival_ps: float, std_ps: float,
    tail: float = 0.0, tail_ps: float = 200.0,
) -> np.ndarray:  # fmt: skip
    """(rows, cols, codes) expected of a pulse that reaches every pixel at once."""
    n = shape[0] * shape[1]
    top = math.ceil(7.5 * clock.period_ps / (2.0 * math.pi * std_ps)) + 1
    omega = 2.0 * np.pi * np.arange(top) / clock.period_ps
    pulse = photons * np.exp(-0.5 * (omega * std_ps) ** 2 - 1j * omega * arrival_ps)
    pulse = pulse * (1.0 - tail + tail * exponential(omega, tail_ps))
    skew = np.zeros(n) if clock.skew_ps is None else clock.skew_ps
    series = pulse * np.exp(-1j * skew[:, None] * omega)
    fine = 1 << math.ceil(math.log2(10.0 * clock.period_ps / std_ps))
    near, far = (np.broadcast_to(e, (n, clock.n_codes)) for e in clock.intervals())
    before = light_before(series, np.concatenate([near, far], axis=1), clock.period_ps, fine)
    light = before[:, clock.n_codes :] - before[:, : clock.n_codes]
    steady = 0.01 * photons * (far - near) / clock.period_ps
    return (light.clip(0.0) + steady).reshape(*shape, -1)
