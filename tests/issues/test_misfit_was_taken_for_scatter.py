"""The error floor took every misfit, and chi-square stayed at one.

Found with haze, which has a place in the fit since then; a lens that bends lines has none.
"""

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.fixture(scope="module", params=["joint", pytest.param("photon", marks=pytest.mark.long)])
def misfitting_path(request):
    """Three legs, 40,000 photons, lines bent by a pixel at the corner."""
    barrel = DEFECTS["barrel"]
    assert not barrel.held_out
    world = barrel.applied(random_world(3, 3, 40_000.0, "known"), barrel.strengths[1])
    with pytest.warns(SuspectDataWarning, match="contradicts"):
        return lf.reconstruct(record(world, 3), method=request.param, **what_the_user_tells(world))


def test_chi2_shows_what_the_floor_took(misfitting_path):
    good = misfitting_path.goodness
    assert good.error_floor_ps > 0.0
    assert good.reduced_chi2 > 2.0
    # Of 17 and 19 a degree of freedom: lines that are bent are believed less than straight ones.
    assert good.chi2_with_floor < 4.0 * good.dof < 0.3 * good.chi2


def test_the_lens_is_named(misfitting_path):
    verdict = misfitting_path.verdict
    assert verdict.level == "contradicted"
    assert verdict.n_tests > 5
    assert "distortion" in [finding.name for finding in verdict.findings]
    assert len(verdict.findings) <= 6


def test_it_is_told_as_misfit(misfitting_path):
    good = misfitting_path.goodness
    assert "beyond the stated errors" in good.floor_in_words
    assert good.floor_in_words.endswith("misfit")
    assert good.floor_share == pytest.approx(1.0 - good.chi2_with_floor / good.chi2)
    assert good.floor_share > 0.9


def test_the_stated_errors_are_those_of_the_table_less_the_floor(misfitting_path):
    table, good = misfitting_path.residuals, misfitting_path.goodness
    used = table[table["used"]]
    stated = used["std_ps"] ** 2 - good.error_floor_ps**2
    assert good.chi2 == pytest.approx(np.sum(used["residual_ps"] ** 2 / stated), rel=1e-6)
    scaled = used["residual_ps"] / used["std_ps"]
    assert good.chi2_with_floor == pytest.approx(np.sum(scaled**2), rel=1e-6)
