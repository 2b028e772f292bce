"""From evidence to a verdict: one budget of false alarms over all tests, and causes in order.

The smallest of many p-values is small by chance. How small is worked out from the tests' number and
correlation: tests of the same data look along known directions, so their p-values are drawn
together; tests of other data are independent.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri

from lightflight.path.verdict import BlindSpot, Finding, FindingName, Level, Severity, Verdict
from lightflight.reconstruct.verdict.evidence import CHECK_AT, LIGHT, MOST_NAMED, WITHIN, Evidence

Floats = NDArray[np.float64]

CONTRADICTED_AT = 1e-4
"""Family-wise chance of a false "contradicted"."""
SYMPTOMS = frozenset(
    {
        FindingName.UNEXPLAINED_LIGHT, FindingName.SHAPE, FindingName.TREND, FindingName.SCATTER,
        FindingName.UNSEEN_LEG, FindingName.LEG_COUNT, FindingName.NOT_EXAMINED,
    }
)  # fmt: skip
"""What is seen and has no size to be freed: named where no cause takes it up."""
_DRAWS = 2000
"""They know a family's chance to 1 to 2 % of itself, however small."""
_MOST = 1.0 - 0.5 / _DRAWS
"""A chance that is drawn may come out as more than one."""


def verdict_from_evidence(evidence: Sequence[Evidence], noticed: Sequence[Finding] = ()) -> Verdict:
    """The verdict on all tests, and on what was noticed without one."""
    if not evidence:
        return Verdict(Level.CHECK if noticed else Level.TRUST, tuple(noticed))
    p_value = family_p_value(evidence)
    level, severity = Level.TRUST, Severity.CHECK
    if p_value < CONTRADICTED_AT:
        level, severity = Level.CONTRADICTED, Severity.CONTRADICTED
    elif p_value < CHECK_AT or noticed:
        level = Level.CHECK
    if any(finding.severity is Severity.CONTRADICTED for finding in noticed):
        level = Level.CONTRADICTED
    causes = named(evidence) if p_value < CHECK_AT else []
    findings = tuple(
        Finding(one.name, one.sentence, one.sigma, one.remedy, severity) for one in causes
    )
    return Verdict(level, (*findings, *noticed), _blind(evidence), p_value, len(evidence))


def family_p_value(evidence: Sequence[Evidence]) -> float:
    """Chance that the smallest p-value of all these tests is as small where all is well."""
    smallest = min(one.p_value for one in evidence)
    together = [one for one in evidence if one.directions.shape[0]]
    passed = _log_all_above(smallest, [one for one in evidence if one not in together])
    for data in dict.fromkeys(one.data for one in together):
        passed += _log_passed(smallest, [e for e in together if e.data == data])
    return float(-np.expm1(passed))


def _log_all_above(p_value: float, tests: Sequence[Evidence]) -> float:
    """Log of the chance that independent tests all stay above a p-value."""
    chances = np.array([one.chance_of(p_value) for one in tests])
    return float(np.log1p(-np.minimum(chances, 1.0 - 1e-16)).sum())


def _log_passed(p_value: float, together: Sequence[Evidence]) -> float:
    """The same of correlated tests: data are drawn where one of them does not pass.

    A test is chosen by its chance, and data in which it is as improbable; where S tests are, each
    draw counts 1/S of the sum of all chances (Owen, Maximov, Chertkov, Electronic Journal of
    Statistics 13, 231, 2019). Right at any p-value, also far out, where tests that look much
    the same way part.
    """
    directions = np.hstack([one.directions for one in together])
    alike = directions.T @ directions
    values, vectors = np.linalg.eigh(alike)
    # The symmetric root: eigenvectors turn at the last digit's whim, and the draws with them.
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    dof = np.array([one.directions.shape[1] for one in together])
    first = np.cumsum(dof) - dof
    least = np.maximum(chdtri(dof, p_value), [one.silent_below for one in together])
    chances = chdtrc(dof, least)
    rng = np.random.default_rng(1914)
    drawn = rng.normal(size=(_DRAWS, len(root))) @ root
    beyond = rng.uniform(size=_DRAWS)
    chosen = np.searchsorted(np.cumsum(chances) / chances.sum(), (np.arange(_DRAWS) + 0.5) / _DRAWS)
    for k in np.unique(chosen):
        own, at = slice(first[k], first[k] + dof[k]), chosen == k
        here = drawn[at, own]
        far = np.sqrt(chdtri(dof[k], beyond[at] * chances[k]) / np.sum(here**2, axis=1))
        drawn[at] += (far[:, np.newaxis] - 1.0) * here @ alike[own]
    chi2 = np.add.reduceat(drawn**2, first, axis=1)
    # The one that was chosen is among them, whatever is rounded.
    failed = np.maximum(np.sum(chi2 >= least, axis=1), 1)
    one_of_them = float(chances.sum() * np.mean(1.0 / failed))
    return float(np.log1p(-min(one_of_them, _MOST)))


def named(evidence: Sequence[Evidence]) -> list[Evidence]:
    """Causes that cannot be told from the best one, the best first; symptoms where none explains.

    A symptom comes first where the best cause leaves it improbable all the same. What is off with
    the times is no excuse for light that is none of the path's: its causes are named as well.
    """
    causes = best_of_each(sorted((e for e in evidence if not e.symptom), key=lambda e: -e.gain))
    best = causes[0] if causes and causes[0].gain > 0.0 else None
    group = _alike(best, causes)
    if best is not None and best.data != LIGHT:
        other = next((e for e in causes if e.data == LIGHT), None)
        if other is not None and _clear(other, evidence):
            group += [e for e in _alike(other, causes) if e.data == LIGHT and e not in group]
    at = CHECK_AT / len(evidence)
    left = [e for e in evidence if e.symptom and _left_by(best, e) < at]
    # Of equally clear ones that which says where: it knows what remains.
    unexplained = best_of_each(sorted(left, key=lambda e: (e.p_value, np.isnan(e.remains))))
    # Light of one place is no halo, though a halo may be made of it: NaN is not more.
    weak = (
        best is None
        or not _clear(best, evidence)
        or any(e.remains > best.gain for e in unexplained)
    )
    ordered = [*unexplained, *group] if weak else [*group, *unexplained]
    # The test that raised the alarm is named, whatever it is.
    raised = min(evidence, key=lambda e: e.p_value)
    if all(one.p_value > CHECK_AT for one in ordered) or not ordered:
        ordered.insert(0, raised)
    return ordered[:MOST_NAMED]


def leaves_misfit(verdict: Verdict) -> bool:
    """Whether a path is contradicted, and by more than what its verdict names as causes.

    Where one cause takes up all that is seen, another way of the light has nothing left to explain.

    Parameters
    ----------
    verdict : Verdict
        Of the path.

    Returns
    -------
    bool
    """
    return verdict.level is Level.CONTRADICTED and names_symptom(verdict)


def names_symptom(verdict: Verdict) -> bool:
    """Whether a verdict names what none of its causes takes up."""
    return any(one.name in SYMPTOMS for one in verdict.findings)


def best_of_each(ranked: Sequence[Evidence]) -> list[Evidence]:
    """The first of each name."""
    first: dict[FindingName, Evidence] = {}
    for one in ranked:
        first.setdefault(one.name, one)
    return list(first.values())


def _clear(cause: Evidence, evidence: Sequence[Evidence]) -> bool:
    """Whether one test by itself would have raised the alarm."""
    return cause.p_value * len(evidence) <= CHECK_AT


def _alike(best: Evidence | None, causes: Sequence[Evidence]) -> list[Evidence]:
    """The causes that cannot be told from a best one, it included."""
    if best is None:
        return []
    return [e for e in causes if e.gain > max(0.0, best.gain - WITHIN)]


def _left_by(cause: Evidence | None, symptom: Evidence) -> float:
    """p-value of a symptom once a cause is freed that takes up what both see."""
    if cause is None or (symptom.data == LIGHT and cause.data != LIGHT):
        return symptom.p_value
    left = symptom.chi2 - cause.chi2
    if symptom.data == cause.data and np.isfinite(symptom.remains):
        left = symptom.remains
    elif symptom.data == cause.data and symptom.directions.shape[0] and cause.directions.shape[0]:
        taken = symptom.directions.T @ (cause.directions @ cause.deviates)
        left = float(np.sum((symptom.deviates - taken) ** 2))
    return float(chdtrc(symptom.dof, max(0.0, left)))


def _blind(evidence: Sequence[Evidence]) -> tuple[BlindSpot, ...]:
    spots = [spot for one in evidence for spot in one.blind]
    return tuple(sorted(spots, key=lambda spot: -spot.moves_mm))
