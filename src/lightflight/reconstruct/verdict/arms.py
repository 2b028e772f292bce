"""Whether light that a path leaves is an arm of it: what goes on, or turns off, at a beam splitter.

Asked where pulses are off a path by more than an arm costs, before other light is looked for, and
where a path is contradicted for light that it does not explain. The arms become part of the path;
an estimator that tells one way of the light says with the light where another leaves it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lightflight.path.verdict import FindingName, Level, Verdict
from lightflight.reconstruct.fit.joint import JointFit, pulses_of_legs
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.trials.arms import fits_with_arm
from lightflight.reconstruct.trials.outcome import NoFit
from lightflight.reconstruct.trials.revise import refitted
from lightflight.reconstruct.verdict.detours import FEW_PULSES, has_weak_leg
from lightflight.reconstruct.verdict.lost import cost_of_pulses, price_of

_PARAMETERS = 5
"""A place on the path and off it, and a direction."""
_MOST_ARMS = 3
"""Arms that are looked for one after another: each is a search and a few fits."""
_MOST_LEFT = 0.5
"""Of a path's misfit arms that tests contradict leave at most this share: right ones left 0.1 to
0.6 of it (and stood the tests), in halos what runs as straight as an arm 0.87 and more."""


def leaves_light(verdict: Verdict) -> bool:
    """Whether a path is contradicted by light that it leaves, which may be an arm's.

    Parameters
    ----------
    verdict : Verdict
        On the path.

    Returns
    -------
    bool
    """
    contradicted = verdict.level is Level.CONTRADICTED
    return contradicted and any(
        one.name == FindingName.UNEXPLAINED_LIGHT for one in verdict.findings
    )


def with_arms(
    fit: JointFit, sightings: list[Sighting], setting: Setting, n_legs: int | None
) -> JointFit | None:
    """The path with the arms that explain far more of the light; None where there is none.

    Parameters
    ----------
    fit : JointFit
        The path without.
    sightings : list of Sighting
        The recordings as they were found.
    setting : Setting
        Camera, source, medium and waypoints.
    n_legs : int or None
        How many legs there are on all branches together, where that is told.

    Returns
    -------
    JointFit or None
        One that forks, with as many legs as were told.
    """
    longer: JointFit | None = None
    misfits = [_misfit(fit, sightings)]
    for more in reversed(range(_MOST_ARMS)):
        best = _best_arm(fit, sightings, setting)
        if best is None:
            break
        longer = fit = best
        misfits.append(_misfit(fit, sightings))
        # The brightest arm comes first: where as many as that still leave most, it is none.
        if misfits[-1] - more * (misfits[-2] - misfits[-1]) > _MOST_LEFT * misfits[0]:
            return None
        if longer.solution.state.n_legs == n_legs:
            break
    right = longer is not None and longer.solution.state.has_legs(n_legs)
    return longer if right else None


def with_arms_for_most(
    fit: JointFit, sightings: list[Sighting], setting: Setting
) -> JointFit | None:
    """The path with arms that take up most of its misfit, before other light is looked for.

    Parameters
    ----------
    fit : JointFit
        The path without.
    sightings : list of Sighting
        The recordings as they were found.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    JointFit or None
        None where there are none, or the path leaves too little to pay for one.
    """
    if _misfit(fit, sightings) < price_of(_PARAMETERS, sightings):
        return None
    forked = with_arms(fit, sightings, setting, None)
    return forked if forked is not None and take_up_most(forked, fit, sightings) else None


def take_up_most(forked: JointFit, fit: JointFit, sightings: list[Sighting]) -> bool:
    """Whether arms leave little of a path's misfit, though tests contradict the path with them.

    Parameters
    ----------
    forked : JointFit
        The path with arms.
    fit : JointFit
        The path without.
    sightings : list of Sighting
        The recordings as they were found.

    Returns
    -------
    bool
    """
    return _misfit(forked, sightings) < _MOST_LEFT * _misfit(fit, sightings)


def _misfit(fit: JointFit, sightings: list[Sighting]) -> float:
    """What pulses are off a path by beyond chance, which is one for each."""
    return cost_of_pulses(fit, sightings) - sum(len(one.usable_pulses) for one in sightings)


def verdict_with_arm(
    verdict: Verdict, fit: JointFit, sightings: list[Sighting], setting: Setting
) -> Verdict:
    """The verdict that says of light the path leaves where an arm of it leaves the path.

    Parameters
    ----------
    verdict : Verdict
        On the path as it is.
    fit : JointFit
        The path.
    sightings : list of Sighting
        The recordings as they were found.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    Verdict
        The same where no light is left, or that is no arm.
    """
    if not leaves_light(verdict):
        return verdict
    best = _best_arm(fit, sightings, setting)
    if best is None or not take_up_most(best, fit, sightings):
        return verdict
    said = _said_of_arm(best, setting)
    findings = tuple(
        replace(
            one,
            sentence=f"{one.sentence}; {said}",
            remedy="film each arm alone, or mask the pixels of one (exclude_mask=)",
        )
        if one.name == FindingName.UNEXPLAINED_LIGHT
        else one
        for one in verdict.findings
    )
    return replace(verdict, findings=findings)


def _best_arm(fit: JointFit, sightings: list[Sighting], setting: Setting) -> JointFit | None:
    """The path with the arm that explains most, where that is far more than without."""
    trials = [
        trial.fit
        for base in (fit, *_up_to_weak_leg(fit, sightings, setting))
        for trial in fits_with_arm(sightings, base, setting)
        if trial.fit.solution.converged and not has_weak_leg(trial.fit, trial.parted)
    ]
    best = min(trials, key=lambda one: cost_of_pulses(one, sightings), default=None)
    if best is None:
        return None
    price = price_of(_PARAMETERS, sightings)
    without, left = (cost_of_pulses(one, sightings) for one in (fit, best))
    return best if left + price <= without else None


def _up_to_weak_leg(
    fit: JointFit, sightings: list[Sighting], setting: Setting
) -> Iterator[JointFit]:
    """The path up to its first leg that is all but unseen, where a search so joined two arms."""
    state = fit.solution.state
    weak = np.flatnonzero(pulses_of_legs(fit) <= FEW_PULSES)
    if not len(weak) or weak[0] == 0 or state.forks or state.unseen or setting.told_vertices:
        return
    shorter = replace(state, vertices_mm=state.vertices_mm[: weak[0] + 1])
    trial = refitted(sightings, shorter, setting)
    if not isinstance(trial, NoFit):
        yield trial


def _said_of_arm(fit: JointFit, setting: Setting) -> str:
    """Where and when the last arm leaves, and how many pulses it holds."""
    state = fit.solution.state
    leg, vertex = state.forks[-1]
    time = state.vertex_times_ps(setting.medium)[vertex]
    pulses = pulses_of_legs(fit)[state.seen.index(leg)]
    where = ", ".join(f"{x:.1f}" for x in state.vertices_mm[vertex])
    return (
        f"{pulses} pulses are an arm that leaves the path at ({where}) mm at "
        f"{time:.0f} ps, as light does at a beam splitter"
    )
