"""formats.schema: files are held against the schema, and old files stay readable."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError
from lightflight.files.store import SCHEMA_VERSION, load_record, save_record
from lightflight.formats.schema import check_arrays, file_schema
from tests.files.unsealed import unsealed
from tools.make_schema_files import (
    CLOCK,
    SETTINGS,
    known_calibration,
    known_calibration_of_unequal_codes,
    known_calibration_with_tail,
    known_frames,
    known_path,
    known_path_that_forks,
    known_path_through_glass,
    known_path_with_a_gap,
    known_path_with_an_alternative,
)

read: Any = lf.read
FOLDER = Path(__file__).resolve().parents[1] / "data"
VERSIONS = range(1, SCHEMA_VERSION + 1)


@pytest.mark.parametrize("version", VERSIONS)
def test_files_of_every_schema_are_read(version):
    frames = known_frames()
    expected = lf.histogram(lf.Recording.from_frames(frames, n_codes=32, no_photon_code=0)).counts
    for name in ("recording", "histograms"):
        record = read(FOLDER / f"{name}_schema_{version}.h5")
        np.testing.assert_array_equal(lf.histogram(record).counts, expected)
        for field, value in CLOCK.items():
            assert getattr(record, field) == value, field
        assert record.settings == SETTINGS
        assert record.n_frames == len(frames)
    dense = read(FOLDER / f"frames_schema_{version}.h5")
    np.testing.assert_array_equal(dense.frames, frames)


@pytest.mark.parametrize("version", VERSIONS)
def test_results_of_every_schema_are_read(version):
    expected, found = known_path(), lf.LightPath.load(FOLDER / f"path_schema_{version}.h5")
    for name in ("vertices_mm", "vertex_times_ps", "covariance", "residuals"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)
    for name in ("source", "medium", "method", "goodness", "prior", "statements", "provenance"):
        assert getattr(found, name) == getattr(expected, name), name
    for name, part in expected.covariance_parts.items():
        np.testing.assert_array_equal(found.covariance_parts[name], part, name)
    np.testing.assert_array_equal(found.truth.vertices_mm, expected.truth.vertices_mm)
    np.testing.assert_array_equal(found.camera.matrix, expected.camera.matrix)
    np.testing.assert_array_equal(found.camera.world_from_camera, expected.camera.world_from_camera)
    clock = lf.TimingCalibration.load(FOLDER / f"calibration_schema_{version}.h5")
    known = known_calibration()
    for name in ("gain", "phases", "code_widths", "skew_ps", "response_std_ps", "flags"):
        np.testing.assert_array_equal(getattr(clock, name), getattr(known, name), name)
    for name in ("shape", "n_codes", "laser_period_ps", "reversed_codes", "scale_std", "notes"):
        assert getattr(clock, name) == getattr(known, name), name


def test_all_that_is_written_is_in_the_schema(tmp_path):
    schema = file_schema()
    assert schema["version"] == SCHEMA_VERSION
    footers = np.zeros((9, 16), np.uint8)
    made = {
        "recording": lf.Recording.from_frames(known_frames(), n_codes=32, footers=footers, **CLOCK),
        "histograms": lf.Histograms(np.ones((2, 2, 4), int)),
    }
    dense = lf.Recording.from_frames(known_frames(), n_codes=32)
    written: dict[str, set[str]] = {"recording": set(), "histograms": set()}
    for kind, record in [*made.items(), ("recording", dense)]:
        lf.write(record, tmp_path / "x.h5")
        arrays, attributes = load_record(tmp_path / "x.h5", kind=kind)
        written[kind] |= set(arrays)
        assert set(attributes) == {*schema["attributes"], *schema[kind]["attributes"]}
    for kind, names in written.items():
        assert names == set(schema[kind]["arrays"])


_U16 = np.zeros(3, np.uint16)


@pytest.mark.parametrize(
    ("kind", "arrays", "text"),
    [
        ("histograms", {}, "holds no counts"),
        ("histograms", {"counts": _U16}, r"not (rows, cols, codes)"),
        ("recording", {"pixel": _U16, "code": _U16[:2]}, "number of photons, 3 and 2"),
        ("recording", {"pixel": _U16.astype(float), "code": _U16}, "'pixel' is float64"),
        ("recording", {"pixel": _U16, "code": _U16, "extra": _U16}, "unknown array 'extra'"),
    ],
)
def test_arrays_that_break_the_schema(tmp_path, kind, arrays, text):
    with pytest.raises(FileFormatError, match=re.escape(text)):
        check_arrays(kind, arrays, path="x.h5")
    attributes = {"shape": [1, 3], "n_codes": 4}
    save_record(tmp_path / "x.h5", kind=kind, arrays=arrays, attributes=attributes)
    with pytest.raises(FileFormatError, match=re.escape(text)):
        read(tmp_path / "x.h5")


def test_a_group_where_an_array_should_be(tmp_path):
    save_record(tmp_path / "x.h5", kind="recording", arrays={}, attributes={})
    with unsealed(tmp_path / "x.h5") as file:
        file.create_group("pixel")
    with pytest.raises(FileFormatError, match="'pixel' is not an array"):
        read(tmp_path / "x.h5")


def test_a_path_with_a_stretch_that_nobody_saw_is_read():
    expected = known_path_with_a_gap()
    found = lf.LightPath.load(FOLDER / "path_schema_2.h5")
    assert found.unseen_legs == expected.unseen_legs == (1,)
    np.testing.assert_array_equal(found.vertices_mm, expected.vertices_mm)
    np.testing.assert_array_equal(found.covariance, expected.covariance)
    assert repr(found.gaps) == repr(expected.gaps)


def test_only_paths_that_need_it_are_of_a_newer_schema(tmp_path):
    """Versions that know no unseen legs, no forks or no alternatives would tell these wrong."""
    made = (
        known_path(), known_path_with_a_gap(), known_path_that_forks(),
        known_path_with_an_alternative(),
    )  # fmt: skip
    for schema, path in enumerate(made, start=1):
        path.save(tmp_path / "path.h5")
        with unsealed(tmp_path / "path.h5") as file:
            assert file.attrs["schema_version"] == schema


def test_a_path_that_forks_is_read():
    expected = known_path_that_forks()
    found = lf.LightPath.load(FOLDER / "path_schema_3.h5")
    assert found.forks == found.truth.forks == expected.forks == ((2, 1),)
    for name in ("vertices_mm", "vertex_times_ps", "covariance", "residuals"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)
    np.testing.assert_array_equal(found.truth.vertices_mm, expected.truth.vertices_mm)


def test_a_path_with_an_alternative_is_read():
    expected = known_path_with_an_alternative()
    found = lf.LightPath.load(FOLDER / "path_schema_4.h5")
    ((one, true),) = zip(found.alternatives, expected.alternatives, strict=True)
    assert (one.says, one.log_evidence) == (true.says, true.log_evidence)
    for name in ("vertices_mm", "vertex_times_ps", "covariance", "residuals"):
        np.testing.assert_array_equal(getattr(one.path, name), getattr(true.path, name), name)
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)
    assert one.path.statements == true.path.statements
    assert one.path.source == found.source


def test_a_path_through_glass_is_read():
    expected = known_path_through_glass()
    found = lf.LightPath.load(FOLDER / "path_through_glass_schema_4.h5")
    assert found.medium == expected.medium
    assert found.legs_in_glass == expected.legs_in_glass == (1,)
    for name in ("vertices_mm", "vertex_times_ps", "covariance", "residuals"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)


def test_a_path_of_a_schema_that_is_newer_still_is_refused(tmp_path):
    known_path_with_a_gap().save(tmp_path / "path.h5")
    with unsealed(tmp_path / "path.h5") as file:
        file.attrs["schema_version"] = 5
    with pytest.raises(FileFormatError, match="this one reads up to 4"):
        lf.LightPath.load(tmp_path / "path.h5")


def test_the_tail_of_a_calibration_is_read():
    expected = known_calibration_with_tail()
    clock = lf.TimingCalibration.load(FOLDER / "calibration_schema_2.h5")
    np.testing.assert_allclose(clock.response_curve, expected.response_curve, rtol=1e-12)
    assert clock.response_place_ps == expected.response_place_ps
    # Files of schema 1 say no place: their pulses stand at the mean.
    assert lf.TimingCalibration.load(FOLDER / "calibration_schema_1.h5").response_place_ps is None


def test_what_is_left_of_unequal_codes_is_read():
    expected = known_calibration_of_unequal_codes()
    clock = lf.TimingCalibration.load(FOLDER / "calibration_schema_3.h5")
    assert clock.code_width_std == expected.code_width_std
    np.testing.assert_array_equal(clock.code_widths, expected.code_widths)
    assert "code widths 1" in clock.shared_errors_ps([0], [0], [900.0])[1]
    # Files of earlier versions say nothing of it: nothing is added.
    assert lf.TimingCalibration.load(FOLDER / "calibration_schema_2.h5").code_width_std == 0.0
