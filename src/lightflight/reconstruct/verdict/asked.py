"""How far what is freed may be off: as far as the misfit asks, where the recording shows one.

A cause that the data cannot tell from five others is off by no more than what the misfit would need
of it alone; its plausible size, an inch or half a nanosecond, would make bars a hundred times wider
than what is wrong. Let each of K causes explain the misfit alone by d_k: with priors of
d_k / sqrt(K) all together expect a misfit as large as was seen, the likeliest common size.
"""

from __future__ import annotations

from collections.abc import Iterable

from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.verdict.doubtful import causes_instead_of_corners
from lightflight.reconstruct.verdict.evidence import CHECK_AT, WITHIN, Evidence
from lightflight.reconstruct.verdict.examine import evidence_of_pulses
from lightflight.reconstruct.verdict.hidden import findings_of_hidden
from lightflight.reconstruct.verdict.judge import family_p_value

_SAME_AS = {"emission_time": "clock_offset"}
"""Causes that no test is made for, and that with the same effect on all times."""


def shares_asked_for(
    fit: JointFit,
    sightings: list[Sighting],
    setting: Setting,
    free: Iterable[str],
    *,
    n_legs: int | None = None,
) -> dict[str, float]:
    """Shares of their plausible sizes that a misfit asks of causes, of those it speaks for.

    Parameters
    ----------
    fit : JointFit
        With all as it was told.
    sightings : list of Sighting
        Its recordings.
    setting : Setting
        As told.
    free : iterable of str
        Names of `free=`.
    n_legs : int, optional
        How many legs were told; None: as many as were found.

    Returns
    -------
    dict of str to float
        Of names that explain the misfit as well as the best cause; at most one. Empty where the
        recording shows no misfit, nor a corner that may stand for one: then nothing says how far
        things are off.
    """
    hidden = findings_of_hidden(fit, told=n_legs is not None)
    evidence, _ = evidence_of_pulses(fit, hidden, sightings, setting, n_legs=n_legs)
    if family_p_value(evidence) <= CHECK_AT:
        causes = _explaining([one for one in evidence if not one.symptom])
    elif n_legs is None:
        # A corner more explains what a clock that is early does: without it there is a misfit.
        causes = causes_instead_of_corners(fit, sightings, setting)[1]
    else:
        causes = []
    named = {one.frees: one.need for one in causes if one.frees}
    needs = {name: named.get(_SAME_AS.get(name, name)) for name in free}
    told = {name: need for name, need in needs.items() if need is not None}
    return {name: min(1.0, need / len(told) ** 0.5) for name, need in told.items()}


def _explaining(causes: list[Evidence]) -> list[Evidence]:
    """Those that gain as much as the best, nearly."""
    best = max((one.gain for one in causes), default=0.0)
    return [one for one in causes if best > 0.0 and one.gain > best - WITHIN]
