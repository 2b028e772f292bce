"""Shapes of a pulse as the camera records it: Gaussian with a tail, or a measured curve.

A `Response` is a density over time. Pulses of that shape are fitted with four numbers, as
Gaussians are: place, width (the shape is stretched about its place), photons and background.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_STEP = 0.02
"""Step of a tabulated shape, in its standard deviations."""

_LEAST_SHARE = 1e-7
"""A shape ends where less than this share of it is left."""

_WIDER = 0.25
"""Flight through a pixel's footprint widens a pulse by about this much, in its standard deviations
(twice as much moves no anchor by 1 % of them)."""

_BACKGROUND = 1e-3
"""Background below a pulse, of its highest density: without it the feet would decide."""

_REACH = 30.0
"""Standard deviations about the mean within which a shape is looked at for its anchor."""


@dataclass(frozen=True, eq=False)
class Response:
    """Density of a recorded pulse over time.

    Attributes
    ----------
    time_ps : array of float, shape (m,)
        Ascending, ps.
    density : array of float, shape (m,)
        Not negative, in any unit; straight lines in between, nothing outside.
    place_ps : float or None
        Which time is the place of the pulse, and stays where it is when the shape is stretched;
        None: the mean.
    """

    time_ps: Floats

    density: Floats

    place_ps: float | None = field(default=None, kw_only=True)

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

        Parameters
        ----------
        std_ps : float
            Standard deviation of the Gaussian G, ps.
        tail_ps : float
            Mean delay of those that are late, ps.
        tail_share : float, optional
            q, 0 to 1.

        Returns
        -------
        Response
            Tabulated in steps of 0.02 `std_ps`.

        Raises
        ------
        ValueError
            Where a width is not positive or the share not in 0 ... 1.
        """
        if not (std_ps > 0 and tail_ps > 0 and np.isfinite(std_ps + tail_ps)):
            raise ValueError(f"std_ps and tail_ps must be positive, got {std_ps} and {tail_ps}")
        if not 0 <= tail_share <= 1:
            raise ValueError(f"tail_share must lie within 0 ... 1, got {tail_share}")
        time = np.arange(-8.0 * std_ps, 8.0 * std_ps + 20.0 * tail_ps, 0.02 * std_ps)
        return cls(time, _density_with_tail(time, std_ps, tail_ps, tail_share))

    @classmethod
    def gaussian(cls, std_ps: float = 1.0) -> Response:
        """Gaussian, tabulated like any other shape.

        Parameters
        ----------
        std_ps : float, optional
            Its standard deviation, ps.

        Returns
        -------
        Response
            Out to 8 standard deviations.

        Examples
        --------
        >>> round(Response.gaussian(60.0).std_ps, 2)
        60.0
        """
        time = np.linspace(-8.0, 8.0, 1601) * std_ps
        return cls(time, np.exp(-0.5 * (time / std_ps) ** 2))

    @property
    def std_ps(self) -> float:
        """Standard deviation, ps."""
        return self._moments()[1]

    def _moments(self) -> tuple[float, float]:
        """Mean and standard deviation of the straight-line density, ps."""
        # Straight lines between few points: finer steps make sums as good as integrals.
        time = np.linspace(self.time_ps[0], self.time_ps[-1], 8 * len(self.time_ps))
        weight = np.interp(time, self.time_ps, self.density)
        mean = float(np.sum(time * weight) / weight.sum())
        return mean, float(np.sqrt(np.sum((time - mean) ** 2 * weight) / weight.sum()))

    def anchored(self) -> Response:
        """The same shape, placed where pulses seem to stand that something else has widened.

        Flight through a footprint widens a pulse as a Gaussian does, and leaves its tail; a fit
        stretches the whole shape, and its mean lags: by 1.9 ps where a fifth of a pixel's flight
        is added to a tail of a quarter of the light. To first order of what is added, a fit by
        weighted least squares is a shift and a stretch; one point of the shape stays.

        Returns
        -------
        Response
            With `place_ps`; a symmetric shape: its middle.
        """
        from scipy.ndimage import gaussian_filter1d

        mean, std = self._moments()
        z = np.arange(-_REACH, _REACH, _STEP)
        density = np.interp(z * std + mean, self.time_ps, self.density, left=0.0, right=0.0)
        # A measured curve has corners: all that follows is of one smoothed by half as much.
        density = gaussian_filter1d(density, 0.5 * _WIDER / _STEP)
        wider = gaussian_filter1d(density, _WIDER / _STEP) - density
        shift, stretch = (-np.gradient(x, _STEP) for x in (density, z * density))
        weight = 1.0 / np.sqrt(density + _BACKGROUND * density.max())
        flat = np.ones_like(z)
        columns = np.stack([shift, stretch, density, flat], axis=1) * weight[:, np.newaxis]
        by, wider_by = np.linalg.lstsq(columns, wider * weight)[0][:2]
        return replace(self, place_ps=mean - std * float(by / wider_by))

    def table(self) -> Floats:
        """The shape as pulse fits take it, in its own standard deviations from its place.

        Returns
        -------
        array of float, shape (3, m)
            Steps of 0.02 standard deviations, the share before each, and density.
        """
        mean, std = self._moments()
        place = mean if self.place_ps is None else self.place_ps
        ends = (self.time_ps[[0, -1]] - place) / std
        z = np.arange(np.floor(ends[0] / _STEP) - 1, np.ceil(ends[1] / _STEP) + 2) * _STEP
        density = np.interp(z * std + place, self.time_ps, self.density, left=0.0, right=0.0)
        cumulated = np.append(0.0, np.cumsum(0.5 * _STEP * (density[1:] + density[:-1])))
        inside = (cumulated > _LEAST_SHARE * cumulated[-1]) & (
            cumulated < (1.0 - _LEAST_SHARE) * cumulated[-1]
        )
        first, last = np.flatnonzero(inside)[[0, -1]]
        # Long feet of nothing would only widen the window that every pulse is fitted in.
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
    # erfcx grows like exp(x^2) to the left, where exp and ndtr by themselves are safe.
    near = place > -4.0
    late[near] = 0.5 / tail_ps * gauss[near] * erfcx(place[near])
    far = time_ps[~near]
    late[~near] = np.exp(0.5 * (std_ps / tail_ps) ** 2 - far / tail_ps) / tail_ps
    late[~near] *= ndtr(far / std_ps - std_ps / tail_ps)
    return np.asarray((1.0 - share) * gauss / (std_ps * np.sqrt(2.0 * np.pi)) + share * late)
