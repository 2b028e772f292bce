"""About light that is mostly another's a fit ran 10^16 mm away: "not enough values to unpack".

Half of the light is a late halo. Places of the path in the picture, from which mirrors are looked
for, were none; and where a path ends so far away, that is told in a sentence.
"""

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import NothingFoundError
from lightflight.reconstruct.fit.result import refuse_run_away
from lightflight.reconstruct.model.geometry import PathState
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


def test_late_halo_of_half_the_light_is_refused_in_a_sentence():
    world = DEFECTS["late_halo"].applied(random_world(9016, 1), 0.5)
    with pytest.raises(NothingFoundError, match="out of all bounds"):
        lf.reconstruct(record(world, 9016), **what_the_user_tells(world))


@pytest.mark.parametrize("far", [4e16, np.nan])
def test_a_path_that_no_bench_holds_is_refused(far):
    with pytest.raises(NothingFoundError, match="out of all bounds"):
        refuse_run_away(PathState(np.array([[0.0, 0.0, 0.0], [1.0, 2.0, far]]), 0.0))
