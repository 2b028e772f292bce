"""From evidence to a verdict: one budget of false alarms over all tests, and causes in order.

The smallest of many p-values is small by chance. How small is worked out from the tests' number and
correlation: tests of the same data look along known directions, so their p-values are drawn
together; tests of other data are independent.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

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
_TABLE = 200
"""Points of a table of chances: straight lines between them err by 1e-3 of a chance."""
_LEAST_P = 1e-300
_TAIL = 0.05
"""Below this, drawn p-values are too few: how far tests are alike is taken from here."""


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
    """Log of the chance that independent tests all stay above a p-value.

    A test that is silent up to some size is not below it more often than it speaks.
    """
    speak = np.array([one.speaks for one in tests])
    return float(np.log1p(-np.minimum(np.minimum(p_value, speak), 1.0 - 1e-16)).sum())


def _log_passed(p_value: float, together: Sequence[Evidence]) -> float:
    """The same of correlated tests, from drawn smallest p-values."""
    drawn = _drawn_smallest(together)
    tail = float(np.quantile(drawn, _TAIL))
    if p_value >= tail:
        above = int(np.count_nonzero(drawn > p_value))
        return float(np.log(max(float(above), 0.5) / len(drawn)))
    independent = _log_all_above(tail, together)
    alike = np.log1p(-_TAIL) / min(independent, float(np.log1p(-_TAIL)))
    return float(alike * _log_all_above(p_value, together))


def _drawn_smallest(together: Sequence[Evidence]) -> Floats:
    """Smallest p-values (draws,) of tests of the same data where all is well."""
    directions = np.hstack([one.directions for one in together])
    values, vectors = np.linalg.eigh(directions.T @ directions)
    # The symmetric root: eigenvectors turn at the last digit's whim, and the draws with them.
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    drawn = np.random.default_rng(1914).normal(size=(_DRAWS, len(root))) @ root
    dof = np.array([one.directions.shape[1] for one in together])
    chi2 = np.add.reduceat(drawn**2, np.cumsum(dof) - dof, axis=1)
    chi2[chi2 < np.array([one.silent_below for one in together])] = 0.0
    # Of tests of equal freedom the largest chi-square is the least likely one.
    by_dof = [_log_chances(int(k), chi2[:, dof == k].max(axis=1)) for k in np.unique(dof)]
    smallest: Floats = np.exp(np.min(by_dof, axis=0))
    return smallest


def _log_chances(dof: int, chi2: Floats) -> Floats:
    """Log of the chance of chi-squares as large; read off a table, which is as good and faster."""
    table = np.linspace(0.0, float(chi2.max()), _TABLE)
    logs: Floats = np.interp(chi2, table, np.log(chdtrc(dof, table) + _LEAST_P))
    return logs


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
