"""Whether a leg is a smooth curve: the path with bent legs, where that explains far more.

Asked where the verdict names a bent leg, or where what it names leaves misfit. A leg that is
straight is never asked about, and costs nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.path.bends import MOST_ORDERS
from lightflight.path.verdict import FindingName, Level, Verdict
from lightflight.reconstruct.fit.bent import (
    bent_for_run,
    runs_of_corners,
    with_axes_across,
    with_bend,
)
from lightflight.reconstruct.fit.fine import with_fine_light
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.told import pieces_of, way_along
from lightflight.reconstruct.trials.outcome import NoFit
from lightflight.reconstruct.trials.revise import refitted, sharpest_bend
from lightflight.reconstruct.verdict.evidence import WITHIN
from lightflight.reconstruct.verdict.judge import leaves_misfit
from lightflight.reconstruct.verdict.lost import (
    cost_of_pulses,
    freed_one_by_one,
    price_of,
)
from lightflight.units import MEDIAN_CHI2

Floats = NDArray[np.float64]

_MOST_ORDERS = 5
"""Shapes of a bend that are tried."""
_FIRST_ORDERS = (1, 4)
"""Shapes that a bend begins with, in place of a run of legs: a chain of four says as many."""
_KINK_CHI2 = 20.0
"""A leg whose times and image have no kink worth this in chi-square is not tried with a further
shape: two numbers are worth no less (ln n each, and what tells two causes apart)."""
_AKAIKE = 2.0
"""Chi-square that a shape in depth must win to be in the errors, where none more is looked for."""
_OF_A_CORNER, _OF_MIRRORS = 3, 5
"""Numbers of a corner, its place, and of two mirrors that nobody saw, with a known way between."""


def asks_for_bends(verdict: Verdict, state: PathState) -> bool:
    """Whether what is said of a path may be legs that are not straight.

    Parameters
    ----------
    verdict : Verdict
        Of the path with straight legs.
    state : PathState
        That path: corners that turn by little may stand for a curve, whatever else explains them.

    Returns
    -------
    bool
    """
    names = [one.name for one in verdict.findings]
    if FindingName.CURVED_LEG in names:
        return True
    if names[:1] == [FindingName.CALIBRATION]:
        # Pixels that err each by themselves leave misfit that no curve takes up.
        return False
    contradicted = verdict.level is Level.CONTRADICTED
    return leaves_misfit(verdict) or (contradicted and bool(runs_of_corners(state)))


def bent_instead(
    fit: JointFit,
    sightings: list[Sighting],
    setting: Setting,
    n_legs: int | None,
    *,
    cut: JointFit | None = None,
    may_bend: bool = False,
    stands: bool = True,
) -> JointFit | None:
    """A path with bent legs that explains the recording far better; None where there is none.

    Whether it explains all is for the tests of its counts to say: pulses as they were found leave
    light by corners, and of a camera with a tail.

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
    cut : JointFit, optional
        The path with more straight legs, pieces of curves that are joined; None: `fit`.
    may_bend : bool, optional
        Whether it is told that legs may be curves: then nothing else that was told is in doubt.
    stands : bool, optional
        Whether tests let the straight path stand: then bends must win far more.

    Returns
    -------
    JointFit or None
        With as many shapes as the counts ask for.
    """
    pieces = (fit if cut is None else cut).solution.state
    begun = _joined(pieces, setting) + _bent_more(fit, sightings, setting)
    bent = _cheapest([one for one in begun if one.has_legs(n_legs)], sightings, setting)
    if bent is None:
        return None
    least = price_of(0, sightings) if stands else WITHIN
    bent = _grown(bent, sightings, setting)
    if not may_bend and _gained(bent, fit, sightings) < least:
        # Shapes fewer, or finer ones in the picture, are cheaper by the price of a few numbers.
        return None
    bent = _finer(_pruned(bent, sightings, setting), sightings, setting)
    cost = cost_with_kinks(bent, sightings)
    # In light as the straight path has it: what differs then are bends.
    if _gained(with_fine_light(bent, setting), fit, sightings) < least:
        return None
    if may_bend:
        # Told: what else may be wrong is no reason for corners where there are none.
        return bent
    alone = not bent.solution.state.unseen
    return bent if alone and _told_apart(bent, cost, sightings, setting) else None


def bent_to_lengths(
    loose: JointFit, straight: JointFit | NoFit, sightings: list[Sighting], setting: Setting
) -> JointFit | None:
    """A path whose legs bend to the lengths that are told of them; None where they are straight.

    Parameters
    ----------
    loose : JointFit
        The path without the lengths, its legs straight or bent.
    straight : JointFit or NoFit
        The path with straight legs and with the lengths, or why there is none.
    sightings : list of Sighting
        The recordings as they were found.
    setting : Setting
        With lengths; legs may bend.

    Returns
    -------
    JointFit or None
        With as many shapes as counts and lengths ask for.
    """
    state = loose.solution.state
    begun = [state] if state.bends else [_bowed(state, setting, sign) for sign in (1.0, -1.0)]
    bent = _cheapest(begun, sightings, setting)
    if bent is None:
        return None
    bent = _grown(bent, sightings, setting)
    bent = _finer(_pruned(bent, sightings, setting), sightings, setting)
    if isinstance(straight, NoFit):
        return bent
    worth = _gained(with_fine_light(bent, setting), straight, sightings)
    return bent if worth >= price_of(0, sightings) else None


def _bowed(state: PathState, setting: Setting, sign: float) -> PathState:
    """The path with the legs whose length is told bowed in depth as far as that asks for.

    A parabola of sagitta s on a chord c is longer than it by 8 s^2 / 3 c. Of straight legs no
    length says which way they bend: a fit would stay there.
    """
    for told in setting.lengths:
        legs = pieces_of(state, told)
        chord = way_along(state, legs)[0]
        for leg in legs:
            state = with_bend(state, leg, 1, setting.camera)
            longer = max(told.length_mm - chord, told.std_mm) * state.lengths_mm[leg] / chord
            sagitta = sign * np.sqrt(0.375 * longer * state.lengths_mm[leg])
            bends = tuple(
                replace(bend, coefficients_mm=np.array([[0.0], [sagitta]]))
                if bend.leg == leg
                else bend
                for bend in state.bends
            )
            state = replace(state, bends=bends)
    return state


def cost_with_kinks(fit: JointFit, sightings: list[Sighting], scatter: float = 1.0) -> float:
    """`cost_of_pulses`, and what the counts say against the shape of each leg's image."""
    return cost_of_pulses(fit, sightings, scatter) + fit.kinks_chi2 / scatter


def priced(fit: JointFit, sightings: list[Sighting], scatter: float = 1.0) -> float:
    """`cost_with_kinks`, with ln n for each number of corners and bends (Schwarz's criterion).

    `scatter` is the chi-square per pulse that even the best path leaves: errors that are stated too
    small must not pay for corners.
    """
    state = fit.solution.state
    numbers = _OF_A_CORNER * len(state.corners_seen) + sum(len(bend.fitted) for bend in state.bends)
    own = price_of(numbers, sightings) - price_of(0, sightings)
    return cost_with_kinks(fit, sightings, scatter) + own


def costs_less(
    bent: JointFit, detour: JointFit, sightings: list[Sighting], setting: Setting
) -> bool:
    """Whether a path with bends explains the pulses as found better than one with ways unseen.

    Parameters
    ----------
    bent : JointFit
        The one.
    detour : JointFit
        The other: the mirrors of each unseen leg are five numbers more.
    sightings : list of Sighting
        The recordings as they were found.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    bool
    """
    curve, gap = (refitted(sightings, one.solution.state, setting) for one in (bent, detour))
    if isinstance(curve, NoFit) or isinstance(gap, NoFit):
        return not isinstance(curve, NoFit)
    scatter = _scatter([curve, gap])
    numbers = _OF_MIRRORS * len(gap.solution.state.unseen)
    own = price_of(numbers, sightings) - price_of(0, sightings)
    return priced(curve, sightings, scatter) < priced(gap, sightings, scatter) + own


def _scatter(fits: list[JointFit]) -> float:
    """Chi-square of the middle pulse of that of some paths which takes most of them, at least one.

    A path that takes few, and these well, has nothing to say of all others.
    """
    squared = max((_squared_pulls(fit) for fit in fits), key=len, default=np.empty(0))
    return max(1.0, float(np.median(squared)) / MEDIAN_CHI2) if len(squared) else 1.0


def _squared_pulls(fit: JointFit) -> Floats:
    """(k,), of the pulses that take part, by their stated errors."""
    used, times = fit.times.weight > 0, fit.times
    stated = (times.photon_var + times.pixel_var)[used]
    squared: Floats = fit.solution.residual_ps[used] ** 2 / stated
    return squared


def _gained(better: JointFit, fit: JointFit, sightings: list[Sighting]) -> float:
    """By how much one path is to be preferred to another, in chi-square."""
    scatter = _scatter([better, fit])
    return priced(fit, sightings, scatter) - priced(better, sightings, scatter)


def _joined(state: PathState, setting: Setting) -> list[PathState]:
    """Paths with a bent leg for each run of legs that turn by little.

    None where waypoints say which vertex is which: with legs joined, others would bear the numbers.
    """
    if setting.told_vertices:
        return []
    return [
        bent_for_run(state, corners, orders, setting.camera)
        for corners in runs_of_corners(state)
        for orders in _FIRST_ORDERS
    ]


def _bent_more(fit: JointFit, sightings: list[Sighting], setting: Setting) -> list[PathState]:
    """Paths with a shape more on each leg whose times or image have a kink."""
    state, found = fit.solution.state, []
    for leg in state.seen:
        orders = sum(bend.orders for bend in state.bends if bend.leg == leg)
        kinked = sharpest_bend(sightings, fit, leg, setting)[0] > _KINK_CHI2
        if kinked and orders < _MOST_ORDERS:
            found.append(with_bend(state, leg, orders + 1, setting.camera))
    return found


def _grown(fit: JointFit, sightings: list[Sighting], setting: Setting) -> JointFit:
    """The path with further shapes and bends as long as each is worth its price."""
    while True:
        # A run of legs beside a bent one may be a part of its curve, or one of its own.
        longer = _bent_more(fit, sightings, setting) + _joined(fit.solution.state, setting)
        better = _cheapest(longer, sightings, setting)
        if better is None or _gained(better, fit, sightings) < WITHIN:
            return fit
        fit = better


def _pruned(fit: JointFit, sightings: list[Sighting], setting: Setting) -> JointFit:
    """The path without the last shapes of its bends, or in depth, that are not worth their price.

    The first of each bend stays, in the picture and in depth.
    """
    while True:
        state = fit.solution.state
        fewer = [
            (bend.leg, orders, alone)
            for bend in state.bends
            for orders, alone in (
                (bend.orders - 1, max(bend.more_in_picture - 1, 0)),
                (bend.orders, bend.more_in_picture + 1),
            )
            if orders > alone
        ]
        shorter = [
            with_bend(state, leg, orders, setting.camera, more_in_picture=alone)
            for leg, orders, alone in fewer
        ]
        better = _cheapest(shorter, sightings, setting)
        if better is None or _gained(better, fit, sightings) < 0.0:
            return fit
        fit = better


def _finer(fit: JointFit, sightings: list[Sighting], setting: Setting) -> JointFit:
    """The path with a shape more of each bend in the picture than the counts are worth.

    What is not worth its price is not zero: left out, it moved places by twice their errors. In the
    picture it costs one percent of the stated errors, in depth a quarter and more: there it must be
    worth its price, but no kink need have shown it (a parabola that stands askew to its chord
    shows none). Where the index is told with an error, times tell it from depth by the shape of the
    curve alone: to 0.007 by that of an exact parabola, five such errors off.
    """
    deep = _with_shape_more(fit, sightings, setting, in_depth=True)
    if setting.medium.path_group_index_std > 0.0 and not isinstance(deep, NoFit):
        return deep
    flat = _with_shape_more(fit, sightings, setting, in_depth=False)
    if isinstance(flat, NoFit) or isinstance(deep, NoFit):
        return fit if isinstance(flat, NoFit) else flat
    scatter = _scatter([flat, deep])
    without, left = (cost_with_kinks(one, sightings, scatter) for one in (flat, deep))
    is_worth = without - left > _AKAIKE * len(fit.solution.state.bends)
    return deep if is_worth else flat


def _with_shape_more(
    fit: JointFit, sightings: list[Sighting], setting: Setting, *, in_depth: bool
) -> JointFit | NoFit:
    """The path with a shape more of each bend, in the picture or in depth too."""
    state = fit.solution.state
    for bend in state.bends:
        orders = min(bend.orders + 1, MOST_ORDERS)
        alone = bend.more_in_picture + (0 if in_depth else orders - bend.orders)
        state = with_bend(state, bend.leg, orders, setting.camera, more_in_picture=alone)
    return refitted(sightings, with_axes_across(state, setting.camera), setting)


def _cheapest(
    begun: list[PathState], sightings: list[Sighting], setting: Setting
) -> JointFit | None:
    """The fit from one of some paths that costs least; None where none can be fitted."""
    trials = [refitted(sightings, state, setting) for state in begun]
    fits = [fit for fit in trials if not isinstance(fit, NoFit)]
    scatter = _scatter(fits)
    return min(fits, key=lambda one: priced(one, sightings, scatter), default=None)


def _told_apart(bent: JointFit, cost: float, sightings: list[Sighting], setting: Setting) -> bool:
    """Whether no straight path explains as much with something told wrong.

    Speed and a bend in depth are one direction of the data: of one leg alone, a wrong index cannot
    be told from it, and what was told stays in doubt.
    """
    straight = replace(bent.solution.state, bends=())
    for _, _, there, seen in freed_one_by_one(sightings, setting):
        trial = refitted(seen, straight, there)
        if not isinstance(trial, NoFit) and cost_with_kinks(trial, seen) < cost + WITHIN:
            return False
    return True
