"""Whether light was out of the picture on its way: a path with a detour, where no other is right.

Asked where what a verdict names leaves misfit, or a leg has hardly a pulse that speaks for it: what
a search that joins all legs makes of a roof mirror beside the picture. Light that is lost from
sight leaves by the picture's edge and comes back by it, so only legs that end and start there are
tried apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import NothingFoundError
from lightflight.path.verdict import Finding, FindingName, noted
from lightflight.reconstruct.fit.joint import JointFit, pulses_of_legs
from lightflight.reconstruct.fit.least_squares import OUTLIER
from lightflight.reconstruct.legs.direction import search_legs
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.reconstruct.model.detour import detours_of
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.trials.outcome import NoFit, fit_or_reason
from lightflight.reconstruct.trials.revise import fit_from_legs, refitted, revised
from lightflight.reconstruct.trials.unseen import fits_with_gaps
from lightflight.reconstruct.verdict.lost import (
    cost_of_light,
    cost_of_pulses,
    explains_all,
    price_of,
)
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

_AT_EDGE_PX = 4.0
"""A leg that is seen up to this near to the edge may run on beyond it, px: so many dim pixels and
those near a corner are not counted to a leg."""
FEW_PULSES = 5
"""A leg that no more pulses than this speak for may stand for a way that nobody saw."""
_LEAST_DETOUR_MM = 10.0
"""A single mirror that fails by less, mm, may be one with something else off: an index, a pose or a
clock that is wrong by a plausible size moves corners by up to 5 mm (docs/explanation/limits.md)."""
_MOST_OF_PERIOD = 0.5
"""Light that comes back later than this, in laser periods, may as well be another pulse's."""
_PARAMETERS = 3
"""A second mirror's place, with each detour."""
_MOST_GAPS = 2
"""Detours that are tried together ..."""
_MANY_PLACES = 5
"""... unless light may have been lost from sight at more places than this: of those so many are
tried, one at a time, where the legs about them fit worst."""
_CHANCE_STDS = 5.0
"""Chi-square falls below its due by no more than this many of its standard deviations."""


def has_weak_leg(fit: JointFit, parted: int | None = None) -> bool:
    """Whether a leg of the path is all but unseen.

    Parameters
    ----------
    fit : JointFit
        The path.
    parted : int or None, optional
        A leg that is one with the next: what shows the one shows both.

    Returns
    -------
    bool
    """
    pulses = pulses_of_legs(fit)
    if parted is not None:
        both = np.isin(fit.solution.state.seen, (parted, parted + 1))
        pulses = np.where(both, pulses[both].sum(), pulses)
    return bool((pulses <= FEW_PULSES).any())


@dataclass(frozen=True)
class Detoured:
    """A path with detours that explains the recording far better than one without.

    Attributes
    ----------
    fit : JointFit
        The path.
    holds_all : bool
        Whether it holds all but all of the light by its pulses as they were found; else the tests
        of its counts have to say whether it is right.
    """

    fit: JointFit
    holds_all: bool


def detour_instead(
    fit: JointFit | None, sightings: list[Sighting], setting: Setting, n_legs: int | None
) -> Detoured | None:
    """A path with detours that explains the recording far better; None where there is none.

    Parameters
    ----------
    fit : JointFit or None
        The path without; None: there is none.
    sightings : list of Sighting
        The recordings as they were found.
    setting : Setting
        Camera, source, medium and waypoints.
    n_legs : int or None
        How many legs there are, where that is told: with those that nobody saw, or without.

    Returns
    -------
    Detoured or None
        With the fewest detours that hold all light; where none does, that explain most.
    """
    if fit is not None and not _leaves_room(fit, sightings):
        return None
    try:
        legs = search_legs(sightings[0].arrivals, sightings[0], setting, None)
    except NothingFoundError:
        return None
    found = _of_legs(legs, fit, sightings, setting, n_legs)
    if found is None and fit is None and n_legs is None and len(legs) > 2:
        # A piece about where light begins, with as many pixels as a leg: no chain has it.
        weakest = min(range(len(legs)), key=lambda k: legs[k].n_pixels)
        found = _of_legs(legs[:weakest] + legs[weakest + 1 :], None, sightings, setting, None)
    return found


def _of_legs(
    legs: tuple[ImageLeg, ...],
    fit: JointFit | None,
    sightings: list[Sighting],
    setting: Setting,
    n_legs: int | None,
) -> Detoured | None:
    """A path with detours between these legs in the picture; else as `detour_instead`."""
    places = _open_places(legs, setting)
    if not places:
        return None
    # Of many places two together are a square as many: twenty passes would take an hour.
    most_gaps = _MOST_GAPS if len(places) <= _MANY_PLACES else 1
    places = _worst_of(places, fit)
    as_it_is = np.inf if fit is None else cost_of_pulses(fit, list(fit.sightings))
    cost: float | None = None
    better: JointFit | None = None
    for n_gaps in range(1, min(len(places), most_gaps) + 1):
        # As many legs as were told, with those that nobody saw or without: others are not fitted.
        if n_legs not in (None, len(legs), len(legs) + n_gaps):
            continue
        trials = [
            trial
            for gaps in combinations(places, n_gaps)
            for trial in fits_with_gaps(sightings, legs, gaps, setting)
            if _are_detours(trial, sightings, setting)
        ]
        best = min(trials, key=lambda one: cost_of_light(one, sightings, setting), default=None)
        # What is no better than the path as it is is none than the best without a detour, for which
        # more must be fitted.
        if best is None or not _is_cheaper(best, n_gaps, as_it_is, sightings):
            continue
        cost = _cost_without(fit, legs, sightings, setting) if cost is None else cost
        if not _is_cheaper(best, n_gaps, cost, sightings):
            continue
        if n_legs is None:
            # Pieces about a corner that a search takes for legs stand in a chain of legs, too.
            best = revised(sightings, best, setting)
        if explains_all(best, sightings, cost):
            return Detoured(best, holds_all=True)
        if better is None or _is_cheaper(best, 1, cost_of_pulses(better, sightings), sightings):
            better = best
    return None if better is None else Detoured(better, holds_all=False)


def without_light_unseen(
    fit: JointFit, sightings: list[Sighting], setting: Setting, n_legs: int | None
) -> JointFit | None:
    """The path whose legs between others that hardly a pulse speaks for are ways that nobody saw.

    A search joins all legs: what it puts between two of them, beside the picture, has mirrors whose
    places nothing tells, or a pulse or two of other legs, and is stated as if they were told. A
    last leg without light is left out, where nobody said that there is one.

    Parameters
    ----------
    fit : JointFit
        The path.
    sightings : list of Sighting
        The recordings as they were found.
    setting : Setting
        Camera, source, medium and waypoints.
    n_legs : int or None
        How many legs there are, where that is told.

    Returns
    -------
    JointFit or None
        None where the light of all legs is worth their mirrors, or one mirror would do.
    """
    state, pulses = fit.solution.state, pulses_of_legs(fit)
    if state.forks or state.bends:
        return None
    # A path does not end in a leg that nobody saw.
    behind_unseen = state.n_legs - 2 in state.unseen
    if len(pulses) > 1 and pulses[-1] == 0 and n_legs is None and not behind_unseen:
        # Nobody saw where the light went: the path ends where it was last seen.
        shorter = refitted(sightings, replace(state, vertices_mm=state.vertices_mm[:-1]), setting)
        return None if isinstance(shorter, NoFit) else shorter
    empty = tuple(state.seen[k] for k in range(1, len(pulses) - 1) if pulses[k] <= FEW_PULSES)
    if not empty:
        return None
    unseen = tuple(sorted((*state.unseen, *empty)))
    if any(after - before == 1 for before, after in pairwise(unseen)):
        return None
    trial = refitted(sightings, replace(state, unseen=unseen), setting)
    if not isinstance(trial, NoFit) and n_legs is None:
        trial = revised(sightings, trial, setting)
    if isinstance(trial, NoFit) or not _are_detours(trial, sightings, setting):
        return None
    lit, cost = refitted(sightings, state, setting), cost_of_pulses(trial, sightings)
    worth = not isinstance(lit, NoFit) and _is_cheaper(lit, len(empty), cost, sightings)
    return None if worth else trial


def _is_cheaper(best: JointFit, n_gaps: int, cost: float, sightings: list[Sighting]) -> bool:
    """Whether a path with so many detours more explains far better than one at that cost."""
    return cost_of_pulses(best, sightings) + price_of(_PARAMETERS * n_gaps, sightings) < cost


def _leaves_room(fit: JointFit, sightings: list[Sighting]) -> bool:
    """Whether a path leaves more misfit than a detour costs, if that took up all but chance."""
    n = sum(len(one.usable_pulses) for one in sightings)
    least = n - _CHANCE_STDS * float(np.sqrt(2.0 * n)) + price_of(_PARAMETERS, sightings)
    return cost_of_pulses(fit, list(fit.sightings)) > least


def _worst_of(places: tuple[int, ...], fit: JointFit | None) -> tuple[int, ...]:
    """The places about which a path fits worst, where they are many; in the order of flight."""
    if fit is None or len(places) <= _MANY_PLACES or fit.solution.state.n_legs <= max(places) + 1:
        return places
    times, solution = fit.times, fit.solution
    squared = times.weight * solution.residual_ps**2 / (times.photon_var + times.pixel_var)
    # A misfit of one pulse more than another's chance: legs have many pulses or few.
    of_legs = np.bincount(times.leg, squared - times.weight, minlength=solution.state.n_legs)
    about = [float(of_legs[k] + of_legs[k + 1]) for k in places]
    worst = np.argsort(about, kind="stable")[::-1][:_MANY_PLACES]
    return tuple(sorted(places[k] for k in worst))


def _cost_without(
    fit: JointFit | None,
    legs: tuple[ImageLeg, ...],
    sightings: list[Sighting],
    setting: Setting,
) -> float:
    """What a path without a detour costs on the pulses as found, at best.

    The path as it is, or one of the very legs that are tried apart, each over one mirror to the
    next: where that explains as much, nothing was out of the picture for longer.
    """
    costs = [OUTLIER**2 * sum(len(one.usable_pulses) for one in sightings)]
    trials = [fit_or_reason(lambda: fit_from_legs(sightings, legs, setting, drop=False))]
    if fit is not None:
        costs.append(cost_of_pulses(fit, list(fit.sightings)))
        trials.append(refitted(sightings, fit.solution.state, setting))
    costs += [cost_of_pulses(one, sightings) for one in trials if not isinstance(one, NoFit)]
    # Without a path every pulse costs what it may at most; a poor path may cost more.
    return min(costs[1:] or costs)


def _open_places(legs: tuple[ImageLeg, ...], setting: Setting) -> tuple[int, ...]:
    """Legs after which light may be out of the picture: seen to its edge, the next from there."""
    edge = _edge_px(setting)
    ends = [np.array(leg.points_px(np.array(leg.extent_px))) for leg in legs]
    at_edge = [
        [float(np.hypot(*(edge - point).T).min()) < _AT_EDGE_PX for point in both] for both in ends
    ]
    return tuple(k for k in range(len(legs) - 1) if at_edge[k][1] and at_edge[k + 1][0])


def _edge_px(setting: Setting) -> NDArray[np.float64]:
    """The picture's rim, (n, 2) undistorted (u, v), px, every quarter pixel."""
    rows, cols = setting.camera.shape
    down, right = np.arange(-0.5, rows - 0.4, 0.25), np.arange(-0.5, cols - 0.4, 0.25)
    row = np.concatenate((down, down, np.full_like(right, -0.5), np.full_like(right, rows - 0.5)))
    col = np.concatenate((np.full_like(down, -0.5), np.full_like(down, cols - 0.5), right, right))
    return undistorted_px(setting.camera, row, col)


def _are_detours(fit: JointFit, sightings: list[Sighting], setting: Setting) -> bool:
    """Whether light goes about everywhere where the path says so, and not over one mirror."""
    period_ps = sightings[0].histograms.laser_period_ps or np.inf
    longest = _MOST_OF_PERIOD * period_ps * SPEED_OF_LIGHT_MM_PER_PS
    return all(
        one.corner_misses_mm > _LEAST_DETOUR_MM and one.length_mm < longest
        for one in detours_of(fit.solution.state, setting.camera)
    )


def findings_of_detours(fit: JointFit) -> tuple[Finding, ...]:
    """What is to be said of a path with legs that nobody saw.

    Parameters
    ----------
    fit : JointFit
        The path.

    Returns
    -------
    tuple of Finding
        One of all of them; () where all legs are seen.
    """
    unseen = fit.solution.state.unseen
    if not unseen:
        return ()
    where = " and ".join(f"legs {k} and {k + 2}" for k in unseen)
    return (
        noted(
            FindingName.UNSEEN_LEG,
            f"between {where} the light was out of the picture: on one leg or on several of the "
            "same delay, over mirrors whose places nothing here tells",
            "say where a mirror stands (waypoints), or film the way between with a second camera",
        ),
    )
