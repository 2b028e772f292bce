"""Legs that lost all their pulses: which cause would give them back?

Where something told is far off (water told as air) the fit may keep two legs and place the third
where none of its light can be. Tests of the pulses that are left see nothing of it: what is wrong
lies in those that are not. So each cause is freed within its plausible size in a fit of its own,
from the legs in the picture.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import NothingFoundError
from lightflight.path.verdict import FindingName
from lightflight.reconstruct.fit.joint import (
    JointFit,
    as_found,
    pulse_std_in_view,
    pulses_of_legs,
)
from lightflight.reconstruct.fit.least_squares import OUTLIER
from lightflight.reconstruct.fit.membership import off_light_ps
from lightflight.reconstruct.fit.pictures import as_shown
from lightflight.reconstruct.fit.result import explained_by_fit
from lightflight.reconstruct.legs.direction import legs_in_all_pictures
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import freed
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.trials.outcome import NoFit, fit_or_reason
from lightflight.reconstruct.trials.revise import fit_from_legs
from lightflight.reconstruct.verdict.evidence import Evidence
from lightflight.reconstruct.verdict.geometry_tests import REMEDIES, counted_ps

Floats = NDArray[np.float64]

_NUMBERS = {
    FindingName.INDEX: 2,
    FindingName.FOCAL_LENGTH: 1,
    FindingName.DISTORTION: 1,
    FindingName.POSE: 6,
    FindingName.WINDOW: 1,
    FindingName.SOURCE: 3,
}
"""Causes that `free=` names, and how many numbers each frees."""
_REGAINED = 0.05
"""A leg outside the picture has no pulses to regain, one of three in it has half of those that the
others hold: of the pulses on the path."""
_LEAST_GAIN = 40.0
"""Chi-square beyond its parameters' worth that a longer path must win, as a further leg must."""
_LEAST_EXPLAINED = 0.95
"""Of the photons found a path with a detour that needs no further test holds at least this share:
one that stands in for a wrong index leaves a third of them. Right ones hold 0.87 to 1.00."""
_MOST_LEFT = 0.25
"""Where its times scatter beyond their errors, it leaves at most this share of the misfit: one that
stands in for a wrong source or time leaves half and more."""
_OF_CLOCK = (FindingName.CLOCK_OFFSET, FindingName.CLOCK_SCALE)


def evidence_from_lost_legs(
    fit: JointFit, sightings: list[Sighting], setting: Setting
) -> tuple[Evidence, ...]:
    """What freeing each cause gains where a leg has lost its pulses; () where none has."""
    if pulses_of_legs(fit).all():
        return ()
    try:
        legs = legs_in_all_pictures(sightings, setting, either_way=True)
    except NothingFoundError:
        return ()
    found, before = [], cost_of_pulses(fit, sightings)
    for name, n_freed, there, seen in freed_one_by_one(sightings, setting):
        trial = fit_or_reason(partial(fit_from_legs, seen, legs, there, drop=False))
        if isinstance(trial, NoFit) or not pulses_of_legs(trial).all():
            continue
        fall = before - cost_of_pulses(trial, seen)
        more = int(trial.times.weight.sum() - fit.times.weight.sum())
        if more < _REGAINED * fit.times.weight.sum():
            continue
        what = name.replace("_", " ")
        found.append(
            Evidence(
                name,
                max(fall, 0.0),
                n_freed,
                fall - n_freed,
                f"with the {what} fitted {more} more pulses lie on the path",
                REMEDIES[name],
            )
        )
    return tuple(found)


def freed_one_by_one(
    sightings: list[Sighting], setting: Setting
) -> Iterator[tuple[FindingName, int, Setting, list[Sighting]]]:
    """Cause, how many numbers it frees, and setting and recordings with it free."""
    # Out and back by themselves: light may run through water and be seen through air.
    apart = replace(setting, medium=replace(setting.medium, index_correlation=0.0))
    windows = any(camera.interfaces for camera in setting.cameras)
    for name, n_freed in _NUMBERS.items():
        if name is FindingName.WINDOW and not windows:
            continue
        # Behind a window the phase index too.
        n_freed += windows and name is FindingName.INDEX
        yield name, n_freed, freed(apart, (), (), (name,))[0], sightings
    for name in _OF_CLOCK:
        size = PLAUSIBLE[name].size
        seen = [
            _with_mode(o, size * (counted_ps(o) if name is FindingName.CLOCK_SCALE else 1.0))
            for o in sightings
        ]
        yield name, 1, setting, seen


def _with_mode(sighting: Sighting, column_ps: Floats | float) -> Sighting:
    """The recording with one more error that its clock's pulses share; (n,), ps."""
    arrivals = sighting.arrivals
    column = np.broadcast_to(column_ps, arrivals.arrival_ps.shape)
    modes = np.column_stack((arrivals.shared_modes_ps, column))
    return replace(sighting, arrivals=replace(arrivals, shared_modes_ps=modes))


def cost_of_pulses(fit: JointFit, sightings: list[Sighting], scatter: float = 1.0) -> float:
    """Chi-square of all pulses by their stated errors, of lines, of what is shared and was told.

    A pulse that takes no part costs what it may at most. `scatter` is the chi-square per pulse that
    there is in any case: by so much stated errors are too small.
    """
    left = sum(len(o.usable_pulses) for o in sightings) - np.count_nonzero(fit.times.weight)
    return float(_cost_of_taken(fit) / scatter + OUTLIER**2 * left)


def cost_of_light(fit: JointFit, sightings: list[Sighting], setting: Setting) -> float:
    """The same, but a pulse that takes no part costs by its time, as far as that is the light's.

    Of the very recordings and the setting that the fit was made with.

    So paths of which one turns in view are weighed fairly against each other: where two legs meet a
    pulse takes no part and is right. Against a path that is wrong it says less, since what a corner
    too many parts lies between its legs, too.
    """
    return float(_cost_of_taken(fit) + _cost_of_left(fit, sightings, setting))


def _cost_of_taken(fit: JointFit) -> float:
    """Chi-square of the pulses that take part, of lines, of what is shared and was told."""
    times, solution = fit.times, fit.solution
    used = times.weight > 0
    squared = solution.residual_ps[used] ** 2 / (times.photon_var + times.pixel_var)[used]
    shared = np.concatenate((solution.modes, solution.shared))
    first = len(times.leg) + len(fit.lines.leg)
    told = solution.rows[[first + one.row for one in fit.freedom.told]]
    return float(squared.sum() + solution.line_chi2 + shared @ shared + told @ told)


def _cost_of_left(fit: JointFit, sightings: list[Sighting], setting: Setting) -> float:
    """What the pulses cost that take no part."""
    cost = 0.0
    seen, clock = as_found(fit.solution, setting, sightings)
    for number, (sighting, picture) in enumerate(zip(clock, fit.pictures, strict=True)):
        own = fit.times.index[(fit.sighting_of == number) & (fit.times.weight > 0)]
        left = np.setdiff1d(sighting.usable_pulses, own)
        std = pulse_std_in_view(sightings, sighting.view)
        state, there = as_shown(fit.solution.state, picture), seen.at(sighting.view)
        off = off_light_ps(sighting, state, there, picture.spot_std_px, std, left)
        stds = off / sighting.arrivals.independent_std_ps[left]
        # What is on time is worth as much as any pulse that is right.
        cost += float(np.minimum(1.0 + stds**2, OUTLIER**2).sum())
    return cost


def explains_all(fit: JointFit, sightings: list[Sighting], cost: float) -> bool:
    """Whether a path holds all but all of the light, and not the misfit of one at that cost."""
    share = explained_by_fit(fit, sightings)
    # Every pulse is worth one by chance: what is beyond is misfit.
    left = cost_of_pulses(fit, sightings) - share.n_found
    clean = fit.floor_ps == 0.0 or left < _MOST_LEFT * (cost - share.n_found)
    return clean and share.photons >= _LEAST_EXPLAINED * share.photons_found


def price_of(n_parameters: int, sightings: list[Sighting]) -> float:
    """Chi-square that a path with so many parameters more must win over one without.

    A parameter is worth ln n of n pulses (Schwarz's criterion); beyond that a margin against what
    the stated errors of the pulses leave out.
    """
    n = sum(len(one.usable_pulses) for one in sightings)
    return _LEAST_GAIN + n_parameters * float(np.log(max(n, 2)))
