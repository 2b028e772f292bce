"""`calibrate --flat` of a beam wrote a clock with 813 of 1,024 pixels dead, without a word."""

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import CalibrationError, SuspectDataWarning
from lightflight.simulate.presets import paper_scene

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.UncalibratedWarning")


@pytest.fixture(scope="module")
def flat():
    return lf.simulate(paper_scene(), photons_per_pixel=40_000, seed=2, kind="flat")


def lit_in_part(flat, share):
    """The flat where the rows behind a share of the array are in the shade."""
    counts = np.array(flat.counts)
    rows = slice(round(share * len(counts)), None)
    counts[rows] = 0
    # Light of the room alone.
    counts[rows, :, 8:914] = np.random.default_rng(1).poisson(5.0, counts[rows, :, 8:914].shape)
    return replace(flat, counts=counts)


def test_a_beam_is_refused():
    beam = lf.simulate(paper_scene(), photons_per_pixel=40_000, seed=3)
    with pytest.raises(CalibrationError, match=r"of 951 pixels that count show no pulse.*a beam"):
        lf.calibrate_timing(flat=beam)


def test_a_flat_that_misses_pixels_is_warned_of(flat):
    with pytest.warns(SuspectDataWarning, match="show no pulse in the flat"):
        clock = lf.calibrate_timing(flat=lit_in_part(flat, 0.75))
    assert any("pixels that count show no pulse" in note for note in clock.notes)


def test_a_flat_that_lights_all_is_not(flat, recwarn):
    lf.calibrate_timing(flat=flat)
    assert not [w for w in recwarn if issubclass(w.category, SuspectDataWarning)]
