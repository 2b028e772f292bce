"""Legs that no pulse speaks for: is there one, or is something else off that it makes up for?

Where times contradict a flight from source to picture, the search for legs may open one outside the
picture: a corner of its own explains much. A trigger that is late by 10 ps looks the same. So the
flight without that leg is asked what else would explain it.
"""

from __future__ import annotations

import numpy as np

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.path.verdict import Finding, FindingName, noted
from lightflight.reconstruct.fit.fine import with_fine_light
from lightflight.reconstruct.fit.joint import JointFit, fit_joint, pulses_of_legs
from lightflight.reconstruct.fit.least_squares import OUTLIER
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.verdict.evidence import WITHIN, Evidence
from lightflight.reconstruct.verdict.geometry_tests import evidence_from_geometry

_FREED = 3
"""Coordinates of the corner that such a leg brings; it was looked for everywhere, so each costs
Schwarz's logarithm of the number of data (Ann. Stat. 6, 461, 1978), not one as of a known cause."""

_SENTENCE = "no pulse speaks for a leg outside the picture that the times ask for"
_REMEDY = "say where the mirror outside the picture is, or give the number of legs"


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
        # In light as the path has it: what differs then is the leg.
        plain = with_fine_light(fit_joint(sightings, straight, setting, legs=None), setting)
    except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
        return ()
    rivals = evidence_from_geometry(plain, sightings, setting)
    chi2 = _excess(plain, rivals) - _excess(fit, own) + _FREED
    by_leg = Evidence(
        FindingName.UNSEEN_LEG,
        max(chi2, 0.0),
        _FREED,
        chi2 - _FREED * float(np.log(len(fit.times.leg))),
        _SENTENCE,
        _REMEDY,
    )
    others = [one for one in rivals if one.name is not FindingName.UNSEEN_LEG]
    enough = by_leg.gain - WITHIN
    if not any(one.gain > enough for one in others if not one.symptom):
        return ()
    return (by_leg, *others)


def findings_of_hidden(fit: JointFit, *, told: bool) -> tuple[Finding, ...]:
    """What is to be said of a path with a leg that no pulse speaks for, told or found."""
    empty = np.flatnonzero(pulses_of_legs(fit) == 0)
    if not len(empty):
        return ()
    sentence = (
        f"no pulse speaks for leg {_number(fit, empty[0])} of the path" if told else _SENTENCE
    )
    return (noted(FindingName.UNSEEN_LEG, sentence, _REMEDY),)


def _number(fit: JointFit, seen: int) -> int:
    """How people count a leg: those that nobody saw too, from 1."""
    return fit.solution.state.seen[seen] + 1


def _excess(fit: JointFit, evidence: tuple[Evidence, ...]) -> float:
    """Chi-square beyond its degrees of freedom: the two fits are not of quite the same pulses."""
    beyond = next(one.chi2 - one.dof for one in evidence if one.name is FindingName.SCATTER)
    return beyond + OUTLIER**2 * int(np.count_nonzero(fit.times.weight == 0))


def _without_hidden(fit: JointFit) -> PathState | None:
    """The path without its first or last leg, where no pulse speaks for that one."""
    state = fit.solution.state
    pulses = pulses_of_legs(fit)
    if state.n_legs < 2 or (pulses[0] and pulses[-1]):
        return None
    corner = 1 if not pulses[0] else state.n_legs - 1
    return state.without((corner,))
