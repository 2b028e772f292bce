"""Three ways in which light that was out of the picture came out otherwise than it was.

A search put two legs for which hardly a pulse spoke where one way was unseen (4029), and their
mirrors were stated to 17 m; a leg with three pulses stood for it and was off by 180 mm in a test of
its own, which the path did not stand (4033); and a piece about the tip of a wide beam kept every
chain from beginning at the source (4028: "no straight flight from the source explains the first
leg"). Laboratories of `benchmarks/piece_labs.py`, unseen legs.
"""

from __future__ import annotations

import pytest

from benchmarks.piece_labs import drawn_scene, path_of, pulls_of, right_legs


@pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")
@pytest.mark.parametrize(
    "seed", [4028, *(pytest.param(seed, marks=pytest.mark.long) for seed in (4029, 4033))]
)
def test_it_is_one_way_that_nobody_saw(seed):
    """Farthest of two places on each leg below 4.5 stated errors (false alarm 1e-4 for all)."""
    scene = drawn_scene("unseen", seed)
    path = path_of(scene)
    assert right_legs(scene, path)
    assert path.verdict.level == "check"
    assert pulls_of(scene, path)[:, 1].max() < 4.5
