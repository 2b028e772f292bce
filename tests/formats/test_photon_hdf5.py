"""formats.photon_hdf5: our recordings come back, files of others come in."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError
from lightflight.formats.photon_hdf5_titles import TITLES

read: Any = lf.read

CLOCK: dict[str, Any] = {
    "bin_width_ps": 55.0,
    "laser_period_ps": 50_000.0,
    "periods_per_frame": 4000,
    "reversed_codes": True,
    "first_edge_ps": 1.5,
    "no_photon_code": 0,
}


def _recording(rng, **clock):
    frames = rng.integers(1, 64, (5000, 3, 4)).astype(np.uint16)
    frames[rng.random(frames.shape) > 0.1] = 0
    frames[-7:] = 0  # the last frames are empty: only n_frames tells of them
    return lf.Recording.from_frames(frames, n_codes=64, settings={"room": "µ"}, **clock)


def test_recordings_come_back(tmp_path, rng):
    recording = _recording(rng, **CLOCK)
    lf.write(recording, tmp_path / "x.photon.h5")
    back = read(tmp_path / "x.photon.h5")
    for name, value in {**CLOCK, "n_frames": 5000, "settings": {"room": "µ"}}.items():
        assert getattr(back, name) == value, name
    np.testing.assert_array_equal(lf.histogram(back).counts, lf.histogram(recording).counts)
    part: dict[str, Any] = {"frames": (100, 3210)}
    np.testing.assert_array_equal(
        lf.histogram(back, **part).counts, lf.histogram(recording, **part).counts
    )
    lf.write(back, tmp_path / "again.photon.h5")
    again = read(tmp_path / "again.photon.h5")
    np.testing.assert_array_equal(again.code, back.code)


def test_what_is_written_is_what_the_format_asks_for(tmp_path, rng):
    lf.write(_recording(rng, **CLOCK), tmp_path / "x.photon.h5")
    with h5py.File(tmp_path / "x.photon.h5") as file:
        assert file.attrs["format_name"] == b"Photon-HDF5"
        assert file["photon_data/timestamps_specs/timestamps_unit"][()] == pytest.approx(2e-4)
        assert file["photon_data/nanotimes_specs/tcspc_unit"][()] == pytest.approx(55e-12)
        assert file["setup/num_pixels"][()] == 12
        assert (np.diff(file["photon_data/timestamps"][()]) >= 0).all()
        missing = [name for name in TITLES if name not in file]
        assert missing == []
        untitled: list[str] = []
        file.visititems(
            lambda name, node: (
                untitled.append(name)
                if "TITLE" not in node.attrs and not name.startswith("user")
                else None
            )
        )
        assert untitled == []


def test_a_frame_must_have_a_duration(tmp_path, rng):
    recording = _recording(rng, no_photon_code=0)
    with pytest.raises(ValueError, match="or frame_duration_ps"):
        lf.write(recording, tmp_path / "x.photon.h5")
    lf.write(recording, tmp_path / "x.photon.h5", frame_duration_ps=1e8)
    assert read(tmp_path / "x.photon.h5").n_frames == 5000
    with pytest.raises(ValueError, match="holds photons"):
        lf.write(lf.histogram(recording), tmp_path / "y.photon.h5")
    with pytest.raises(ValueError, match="needs the frame of each photon"):
        lf.write(
            lf.Recording.from_events([0], [0], [1], shape=(1, 1), n_codes=4),
            tmp_path / "y.photon.h5",
        )
    assert not (tmp_path / "y.photon.h5").exists()


def _foreign(path, **photon_data):
    with h5py.File(path, "w") as file:
        file.attrs["format_name"] = np.bytes_("Photon-HDF5")
        file.attrs["format_version"] = np.bytes_("0.4")
        for name, values in photon_data.items():
            file[f"photon_data/{name}"] = values
        file["photon_data/nanotimes_specs/tcspc_unit"] = 16e-12
        file["photon_data/nanotimes_specs/tcspc_num_bins"] = 4096
        file["setup/laser_repetition_rates"] = np.array([40e6])


def test_files_of_others(tmp_path, rng):
    codes = rng.integers(0, 4096, 500).astype(np.uint16)
    detectors = rng.integers(0, 6, 500).astype(np.int8)
    _foreign(tmp_path / "x.hdf5", timestamps=np.arange(500), nanotimes=codes, detectors=detectors)
    recording = read(tmp_path / "x.hdf5", shape=(2, 3))
    assert (recording.bin_width_ps, recording.laser_period_ps) == (
        pytest.approx(16.0),
        pytest.approx(25_000.0),
    )
    assert (recording.shape, recording.n_codes, recording.n_frames) == ((2, 3), 4096, None)
    expected = np.zeros((6, 4096), int)
    np.add.at(expected, (detectors, codes), 1)
    np.testing.assert_array_equal(lf.histogram(recording).counts.reshape(6, -1), expected)
    assert read(tmp_path / "x.hdf5").shape == (1, 6)
    _foreign(tmp_path / "one.hdf5", timestamps=np.arange(500), nanotimes=codes)
    assert lf.histogram(read(tmp_path / "one.hdf5")).counts.sum() == 500


def test_files_that_lack_something(tmp_path, rng):
    _foreign(tmp_path / "x.hdf5", timestamps=np.arange(5))
    with pytest.raises(FileFormatError, match="no nanotimes"):
        read(tmp_path / "x.hdf5")
    _foreign(tmp_path / "x.hdf5", nanotimes=np.array([1, -1]))
    with pytest.raises(FileFormatError, match="numbers that cannot be"):
        read(tmp_path / "x.hdf5")
    lf.write(_recording(rng, **CLOCK), tmp_path / "x.photon.h5")
    with h5py.File(tmp_path / "x.photon.h5", "a") as file:
        file["photon_data/timestamps"][3] = 10**6
    with pytest.raises(FileFormatError, match="time stamps are no frames"):
        read(tmp_path / "x.photon.h5")


@pytest.mark.parametrize("shape", [0, (1, 2, 3), (0, 4), (2.5, 1.0)])
def test_a_shape_that_is_none_is_the_file_s_mistake(tmp_path, rng, shape):
    lf.write(_recording(rng, **CLOCK), tmp_path / "x.photon.h5")
    with h5py.File(tmp_path / "x.photon.h5", "a") as file:
        file["user/lightflight"].attrs["shape"] = shape
    with pytest.raises(FileFormatError, match="shape"):
        read(tmp_path / "x.photon.h5")


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("photon_data/timestamps", np.arange(3), "one time stamp per photon"),
        ("user/lightflight/settings", np.bytes_("7"), "settings are not readable"),
        ("photon_data/nanotimes_specs/tcspc_num_bins", np.arange(2), "is no number"),
    ],
)
def test_parts_that_cannot_be_are_refused(tmp_path, rng, name, values, said):
    lf.write(_recording(rng, **CLOCK), tmp_path / "x.photon.h5")
    with h5py.File(tmp_path / "x.photon.h5", "a") as file:
        del file[name]
        file[name] = values
    with pytest.raises(FileFormatError, match=said):
        read(tmp_path / "x.photon.h5")


def test_time_stamps_that_claim_without_end_are_not_read(tmp_path, rng):
    lf.write(_recording(rng, **CLOCK), tmp_path / "x.photon.h5")
    with h5py.File(tmp_path / "x.photon.h5", "a") as file:
        del file["photon_data/timestamps"]
        file.create_dataset("photon_data/timestamps", (2**44,), np.int64, chunks=(64,))
    with pytest.raises(FileFormatError, match="the file is damaged"):
        read(tmp_path / "x.photon.h5")
