"""A TDC array in twenty lines: true code edges, and Poisson counts of uniform light or pulses.

Written apart from the package's own twin, so that the calibration is tested against a second
account of the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from lightflight.recording.histograms import Histograms

PERIOD_PS = 50_000.0
PF32_PATTERN = (1.036, 0.922, 0.990, 1.096, 0.968, 0.982, 0.936, 1.069)


@dataclass(frozen=True)
class FakeClock:
    lower: np.ndarray  # (n, codes) ps after the sync
    upper: np.ndarray
    width_ps: np.ndarray  # (n,)
    phases: np.ndarray  # (n, n_phases), mean 1
    skew_ps: np.ndarray  # (n,)
    shape: tuple[int, int]
    reversed_codes: bool
    nominal_ps: float

    def histograms(self, counts, **metadata):
        given = {
            "bin_width_ps": self.nominal_ps,
            "laser_period_ps": PERIOD_PS,
            "reversed_codes": self.reversed_codes,
            "no_photon_code": 0 if self.lower.shape[1] == 1024 else None,
        }
        return Histograms(counts.reshape(*self.shape, -1), **(given | metadata))

    def uniform(self, rng, photons, **metadata):
        mean = np.broadcast_to(photons, self.width_ps.shape)[:, None] / PERIOD_PS
        return self.histograms(rng.poisson(mean * (self.upper - self.lower)), **metadata)

    def pulse(self, rng, arrival_ps, photons, *, std_ps=70.0, background=0.2, **metadata):
        center = (np.asarray(arrival_ps) + self.skew_ps)[:, None]

        def share_before(time):
            return sum(ndtr((time - center + turn * PERIOD_PS) / std_ps) for turn in (-1, 0, 1))

        mean = photons * (share_before(self.upper) - share_before(self.lower))
        mean = mean + background * photons * (self.upper - self.lower) / PERIOD_PS
        return self.histograms(rng.poisson(mean), **metadata)


def fake_clock(
    rng,
    shape=(16, 16),
    *,
    n_codes=1024,
    width_ps=55.2,
    gain_std=0.0065,
    pattern=PF32_PATTERN,
    own_std=0.03,
    first_live=8,
    start=(0.76, 0.52, 0.13),
    start_std=0.0,
    lost=False,
    reversed_codes=True,
    trend=0.0,
    near_end=None,
    free_std=0.0,
    skew_ps=300.0,
):
    """Draw an array. `start`: excess of the first live codes; `lost`: dead time gets no code;
    `trend`: relative change of widths over all codes; `near_end`: width from codes to the end."""
    n = shape[0] * shape[1]
    phases = np.asarray(pattern) + own_std * rng.normal(size=(n, len(pattern)))
    phases = phases / phases.mean(axis=1, keepdims=True)
    width = width_ps * (1.0 + gain_std * rng.normal(size=n))
    code = np.arange(n_codes)
    plain = phases[:, code % len(pattern)] * (1.0 + trend * (code / 900.0 - 0.5))
    plain = plain * np.maximum(1.0 + free_std * rng.normal(size=plain.shape), 0.1)
    if near_end is not None:
        end = PERIOD_PS / width + (0.0 if lost else first_live - sum(start))
        plain = plain * near_end(end[:, None] - code - 0.5)
    widths = plain.copy()
    for i, excess in enumerate(start):
        widths[:, first_live + i] *= 1.0 + excess
    if start:
        widths[:, first_live] += start_std * rng.normal(size=n)
    widths[:, :first_live] = 0.0
    edges = np.concatenate([np.zeros((n, 1)), np.cumsum(widths, axis=1)], axis=1)
    if lost:
        edges += (plain[:, :first_live].sum(1) - (widths - plain)[:, first_live:].sum(1))[:, None]
    edges = np.minimum(edges * width[:, None], PERIOD_PS)
    lower, upper = edges[:, :-1], edges[:, 1:]
    if reversed_codes:
        lower, upper = PERIOD_PS - upper, PERIOD_PS - lower
    skew = rng.uniform(-skew_ps, skew_ps, n)
    return FakeClock(lower, upper, width, phases, skew, shape, reversed_codes, 55.0)
