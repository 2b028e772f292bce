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
from lightflight.reconstruct.fit.revise import refitted, setting_without
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
_FIRST_ORDERS = (1, 2)
"""Shapes that a bend begins with."""
_NUMBERS = 2
"""Of each shape: one in the picture, one in depth."""
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
    fit: JointFit, sightings: list[Sighting], setting: Setting, n_legs: int | None
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

    Returns
    -------
    JointFit or None
        With as many shapes as the counts ask for.
    """
    best = _best_begun(fit, sightings, setting, n_legs)
    if best is None:
        return None
    best = _grown(best, sightings)
    bent, own = best
    cost, without = cost_with_kinks(bent, sightings), cost_with_kinks(fit, list(fit.sightings))
    margin = price_of(0, sightings)
    if priced(bent, sightings) + margin > priced(fit, list(fit.sightings)):
        return None
    if not explains_all(bent, sightings, without) or bent.solution.state.unseen:
        return None
    return bent if _told_apart(bent, cost, fit, sightings, own) else None


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
    trials = [
        (trial, there)
        for state, there in _begun(fit.solution.state, setting)
        if state.has_legs(n_legs)
        and not isinstance(trial := _fitted(sightings, state, there), NoFit)
    ]
    return min(trials, key=lambda one: priced(one[0], sightings), default=None)


def _begun(state: PathState, setting: Setting) -> list[tuple[PathState, Setting]]:
    """Paths with a bent leg for each leg, and for each run of legs that turn by little."""
    told = {index for index, _, _ in setting.waypoints}
    camera, begun = setting.camera, []
    for corners in runs_of_corners(state, sorted(told)):
        there = setting_without(setting, corners)
        begun += [(bent_for_run(state, corners, n, camera), there) for n in _FIRST_ORDERS]
    begun += [(with_bend(state, leg, 1, camera), setting) for leg in state.seen]
    return begun


def _fitted(sightings: list[Sighting], state: PathState, setting: Setting) -> JointFit | NoFit:
    return fit_or_reason(partial(refitted, sightings, state, setting))


def _grown(best: _Trial, sightings: list[Sighting]) -> _Trial:
    """The path with further shapes and bends as long as each is worth its price."""
    while True:
        fit, setting = best
        state = fit.solution.state
        had = {bend.leg: bend.orders for bend in state.bends}
        trials = [
            (trial, setting)
            for leg in state.seen
            if had.get(leg, 0) < _MOST_ORDERS
            and not isinstance(
                trial := _fitted(
                    sightings, with_bend(state, leg, had.get(leg, 0) + 1, setting.camera), setting
                ),
                NoFit,
            )
        ]
        # A run of legs beside a bent one may be a part of its curve, or one of its own.
        trials += [
            (trial, there)
            for longer, there in _begun(state, setting)
            if len(longer.vertices_mm) < len(state.vertices_mm)
            and not isinstance(trial := _fitted(sightings, longer, there), NoFit)
        ]
        better = min(trials, key=lambda one: priced(one[0], sightings), default=None)
        if better is None or priced(better[0], sightings) > priced(fit, sightings) - WITHIN:
            return best
        best = better


def _told_apart(
    bent: JointFit, cost: float, fit: JointFit, sightings: list[Sighting], setting: Setting
) -> bool:
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
