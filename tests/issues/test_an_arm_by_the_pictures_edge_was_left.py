"""An arm that leaves a leg a few pixels from where that leaves the picture was not taken.

What is left of the leg beyond the splitter lights a handful of pixels: as a leg by itself it was
all but unseen, and a path with such a leg is not taken. It is the same leg, which the arm parts. Of
16 worlds of `benchmarks/strangers.py --kinds splitter --first 100080 --methods joint` two: one was
contradicted, in one the arm was taken for the flight in a mirror.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.other_light import path_of
from benchmarks.strangers import lights_of, world_of
from lightflight.reconstruct.verdict.detours import has_weak_leg


def test_the_parts_of_a_leg_that_an_arm_parts_count_together() -> None:
    """Pulses on both parts and on the arm; five are few."""

    def fit(*pulses: int) -> SimpleNamespace:
        legs = np.repeat(np.arange(len(pulses)), pulses)
        state = SimpleNamespace(n_legs=len(pulses), seen=tuple(range(len(pulses))))
        times = SimpleNamespace(leg=legs, weight=np.ones(len(legs)))
        return SimpleNamespace(times=times, solution=SimpleNamespace(state=state))

    assert has_weak_leg(fit(9, 3, 20))
    assert not has_weak_leg(fit(9, 3, 20), parted=0)
    assert has_weak_leg(fit(9, 3, 3), parted=0)
    assert has_weak_leg(fit(2, 3, 20), parted=0)


@pytest.mark.filterwarnings("ignore:check this path:UserWarning")
def test_a_splitter_where_a_leg_enters_the_picture() -> None:
    """3.6 px of the leg before it are in view; the first such world of `--first 101001`, of two
    whose arm has more than 20 px and 40 % of the light."""
    world = world_of("splitter", 101081, n_legs=1)
    path, row = path_of(world, "joint", 101081)
    assert path is not None
    assert row["level"] != "contradicted"
    assert path.forks == ((2, 1),)
    splitter, _ = lights_of(world)[1][0][1:3]
    assert path.vertices_mm[1] == pytest.approx(splitter, abs=0.5)
