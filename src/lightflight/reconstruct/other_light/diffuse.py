"""Diffuse light: its strengths from the counts, and the times of pulses without it.

Light that is late (haze, a tail of the response) draws a pulse out, a halo about the path and glare
over the picture lie under it. The strengths of all of these are linear in the counts,

    mean = sum_legs N [(1 - sum_i h_i) F + sum_i h_i F * E_i] + sum_j g_j G_j + b w,

F the pulse, E_i exponential waits, G_j the light of all legs spread over the picture. Each pixel's
own N, time, width and background are eliminated (A - C B^-1 C^T), so the strengths found tell
nothing that the times of pulses tell: those times follow the strengths by B^-1 C, and what is left
unknown of the strengths enters the path's fit as errors that all pulses share, with unit priors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.reconstruct.fit.fine import finely_lit, fitted_again, with_fine_light
from lightflight.reconstruct.fit.joint import (
    JointFit,
    fit_joint,
    moved_stds,
    pulse_std_in_view,
    pulse_std_ps,
    pulses_of_legs,
    refuse_run_away,
)
from lightflight.reconstruct.fit.membership import CLAIM_STDS
from lightflight.reconstruct.model import light
from lightflight.reconstruct.model.forward import LEAST_OWN_VARIANCE
from lightflight.reconstruct.model.pulse_shape import shape_of
from lightflight.reconstruct.model.second_pulse import Echo
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.spread import Beam
from lightflight.reconstruct.other_light.around import (
    Seen,
    alike,
    dark_group,
    pixels_about_path,
    pulses_expected,
)
from lightflight.reconstruct.other_light.lit_places import lit_places
from lightflight.reconstruct.other_light.second_path import places_of_path
from lightflight.reconstruct.other_light.strengths import (
    Known,
    Second,
    of_repeat,
)
from lightflight.reconstruct.other_light.twice import Asked, scattered, with_second

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_MOST_PATHS = 8
"""Most times that strengths are measured about a path that they have moved far."""
_MOST_SCATTER = 0.5
"""Of a pulse's width, what times may scatter by about a path of which other light is asked. Beside
other light they do by 0.15 at most, about a path of too few legs by 1.2."""
_FAR_STDS = 1.0
"""Pulses are told apart anew where the path moves by more than this many of its errors."""
_STILL_STDS = 0.2
"""With a mirror a path is settled once it moves by less of its errors than this."""
_LEAST_LIT = 1e-3
"""Of the brightest pixel's light: pixels that a leg is to give less hold none of its pulses."""
_CLEAR_OF_HALO = 3.0
"""Nor do those that it gives less than so many times the chance of the halo there. Their pulses
take up what chance adds to the halo, and not what it takes away: without this halos were two to
four errors too dim in four of 20 recordings (1,000 photons of halo, 10 to 50 of the leg)."""
_BESIDE_PX = ((1.5, 4.0), (10.0, np.inf))
"""So far from pixels on a leg's line others show its halo, and those that show none, px."""
_FEW_BESIDE = 20
"""Fewer pixels than this say nothing of a halo before it is fitted."""
_BEYOND_CHANCE = 3.0
"""Times the error of the difference of two medians: less is no halo."""
_MOST_DIM = 0.1
"""Of the brightest pixel's light: none is left out that holds more."""
_LEAST_SHARE = 0.5
"""A pulse is a leg's where at least this share of the light about it is."""
_STRETCHED = 0.3
"""Of what flight adds to the width of a pulse, its time may be off where it was stretched for it: a
tail that holds half of the light and lasts three times as long as the core makes 0.23."""
_CORE_STDS = 1.5
"""Half width of what counts as about a pulse, in its standard deviations."""
_GATE_STDS = 4.0
"""A pulse this near to the expected time is the one that was measured, in standard deviations."""
_MOST_LIGHT = 10.0
"""Of all counts: more in the picture is no path's."""
_LONGEST_PS = 1e6
"""A flight of 300 m is none that a picture shows, nor one that all cells of time could hold."""
_FAR_PX = 25.0
"""Light this far outside of the picture reaches it no more, px."""


@dataclass(frozen=True, eq=False)
class _Measured:
    """Times of the path's pulses with diffuse light at its place; n pixels, s legs each.

    Attributes
    ----------
    expected_ps : array of float, shape (n, s)
        When the light of the nearest legs should come, ps on the clock; NaN: no further leg.
    late_ps : array of float, shape (n, s)
        How much later it came.
    variance_ps2 : array of float, shape (n, s)
        Of that time.
    share : array of float, shape (n, s)
        Of the light about each pulse, that of its leg.
    diffuse : Diffuse
        What was found, with pixels, widths, and how the times follow it.
    """

    expected_ps: Floats
    late_ps: Floats
    variance_ps2: Floats
    share: Floats
    diffuse: light.Diffuse


def with_diffuse(fit: JointFit, setting: Setting, *, nominal: bool) -> JointFit:
    """The fit with the strengths of diffuse light free; as it was where those cannot be told.

    Parameters
    ----------
    fit : JointFit
        Of pulses as they were found.
    setting : Setting
        Camera, source, medium and waypoints.
    nominal : bool
        Whether the widths of the codes were never measured.

    Returns
    -------
    JointFit
        Of the same pulses, but for those that are mostly other light.
    """
    fit = with_fine_light(fit, setting)
    plain = list(fit.sightings)
    # About a leg that no pulse speaks for, or where light comes when none is expected, the light of
    # a path told wrong would be called diffuse.
    scatters = fit.floor_ps > _MOST_SCATTER * pulse_std_ps(plain)
    if scatters or not pulses_of_legs(fit).all():
        return fit
    try:
        far = False
        for _ in range(_MOST_PATHS):
            clear, strengths = without_diffuse(plain, fit, setting, nominal=nominal, stands=not far)
            found = [o.diffuse for o in clear if o.diffuse is not None]
            seconds = any(one.second is not None for one in found)
            much = any(one.strengths.most > light.MUCH for one in found)
            # Lines and brightness, too, without what is no leg's.
            shown = finely_lit(fit, clear, setting) if seconds or much else fit
            better = fitted_again(shown, clear, setting)
            moved = moved_stds(fit, better)
            far = moved > _FAR_STDS
            if far:
                again = fit_joint(clear, better.solution.state, setting, legs=None)
                better = with_fine_light(again, setting)
            refuse_run_away(better.solution.state, better.solution.rows)
            fit = replace(better, strengths=strengths, n_shown=fit.n_shown)
            # Images and halos follow the path and its brightness, which in turn follow them.
            if moved < (_STILL_STDS if seconds or much else _FAR_STDS):
                break
    except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
        return fit
    return fit


def without_diffuse(
    sightings: list[Sighting],
    fit: JointFit,
    setting: Setting,
    *,
    nominal: bool,
    stands: bool = False,
) -> tuple[list[Sighting], tuple[light.Strengths, ...]]:
    """The recordings with the times of the path's pulses as they are without diffuse light.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    fit : JointFit
        The path.
    setting : Setting
        Camera, source, medium and waypoints.
    nominal : bool
        Whether the widths of the codes were never measured.
    stands : bool, optional
        Whether the path is where it was, nearly, when light that comes twice was found.

    Returns
    -------
    sightings : list of Sighting
        Pulses that are mostly other light have no time; all others, errors that they share.
    strengths : tuple of Strengths
        Of each camera and clock.

    Raises
    ------
    NothingFoundError
        Where too few pixels show a whole pulse, or no strengths explain them.
    """
    found, strengths = list(sightings), []
    for whole, own in alike(found):
        std = pulse_std_in_view(found, whole.view)
        seen = pixels_about_path(whole, fit, own[0], std, claimed=True)
        so_far = fit.sightings[own[0]].diffuse
        about, least = seen.leg[:, 0] >= 0, _least_lit(so_far, seen, whole)
        reach = fit.pictures[own[0]].spot_std_px * np.sqrt(-2.0 * np.log(least))
        lit = np.flatnonzero(about & (seen.away_px[:, 0] < reach))
        # The wings of a spot are neither dark nor known well enough to be told from a halo.
        wing, far = np.flatnonzero(about & (seen.away_px[:, 0] >= reach)), np.flatnonzero(~about)
        if not len(lit):
            raise NothingFoundError("no usable pixel lies on the path")
        source_told = setting.source.position_mm is not None
        # Halo draws pulses out that are found without it: its light comes as those fitted with it.
        beam_std = std if so_far is None else so_far.beam.std_ps
        beam = beam_of_path(fit, own[0], whole, beam_std, source_told=source_told)
        dark = dark_group(whole, seen, lit, far, std, nominal)
        shape = shape_of(whole.timing.response)
        pulses = pulses_expected(seen.of(lit), shape)
        asked = Asked(whole, seen.of(lit), pulses, beam, dark, std, nominal)
        # What comes twice is told by photons on codes that were measured.
        sharp = whole.histograms.poisson and not nominal
        known = scattered(asked) if not sharp else with_second(
            asked,
            partial(places_of_path, fit, own[0], whole, source_told=source_told),
            so_far,
            fit.solution.cameras[whole.view],
            stands=stands,
        )  # fmt: skip
        if not known.settled:
            raise NothingFoundError("the strengths of diffuse light do not settle")
        strengths.append(known.strengths)
        for number in own:
            part, one = 1.0, known
            if len(own) > 1:
                # Each repeat by itself, in the light that all of them show.
                part = found[number].histograms.photons.sum() / whole.histograms.photons.sum()
                cells = asked.cells(found[number], known.second, known.lags_ps)
                one = of_repeat(known, cells, part)
            bright = asked.lit_by(known.second)
            bright = replace(
                bright, photons=part * bright.photons, std_ps=_std_as_fitted_ps(one, asked.seen)
            )
            clear = _doubting_stretched(_without_wings(found[number], seen.of(wing)), seen)
            found[number] = _corrected(clear, _measured(one, bright, part))
    return found, tuple(strengths)


def _least_lit(so_far: light.Diffuse | None, seen: Seen, whole: Sighting) -> float:
    """Of the brightest pixel's light, the least that a leg gives pixels which hold its pulses.

    `so_far`: the halo as it was found before; None: what pixels beside the legs count, of `seen`.
    """
    about = seen.of(np.flatnonzero(seen.leg[:, 0] >= 0))
    if so_far is not None:
        if not so_far.has_halo or not len(about.rows):
            return _LEAST_LIT
        halo = float(np.median(so_far.halo_photons(about.rows, about.cols, whole.blind.shape)))
        brightest = float(np.nanmax(so_far.photons))
    else:
        halo = _counted_beside(seen, whole.histograms.photons)
        brightest = float(np.nanmax(whole.arrivals.photons, initial=1.0))
    dim = _CLEAR_OF_HALO * np.sqrt(max(halo, 0.0)) / max(brightest, 1.0)
    return float(np.clip(dim, _LEAST_LIT, _MOST_DIM))


def _counted_beside(seen: Seen, photons: NDArray[np.unsignedinteger]) -> float:
    """What pixels beside the legs count more than those far off, beyond chance; photons."""
    about = seen.leg[:, 0] >= 0
    here, line = np.column_stack((seen.rows, seen.cols)), about & (seen.away_px[:, 0] < 1.0)
    if not line.any():
        return 0.0
    away = cKDTree(here[line]).query(here)[0]
    near, far = (
        photons[tuple(here[(away > low) & (away <= high)].T)].astype(np.float64)
        for low, high in _BESIDE_PX
    )
    if min(len(near), len(far)) < _FEW_BESIDE:
        return 0.0
    typical = np.median(near), np.median(far)
    error = np.sqrt(
        0.5 * np.pi * sum(m / len(of) for m, of in zip(typical, (near, far), strict=True))
    )
    return float(typical[0] - typical[1] - _BEYOND_CHANCE * error)


def _std_as_fitted_ps(known: Known, seen: Seen) -> float:
    """Typical standard deviation of pulses as fitted, without what flight adds to them, ps."""
    fitted = known.pixels.std_ps[:, 0] ** 2
    own = fitted
    if known.pixels.shape.is_gaussian:
        # Where the beam is wide, and not the lens, flight adds less than is thought.
        own = np.maximum(fitted - seen.flight_ps[:, 0] ** 2, LEAST_OWN_VARIANCE * fitted)
    return float(np.sqrt(np.median(own)))


def beam_of_path(
    fit: JointFit, number: int, whole: Sighting, std_ps: float, *, source_told: bool
) -> Beam:
    """Places along the legs, in the picture and about it, with the light that they give.

    Parameters
    ----------
    fit : JointFit
        The path.
    number : int
        The recording whose picture of the path is taken.
    whole : Sighting
        All recordings alike.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    source_told : bool
        Whether the path begins at its source, and not where it enters the view.

    Returns
    -------
    Beam
        Outside of the picture a leg is as bright as where it leaves it, and runs on.

    Raises
    ------
    NothingFoundError
        Where no leg is near the picture, or one runs away, or gives more light than the recording
        holds.
    """
    camera, index = fit.solution.cameras[whole.view], fit.solution.medium.return_group_index
    parts = []
    for of in lit_places(fit, number, whole, source_told=source_told, near_px=_FAR_PX):
        arrival = of.event_ps + camera.return_times_ps(of.points_mm, return_group_index=index)
        known = np.isfinite(of.row + of.col + arrival + of.photons)
        leg = np.full(len(known), of.leg)
        parts.append(tuple(x[known] for x in (of.row, of.col, leg, arrival, of.photons)))
    if not parts:
        raise NothingFoundError("no leg runs in the picture or near it")
    row, col, leg, arrival, photons = (np.concatenate(part) for part in zip(*parts, strict=True))
    if len(arrival) and np.ptp(arrival) > _LONGEST_PS:
        raise NothingFoundError("a leg runs away from the light of the others")
    beam = Beam(np.column_stack((row, col)), leg, arrival, photons, std_ps)
    # More light than there is: a leg's line is off its pixels, and bright by exp(400).
    shown = beam.sides(camera.shape) < 0
    if photons[shown].sum() > _MOST_LIGHT * whole.histograms.photons.sum(dtype=np.float64):
        raise NothingFoundError("the line of a leg lies beside its light")
    return beam


def _measured(known: Known, beam: Beam, part: float) -> _Measured:
    """Times of the path's pulses, the last step after those at which the pixels were fitted."""
    pixels, pulses, strengths = known.pixels, known.pulses, known.strengths
    beside, seen = known.beside, known.beside.seen
    s = pulses.late_ps.shape[1]
    own = slice(s, 2 * s)
    mine = beside.of_repeat(pixels.cells, part)
    spread, _, by_second = mine.other(strengths, known.second)
    taken = pixels.taken_of(mine.columns(pixels, strengths, by_second))[:, own]
    shift = np.nan_to_num(pixels.late_ps - pulses.late_ps) - taken @ known.step
    variance = np.diagonal(pixels.inverse[:, own, own], axis1=1, axis2=2)
    # Times were held near the expected ones by the pulse's width: that is no measurement.
    free = 1.0 / (1.0 - np.clip(variance / pulses.std_ps**2, 0.0, 0.999))
    root = np.linalg.cholesky(strengths.covariance)
    middle = 0.5 * (pixels.cells.edges_ps[:, 1:] + pixels.cells.edges_ps[:, :-1])
    about = np.abs(middle[:, np.newaxis] - np.nan_to_num(pixels.late_ps)[:, :, np.newaxis])
    core = about < _CORE_STDS * pixels.drawn_out_ps[:, :, np.newaxis]
    other = np.sum(core * np.abs(spread)[:, np.newaxis], axis=2)
    diffuse = light.Diffuse(
        known.told,
        beam,
        seen.rows,
        seen.cols,
        seen.leg,
        seen.arrival_ps + shift,
        pixels.photons,
        pixels.std_ps,
        (free[:, :, np.newaxis] * taken) @ root,
        second=_with_errors(known.second, strengths),
        shape=pixels.shape,
    )
    share = pixels.photons / np.maximum(pixels.photons + np.nan_to_num(other), 1e-9)
    return _Measured(seen.arrival_ps, shift * free, variance * free, share, diffuse)


def _with_errors(second: Second | None, strengths: light.Strengths) -> Second | None:
    """A second pulse with the covariance of its share and delay."""
    if not isinstance(second, Echo):
        return second
    return replace(second, covariance=strengths.covariance[-second.size :, -second.size :])


def _without_wings(sighting: Sighting, seen: Seen) -> Sighting:
    """The recording without the path's pulses in pixels that it hardly lights."""
    rows, pixel = sighting.pulses_in(sighting.usable_pulses, seen.rows, seen.cols)
    gap = np.abs(sighting.arrival_ps[rows, np.newaxis] - seen.arrival_ps[pixel])
    # Dim pulses of glare are wide, and claimed from as far off as their errors are large.
    claimed = CLAIM_STDS * sighting.arrivals.independent_std_ps[rows]
    gate = np.maximum(_GATE_STDS * seen.std_ps[pixel], claimed[:, np.newaxis])
    mine = (gap < gate).any(axis=1)
    time = sighting.arrival_ps.copy()
    time[rows[mine]] = np.nan
    return replace(sighting, arrival_ps=time)


def _doubting_stretched(sighting: Sighting, seen: Seen) -> Sighting:
    """The recording, errors of pulses that flight stretched and nobody measured anew as they are.

    Pulses are found with the response as it is, stretched to their width, tail and all: times are
    off by a part of what flight adds to them.
    """
    response = sighting.timing.response
    if response is None:
        return sighting
    table, asked = sighting.arrivals, np.zeros(sighting.blind.shape, dtype=bool)
    asked[seen.rows, seen.cols] = True
    flight2 = np.maximum(np.nan_to_num(table.std_ps) ** 2 - response.std_ps**2, 0.0)
    off = np.where(asked[table.row, table.col], 0.0, _STRETCHED * np.sqrt(flight2))
    return replace(
        sighting, arrivals=replace(table, photon_std_ps=np.hypot(table.photon_std_ps, off))
    )


def _corrected(sighting: Sighting, found: _Measured) -> Sighting:
    """The recording with the times of the path's pulses as measured."""
    arrivals, diffuse = sighting.arrivals, found.diffuse
    rows, pixel = sighting.pulses_in(sighting.usable_pulses, diffuse.rows, diffuse.cols)
    gap = np.abs(sighting.arrival_ps[rows, np.newaxis] - found.expected_ps[pixel])
    gap = np.where(gap < _GATE_STDS * diffuse.drawn_out_ps[pixel], gap, np.inf)
    slot = np.argmin(gap, axis=1)
    least = gap[np.arange(len(rows)), slot]
    # The nearest pulse of a pixel is the leg's; where two are, the other stays what it is.
    order = np.lexsort((least, slot, pixel))
    order = order[np.isfinite(least[order])]
    first = np.ones(len(order), dtype=bool)
    first[1:] = (np.diff(pixel[order]) != 0) | (np.diff(slot[order]) != 0)
    chosen = order[first]
    rows, at = rows[chosen], (pixel[chosen], slot[chosen])
    time, std = sighting.arrival_ps.copy(), arrivals.photon_std_ps.copy()
    width_ps = arrivals.std_ps.copy()
    clear = found.share[at] > _LEAST_SHARE
    time[rows] = np.where(clear, found.expected_ps[at] + found.late_ps[at], np.nan)
    std[rows] = np.sqrt(found.variance_ps2[at])
    # Other light had drawn them out: lines and brightness are measured with the path's own pulses.
    width_ps[rows] = diffuse.drawn_out_ps[at]
    time[_of_second_pulse(sighting, diffuse, rows)] = np.nan
    modes = np.zeros((len(time), diffuse.modes_ps.shape[2]))
    modes[rows] = diffuse.modes_ps[at]
    told = replace(
        arrivals,
        arrival_ps=np.where(np.isnan(time), arrivals.arrival_ps, time),
        photon_std_ps=std,
        std_ps=width_ps,
        shared_modes_ps=np.column_stack((arrivals.shared_modes_ps, modes)),
        shared_names=(*arrivals.shared_names, *light.LABELS, *_labels_of(diffuse.second)),
    )
    return replace(sighting, arrivals=told, arrival_ps=time, diffuse=diffuse)


def _of_second_pulse(sighting: Sighting, diffuse: light.Diffuse, legs: Indices) -> Indices:
    """Pulses, by row of the arrivals, that are a second one's; `legs` are the path's."""
    second = diffuse.second
    if not isinstance(second, Echo):
        return np.zeros(0, dtype=np.int64)
    rows = np.setdiff1d(sighting.usable_pulses, legs)
    rows, pixel = sighting.pulses_in(rows, diffuse.rows, diffuse.cols)
    table, period = sighting.arrivals, second.period_ps
    late = sighting.arrival_ps[rows, np.newaxis] - diffuse.arrival_ps[pixel] - second.delay_ps
    if period > 0.0:
        late -= period * np.rint(late / period)
    near = np.abs(late) < _GATE_STDS * diffuse.drawn_out_ps[pixel]
    brought = second.share * np.sum(near * diffuse.photons[pixel], axis=1)
    own: Indices = rows[brought > _LEAST_SHARE * table.photons[rows]]
    return own


def _labels_of(second: Second | None) -> tuple[str, ...]:
    """The unknowns of light that comes twice, in words."""
    if second is None:
        return ()
    if isinstance(second, Echo):
        return ("share of a second pulse", "its delay")
    legs = range(1, len(second.mirror.share) + 1)
    plane = ("mirror turned", "mirror turned across", "mirror nearer")
    return (*plane, *(f"image of leg {k}" for k in legs))
