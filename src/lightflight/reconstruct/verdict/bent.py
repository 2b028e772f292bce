"""Whether a leg is a smooth curve: the path with bent legs, where that explains far more.

Asked where a path is contradicted, or where its verdict names a bent leg. A leg that is straight is
never asked about, and costs nothing.
"""

from __future__ import annotations

from functools import partial

from lightflight.path.verdict import FindingName, Level, Verdict
from lightflight.reconstruct.fit.bent import (
    bent_for_run,
    runs_of_corners,
    straightened,
    with_bend,
)
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.outcome import NoFit, fit_or_reason
from lightflight.reconstruct.fit.revise import refitted, setting_without, sharpest_bend
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.verdict.evidence import WITHIN
from lightflight.reconstruct.verdict.lost import (
    cost_of_pulses,
    explains_all,
    freed_one_by_one,
    price_of,
)

_MOST_ORDERS = 5
"""Shapes of a bend that are tried."""
_FIRST_ORDERS = (1, 4)
"""Shapes that a bend begins with, in place of a run of legs: a chain of four says as many."""
_KINK_CHI2 = 20.0
"""A leg whose times and image have no kink worth this in chi-square is not tried with a further
shape: two numbers are worth no less (ln n each, and what tells two causes apart)."""
_OF_A_CORNER = 3
"""Numbers of a corner, its place."""

_Trial = tuple[JointFit, Setting]


def asks_for_bends(verdict: Verdict) -> bool:
    """Whether what is said of a path may be a leg that is not straight.

    Parameters
    ----------
    verdict : Verdict
        Of the path with straight legs.

    Returns
    -------
    bool
    """
    named = any(one.name == FindingName.CURVED_LEG for one in verdict.findings)
    return named or verdict.level is Level.CONTRADICTED


def bent_instead(
    fit: JointFit,
    sightings: list[Sighting],
    setting: Setting,
    n_legs: int | None,
    *,
    may_bend: bool = False,
) -> JointFit | None:
    """A path with bent legs that explains the recording far better; None where there is none.

    Parameters
    ----------
    fit : JointFit
        The path with straight legs.
    sightings : list of Sighting
        The recordings as they were found.
    setting : Setting
        Camera, source, medium and waypoints.
    n_legs : int or None
        How many legs there are, where that is told.
    may_bend : bool, optional
        Whether it is told that legs may be curves: then nothing else that was told is in doubt.

    Returns
    -------
    JointFit or None
        With as many shapes as the counts ask for.
    """
    best = _best_begun(fit, sightings, setting, n_legs)
    if best is None:
        return None
    best = _pruned(_grown(best, sightings), sightings)
    bent, own = best
    cost, without = cost_with_kinks(bent, sightings), cost_with_kinks(fit, list(fit.sightings))
    margin = price_of(0, sightings)
    if priced(bent, sightings) + margin > priced(fit, list(fit.sightings)):
        return None
    if may_bend:
        # Told: what else may be wrong is no reason for corners where there are none.
        return bent
    clean = explains_all(bent, sightings, without) and not bent.solution.state.unseen
    return bent if clean and _told_apart(bent, cost, sightings, own) else None


def cost_with_kinks(fit: JointFit, sightings: list[Sighting]) -> float:
    """`cost_of_pulses`, and what the counts say against the shape of each leg's image."""
    kinks = sum(line.bend_chi2 for picture in fit.pictures for line in picture.fits)
    return cost_of_pulses(fit, sightings) + kinks


def priced(fit: JointFit, sightings: list[Sighting]) -> float:
    """`cost_with_kinks`, with ln n for each number of corners and bends (Schwarz's criterion)."""
    state = fit.solution.state
    numbers = _OF_A_CORNER * len(state.corners_seen) + sum(bend.size for bend in state.bends)
    return cost_with_kinks(fit, sightings) + price_of(numbers, sightings) - price_of(0, sightings)


def _best_begun(
    fit: JointFit, sightings: list[Sighting], setting: Setting, n_legs: int | None
) -> _Trial | None:
    """The best path with one bent leg more than it has, few shapes each."""
    begun = _begun(fit.solution.state, setting)
    begun += [(longer, setting) for longer in _bent_more(fit, sightings, setting)]
    return _cheapest([one for one in begun if one[0].has_legs(n_legs)], sightings)


def _begun(state: PathState, setting: Setting) -> list[tuple[PathState, Setting]]:
    """Paths with a bent leg for each run of legs that turn by little."""
    told = {index for index, _, _ in setting.waypoints}
    camera, begun = setting.camera, []
    for corners in runs_of_corners(state, sorted(told)):
        there = setting_without(setting, corners)
        begun += [(bent_for_run(state, corners, n, camera), there) for n in _FIRST_ORDERS]
    return begun


def _bent_more(fit: JointFit, sightings: list[Sighting], setting: Setting) -> list[PathState]:
    """Paths with a shape more on each leg whose times or image have a kink."""
    state, found = fit.solution.state, []
    for leg in state.seen:
        orders = sum(bend.orders for bend in state.bends if bend.leg == leg)
        kinked = sharpest_bend(sightings, fit, leg, setting)[0] > _KINK_CHI2
        if kinked and orders < _MOST_ORDERS:
            found.append(with_bend(state, leg, orders + 1, setting.camera))
    return found


def _fitted(sightings: list[Sighting], state: PathState, setting: Setting) -> JointFit | NoFit:
    return fit_or_reason(partial(refitted, sightings, state, setting))


def _grown(best: _Trial, sightings: list[Sighting]) -> _Trial:
    """The path with further shapes and bends as long as each is worth its price."""
    while True:
        fit, setting = best
        state = fit.solution.state
        # A run of legs beside a bent one may be a part of its curve, or one of its own.
        longer = [(one, setting) for one in _bent_more(fit, sightings, setting)]
        longer += _begun(state, setting)
        better = _cheapest(longer, sightings)
        if better is None or priced(better[0], sightings) > priced(fit, sightings) - WITHIN:
            return best
        best = better


def _pruned(best: _Trial, sightings: list[Sighting]) -> _Trial:
    """The path without the last shapes of its bends that are not worth their price."""
    while True:
        fit, setting = best
        state, camera = fit.solution.state, setting.camera
        shorter = [
            (with_bend(state, bend.leg, bend.orders - 1, camera), setting)
            for bend in state.bends
            if bend.orders > 1
        ]
        better = _cheapest(shorter, sightings)
        if better is None or priced(better[0], sightings) > priced(fit, sightings):
            return best
        best = better


def _cheapest(begun: list[tuple[PathState, Setting]], sightings: list[Sighting]) -> _Trial | None:
    """The fit from one of some paths that costs least; None where none can be fitted."""
    trials = [(_fitted(sightings, state, setting), setting) for state, setting in begun]
    fits = [(fit, setting) for fit, setting in trials if not isinstance(fit, NoFit)]
    return min(fits, key=lambda one: priced(one[0], sightings), default=None)


def _told_apart(bent: JointFit, cost: float, sightings: list[Sighting], setting: Setting) -> bool:
    """Whether no straight path explains as much with something told wrong.

    Speed and a bend in depth are one direction of the data: of one leg alone, a wrong index cannot
    be told from it, and what was told stays in doubt.
    """
    straight = straightened(bent.solution.state)
    for _, _, there, seen in freed_one_by_one(sightings, setting):
        trial = _fitted(seen, straight, there)
        if not isinstance(trial, NoFit) and cost_with_kinks(trial, seen) < cost + WITHIN:
            return False
    return True
