"""A source in the wrong place: "calibrate the clock" or "reversed_codes" was advised."""

import warnings

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import CalibrationError, SuspectDataWarning
from tests.labs import three_legs


def outcome(**changes):
    """What `reconstruct` says of a recording on an even, nominal clock."""
    lab = three_legs()
    given = {"camera": lab.camera, "source": lab.known} | changes
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            lf.reconstruct(lab.recording(4), **given)
        except ValueError as problem:
            return [problem]
    return [one.message for one in caught if issubclass(one.category, SuspectDataWarning)]


# Along the line of sight, and across it.
@pytest.mark.usefixtures("as_found")
@pytest.mark.parametrize(
    "off", [(0, 0, 150.0), pytest.param((100.0, 0, 0), marks=pytest.mark.long)]
)
@pytest.mark.long
def test_a_source_in_the_wrong_place_is_no_fault_of_the_clock(off):
    said = outcome(source=lf.Source(np.array(off), emission_time_ps=2000.0))
    for one in said:
        assert not isinstance(one, CalibrationError)
        assert "calibrate the clock" not in str(one)
        assert "reversed_codes" not in str(one)
