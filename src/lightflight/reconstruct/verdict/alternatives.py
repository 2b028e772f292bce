"""Other paths that explain a recording about as well as the one that was found.

Each is fitted like the path itself and told with it, as long as the recording makes it less than
a hundred times less likely; the verdict then says that the path is not the only answer. One that
is more than a hundred times likelier is the answer itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lightflight.path.alternative import Alternative
from lightflight.path.light_path import LightPath
from lightflight.path.verdict import Finding, FindingName, Level, noted
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.trials.outcome import NoFit
from lightflight.reconstruct.trials.revise import refitted
from lightflight.reconstruct.trials.rivals import Rival, by_other_pulse, rivals_of

_TELL_DEPTH = "tell when the pulse set out, or where a place of this leg is (waypoints)"
_TELL_LEGS = "tell how many legs there are (n_legs, --n-legs)"
LEAST_LOG_EVIDENCE = -float(np.log(100.0))
"""An answer that the recording makes less likely than by this is not told: of two that one could
choose between, the one told is then wrong once in a hundred times."""


@dataclass(frozen=True, eq=False)
class Other:
    """Another answer, and what it rests on.

    Attributes
    ----------
    answer : Alternative
        As the path that holds it tells it.
    finding : Finding
        That says so.
    fit : JointFit
        Of pulses, in the light as it is.
    """

    answer: Alternative
    finding: Finding
    fit: JointFit

    @property
    def is_far_likelier(self) -> bool:
        """Whether the path that was found is no answer beside it."""
        return self.answer.log_evidence > -LEAST_LOG_EVIDENCE


def others_beside(
    path: LightPath,
    fit: JointFit,
    sightings: list[Sighting],
    setting: Setting,
    n_legs: int | None,
    told_of: Callable[[JointFit], tuple[LightPath, JointFit] | None],
) -> tuple[Other, ...]:
    """Other answers beside a path, the likeliest first.

    Parameters
    ----------
    path : LightPath
        With its verdict; one that is contradicted is no answer, and has no others beside it.
    fit : JointFit
        The fit of pulses that it rests on.
    sightings : list of Sighting
        The recordings as they were found.
    setting : Setting
        Camera, source, medium and waypoints.
    n_legs : int or None
        How many legs there are, where that is told.
    told_of : callable
        The estimator's path from a fit of pulses, and that fit in the light as it is; None where
        it has none.

    Returns
    -------
    tuple of Other
        () where nothing else explains the recording.
    """
    if path.verdict.level is Level.CONTRADICTED:
        return ()
    best: dict[str, Other] = {}
    # Of those that say the same the likeliest that stands: a fit of its own for each costs most.
    rivals = (*rivals_of(fit, setting), *by_other_pulse(fit, setting))
    for rival in sorted(rivals, key=lambda one: -one.log_evidence):
        if rival.says in best or not rival.state.has_legs(n_legs):
            continue
        other = _told(rival, fit, path.n_legs, sightings, setting, told_of)
        if other is not None:
            best[rival.says] = other
    return tuple(sorted(best.values(), key=lambda one: -one.answer.log_evidence))


def with_others(path: LightPath, others: Sequence[Other]) -> LightPath:
    """The path with other answers, "check" where there are some."""
    if not others:
        return path
    findings = (*path.verdict.findings, *(one.finding for one in others))
    verdict = replace(path.verdict, level=Level.CHECK, findings=findings)
    return replace(path, alternatives=tuple(one.answer for one in others), verdict=verdict)


def _told(
    rival: Rival,
    fit: JointFit,
    n_legs: int,
    sightings: list[Sighting],
    setting: Setting,
    told_of: Callable[[JointFit], tuple[LightPath, JointFit] | None],
) -> Other | None:
    """The rival as a path of its own, where it is likely enough.

    Lines say where a leg runs at two places of its image, or few more. What the counts say against
    the shape in between is the kinks they ask for. `n_legs` are those of the path.
    """
    own_kinks = fit.kinks_chi2 if rival.bends_lines else 0.0
    if rival.log_evidence + 0.5 * own_kinks < LEAST_LOG_EVIDENCE:
        return None
    refit = refitted(sightings, rival.state, setting)
    if isinstance(refit, NoFit) or not rival.is_other(refit.solution.state):
        return None
    told = told_of(refit)
    if told is None:
        return None
    kinks = told[1].kinks_chi2 if rival.bends_lines else 0.0
    log_evidence = rival.log_evidence + 0.5 * (own_kinks - kinks)
    if log_evidence < LEAST_LOG_EVIDENCE:
        return None
    answer = Alternative(told[0], log_evidence, rival.says)
    return Other(answer, _finding(answer, rival, n_legs), told[1])


def _finding(other: Alternative, rival: Rival, n_legs: int) -> Finding:
    return noted(
        FindingName.ALTERNATIVE,
        f"{other} explains the recording as well",
        _TELL_DEPTH if rival.state.n_legs == n_legs else _TELL_LEGS,
    )
