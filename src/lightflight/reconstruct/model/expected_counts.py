"""What a pixel expects in its cells: pulses of its legs, other light and background."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.cells import Cells
from lightflight.reconstruct.model.pulse_shape import GAUSSIAN, Shape
from lightflight.reconstruct.model.second_pulse import Echo

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

Tails = Sequence[tuple[float, float]]
"""Shares of a pulse that are late by exponential waits of a mean, ps."""

_FLIGHT_STD = 0.03
"""By how much pulses with a tail may differ from pixel to pixel: half the variance that is more or
less than expected, in the pulse's own. Where it was 0.1, as free as the width of others
(`model.counted`), dim pixels lost a pulse's front."""
_TAPERS = 0.25
"""Of the background: other light below none takes so much of it in full, and twice that at most."""


@dataclass(frozen=True, eq=False)
class Pulses:
    """Where the light of the nearest legs is expected in n pixels; s legs at most in one.

    Attributes
    ----------
    late_ps : array of float, shape (n, s)
        Expected time after the pixel's reference, ps; NaN where there is no further leg.
    std_ps : array of float, shape (n, s)
        Expected standard deviation, ps.
    shape : Shape
        Of each of them.
    """

    late_ps: Floats
    std_ps: Floats
    shape: Shape = GAUSSIAN
    skewness: Floats | None = None
    """(n, s), third cumulant of the standardised pulse: what flight adds where time runs unevenly
    through the footprint. None: nothing, nor has it a fourth."""
    kurtosis: Floats | None = None
    """(n, s), its fourth: of flight through an active area with edges. None: nothing."""
    share: Floats | None = None
    """(n, s), of the pixel's light that of each, as far as the picture tells it. None: nothing is
    known of it."""
    flight_std: Floats | None = None
    """(n, s), what flight may add beside what is expected: of a Gaussian to ln `std_ps`, of another
    shape to its `flight`. None: nothing."""


class Expected(NamedTuple):
    """Unknowns (n, q), mean counts (n, m), their slopes by these (n, m, q) and by light (n, m)."""

    unknown: Floats
    mean: Floats
    slopes: Floats
    follow: Floats

    def back(self, before: Expected, worse: NDArray[np.bool_]) -> Expected:
        """As before where it was better."""
        if not worse.any():
            return self
        where = (worse.reshape(-1, *[1] * (one.ndim - 1)) for one in self)
        pairs = zip(where, before, self, strict=True)
        return Expected(*(np.where(at, old, new) for at, old, new in pairs))


def flight_std_of(pulses: Pulses) -> Floats:
    """(n, s), half the variance that flight may add beside what is expected, in the pulse's own."""
    doubt = 0.0 if pulses.flight_std is None else np.nan_to_num(pulses.flight_std)
    std: Floats = np.hypot(_FLIGHT_STD, np.broadcast_to(doubt, pulses.late_ps.shape))
    return std


def with_flight(pulses: Pulses, unknown: Floats) -> Shape:
    """The shape as pixels were fitted with it."""
    shape = pulses.shape
    return (
        shape if shape.is_gaussian else shape.with_more(unknown[:, -3:-2] * flight_std_of(pulses))
    )


def expected_counts(
    cells: Cells,
    late: Floats,
    std: Floats,
    unknown: Floats,
    pulses: Pulses,
    tails: Tails,
    other: Floats | float,
    beyond: Floats | None,
    second: Echo | None,
) -> Expected:
    """Mean counts for some unknowns."""
    width, s = cells.width_ps, late.shape[1]
    slopes = np.zeros((*width.shape, unknown.shape[1]))
    changes = bool(s) and not pulses.shape.is_gaussian
    drawn_out = with_flight(pulses, unknown) if changes else pulses.shape
    if beyond is not None:
        other = other + unknown[:, 2 * s, np.newaxis] * beyond
        slopes[:, :, 2 * s] = beyond
    light = np.zeros_like(width) + other
    for k in range(s):
        lit = np.flatnonzero(unknown[:, k] > 0.0)
        own = std[lit, k : k + 1] * np.exp(unknown[lit, -2:-1])
        place = late[lit, k : k + 1] + unknown[lit, s + k : s + k + 1]
        z, shape = (cells.edges_ps[lit] - place) / own, drawn_out.of(lit, k)
        uneven = _uneven(pulses, lit, k)
        come, density, bend, wider = pulse_at(z, own, shape, tails, uneven)
        if second is not None:
            again = pulse_at(
                z - second.later(cells.edges_ps[lit], place) / own,
                own,
                shape,
                tails,
                uneven,
            )
            come, density, bend, wider = (
                first + second.share * more
                for first, more in zip((come, density, bend, wider), again, strict=True)
            )
        photons = unknown[lit, k : k + 1]
        if changes:
            by_flight = photons * flight_std_of(pulses)[lit, k : k + 1]
            slopes[lit, :, -3] += by_flight * np.diff(wider, axis=1)
        share = np.diff(come, axis=1) * cells.live[lit]
        light[lit] += photons * share
        slopes[lit, :, k] = share
        slopes[lit, :, s + k] = -photons / own * np.diff(density, axis=1)
        slopes[lit, :, -2] += photons * np.diff(bend, axis=1)
    mean, follow, kept = _with_light(unknown[:, -1:] * width, light)
    slopes *= follow[:, :, np.newaxis]
    slopes[:, :, -1] = kept * width
    slopes *= (cells.live * cells.open_share)[:, :, np.newaxis]
    return Expected(unknown, mean * cells.open_share, slopes, follow)


def _with_light(background: Floats, light: Floats) -> tuple[Floats, Floats, Floats]:
    """Counts of background and light, and their slopes by light and by background (n, m).

    Other light may come out less than none, counts may not. What it takes away tapers off to half
    of the background, without an edge: the slope is the likelihood's everywhere.
    """
    lacks = np.divide(-light, background, out=np.zeros_like(background), where=background > 0.0)
    far = np.maximum(lacks / _TAPERS - 1.0, 0.0)
    follow = np.exp(-far)
    taken = _TAPERS * (2.0 - follow)
    mean = np.where(far > 0.0, background * (1.0 - taken), background + light)
    return mean, follow, np.where(far > 0.0, 1.0 - taken + follow * lacks, 1.0)


def _uneven(pulses: Pulses, lit: Indices, leg: int) -> tuple[Floats, Floats] | None:
    """Third and fourth cumulant of one leg's pulses, (k, 1) each."""
    if pulses.skewness is None or pulses.kurtosis is None:
        return None
    return pulses.skewness[lit, leg : leg + 1], pulses.kurtosis[lit, leg : leg + 1]


def pulse_at(
    z: Floats,
    std: Floats,
    shape: Shape,
    tails: Tails,
    uneven: tuple[Floats, Floats] | None = None,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Share F of a pulse before z, std dF/dt, dF/d ln std, and what flight adds (a Gaussian: 0).

    Late by an exponential wait w a pulse has F' = (Phi - F) / w. Whatever a Gaussian is drawn out
    by, d/d ln std = std^2 F'' (it spreads as heat does); another shape is stretched, waits and all.
    """
    changes = not shape.is_gaussian
    prompt, density = shape.at(z)
    if uneven is not None:
        # What waits keep back is of the second order in this.
        more = shape.unevenly(z, density, *uneven)
        prompt, density = prompt + more[0], density + more[1]
    wider = shape.widening(z) if changes else np.zeros_like(z)
    # Most of the work is of waits, and every search begins with shares of nothing.
    tails = [(share, wait) for share, wait in tails if share]
    if not tails:
        return prompt, density, -z * density, wider
    held = 1.0 - sum(share for share, _ in tails)
    come, slope, wider = held * prompt, held * density, held * wider
    bend = -z * slope
    for share, wait in tails:
        ratio = std / wait
        gone = shape.kept_back(z, ratio)
        come = come + share * (prompt - gone)
        slope = slope + share * ratio * gone
        spread = share * ratio * (density - ratio * gone)
        wider = wider + spread * changes
        bend = bend + (-z * share * ratio * gone if changes else spread)
    return come, slope, bend, wider
