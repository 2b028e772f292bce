"""One stray pulse far from the others moved all of them by a laser period."""

import numpy as np

from lightflight.reconstruct.legs.find import unwrapped_arrivals


def test_a_stray_pulse_does_not_move_all_others_by_a_period():
    given = [4_000.0, 5_000.0, 7_000.0, 40_000.0]
    times = unwrapped_arrivals(given, period_ps=50_000.0)
    np.testing.assert_allclose(times, [4_000.0, 5_000.0, 7_000.0, -10_000.0])
