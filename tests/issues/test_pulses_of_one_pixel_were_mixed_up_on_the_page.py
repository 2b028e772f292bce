"""The page matched pulses by their pixel alone: with two in one, each got the other's width."""

import numpy as np

from lightflight.path.tables import RESIDUAL_DTYPE
from lightflight.timing.pulses.arrivals import Arrivals
from lightflight.view.page import payload

PERIOD_PS = 50_000.0


def arrivals_of(rows, cols, times, stds):
    n = len(rows)
    zero = np.zeros(n)
    return Arrivals(
        row=np.array(rows), col=np.array(cols), arrival_ps=np.array(times), photon_std_ps=zero,
        pixel_std_ps=zero, shared_modes_ps=np.zeros((n, 0)), shared_names=(),
        std_ps=np.array(stds), std_error_ps=zero, photons=zero + 100.0, photons_std=zero,
        background_per_ps=zero, chi2=zero, dof=np.zeros(n, int), flags=np.zeros(n, np.uint32),
        pulse_index=np.zeros(n, int), shape=(4, 4), laser_period_ps=PERIOD_PS, method="likelihood",
    )  # fmt: skip


def path_pulses(rows, cols, times):
    n = len(rows)
    table = {name: np.zeros(n) for name in RESIDUAL_DTYPE.names}
    table |= {"row": np.array(rows), "col": np.array(cols), "arrival_ps": np.array(times)}
    return table | {"width_ps": np.full(n, np.nan)}


FIRST_PS = 3_000.0
FOUND = arrivals_of(
    [1, 1, 1, 2], [2, 2, 2, 3], [3_100.0, 4_000.0, 9_000.0, 3_500.0], [70.0, 80.0, 90.0, 75.0]
)


def test_each_pulse_of_a_pixel_keeps_its_width():
    table = payload._with_arrivals(path_pulses([1, 1], [2, 2], [1_000.0, 100.0]), FOUND, FIRST_PS)
    np.testing.assert_array_equal(table["width_ps"][:2], [80.0, 70.0])


def test_what_is_not_on_the_path_is_shown_also_in_a_pixel_of_it():
    table = payload._with_arrivals(path_pulses([1, 1], [2, 2], [1_000.0, 100.0]), FOUND, FIRST_PS)
    assert list(table["leg"][2:]) == [-1, -1]
    np.testing.assert_array_equal(table["arrival_ps"][2:], [6_000.0, 500.0])


def test_repeats_and_laps_of_the_clock_are_the_same_pulse():
    pulses = path_pulses([2, 2, 2], [3, 3, 3], [500.0, 503.0, 500.0 + PERIOD_PS])
    table = payload._with_arrivals(pulses, FOUND, FIRST_PS)
    np.testing.assert_array_equal(table["width_ps"][:3], 75.0)
    assert len(table["row"]) == 3 + 3


def test_another_cameras_pulse_in_that_pixel_is_another():
    table = payload._with_arrivals(path_pulses([2], [3], [2_000.0]), FOUND, FIRST_PS)
    assert np.isnan(table["width_ps"][0])
    assert len(table["row"]) == 1 + 4
