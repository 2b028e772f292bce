"""Legs that no pulse speaks for: is there one, or is something else off that it makes up for?

Where times contradict a flight from source to picture, the search for legs may open one outside the
picture: a corner of its own explains much. A trigger that is late by 10 ps looks the same. So the
flight without that leg is asked what else would explain it.
"""

from __future__ import annotations

import numpy as np

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.path.verdict import FindingName
from lightflight.reconstruct.fit.joint import JointFit, fit_joint
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.verdict.evidence import Evidence
from lightflight.reconstruct.verdict.geometry_tests import evidence_from_geometry

_WITHIN = 9.0
"""A cause whose gain is as near as this to the leg's cannot be told from it."""
_LINEAR = 0.02
"""Share by which the gain of a large error may be wrong, worked out by a straight line."""
_FREED = 3
"""Coordinates of the corner that such a leg brings."""


def evidence_without_hidden(
    fit: JointFit, own: tuple[Evidence, ...], sightings: list[Sighting], setting: Setting
) -> tuple[Evidence, ...]:
    """Tests of the flight without a leg that has no pulse, where another cause would do as well.

    Empty where every leg has pulses, or nothing else explains what the leg does. `own` is the
    evidence on the fit as it is.
    """
    straight = _without_hidden(fit)
    if straight is None:
        return ()
    try:
        plain = fit_joint(sightings, straight, setting, legs=None)
    except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
        return ()
    rivals = evidence_from_geometry(plain, sightings, setting)
    gained = _whole(rivals) - _whole(own)
    by_leg = Evidence(
        FindingName.UNSEEN_LEG,
        max(gained, 0.0),
        _FREED,
        gained - _FREED,
        "no pulse speaks for a leg outside the picture that the times ask for",
        "say where the mirror outside the picture is, or give the number of legs",
        np.empty((0, _FREED)),
    )
    others = [one for one in rivals if one.name is not FindingName.UNSEEN_LEG]
    enough = (1.0 - _LINEAR) * by_leg.gain - _WITHIN
    if not any(one.gain > enough for one in others if not one.symptom):
        return ()
    return (by_leg, *others)


def _whole(evidence: tuple[Evidence, ...]) -> float:
    """Chi-square of all rows."""
    return next(one.chi2 for one in evidence if one.name is FindingName.SCATTER)


def _without_hidden(fit: JointFit) -> PathState | None:
    """The path without its first or last leg, where no pulse speaks for that one."""
    state = fit.solution.state
    pulses = np.bincount(fit.times.leg[fit.times.weight > 0], minlength=state.n_legs)
    if state.n_legs < 2 or (pulses[0] and pulses[-1]):
        return None
    corner = 1 if not pulses[0] else state.n_legs - 1
    return PathState(np.delete(state.vertices_mm, corner, axis=0), state.start_time_ps)
