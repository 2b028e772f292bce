"""Legs that may be light in a slab of glass which nobody told."""

import numpy as np
import pytest

from lightflight.reconstruct.verdict.glass import findings_of_slabs, legs_that_may_be_glass
from tests.path_fakes import make_path

SURE = 0.3**2 * np.eye(20)


def path_with(last: tuple[float, float, float], turn_mm: float = 8.0):
    """Light along x, aside for 30 mm, and then on towards a last place."""
    return make_path([[0, 0, 0], [100, 0, 0], [130, turn_mm, 0], last, [400, 90, 9]], SURE)


def test_light_that_goes_on_as_it_came_may_have_crossed_glass():
    ((leg, turn_deg),) = legs_that_may_be_glass(path_with((330, 8, 0)))
    assert leg == 1
    assert turn_deg == pytest.approx(np.degrees(np.arctan2(8, 30)))
    (finding,) = findings_of_slabs(path_with((330, 8, 0)))
    assert "leg 2 turns by 15°" in finding.sentence


@pytest.mark.parametrize(
    ("path", "why"),
    [
        (path_with((330, 40, 0)), "it goes on another way"),
        (path_with((330, 90, 0), turn_mm=90.0), "mirrors turn light by more"),
        (make_path(path_with((330, 8, 0)).vertices_mm, 900.0 * SURE), "too little is known"),
    ],
)
def test_others_are_legs(path, why):
    assert legs_that_may_be_glass(path) == [], why
