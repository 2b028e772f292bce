"""Widths that all pixels share: smooth where they are, one by one where they are not."""

import numpy as np
import pytest

from lightflight.timing.calibrate.shared_widths import Plateau, shared_widths
from lightflight.timing.clock.code_edges import walked

PLATEAU = Plateau(first_live=0, start=16, stop=600, fall=600, end_seen=False)


def counted(rng, own, counts):
    widths = 1.0 + own * rng.normal(size=600)
    return widths / widths[16:].mean(), rng.poisson(counts * widths).astype(float)


@pytest.mark.parametrize(("own", "counts"), [(0.03, 2e3), (0.03, 2e4), (0.08, 500.0), (0.002, 1e6)])
def test_widths_come_back_within_their_error(rng, own, counts):
    """Rms of 600 errors over the stated one: within 0.87 to 1.13 in all but one of 10,000."""
    widths, summed = counted(rng, own, counts)
    found = shared_widths(summed, np.full(600, counts), PLATEAU)
    assert found.spread2 == pytest.approx(own**2, rel=0.35)
    assert 0.87 < np.sqrt(np.mean((found.widths - widths) ** 2)) / found.std < 1.13


def test_equal_codes_are_smooth(rng):
    """20 recordings: by chance one in 90 would be taken for unequal, each by little."""
    unequal = [
        shared_widths(counted(rng, 0.0, 1e4)[1], np.full(600, 1e4), PLATEAU) for _ in range(20)
    ]
    assert sum(one.spread2 > 0.0 for one in unequal) <= 2
    assert all(np.ptp(one.widths) == 0.0 for one in unequal if one.spread2 == 0.0)


def test_few_codes_that_stand_out_make_the_others_no_less_equal(rng):
    _, summed = counted(rng, 0.0, 1e4)
    summed[[100, 350, 351]] *= [2.0, 1.3, 0.6]
    found = shared_widths(summed, np.full(600, 1e4), PLATEAU)
    assert found.spread2 == 0.0
    np.testing.assert_allclose(found.widths[[100, 350, 351]], [2.0, 1.3, 0.6], rtol=0.05)
    np.testing.assert_allclose(np.delete(found.widths, [100, 350, 351]), 1.0, rtol=0.01)


def test_codes_counted_later_are_drawn_alike(rng):
    widths, summed = counted(rng, 0.05, 1e4)
    short = Plateau(first_live=0, start=16, stop=500, fall=550, end_seen=True)
    found = shared_widths(summed, np.full(600, 1e4), short)
    np.testing.assert_allclose(found.widths[550:], found.regular[0:1].mean(), atol=0.2)
    expected = np.where(np.arange(600) < 550, 0.0, 1e4 * found.regular)
    whole = found.with_counts(np.where(expected > 0.0, summed, 0.0), expected)
    np.testing.assert_allclose(
        whole.widths / whole.widths.mean(), widths / widths.mean(), atol=0.06
    )


def test_a_walk_has_gone_as_far_as_it_is_long():
    """At the ends of stretches its variance is their length, forward and back."""
    ends = np.array([10.0, 40.0])
    codes = np.array([0.0, 10.0, 40.0, 90.0, -10.0, -40.0, -90.0])
    np.testing.assert_allclose(np.sum(walked(codes, ends) ** 2, axis=1), np.abs(codes))
    # Within one it is a line: of no more variance than a walk's.
    inside = np.linspace(-100.0, 100.0, 201)
    assert (np.sum(walked(inside, ends) ** 2, axis=1) <= np.abs(inside) + 1e-9).all()
    # What it does behind the flat tells nothing of what it does before.
    assert not (walked(codes[1:4], ends)[:, 3:]).any()
