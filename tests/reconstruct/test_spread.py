"""Halo and glare of a beam, of which part lies outside of the picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from lightflight.reconstruct.model import spread
from lightflight.reconstruct.model.cells import Cells
from lightflight.reconstruct.model.light import Strengths

SHAPE = (17, 21)
PHOTONS_PER_PX = 1000.0
PER_PX = 4
ROW = 8.0
N_HALOS = len(spread.WIDE_PX) + len(spread.WIDE_LATE)
N_WIDE = len(spread.WIDE_LABELS)


def beam(first_px: float, last_px: float) -> spread.Beam:
    """Even light along a row of the picture, all of it at one time."""
    n = int((last_px - first_px) * PER_PX)
    col = first_px + (np.arange(n) + 0.5) / PER_PX
    return spread.Beam(
        np.column_stack((np.full(n, ROW), col)), np.zeros(n, dtype=int), np.zeros(n),
        np.full(n, PHOTONS_PER_PX / PER_PX), 50.0,
    )  # fmt: skip


def light_in(points: np.ndarray, of: spread.Beam) -> spread.Spread:
    """Spread light in pixels, in one cell that holds all times."""
    n = len(points)
    edges = np.tile([-1e6, 1e6], (n, 1))
    one = np.ones((n, 1))
    cells = Cells(edges, one, one > 0.0, 0.0 * one, one)
    return spread.spread_light(cells, points, np.zeros(n), of, SHAPE)


def test_the_halo_of_a_line_that_runs_on_is_even():
    points = np.array([[8, 0], [8, 10], [8, 20], [5, 0], [11, 20]])
    found = light_in(points, beam(-90.0, 110.0))
    for k, reach in enumerate(spread.WIDE_PX):
        across = norm.pdf(points[:, 0] - ROW, scale=reach)
        # Less than a ten-thousandth of its brightest pixel is none, from each side and within.
        assert found.wide[:, 0, k] == pytest.approx(PHOTONS_PER_PX * across, rel=1e-4)
    # What comes from outside of the picture: by the line's share beyond its edge.
    assert list(found.sides) == [2, 3]
    for k, reach in enumerate(spread.WIDE_PX):
        across = PHOTONS_PER_PX * norm.pdf(points[:, 0] - ROW, scale=reach)
        left = norm.cdf((-0.5 - points[:, 1]) / reach)
        right = norm.sf((SHAPE[1] - 0.5 - points[:, 1]) / reach)
        assert found.outside[:, 0, 0, k] == pytest.approx(across * left, rel=2e-3, abs=0.02)
        assert found.outside[:, 0, 1, k] == pytest.approx(across * right, rel=2e-3, abs=0.02)


def test_light_outside_makes_no_glare():
    points = np.array([[2, 3]])
    found = light_in(points, beam(-90.0, 110.0))
    inside = SHAPE[1] * PHOTONS_PER_PX
    assert found.wide[0, 0, N_HALOS] == pytest.approx(inside / (SHAPE[0] * SHAPE[1]), rel=1e-6)


def test_counts_follow_their_columns():
    points = np.array([[8, 0], [8, 10], [3, 20]])
    light = light_in(points, beam(-90.0, 110.0))
    rng = np.random.default_rng(3)
    at = rng.normal(size=N_WIDE + 4)
    wide, outside = np.split(at, [N_WIDE])
    columns = light.columns(wide, outside)
    step = 1e-6
    for k, nudge in enumerate(step * np.eye(len(at))):
        by = (light.counts(*np.split(at + nudge, [N_WIDE])) - light.counts(wide, outside)) / step
        assert columns[:, :, k] == pytest.approx(by, rel=1e-5, abs=1e-5)
    # The same with the light outside as bright as it is then.
    as_bright = light_in(points, beam(-90.0, 110.0).brighter(outside, SHAPE))
    assert light.counts(wide, outside) == pytest.approx(as_bright.wide @ wide, rel=1e-9)
    # None outside: minus once as much as was guessed.
    alone = light_in(points, beam(-0.5, SHAPE[1] - 0.5))
    assert light.counts(wide, -np.ones(4)) == pytest.approx(alone.counts(wide, outside), rel=1e-9)


def test_strengths_tell_their_parts_apart():
    from lightflight.reconstruct.model.light import LABELS

    value = np.arange(float(len(LABELS)))
    of = Strengths(value, np.zeros((len(value), len(value))))
    told = dict(zip(LABELS, value, strict=True))
    assert of.wide[0] == told["about the path by 2 px"]
    assert of.outside[3] == told["how much brighter it is right of the picture"]
    assert of.of_kinds[0] == told["late by 150 ps"]
    halo = [told[f"about the path by {reach:g} px"] for reach in spread.WIDE_PX]
    assert of.of_kinds[3] == sum(halo)
    late = [
        told[f"about the path by {px:g} px and late by {ps:g} ps"] for px, ps in spread.WIDE_LATE
    ]
    assert of.of_kinds[4] == sum(late)
    assert of.tails[1][0] == told["late by 500 ps"]


def test_light_that_is_all_outside_makes_a_halo_and_no_glare():
    found = light_in(np.array([[8, 20]]), beam(SHAPE[1] - 0.5, 80.0))
    assert list(found.sides) == [3]
    assert found.wide[0, 0, :N_HALOS] == pytest.approx(found.outside[0, 0, 0])
    assert not found.wide[0, 0, N_HALOS:].any()


def test_counts_of_cells_alike_are_those_of_every_column():
    """Against `wide_light`, strength by strength, legs of two times, light outside: 1e-3 of it."""
    rng = np.random.default_rng(7)
    bent = beam(-20.0, 30.0)
    bent = replace(
        bent,
        leg=(np.arange(len(bent.leg)) > 60).astype(int),
        arrival_ps=3000.0 + 20.0 * bent.points_px[:, 1] + rng.uniform(0.0, 30.0, len(bent.leg)),
    )
    points = np.array([[8, 0], [8, 10], [3, 20], [16, 7]])
    edges = np.concatenate((np.arange(0.0, 5000.0, 25.0), [9e3, 2e4]))
    one = np.ones((4, len(edges) - 1))
    cells = Cells(np.tile(edges - 1000.0, (4, 1)), one, one > 0.0, 0.0 * one, one)
    wide = rng.normal(0.0, 0.1, N_WIDE)
    columns = spread.wide_light(cells, points, np.full(4, 1000.0), bent, SHAPE)
    found = spread.spread_counts(edges, points, bent, SHAPE, wide)
    assert found == pytest.approx(columns @ wide, abs=1e-3 * np.abs(columns).sum(axis=1).max())
    assert found.sum(axis=1) == pytest.approx(columns.sum(axis=1) @ wide, rel=1e-3)
