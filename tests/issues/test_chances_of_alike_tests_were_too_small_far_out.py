"""Chances of a family of tests were taken from how alike they are at 5 %, also at 1e-6.

Tests that look nearly the same way fail together at 5 % and apart far out: of forty directions in a
plane one fails at 1e-6 in 6.3e-6 of all recordings, where 3.4e-6 was told. In the families of real
paths (some 15 such tests) "contradicted" came 1.2 times as often as said.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import chdtri

from lightflight.reconstruct.verdict.judge import family_p_value
from tests.reconstruct.test_verdict import along


@pytest.mark.parametrize("p_value", [0.05, 1e-3, 1e-6, 1e-12])
@pytest.mark.parametrize("n_tests", [3, 12, 40])
def test_tests_in_a_plane_fail_as_often_as_the_corners_of_a_polygon_say(
    n_tests: int, p_value: float
) -> None:
    """All pass within a polygon of twice as many sides; drawn to 2 % (four errors of the draws)."""
    turns = np.pi * np.arange(n_tests) / n_tests
    columns = [np.array([[np.cos(turn)], [np.sin(turn)]]) for turn in turns]
    inradius = float(np.sqrt(chdtri(1, p_value)))
    half = np.pi / (2 * n_tests)
    outside = quad(lambda turn: np.exp(-0.5 * (inradius / np.cos(turn)) ** 2), 0.0, half)[0] / half
    # The first test is the least likely one: no other looks along its direction.
    tests = [along(own, inradius * columns[0][:, 0]) for own in columns]
    assert family_p_value(tests) == pytest.approx(outside, rel=0.03)
