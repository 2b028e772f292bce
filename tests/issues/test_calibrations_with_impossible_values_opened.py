"""A calibration file with plain values that cannot be, a width below zero, was opened."""

from pathlib import Path

import pytest

from lightflight.errors import FileFormatError
from lightflight.files.store import load_record, save_record
from lightflight.timing.clock.calibration import TimingCalibration


@pytest.mark.parametrize(
    ("name", "value"),
    [("first_edge_ps", "x"), ("no_photon_code", "\0"), ("bin_width_ps", -1.0), ("n_codes", True),
     ("reversed_codes", 1), ("laser_period_ps", float("nan")), ("first_live_code", 10**9)],
)  # fmt: skip
def test_a_file_with_a_value_that_cannot_be_is_refused(tmp_path, name, value):
    file = Path(__file__).parents[1] / "data" / "calibration_schema_1.h5"
    arrays, attributes = load_record(file, kind="calibration")
    changed = {**attributes, name: value}
    save_record(tmp_path / "c.h5", kind="calibration", arrays=arrays, attributes=changed)
    with pytest.raises(FileFormatError, match=name):
        TimingCalibration.load(tmp_path / "c.h5")
