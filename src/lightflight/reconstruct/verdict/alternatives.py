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

_TELL_DEPTH = "tell when the pulse set out, or where a place of this leg is (waypoints)"
_TELL_LEGS = "tell how many legs there are (n_legs, --n-legs)"
LEAST_LOG_EVIDENCE = -float(np.log(100.0))
"""An answer that the recording makes less likely than by this is not told: of two that one could
choose between, the one told is then wrong once in a hundred times."""


def with_alternatives(
    path: LightPath,
    fit: JointFit,
    sightings: list[Sighting],
    setting: Setting,
    n_legs: int | None,
    told_of: Callable[[JointFit], tuple[LightPath, JointFit] | None],
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
    told_of : callable
        The estimator's path from a fit of pulses, and that fit in the light as it is; None where
        it has none.

    Returns
    -------
    LightPath
        The same where nothing else explains the recording.
    """
    if path.verdict.level is Level.CONTRADICTED:
        return path
    best: dict[str, tuple[Alternative, Rival]] = {}
    for rival in rivals_of(fit, setting):
        other = (
            _told(rival, fit, sightings, setting, told_of) if rival.state.has_legs(n_legs) else None
        )
        known = best.get(rival.says)
        if other and (known is None or other.log_evidence > known[0].log_evidence):
            best[rival.says] = other, rival
    if not best:
        return path
    found = sorted(best.values(), key=lambda one: -one[0].log_evidence)
    verdict = replace(
        path.verdict,
        level=Level.CHECK,
        findings=(*path.verdict.findings, *(_finding(*one, path.n_legs) for one in found)),
    )
    return replace(path, alternatives=tuple(other for other, _ in found), verdict=verdict)


def _told(
    rival: Rival,
    fit: JointFit,
    sightings: list[Sighting],
    setting: Setting,
    told_of: Callable[[JointFit], tuple[LightPath, JointFit] | None],
) -> Alternative | None:
    """The rival as a path of its own, where it is likely enough.

    Lines say where a leg runs at two places of its image, or few more. What the counts say against
    the shape in between is the kinks they ask for.
    """
    own_kinks = _kinks_chi2(fit)
    if rival.log_evidence + 0.5 * own_kinks < LEAST_LOG_EVIDENCE:
        return None
    refit = refitted(sightings, rival.state, setting)
    if isinstance(refit, NoFit) or not rival.is_other(refit.solution.state):
        return None
    told = told_of(refit)
    if told is None:
        return None
    log_evidence = rival.log_evidence + 0.5 * (own_kinks - _kinks_chi2(told[1]))
    if log_evidence < LEAST_LOG_EVIDENCE:
        return None
    return Alternative(told[0], log_evidence, rival.says)


def _kinks_chi2(fit: JointFit) -> float:
    """What the counts say against the shape of each leg's image, chi-square."""
    return float(sum(line.bend_chi2 for picture in fit.pictures for line in picture.fits))


def _finding(other: Alternative, rival: Rival, n_legs: int) -> Finding:
    return Finding(
        FindingName.ALTERNATIVE,
        f"{other} explains the recording as well",
        0.0,
        _TELL_DEPTH if rival.state.n_legs == n_legs else _TELL_LEGS,
        Severity.CHECK,
    )
