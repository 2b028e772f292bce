"""Simulated frames written into part of a larger array were lost."""

import numpy as np
import pytest

from lightflight.simulate import pf32, simulate
from tests.simulate.fakes import small_scene


@pytest.mark.parametrize("crosstalk", [0.0, 0.1])
def test_frames_may_be_written_into_a_part_of_something_larger(crosstalk):
    scene = small_scene(pf32(crosstalk_probability=crosstalk))
    larger = np.zeros((100, 8, 16), np.uint16)
    simulate(
        scene, photons_per_pixel=20.0, kind="frames", n_frames=100, frames_out=larger[:, :, 4:12]
    )
    plain = simulate(scene, photons_per_pixel=20.0, kind="frames", n_frames=100)
    np.testing.assert_array_equal(larger[:, :, 4:12], plain.frames)
    assert plain.frames.any()
