"""Whether light that a path leaves is an arm of it: what goes on, or turns off, at a beam splitter.

Asked where a path is contradicted for light that it does not explain. `reconstruct` tells one arm;
that there is another, and where it leaves, is said with the light.
"""

from __future__ import annotations

from dataclasses import replace

from lightflight.path.verdict import FindingName, Verdict
from lightflight.reconstruct.fit.arms import fits_with_arm
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.verdict.detours import has_weak_leg
from lightflight.reconstruct.verdict.hidden import pulses_of_legs
from lightflight.reconstruct.verdict.lost import cost_of_pulses, price_of

_PARAMETERS = 5
"""A place on the path and off it, and a direction."""


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
    if not any(one.name == FindingName.UNEXPLAINED_LIGHT for one in verdict.findings):
        return verdict
    best = _best_arm(fit, sightings, setting)
    if best is None:
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
        trial
        for trial in fits_with_arm(sightings, fit, setting)
        if trial.solution.converged and not has_weak_leg(trial)
    ]
    best = min(trials, key=lambda one: cost_of_pulses(one, sightings), default=None)
    if best is None:
        return None
    price = price_of(_PARAMETERS, sightings)
    without, left = (cost_of_pulses(one, sightings) for one in (fit, best))
    return best if left + price <= without else None


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
