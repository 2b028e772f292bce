"""A flat beam on edge is wide across its image, and its pulses are narrower than flight through so
wide a spot would make them: less than no width was left, and `reconstruct` ended in "arange: cannot
compute length".
"""

from types import SimpleNamespace

import numpy as np
import pytest

import lightflight as lf
from benchmarks.misfit_labs import recording_of
from benchmarks.random_labs import pulls_of
from lightflight.reconstruct.other_light.diffuse import _std_as_fitted_ps

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


@pytest.mark.parametrize("flight_ps", [60.0, 99.0, 120.0])
def test_a_pulse_has_some_width_of_its_own(flight_ps):
    """Of 100 ps: the rest of what flight makes, or 0.3 of the variance."""
    fitted, flight = np.full((5, 1), 100.0), np.full((5, 1), flight_ps)
    pixels = SimpleNamespace(std_ps=fitted, shape=SimpleNamespace(is_gaussian=True))
    own = _std_as_fitted_ps(SimpleNamespace(pixels=pixels), SimpleNamespace(flight_ps=flight))
    assert own == pytest.approx(80.0 if flight_ps == 60.0 else 100.0 * np.sqrt(0.3))


@pytest.mark.long
def test_the_path_is_right_or_doubted():
    """Farthest of four places: 3.9 errors off once in 2,500."""
    lab, recording, told = recording_of("ribbon", 0.6, 6020)
    path = lf.reconstruct(recording, **told)
    assert path.n_legs == 2
    assert path.verdict.level != "trust" or pulls_of(lab, path)[:, 1].max() < 3.9
