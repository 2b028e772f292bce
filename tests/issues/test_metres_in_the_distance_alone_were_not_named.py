"""A reader typed what the pages promise to notice: a distance of 0.535 for 535 mm was not.

`check` found nothing, since it asked what one pixel sees alone; `reconstruct` computed for five
minutes. Lengths of 1e300 mm ended in an internal error, a set-up with a byte order mark in "Invalid
statement", one in Latin-1 in "is not a text file", and a recording without a photon could calibrate
codes.
"""

from __future__ import annotations

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import ConfigError, GeometryError
from lightflight.files.toml_tables import table_from_toml
from lightflight.reconstruct.legs.plausible import OtherUnitsError, implausible
from lightflight.recording.description import describe_recording


def camera_at(distance_mm: float) -> lf.Camera:
    return lf.Camera.facing_plane(
        (32, 32), distance_mm=distance_mm, field_of_view_mm=(245.0, 245.0)
    )


@pytest.mark.parametrize("distance_mm", [0.535, 535_000.0])
def test_a_slip_of_a_thousand_is_named_and_refused(distance_mm):
    camera = camera_at(distance_mm)
    findings = implausible(camera, lf.Source(), lf.Medium(), [])
    assert [str(one.name) for one in findings] == ["units"]
    hist = lf.Histograms(np.ones((32, 32, 64), dtype=np.uint32), bin_width_ps=50.0)
    with pytest.raises(OtherUnitsError, match=r"times as wide as it is far away: give .* in mm"):
        lf.reconstruct(hist, camera=camera)


def test_what_labs_have_is_no_slip():
    for distance_mm in (100.0, 535.0, 20_000.0):
        assert not implausible(camera_at(distance_mm), lf.Source(), lf.Medium(), [])


@pytest.mark.parametrize("distance_mm", [1e300, 1e-300])
def test_lengths_beyond_all_rooms_are_refused(distance_mm):
    with pytest.raises(GeometryError, match="distance_mm must be positive and at most 1e9"):
        camera_at(distance_mm)


def test_a_set_up_of_another_editor_is_read_or_told(tmp_path):
    file = tmp_path / "lab.toml"
    text = "[camera]\ndistance_mm = 535.0  # 1 µm\n"
    file.write_text(text, encoding="utf-8-sig")
    assert table_from_toml(file) == {"camera": {"distance_mm": 535.0}}
    file.write_text(text, encoding="latin-1")
    with pytest.raises(ConfigError, match="is not a text file in UTF-8"):
        table_from_toml(file)


def test_no_photon_calibrates_nothing():
    empty = lf.Histograms(np.zeros((4, 4, 16), dtype=np.uint32), bin_width_ps=50.0)
    assert not any("calibrate codes" in each for each in describe_recording(empty).missing)
