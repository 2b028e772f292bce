"""Tests that a floor of no account had blunted were budgeted as if they could still raise alarms.

In bright light the lopsidedness of legs is known to a tenth of what is of no account, which its
divisor holds: where all is well the test never speaks, and the others' p-values came out too large.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from lightflight.path.verdict import FindingName
from lightflight.reconstruct.verdict.evidence import Evidence, evidence_from_deviate
from lightflight.reconstruct.verdict.judge import family_p_value

WIDENED = 10.0


def of(z: float) -> Evidence:
    return evidence_from_deviate(FindingName.HALO, z, sentence="", remedy="")


def blunted(z: float) -> Evidence:
    """A test whose number chance spreads by one, divided by ten."""
    return replace(of(z / WIDENED), widened=WIDENED)


def test_p_values_are_uniform_beside_tests_that_a_floor_blunts():
    """Two tests and four that are blunted, 4,000 times; false alarm 1e-4."""
    rng = np.random.default_rng(29)
    found = [
        family_p_value([*map(of, rng.normal(size=2)), *map(blunted, rng.normal(size=4))])
        for _ in range(4000)
    ]
    # Taken for six tests they would have a median of 0.86.
    assert kstest(found, "uniform").pvalue > 1e-4


def test_a_blunted_test_that_speaks_is_no_clearer_than_its_floor_lets_it_be():
    """At 30 deviations of chance, 3 of its divisor: 0.3 %, with nine more like it."""
    alone = family_p_value([blunted(30.0), *[blunted(0.0)] * 9])
    assert alone == pytest.approx(chi2.sf(9.0, 1), rel=1e-6)
