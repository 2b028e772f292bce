"""Strengths of diffuse light from the counts, each pixel's own unknowns eliminated.

How long late light waits is free within the table's steps; a second path, where there is one, is
solved for with them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import NothingFoundError
from lightflight.path.verdict import FindingName
from lightflight.reconstruct.model import light
from lightflight.reconstruct.model.cells import Cells
from lightflight.reconstruct.model.counted import (
    Pixels,
    as_wide_as_seen,
    dark_pixels,
    light_of_second_pulse,
    lit_pixels,
)
from lightflight.reconstruct.model.expected_counts import Pulses, Tails
from lightflight.reconstruct.model.second_path import Images, SecondPath
from lightflight.reconstruct.model.second_pulse import Echo
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.model.spread import Beam, Spread, spread_light
from lightflight.reconstruct.other_light.around import Group, Seen

Floats = NDArray[np.float64]

MOST_ROUNDS = 30
"""Typically 3 without diffuse light, 12 where two waits share one tail."""
_STILL = 0.1
"""A round that moves the strengths by less than this many of their errors was the last."""
_NEARLY_STILL = 1.0
"""The same where no round is left: what is known of strengths to their errors is known, and the
path shares those errors."""
_ROUGHLY_STILL = 0.02
"""The same where only legs are found with them: shares that move by less."""
_LINEAR = 0.01
"""Strengths below this move times in proportion: pixels are not fitted again (error: a square)."""
_LONGEST = 0.3
"""Most that one strength moves in a round: far from its value a step in proportion is too long."""
_LEAST_STEP = 0.25
"""Of a whole step."""
_WORSE, _TIMES = 0.5, 10.0
"""A step went too far that leaves the counts less likely, twice the log, by this for each pixel, as
far as its own fit may be from its end, and so many times what it promised. Where light of less than
none meets dark cells that hold a photon, likelihoods fall as off a cliff, thirty times."""
_LEAST_PART = 0.01
"""Of a step that went too far: what no part of it betters is not told by the counts."""
_WAIT_STD = 0.6
"""How far mean waits may be from those of the table, ln: half of the way to the next one."""
_OUTSIDE_STD = 1.0
"""By how much light that runs on outside of the picture may be brighter than where it leaves it, as
a share: there may be none, or twice as much."""
_DARK = -1.0
"""Brighter than guessed by this share light there is none: a stop stands before the sensor."""
_TELLING = 0.01
"""Of the light: shares well below this leave how long they wait where the table has it. Waits of
light that is hardly there sway about each other for ever; what they do to a path is a hundredth."""
_WIDTHS = (0.3, 0.1, 0.03, 0.01, 0.003)
"""Of the prior of halo and glare, of the light: in half decades from what is plausible. All 30 %
larger, tips of `benchmarks/steep_tips.py` are 0.65 mm off for 0.67."""
_PATIENCE = 2
"""Rounds after which a second path is given up that cannot explain as much as is asked of it:
shares of light that is not there leave the plane free, and it wanders on and on. The first round
moves shares alone; from the second on it promises what a wall would bring (of 56 recordings with
walls of 0.1 to 10 %, and 20 with second pulses, none was given up that is found in the end)."""
_HOPES = 4.0
"""How many times as much as a round promises may still come, where it is asked whether any can."""


Second = SecondPath | Echo
"""Light that comes a second time: by way of a mirror, or of another pulse."""


class Other(NamedTuple):
    """Counts of light that is no leg's in n pixels.

    Attributes
    ----------
    counts : array of float, shape (n, m)
    beyond : array of float, shape (n, m), or None
        Of these, images of what the picture does not show; None: there are none.
    by_second : array of float, shape (n, m, k)
        How they follow the second light's unknowns.
    """

    counts: Floats
    beyond: Floats | None
    by_second: Floats


@dataclass(frozen=True, eq=False)
class Beside:
    """Pixels (n,), their cells, and the halo and glare there.

    Attributes
    ----------
    seen : Seen
        Asked for where a second path shows alone.
    cells : Cells
    spread : Spread or None
        Counts of halo and glare; None: there are none, and nobody asks.
    """

    seen: Seen
    cells: Cells
    spread: Spread | None

    def other(
        self, strengths: light.Strengths, second: Second | None, images: Images | None = None
    ) -> Other:
        """Light that is no leg's; `images` are those of the second path, where drawn already."""
        spread = np.zeros_like(self.cells.counts)
        if self.spread is not None:
            spread = self.spread.counts(strengths.wide, strengths.outside)
        if not isinstance(second, SecondPath):
            # That of a second pulse is the legs', which their pixels fit with the rest of it.
            size = 0 if second is None else second.size
            return Other(spread, None, np.zeros((*spread.shape, size)))
        seen = self.seen
        more, beyond, columns = second.light(
            self.cells, seen.rows, seen.cols, seen.arrival_ps[:, 0], images
        )
        return Other(spread + more, beyond if beyond.any() else None, columns)

    def of_repeat(self, cells: Cells, part: float) -> Beside:
        """The same pixels in the cells of a repeat that holds `part` of the light."""
        spread = None if self.spread is None else self.spread.times(part)
        return replace(self, cells=cells, spread=spread)

    def columns(self, pixels: Pixels, strengths: light.Strengths, by_second: Floats) -> Floats:
        """How the counts of lit pixels follow all unknowns (n, m, k): strengths, second light."""
        own = light.diffuse_light(pixels, self.spread, strengths)
        if pixels.second is not None:
            by_second = light_of_second_pulse(pixels, pixels.second, strengths.tails)
        return np.concatenate((own, by_second), axis=2) * pixels.follow[:, :, np.newaxis]


def beside_in(whole: Sighting, seen: Seen, cells: Cells, beam: Beam) -> Beside:
    """Halo and glare in cells of some pixels."""
    points, reference = np.column_stack((seen.rows, seen.cols)), seen.arrival_ps[:, 0]
    return Beside(seen, cells, spread_light(cells, points, reference, beam, whole.blind.shape))


def beside_dark(whole: Sighting, dark: Group | None, beam: Beam) -> Beside | None:
    """The same in pixels that no leg lights."""
    if dark is None:
        return None
    rows, cols = dark.points_px.T
    no_leg, reference = np.full((len(rows), 1), -1), dark.reference_ps[:, np.newaxis]
    seen = Seen(rows, cols, no_leg, reference, *np.ones((7, *reference.shape)))
    return beside_in(whole, seen, dark.pixels.cells, beam)


@dataclass(frozen=True, eq=False)
class Known:
    """Strengths as found, with the pixels as they were fitted last.

    Attributes
    ----------
    strengths : Strengths
        Of diffuse light; the covariance also of the second light's unknowns.
    second : SecondPath, Echo or None
    pixels : Pixels
        Those that the legs light.
    dark : Group or None
        Those that they do not.
    step : array of float, shape (k,)
        Of all unknowns, since the pixels were fitted.
    settled : bool
        Whether a further round would move them no more.
    dispersion : float
        Variance of counts over that of Poisson's.
    pulses : Pulses
        Where and how wide light was expected when the pixels were fitted.
    beside : Beside
        What else they see.
    ahead : float
        What that step still takes off the deviance.
    lags_ps : array of float, shape (m + 1,), or None
        Edges of their cells; None: as their second light asks for.
    """

    strengths: light.Strengths
    second: Second | None
    pixels: Pixels
    dark: Group | None
    step: Floats
    settled: bool
    dispersion: float
    pulses: Pulses
    beside: Beside
    ahead: float = 0.0
    lags_ps: Floats | None = None

    @property
    def told(self) -> light.Strengths:
        """Strengths as they are likeliest, for whoever takes that light off as known.

        Halo and glare that counts cannot tell from the legs' own light are as large as a weak prior
        lets chance make them. How wide the prior of these is the counts say: a mean over widths by
        their evidence, all else held as it was.
        """
        prior = _precision(self.strengths.value, self.second, rough=False)
        total = np.linalg.inv(self.strengths.covariance)
        score, told = total @ _unknown(self.strengths.value, self.second), total - np.diag(prior)
        means, evidence = [], []
        for width in _WIDTHS:
            held = prior.copy()
            held[light.WIDE] = width**-2.0
            here = told + np.diag(held)
            means.append(np.linalg.solve(here, score))
            volume = np.linalg.slogdet(here)[1] - np.log(held).sum()
            evidence.append(0.5 * float(score @ means[-1]) - 0.5 * volume)
        weight = np.exp(np.array(evidence) - max(evidence))
        mean = weight @ np.array(means) / weight.sum()
        return replace(self.strengths, value=mean[: len(light.LABELS)])

    def misfit(self) -> float:
        """Deviance of the counts: twice what the log-likelihood lacks, up to a constant."""
        return _misfit(self.pixels, self.dark)


def _misfit(pixels: Pixels, dark: Group | None) -> float:
    return sum(
        2.0 * float(np.sum(mean - counts * np.log(mean)))
        for each in ([pixels] if dark is None else [pixels, dark.pixels])
        for mean, counts in [(x[each.weight > 0.0] for x in (each.mean, each.cells.counts))]
    )


def strengths_of(
    pulses: Pulses,
    beside: Beside,
    dark: Group | None,
    unlit: Beside | None,
    second: Second | None = None,
    *,
    dispersion: float = 1.0,
    rough: bool = False,
    most_misfit: float = np.inf,
    most_rounds: int = MOST_ROUNDS,
    to_the_end: bool = False,
) -> Known:
    """Strengths of diffuse light, and of light that comes a second time if there is any.

    Parameters
    ----------
    pulses : Pulses
        Where the light of the legs is expected.
    beside : Beside
        The pixels that they light.
    dark : Group or None
        Pixels that they do not.
    unlit : Beside or None
        Halo and glare in those.
    second : SecondPath or Echo, optional
        Where its mirror is, or when it comes, roughly.
    dispersion : float, optional
        Variance of counts over that of Poisson's.
    rough : bool, optional
        Whether no time will be measured with them: pulses stay where they were found, waits of
        little light are as free as those of much, and shares need not stand as still.
    most_misfit : float, optional
        Where no round to come can bring the deviance below this, none follows: not settled.
    most_rounds : int, optional
        1: the pixels are fitted without other light, and no more.
    to_the_end : bool, optional
        Whether pixels are fitted with strengths that are small, too: who is compared with others by
        the deviance may not lack what they gain by narrower pulses.

    Returns
    -------
    Known
        Unknowns in the order of `light.LABELS`, then those of the second light.
    """
    size = len(light.LABELS)
    value: Floats = np.zeros(size)
    before = step = np.zeros(size + (0 if second is None else second.size))
    best = _round(value, second, pulses, beside, dark, unlit, dispersion, rough)
    damping, part, moved = 1.0, 1.0, 0.0
    settled = anew = False
    for number in range(most_rounds):
        if number:
            here = _round(value, second, pulses, beside, dark, unlit, dispersion, rough, best)
            most = best.lacks + _WORSE * len(pulses.late_ps) + _TIMES * moved
            if here.lacks > most and not anew:
                # Expected otherwise, counts are less likely without a step: it is asked alone then.
                anew = best.pulses is not pulses
                part = 0.0 if anew else _LEAST_STEP * part
                value, second = best.on(part * step)
                if not anew and part < _LEAST_PART:
                    break
                continue
            best, part = here, 1.0
        total = best.information + np.diag(best.prior)
        whole = _step(total, best.score - best.prior * best.unknown, value)
        moved = float(whole @ total @ whole)
        # A shape's width and what flight adds to it sway about each other: half as far, then.
        swayed = float(before @ total @ whole) < 0.0
        damping = max(0.5 * damping, _LEAST_STEP) if swayed else min(1.4 * damping, 1.0)
        before = whole
        step = damping / max(1.0, _length(whole, second)) * whole
        value, second = best.on(step)
        shares = light.Strengths(value, best.strengths.covariance)
        small = second is None and shares.most < _LINEAR and not to_the_end
        still = moved < (_STILL if number < most_rounds - 1 else _NEARLY_STILL) ** 2
        if rough:
            still = np.abs(whole[: light.N_LATE]).max() < _ROUGHLY_STILL
        alike, changed = as_wide_as_seen(pulses, best.pixels)
        settled = bool((small and not changed) or still)
        misfit = _misfit(best.pixels, best.dark)
        hopeless = number >= _PATIENCE and misfit - _HOPES * moved > most_misfit
        if settled or hopeless:
            break
        # Of pulses with tails the width of a Gaussian is not that of their core.
        wider = float(np.log(np.nanmedian((best.pixels.std_ps / pulses.std_ps)[:, 0])))
        late = best.pixels.late_ps if rough else pulses.late_ps
        if not anew:
            pulses = replace(alike, late_ps=late, std_ps=pulses.std_ps * np.exp(damping * wider))
        anew = False
        if second is not None:
            second = second.of_width(float(np.median(best.pixels.std_ps[:, 0])))
    covariance: Floats = np.linalg.inv(total).astype(np.float64, copy=False)
    found = light.Strengths(value, covariance)
    return Known(
        found, second, best.pixels, best.dark, step, settled, dispersion, best.pulses, beside, moved
    )


@dataclass(frozen=True, eq=False)
class _Round:
    """The pixels fitted for some strengths, and what they say.

    Attributes
    ----------
    strengths : Strengths
        Without a covariance.
    second : SecondPath, Echo or None
    pulses : Pulses
    pixels : Pixels
    dark : Group or None
    score : array of float, shape (k,)
        Slope of the likelihood by all unknowns.
    information : array of float, shape (k, k)
    prior : array of float, shape (k,)
        Precision of what is known of them beforehand.
    lacks : float
        Twice what the log of likelihood and priors lacks, up to a constant.
    """

    strengths: light.Strengths
    second: Second | None
    pulses: Pulses
    pixels: Pixels
    dark: Group | None
    score: Floats
    information: Floats
    prior: Floats
    lacks: float

    @property
    def unknown(self) -> Floats:
        """(k,), values of all unknowns."""
        return _unknown(self.strengths.value, self.second)

    def on(self, step: Floats) -> tuple[Floats, Second | None]:
        """Strengths and second light a step (k,) further; no darker than dark."""
        size = len(light.LABELS)
        value = self.strengths.value + step[:size]
        value[light.OUTSIDE] = np.maximum(value[light.OUTSIDE], _DARK)
        return value, None if self.second is None else self.second.moved(step[size:])


def _step(total: Floats, pull: Floats, value: Floats) -> Floats:
    """(k,), the whole step; where it is dark outside of the picture it gets no darker."""
    dark = np.flatnonzero(value <= _DARK)
    dark = dark[(dark >= light.OUTSIDE.start) & (dark < light.OUTSIDE.stop) & (pull[dark] < 0.0)]
    free = np.setdiff1d(np.arange(len(pull)), dark)
    step = np.zeros(len(pull))
    step[free] = np.linalg.solve(total[np.ix_(free, free)], pull[free])
    return step


def _round(
    value: Floats,
    second: Second | None,
    pulses: Pulses,
    beside: Beside,
    dark: Group | None,
    unlit: Beside | None,
    dispersion: float,
    rough: bool,
    last: _Round | None = None,
) -> _Round:
    """Lit and dark pixels fitted, and what they say of all unknowns."""
    size = len(light.LABELS)
    now = light.Strengths(value, np.zeros((size, size)))
    free = np.arange(size, size + (0 if second is None else second.size))
    lit = np.append(light.OF_PULSES if beside.spread is None else np.arange(size), free)
    score, information = np.zeros(size + len(free)), np.zeros((size + len(free),) * 2)
    # The images fall on lit pixels and on dark ones: they are drawn once for both.
    images = second.images() if isinstance(second, SecondPath) else None
    other = beside.other(now, second, images)
    pixels = lit_pixels(
        beside.cells, pulses, dispersion=dispersion, tails=now.tails, other=other.counts,
        beyond=other.beyond, second=_pulse_of(second), last=None if last is None else last.pixels,
    )  # fmt: skip
    said = pixels.said_of(beside.columns(pixels, now, other.by_second))
    score[lit], information[np.ix_(lit, lit)] = said[:2]
    prior = _precision(value, second, rough=rough)
    lacks = float(pixels.lacks.sum() + prior @ _unknown(value, second) ** 2)
    if dark is not None and unlit is not None and unlit.spread is not None:
        other = unlit.other(now, second, images)
        empty = dark_pixels(
            unlit.cells, dispersion=dispersion, other=other.counts, beyond=other.beyond
        )
        by_spread = unlit.spread.columns(now.wide, now.outside)
        columns = np.concatenate((by_spread, other.by_second), axis=2)
        said = empty.said_of(columns * empty.follow[:, :, np.newaxis])
        in_dark = np.append(light.OF_SPREAD, free)
        score[in_dark] += said[0]
        information[np.ix_(in_dark, in_dark)] += said[1]
        lacks += float(empty.lacks.sum())
        dark = replace(dark, pixels=empty)
    return _Round(now, second, pulses, pixels, dark, score, information, prior, lacks)


def _unknown(value: Floats, second: Second | None) -> Floats:
    """(k,), values of strengths and of the second light's unknowns."""
    return value if second is None else np.append(value, second.value)


def _pulse_of(second: Second | None) -> Echo | None:
    """What comes with every pulse of a pixel."""
    return second if isinstance(second, Echo) else None


def tails_of(cells: Cells, pulses: Pulses) -> tuple[Tails, Pixels]:
    """Shares that are late and their mean waits, of pixels that each show a pulse of their own.

    Parameters
    ----------
    cells : Cells
        Their counts.
    pulses : Pulses
        Where the pulses are, roughly.

    Returns
    -------
    tails : Tails
    pixels : Pixels
        As they were fitted last.

    Raises
    ------
    NothingFoundError
        Where no tails explain the counts.
    """
    # Which pixels these are is asked of light that others send to them: there is none here.
    nowhere, none = np.zeros(0, dtype=np.int64), np.zeros((0, 1))
    seen = Seen(nowhere, nowhere, none.astype(np.int64), *[none] * 8)
    own = Beside(seen, cells, None)
    known = strengths_of(pulses, own, None, None, rough=True)
    if not known.settled:
        raise NothingFoundError("the shares of late light do not settle")
    return known.strengths.tails, known.pixels


def _precision(value: Floats, second: Second | None, *, rough: bool) -> Floats:
    """Of what would surprise nobody: the same for all kinds of diffuse light, and for shares."""
    prior = np.full(len(value), PLAUSIBLE[FindingName.HAZE].size ** -2.0)
    here = value[: light.N_LATE] ** 2
    freedom = 1.0 if rough else (here + 1e-8) / (here + _TELLING**2)
    prior[light.WAITS] = (_WAIT_STD * freedom) ** -2.0
    prior[light.OUTSIDE] = _OUTSIDE_STD**-2.0
    return prior if second is None else np.append(prior, second.precision)


def _length(step: Floats, second: Second | None) -> float:
    """Of a step, in the longest that its parts may be."""
    free = 0 if second is None else second.size
    longest = np.full(len(step), _LONGEST)
    longest[light.OUTSIDE] = _OUTSIDE_STD
    if second is not None:
        longest[len(step) - free :] = second.longest
    return float(np.abs(step / longest).max())


def of_repeat(known: Known, cells: Cells, part: float) -> Known:
    """One repeat, in the light that all of them show: `part` of it."""
    second = None if known.second is None else known.second.times(part)
    mine = known.beside.of_repeat(cells, part)
    other = mine.other(known.strengths, second)
    pixels = lit_pixels(
        cells,
        known.pulses,
        dispersion=known.dispersion,
        tails=known.strengths.tails,
        other=other.counts,
        beyond=other.beyond,
        second=_pulse_of(second),
    )
    return replace(known, second=second, pixels=pixels, step=np.zeros_like(known.step))


def scatter_of(pixels: Pixels) -> float:
    """Variance of counts over their mean, where the fit of the pixels leaves it; 1: photons."""
    telling = pixels.cells.live & (pixels.weight > 0.0)
    squared = pixels.weight * (pixels.cells.counts - pixels.mean) ** 2
    left = telling.sum(axis=1) - pixels.slopes.shape[2]
    bright = (left > 0) & (pixels.photons[:, 0] > np.median(pixels.photons[:, 0]))
    # By the median: a pixel with a pulse of its own does not say how counts scatter.
    ratio = np.sum(squared * telling, axis=1)[bright] / left[bright]
    return max(float(np.median(ratio)), 1e-12) if bright.any() else 1.0
