"""Other paths that explain a recording about as well as the one that was found.

Each is fitted like the path itself and told with it, as long as the recording makes it less than
a hundred times less likely; the verdict then says that the path is not the only answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lightflight.path.alternative import Alternative
from lightflight.path.light_path import LightPath
from lightflight.path.verdict import Finding, FindingName, Level, Severity
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.outcome import NoFit
from lightflight.reconstruct.fit.revise import refitted
from lightflight.reconstruct.fit.rivals import Rival, rivals_of
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting

LEAST_LOG_EVIDENCE = -float(np.log(100.0))
"""An answer that the recording makes less likely than by this is not told: of two that one could
choose between, the one told is then wrong once in a hundred times."""


def with_alternatives(
    path: LightPath,
    fit: JointFit,
    sightings: list[Sighting],
    setting: Setting,
    n_legs: int | None,
    path_of: Callable[[JointFit], LightPath | None],
) -> LightPath:
    """The path with other answers, "check" where there are some.

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
    path_of : callable
        The estimator's path from a fit of pulses, None where it has none.

    Returns
    -------
    LightPath
        The same where nothing else explains the recording.
    """
    if path.verdict.level is Level.CONTRADICTED:
        return path
    found, findings = [], []
    for rival in _close(fit, setting, n_legs):
        other = refitted(sightings, rival.state, setting)
        if isinstance(other, NoFit) or not rival.is_other(other.solution.state):
            continue
        its_path = path_of(other)
        if its_path is not None:
            found.append(Alternative(its_path, rival.log_evidence, rival.says))
            findings.append(_finding(found[-1], rival))
    if not found:
        return path
    verdict = replace(
        path.verdict, level=Level.CHECK, findings=(*path.verdict.findings, *findings)
    )
    return replace(path, alternatives=tuple(found), verdict=verdict)


def _close(fit: JointFit, setting: Setting, n_legs: int | None) -> list[Rival]:
    """Rivals within reach, the likeliest first; of those that say the same, one."""
    near = [
        one
        for one in rivals_of(fit, setting)
        if one.log_evidence >= LEAST_LOG_EVIDENCE and one.state.has_legs(n_legs)
    ]
    best: dict[str, Rival] = {}
    for one in sorted(near, key=lambda one: -one.log_evidence):
        best.setdefault(one.says, one)
    return list(best.values())


def _finding(other: Alternative, rival: Rival) -> Finding:
    return Finding(
        FindingName.ALTERNATIVE,
        f"{other} explains the recording as well",
        0.0,
        rival.remedy,
        Severity.CHECK,
    )
