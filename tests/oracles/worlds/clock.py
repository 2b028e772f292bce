"""Clocks of the oracle: a perfect one, and an array drawn like the PF32's."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

PF32_PHASES = (1.036, 0.922, 0.990, 1.096, 0.968, 0.982, 0.936, 1.069)


@dataclass(frozen=True, eq=False)
class Clock:
    """Codes of the time-to-digital converters, as delays after the sync, modulo the period."""

    n_codes: int = 909
    width_ps: float = 55.0
    period_ps: float = 50_000.0
    reversed: bool = False
    edges_ps: np.ndarray | None = None
    """(pixels, codes + 1), start and end of each code from where counting starts; None: equal
    codes of `width_ps` in all pixels."""
    skew_ps: np.ndarray | None = None
    """(pixels,), delay of each pixel's electronics; None: none."""
    no_photon_code: int | None = None

    def intervals(
        self, scale: float = 0.0, uneven: float = 0.0, slow: tuple[float, float] = (0.0, 1.0)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Delays (1 or pixels, codes) that each code covers; the next sync ends the last one.

        `scale`: codes are longer by this share; `uneven`: share by which widths go up and down
        with eight codes; `slow`: by how much, and with which period, codes run ahead and fall
        behind, ps.
        """
        if self.edges_ps is None:
            ripple = uneven * np.cos(2.0 * np.pi * np.arange(self.n_codes) / 8.0)
            edges = self.width_ps * np.append(0.0, np.cumsum(1.0 + ripple))[None, :]
        else:
            edges = self.edges_ps
        edges = edges * (1.0 + scale) + slow[0] * np.sin(2.0 * np.pi * edges / slow[1])
        edges = np.minimum(edges, self.period_ps)
        near, far = edges[:, :-1], edges[:, 1:]
        return (self.period_ps - far, self.period_ps - near) if self.reversed else (near, far)


PERFECT = Clock()
BACKWARDS = Clock(reversed=True)


@cache
def pf32_clock(seed: int, shape: tuple[int, int] = (32, 32)) -> Clock:
    """1,024 reversed codes: gains 0.65 % rms, eight phases with 3 % of each pixel's own, delays
    within 300 ps, dead codes 0 .. 7 whose time the first live one takes up, 0 for no photon."""
    rng = np.random.default_rng([seed, 32])
    n, codes = shape[0] * shape[1], 1024
    phases = np.array(PF32_PHASES) + 0.03 * rng.normal(size=(n, 8))
    phases /= phases.mean(axis=1, keepdims=True)
    widths = phases[:, np.arange(codes) % 8]
    widths[:, 8] *= 1.8
    widths[:, :8] = 0.0
    gain = 55.06 * (1.0 + 0.0065 * rng.normal(size=(n, 1)))
    edges = np.concatenate([np.zeros((n, 1)), np.cumsum(widths, axis=1)], axis=1) * gain
    skew = rng.uniform(-300.0, 300.0, n)
    return Clock(codes, 55.0, 50_000.0, True, edges, skew, no_photon_code=0)
