"""A leg whose light is slow through the pixels was left out whole, as "too wide".

In a large room, or along the line of sight, flight makes pulses two or three times as wide as those
of another leg. They were taken for no pulses, and a path of three legs had two, contradicted.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.random_labs import FAR_STDS, drawn_lab, path_of, pulls_of
from lightflight import flags
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.steep_pulses import with_steep_pulses
from tests.reconstruct.fakes import arrivals_from_columns

OWN_PS = 70.0


def sighting_of(row, col, time, std) -> Sighting:
    """Pulses of one recording; those wider than 1.6 of the usual are called too wide."""
    std = np.array(std, dtype=float)
    table = arrivals_from_columns(
        row, col, time, np.ones(len(std)), np.full(len(std), 500.0), (9, 30)
    )
    wide = np.where(std > 1.6 * OWN_PS, flags.TOO_WIDE, 0).astype(table.flags.dtype)
    table = replace(table, std_ps=std, flags=table.flags | wide)
    blind = np.zeros((9, 30), dtype=bool)
    return Sighting(SimpleNamespace(), SimpleNamespace(), table, table.arrival_ps, blind)


def test_pulses_that_flight_makes_wide_are_taken():
    """A leg along row 2, 40 ps a pixel; one along row 6, 250 ps a pixel, seen through 0.6 px."""
    col = np.arange(25)
    wide = np.full(25, np.hypot(OWN_PS, 0.6 * 250.0))
    seen = sighting_of(
        np.repeat([2, 6], 25),
        np.tile(col, 2),
        np.append(2000.0 + 40.0 * col, 5000.0 + 250.0 * col),
        np.append(np.full(25, OWN_PS), wide),
    )
    assert len(seen.usable_pulses) == 25
    # The first and the last pulse have one neighbour alone.
    assert len(with_steep_pulses(seen).usable_pulses) == 50 - 2


def test_mixed_light_of_two_legs_is_still_too_wide():
    """Between legs along rows 2 and 4, 600 ps apart: as wide as their times differ."""
    col = np.arange(25)
    seen = sighting_of(
        np.repeat([2, 3, 4], 25),
        np.tile(col, 3),
        np.concatenate([late + 40.0 * col for late in (2000.0, 2300.0, 2600.0)]),
        np.repeat([OWN_PS, np.hypot(OWN_PS, 300.0), OWN_PS], 25),
    )
    assert with_steep_pulses(seen).usable_pulses.tolist() == seen.usable_pulses.tolist()


@pytest.mark.parametrize(
    ("seed", "method"),
    [
        pytest.param(201, "joint", id="three legs", marks=pytest.mark.long),
        pytest.param(201, "photon", id="three legs, all counts", marks=pytest.mark.long),
        pytest.param(235, "joint", id="the last leg beside one that was parted"),
    ],
)
def test_no_leg_is_left_out(seed, method):
    lab = drawn_lab(seed)
    path = path_of(lab, method)
    assert path.n_legs == len(lab.vertices) - 1
    assert path.verdict.level == "trust"
    assert (pulls_of(lab, path)[:, 1] < FAR_STDS).all()
