"""Light that the fit has taken up: named all the same, and no contradiction any more.

Tests of the counts ask whether a plain flight explains them. Where haze, a halo, glare, a mirror or
a second pulse does not let it, and the fit has measured their strengths, the counts are held
against the flight with that light. What passes then is told, since more of it would harm; the
path's errors hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.result import mirror_of_fit, second_pulse_of_fit
from lightflight.reconstruct.model import light
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.spread import WIDE_LATE, WIDE_PX
from lightflight.reconstruct.verdict.count_evidence import causes, evidence_from_counts
from lightflight.reconstruct.verdict.evidence import Evidence
from lightflight.reconstruct.verdict.judge import verdict_from_evidence

_DIFFUSE = (FindingName.HAZE, FindingName.SHAPE, FindingName.HALO, FindingName.GLARE)
"""What `other_light.diffuse` has a place for."""
_MOST_SHARE = 2.0
"""Of the path's own light, two thirds of all: thicker fog was not solved. That strengths are
unusual their priors say, and the counts whether the light is such."""


def verdict_with_light_taken_up(
    plain: Verdict,
    evidence: Sequence[Evidence],
    noticed: Sequence[Finding],
    fit: JointFit,
    sightings: list[Sighting],
    *,
    nominal: bool,
) -> Verdict:
    """The verdict where the counts are held against a flight with the light that the fit found.

    Parameters
    ----------
    plain : Verdict
        With the counts held against a plain flight.
    evidence : sequence of Evidence
        All tests but those of the counts.
    noticed : sequence of Finding
        What was noticed without a test.
    fit : JointFit
        The path, and the strengths of diffuse light.
    sightings : list of Sighting
        Its recordings.
    nominal : bool
        Whether the widths of the codes were never measured.

    Returns
    -------
    Verdict
        `plain`, unless diffuse light of a plausible strength, or light that comes twice, is all
        that contradicts the path.
    """
    if plain.level is not Level.CONTRADICTED or not _plausible(fit):
        return plain
    try:
        counts = evidence_from_counts(fit, sightings, nominal=nominal, taken_up=True)
    except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
        return plain
    left = verdict_from_evidence((*evidence, *counts), noticed)
    if left.level is Level.CONTRADICTED:
        return plain
    told = tuple(
        replace(one, sentence=f"{one.sentence}: taken into the fit", severity=Severity.CHECK)
        for one in _as_fitted(plain, fit)
    )
    return replace(left, level=Level.CHECK, findings=(*told, *left.findings))


def _as_fitted(plain: Verdict, fit: JointFit) -> tuple[Finding, ...]:
    """What the fit has taken up, with the strengths that it has.

    Causes that were named keep their names. Where none has a place in the fit, as where a short
    tail was taken for an echo, what there is most of in the fit is named.
    """
    twice = _what_comes_twice(plain, fit)
    most = max(fit.strengths, key=lambda one: float(one.of_kinds.sum()))
    named = tuple(_with_strength(one, most) for one in plain.findings if one.name in _DIFFUSE)
    if named or twice:
        return (*twice, *named)
    sigma = max((one.sigma for one in plain.findings), default=0.0)
    cause = max(
        (one for one in causes(np.empty(0)) if one.name in _DIFFUSE[1:]),
        key=lambda one: _share_and_words(one.name, most)[0],
    )
    words = _share_and_words(cause.name, most)[1]
    return (Finding(cause.name, words, sigma, cause.remedy, Severity.CHECK),)


def _with_strength(finding: Finding, most: light.Strengths) -> Finding:
    """The finding with the strength that the fit has: tests tell sizes from a plain flight's.

    As it was where the fit calls most of that light by another name.
    """
    share, words = _share_and_words(finding.name, most)
    return replace(finding, sentence=words) if share > light.LEAST_SHARE else finding


def _share_and_words(name: FindingName, most: light.Strengths) -> tuple[float, str]:
    """How much light of that name the fit has, and what is said of it."""
    if name in (FindingName.HAZE, FindingName.SHAPE):
        share, wait = _sum_and_mean(most.tails)
        words = {
            FindingName.HAZE: f"{share:.2g} of the light on the path comes late",
            FindingName.SHAPE: f"pulses have a tail: {share:.2g} of their light",
        }[name]
        return share, f"{words}, by some {wait:.3g} ps"
    if name is FindingName.HALO:
        reaches = (*WIDE_PX, *(reach for reach, _ in WIDE_LATE))
        share, reach = _sum_and_mean(list(zip(most.value[light.HALOS], reaches, strict=True)))
        return share, f"{share:.2g} of the light lies about the path, over some {reach:.2g} px"
    share = float(most.of_kinds[-2:].sum())
    return share, f"{share:.2g} of the light lies over the whole picture"


def _sum_and_mean(parts: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Of shares and what they are by: the sum of shares, and the mean by those above none."""
    shares, values = np.array(parts).T
    weights = np.maximum(shares, 0.0)
    return float(shares.sum()), float(weights @ values / max(float(weights.sum()), 1e-12))


def _what_comes_twice(plain: Verdict, fit: JointFit) -> tuple[Finding, ...]:
    """What is said of a second pulse or a mirror as fitted; () where there is neither."""
    sigma = max((one.sigma for one in plain.findings), default=0.0)

    def said(what: str, remedy: str) -> tuple[Finding, ...]:
        return (Finding(FindingName.OTHER_PULSE, what, sigma, remedy, Severity.CHECK),)

    pulse = second_pulse_of_fit(fit)
    if pulse is not None:
        return said(
            f"a second pulse of {pulse}",
            "look for a reflection in windows and filters, or a second pulse of the laser",
        )
    mirror = mirror_of_fit(fit)
    if mirror is None:
        return ()
    return said(
        "the flight is seen once more in a mirror (a wall, a window) "
        f"{mirror.behind_mm:.3g} mm behind it, with {mirror.mean_share:.2g} of its light",
        "cover what reflects, if it can be",
    )


def _plausible(fit: JointFit) -> bool:
    """Whether the fit found diffuse light, in all no more than twice the path's own."""
    return bool(fit.strengths) and all(
        float(np.maximum(one.of_kinds, 0.0).sum()) <= _MOST_SHARE for one in fit.strengths
    )
