"""A megabyte of HDF5 groups within groups was walked for hours, by every reader of HDF5."""

from __future__ import annotations

import time
from typing import Any

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError
from lightflight.files import hdf5_tree
from lightflight.files.hdf5_tree import entries_of
from lightflight.timing.clock.calibration import TimingCalibration
from tests.files.unsealed import unsealed

CUBE = np.arange(32, dtype=np.uint16).reshape(2, 2, 8)
read: Any = lf.read


def _nested(group: h5py.Group, levels: int) -> h5py.Group:
    for _ in range(levels):
        group = group.create_group("g")
    return group


def _foreign(path):
    with h5py.File(path, "w") as file:
        _nested(file, 1500)["cube"] = CUBE


def _ours(path):
    lf.write(lf.Histograms(CUBE), path)
    with unsealed(path) as file:
        _nested(file, 1500)


def _photons(path):
    with h5py.File(path, "w") as file:
        file.attrs["format_name"] = np.bytes_("Photon-HDF5")
        _nested(file.create_group("photon_data"), 1500)


@pytest.mark.parametrize("make", [_foreign, _ours, _photons])
def test_it_is_refused_at_once(tmp_path, make):
    path = tmp_path / ("x.photon.h5" if make is _photons else "x.h5")
    make(path)
    before = time.process_time()
    with pytest.raises(FileFormatError, match="more than 64 groups within groups: copy"):
        read(path, **({"axes": "yxt"} if make is _foreign else {}))
    with pytest.raises(FileFormatError):
        TimingCalibration.load(path)
    assert time.process_time() - before < 5.0  # seconds; it was minutes


def test_more_entries_than_anybody_means_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(hdf5_tree, "_MOST_ENTRIES", 20)
    with h5py.File(tmp_path / "x.h5", "w") as file:
        for number in range(21):
            file.create_group(f"shot{number}")
        file["cube"] = CUBE
    with pytest.raises(FileFormatError, match="more than 20 groups and arrays: copy the recording"):
        read(tmp_path / "x.h5", axes="yxt")


def test_what_a_file_holds_is_told_once_and_no_link_is_followed(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["a/cube"] = CUBE
        file["a/itself"] = file["a"]
        file["again"] = file["a/cube"]
        file["soft"] = h5py.SoftLink("/a/cube")
        file["away"] = h5py.ExternalLink("other.h5", "/cube")
        found = {name: node is not None for name, _, node in entries_of(file)}
    assert found == {
        "a": True, "a/cube": True, "a/itself": False, "again": False, "away": False, "soft": False,
    }  # fmt: skip
    np.testing.assert_array_equal(read(tmp_path / "x.h5", axes="yxt").counts, CUBE)
    with h5py.File(tmp_path / "deep.h5", "w") as file:
        _nested(file, 60)["cube"] = CUBE
    np.testing.assert_array_equal(read(tmp_path / "deep.h5", axes="yxt").counts, CUBE)
