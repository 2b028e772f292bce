"""Counts of halo and glare were known from 1.5 ns before the middle of the flight on.

In pixels that no leg lights; and finely for 1.5 ns after it. Three legs last 4 ns: `photon`, which
expects these counts, was 19 times as far off as the bound beside a halo over 3 px.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from lightflight.reconstruct.model.light import LABELS, WIDE, Diffuse, Strengths
from lightflight.reconstruct.model.spread import WIDE_PX, Beam

SHAPE = (16, 16)
STD_PS, CODE_PS, SHARE, PHOTONS = 60.0, 50.0, 0.25, 40_000.0
AT_PS = (20_000.0, 22_000.0, 24_000.0)
"""Three bright places, 2 ns apart."""


def test_spread_light_is_expected_where_and_when_it_comes():
    at = np.array([[3, 3], [8, 8], [12, 12]])
    beam = Beam(at.astype(float), np.arange(3), np.array(AT_PS), np.full(3, PHOTONS), STD_PS)
    value = np.zeros(len(LABELS))
    value[WIDE.start] = SHARE
    # A leg lights the last pixel, by nothing.
    last, nothing = np.array([15]), np.zeros((1, 1))
    diffuse = Diffuse(
        Strengths(value, np.zeros((len(value), len(value)))), beam, last, last,
        np.zeros((1, 1), dtype=int), nothing, nothing, nothing, np.zeros((1, 1, 1)),
    )  # fmt: skip
    # Beside each of them, where the halos of the others are below a photon.
    rows, cols = at[:, 0], at[:, 1] + 1
    lower = np.tile(np.arange(17_000.0, 28_000.0, CODE_PS), (3, 1))
    found = diffuse.counts(rows, cols, (lower, lower + CODE_PS), 0.0, SHAPE)
    reach, edges = WIDE_PX[0], np.append(lower[0], lower[0, -1] + CODE_PS)
    for pixel in range(3):
        expected = np.zeros(lower.shape[1])
        for place, time in zip(at, AT_PS, strict=True):
            gap = np.hypot(*(place - (rows[pixel], cols[pixel])))
            light = SHARE * PHOTONS * norm.pdf(gap, scale=reach) * norm.pdf(0.0, scale=reach)
            expected += light * np.diff(norm.cdf(edges, time, STD_PS))
        # Straight lines over 25 ps of a pulse of 60: to 3 % of its brightest code.
        assert found[pixel] == pytest.approx(expected, abs=0.03 * expected.max())
        assert found[pixel].sum() == pytest.approx(expected.sum(), rel=1e-3)
