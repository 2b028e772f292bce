"""Shapes of a pulse as the camera records it: Gaussian with a tail, or a measured curve.

A `Response` is a density over time. Pulses of that shape are fitted with four numbers, as
Gaussians are: place, width (the shape is stretched about its mean), photons and background.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from lightflight.histogram import Histograms
    from lightflight.timing.calibration import TimingCalibration

Floats = NDArray[np.float64]

_STEP = 0.02
"""Step of a tabulated shape, in its standard deviations."""

_LEAST_SHARE = 1e-7
"""A shape ends where less than this share of it is left."""

_FOOT = 1e-5
"""A measured curve ends where it is lost in the noise, or has fallen below this share."""

_FINE = 16
"""Points per code of a measured curve."""

_SAMPLE = 100
"""Pixels that are enough to find the shape of the array's pulse."""


@dataclass(frozen=True, eq=False)
class Response:
    """Density of a recorded pulse over time; its mean is the place of the pulse."""

    time_ps: Floats
    """(m,), ascending, ps; only differences matter."""

    density: Floats
    """(m,), not negative, in any unit; straight lines in between, nothing outside."""

    def __post_init__(self) -> None:
        time, density = (np.array(x, dtype=np.float64) for x in (self.time_ps, self.density))
        if time.ndim != 1 or time.shape != density.shape or len(time) < 3:
            raise ValueError(
                f"time_ps and density must be equally long, at least 3, got {time.shape} and "
                f"{density.shape}"
            )
        if not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
            raise ValueError("time_ps must be finite and ascend")
        if not (np.isfinite(density).all() and density.min() >= 0 and density.max() > 0):
            raise ValueError("density must be finite, not negative and not zero everywhere")
        for name, array in (("time_ps", time), ("density", density)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def with_tail(cls, *, std_ps: float, tail_ps: float, tail_share: float = 1.0) -> Response:
        """Gaussian of which a share is late by an exponential delay.

        (1 - q) G(t) + q (G * E)(t), E(t) = exp(-t / tail_ps) / tail_ps for t > 0 (diffusion of
        carriers in a SPAD; an exponentially modified Gaussian for q = 1).

        Raises ValueError where a width is not positive or the share not in 0 ... 1.
        """
        if not (std_ps > 0 and tail_ps > 0 and np.isfinite(std_ps + tail_ps)):
            raise ValueError(f"std_ps and tail_ps must be positive, got {std_ps} and {tail_ps}")
        if not 0 <= tail_share <= 1:
            raise ValueError(f"tail_share must lie within 0 ... 1, got {tail_share}")
        time = np.arange(-8.0 * std_ps, 8.0 * std_ps + 20.0 * tail_ps, 0.02 * std_ps)
        return cls(time, _density_with_tail(time, std_ps, tail_ps, tail_share))

    @classmethod
    def gaussian(cls, std_ps: float = 1.0) -> Response:
        """Gaussian, tabulated like any other shape."""
        time = np.linspace(-8.0, 8.0, 1601) * std_ps
        return cls(time, np.exp(-0.5 * (time / std_ps) ** 2))

    @classmethod
    def from_counts(cls, counts: ArrayLike, hist: Histograms) -> Response:
        """Measured curve, counted in the codes of a recording; its background is taken off.

        Parameters
        ----------
        counts : (codes,), counts of many pulses on the nominal codes of `hist`.

        Raises
        ------
        ValueError
            Wrong length, or no pulse in it.
        """
        from scipy.interpolate import CubicSpline

        from lightflight.timing.calibration import TimingCalibration

        heights = np.asarray(counts, dtype=np.float64)
        if heights.shape != (hist.n_codes,):
            raise ValueError(
                f"a measured response needs one count per code, ({hist.n_codes},), got shape "
                f"{heights.shape}"
            )
        if not np.isfinite(heights).all() or heights.min() < 0:
            raise ValueError("counts of a measured response must be finite and not negative")
        lower, upper = TimingCalibration.nominal(hist).code_intervals_ps([0], [0])
        live = np.flatnonzero(upper[0] > lower[0])
        live = live[np.argsort(lower[0, live])]
        heights = heights[live]
        level = float(np.median(heights))
        excess = heights - level
        peak = int(np.argmax(excess))
        if not excess[peak] > 0:
            raise ValueError("the measured response is flat: give a curve with a pulse in it")
        low = np.flatnonzero(excess < max(2.0 * np.sqrt(level + 1.0), _FOOT * excess[peak]))
        first = int(low[low < peak].max(initial=-1))
        last = int(low[low > peak].min(initial=len(excess)))
        inside = slice(max(first, 0), min(last + 1, len(excess)))
        edges = np.append(lower[0, live][inside], upper[0, live[inside][-1]])
        # A smooth curve that holds the counts of every code: codes are wide against the shape.
        held = np.append(0.0, np.cumsum(np.maximum(excess[inside], 0.0)))
        time = np.linspace(edges[0], edges[-1], _FINE * (len(edges) - 1) + 1)
        density = CubicSpline(edges, held, bc_type="clamped").derivative()(time)
        return cls(time, np.maximum(density, 0.0))

    @property
    def std_ps(self) -> float:
        """Standard deviation, ps."""
        return self._moments()[1]

    def _moments(self) -> tuple[float, float]:
        """Mean and standard deviation of the straight-line density, ps."""
        time = np.linspace(self.time_ps[0], self.time_ps[-1], 8 * len(self.time_ps))
        weight = np.interp(time, self.time_ps, self.density)
        mean = float(np.sum(time * weight) / weight.sum())
        return mean, float(np.sqrt(np.sum((time - mean) ** 2 * weight) / weight.sum()))

    def table(self) -> Floats:
        """(3, m): steps of 0.02 standard deviations from the mean, cumulated shape, density."""
        mean, std = self._moments()
        ends = (self.time_ps[[0, -1]] - mean) / std
        z = np.arange(np.floor(ends[0] / _STEP) - 1, np.ceil(ends[1] / _STEP) + 2) * _STEP
        density = np.interp(z * std + mean, self.time_ps, self.density, left=0.0, right=0.0)
        cumulated = np.append(0.0, np.cumsum(0.5 * _STEP * (density[1:] + density[:-1])))
        inside = (cumulated > _LEAST_SHARE * cumulated[-1]) & (
            cumulated < (1.0 - _LEAST_SHARE) * cumulated[-1]
        )
        first, last = np.flatnonzero(inside)[[0, -1]]
        kept = slice(max(first - 1, 0), last + 2)
        z, density = z[kept], density[kept]
        cumulated = np.append(0.0, np.cumsum(0.5 * _STEP * (density[1:] + density[:-1])))
        total = cumulated[-1]
        return np.stack([z, cumulated / total, density / total])


def _density_with_tail(time_ps: Floats, std_ps: float, tail_ps: float, share: float) -> Floats:
    """See `Response.with_tail`; the Gaussian's centre at zero."""
    from scipy.special import erfcx, ndtr

    gauss = np.exp(-0.5 * (time_ps / std_ps) ** 2)
    place = (std_ps / tail_ps - time_ps / std_ps) / np.sqrt(2.0)
    late = np.empty_like(time_ps)
    near = place > -4.0
    late[near] = 0.5 / tail_ps * gauss[near] * erfcx(place[near])
    far = time_ps[~near]
    late[~near] = np.exp(0.5 * (std_ps / tail_ps) ** 2 - far / tail_ps) / tail_ps
    late[~near] *= ndtr(far / std_ps - std_ps / tail_ps)
    return np.asarray((1.0 - share) * gauss / (std_ps * np.sqrt(2.0 * np.pi)) + share * late)


def tail_of_flat(flat: Histograms, *, timing: TimingCalibration) -> Response:
    """Gaussian with a tail that fits the pulses of a flat best: one ratio and share for all.

    Place, width, photons and background are each pixel's own; the least sum of Pearson's chi2
    over the brightest pixels decides.

    Raises NothingFoundError as `fit_pulses` does.
    """
    from scipy.optimize import minimize

    from lightflight.timing.pulses import fit_pulses

    first = fit_pulses(flat, timing=timing, max_pulses=1, response=Response.gaussian())
    photons = np.where(first.usable, first.photons, -1.0).reshape(flat.shape)
    least = np.sort(photons, axis=None)[-min(_SAMPLE, photons.size)]
    others = photons < max(least, 1.0)

    def with_tail(x: Floats) -> Response:
        return Response.with_tail(
            std_ps=1.0, tail_ps=float(np.exp(x[0])), tail_share=float(1.0 / (1.0 + np.exp(-x[1])))
        )

    def misfit(x: Floats) -> float:
        if abs(x[0]) > 3.0 or abs(x[1]) > 8.0:
            return np.inf
        fits = fit_pulses(
            flat, timing=timing, max_pulses=1, response=with_tail(x), exclude_mask=others
        )
        return float(np.nansum(fits.chi2[~others.ravel()]))

    starts = (np.array([0.7, -2.0]), np.array([0.0, 0.0]))
    options: Any = {"maxfev": 60, "xatol": 0.02, "fatol": 0.5}
    found = [minimize(misfit, x, method="Nelder-Mead", options=options) for x in starts]
    best = min(found, key=lambda one: float(one.fun))
    middle = float(np.median(first.std_ps[first.usable]))
    shape = with_tail(best.x)
    return Response(shape.time_ps * (middle / shape.std_ps), shape.density)
