"""`simulate --set detector.seed=99` gave an ideal camera instead of another PF32, silently."""

import pytest

from lightflight.errors import SuspectDataWarning
from lightflight.lab import lab_from_table
from lightflight.simulate.presets import ideal, pf32


@pytest.mark.parametrize("keys", [{"seed": 99}, {"gain_rms": 0.02}])
def test_keys_without_a_preset_are_said_to_change_an_ideal_camera(keys):
    with pytest.warns(SuspectDataWarning, match='not the default PF32: write preset = "pf32"'):
        lab = lab_from_table({"detector": keys})
    assert lab.detector.skew_range_ps == ideal().skew_range_ps


@pytest.mark.parametrize(
    "keys",
    [{"preset": "pf32", "seed": 99}, {"preset": "ideal", "seed": 1}, {"n_codes": 256, "seed": 1}],
)
def test_a_camera_that_is_named_or_described_is_taken_as_it_is(keys, recwarn):
    lab = lab_from_table({"detector": keys})
    assert not len(recwarn)
    if keys["seed"] == 99:
        assert lab.detector.skew_range_ps == pf32().skew_range_ps
