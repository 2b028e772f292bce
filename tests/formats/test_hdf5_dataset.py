"""formats.hdf5_dataset: datasets of others, axes stated or hinted, never guessed."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import ConfigError, FileFormatError

read: Any = lf.read


@pytest.fixture
def cube(rng):
    return rng.poisson(3.0, (4, 5, 16)).astype(np.uint16)


def test_a_dataset_by_name_and_axes(tmp_path, cube):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["run/cube"] = np.transpose(cube, (2, 0, 1))
        file["run/other"] = cube[:2]
        file["run"].attrs["exposure_s"] = 2.5
        file["run/cube"].attrs["camera"] = "streak"
    hist = read(tmp_path / "x.h5", dataset="/run/cube", axes="tyx", bin_width_ps=2.0)
    np.testing.assert_array_equal(hist.counts, cube)
    assert hist.settings == {"dataset": "run/cube", "exposure_s": 2.5, "camera": "streak"}
    with pytest.raises(FileFormatError, match=r"run/cube \(16, 4, 5\), run/other .* dataset="):
        read(tmp_path / "x.h5")
    with pytest.raises(ConfigError, match="dataset='run/cub' is no array of numbers"):
        read(tmp_path / "x.h5", dataset="run/cub")
    with pytest.raises(FileFormatError, match=r"run/cube \(16, 4, 5\)\): give axes="):
        read(tmp_path / "x.h5", dataset="run/cube")


@pytest.mark.parametrize("how", ["labels", "attribute", "name"])
def test_stated_axes_need_no_hint(tmp_path, cube, how):
    name = "cube_t_y_x" if how == "name" else "cube"
    with h5py.File(tmp_path / "x.h5", "w") as file:
        node = file.create_dataset(name, data=np.transpose(cube, (2, 0, 1)))
        if how == "labels":
            for dimension, label in zip(node.dims, "tyx", strict=True):
                dimension.label = label
        elif how == "attribute":
            node.attrs["axes"] = "tyx"
    np.testing.assert_array_equal(read(tmp_path / "x.h5").counts, cube)


def test_frames_stay_in_the_file(tmp_path, rng):
    frames = rng.integers(0, 64, (200, 3, 4)).astype(np.uint16)
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("codes", data=frames, chunks=(16, 3, 4), compression="gzip")
    recording = read(tmp_path / "x.h5", axes="fyx", n_codes=64, no_photon_code=0)
    assert not isinstance(recording.frames, np.ndarray)
    direct = lf.histogram(lf.Recording.from_frames(frames, n_codes=64, no_photon_code=0))
    np.testing.assert_array_equal(lf.histogram(recording, chunk_bytes=999).counts, direct.counts)


def test_arrays_that_cannot_be_read_safely(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "away.h5", "w") as file:
        file.create_dataset("x", (2, 2, 2), "u1", external=[(str(tmp_path / "y.bin"), 0, 8)])
    with pytest.raises(FileFormatError, match="lies in another file"):
        read(tmp_path / "away.h5", axes="yxt")
    with h5py.File(tmp_path / "huge.h5", "w") as file:
        file.create_dataset("x", (1 << 17, 1 << 17, 1 << 10), "u1", chunks=(1 << 10, 1 << 10, 64))
        file.create_dataset(
            "wide", (1 << 10, 1 << 10, 1 << 10), "u1", chunks=(1 << 10, 1 << 10, 512)
        )
    with pytest.raises(FileFormatError, match=r"needs 1.8e\+04 GB of memory"):
        read(tmp_path / "huge.h5", dataset="x", axes="yxt")
    with h5py.File(tmp_path / "text.h5", "w") as file:
        file["names"] = np.array([b"a", b"b"])
    with pytest.raises(FileFormatError, match="holds no array of numbers"):
        read(tmp_path / "text.h5")


def test_damage(tmp_path, cube):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("cube", data=cube, compression="gzip")
    image = (tmp_path / "x.h5").read_bytes()
    (tmp_path / "cut.h5").write_bytes(image[: len(image) // 2])
    with pytest.raises(FileFormatError, match="damaged"):
        read(tmp_path / "cut.h5", axes="yxt")


def test_real_streak_cubes(data_dir):
    path = data_dir / "lift-fiber" / "lift_derived.h5"
    for name, codes in (("LinearFiber", 245), ("LinearFiber_vertical", 150), ("CurveFiber", 310)):
        hist = read(path, dataset=f"{name}/cube_t_y_x", axes="tyx", poisson=False)
        assert hist.counts.shape == (64, 64, codes)
        assert hist.poisson is False
        assert hist.bin_width_ps is None
        with h5py.File(path) as file:
            np.testing.assert_array_equal(
                hist.counts[10, 20], file[f"{name}/cube_t_y_x"][:, 10, 20]
            )
    with pytest.raises(FileFormatError, match=r"holds several arrays .*LinearFiber/cube_t_y_x"):
        read(path)
