"""formats.zarr_cube: cubes come back; axes stated or hinted, never guessed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import ConfigError, FileFormatError, MissingExtraError

zarr = pytest.importorskip("zarr")
read: Any = lf.read


@pytest.fixture
def cube(rng):
    return rng.poisson(3.0, (4, 5, 16)).astype(np.uint16)


def test_histograms_come_back(tmp_path, cube):
    hist = lf.Histograms(cube, bin_width_ps=55.0, n_frames=9, settings={"room": "µ"})
    for _ in range(2):  # the second time it takes the place of the first
        lf.write(hist, tmp_path / "x.zarr")
        back = read(tmp_path / "x.zarr")
        np.testing.assert_array_equal(back.counts, cube)
        assert (back.bin_width_ps, back.n_frames, back.settings) == (55.0, 9, {"room": "µ"})
    assert [entry.name for entry in tmp_path.iterdir()] == ["x.zarr"]


@pytest.mark.parametrize("version", [2, 3])
def test_arrays_and_groups_of_others(tmp_path, cube, version):
    group = zarr.open_group(str(tmp_path / "g.zarr"), mode="w", zarr_format=version)
    turned = np.transpose(cube, (2, 0, 1))
    node = group.create_array("run/cube", shape=turned.shape, chunks=(4, 4, 5), dtype="u2")
    node[...] = turned
    group.create_array("run/dark", shape=(4, 5), dtype="u2")
    hist = read(tmp_path / "g.zarr", axes="tyx")
    np.testing.assert_array_equal(hist.counts, cube)
    np.testing.assert_array_equal(read(tmp_path / "g.zarr/run/cube", axes="tyx").counts, cube)
    with pytest.raises(FileFormatError, match=r"\(16, 4, 5\)\): give axes="):
        read(tmp_path / "g.zarr")
    with pytest.raises(ConfigError, match="array='cube' is not in"):
        read(tmp_path / "g.zarr", array="cube")
    node.attrs["axes"] = "tyx"
    np.testing.assert_array_equal(read(tmp_path / "g.zarr", array="run/cube").counts, cube)


def test_frames_stay_in_the_folder(tmp_path, rng):
    frames = rng.integers(0, 64, (200, 3, 4)).astype(np.uint16)
    node = zarr.create_array(
        str(tmp_path / "f.zarr"), shape=frames.shape, chunks=(32, 3, 4), dtype="u2"
    )
    node[...] = frames
    recording = read(tmp_path / "f.zarr", axes="fyx", n_codes=64, no_photon_code=0)
    direct = lf.histogram(lf.Recording.from_frames(frames, n_codes=64, no_photon_code=0))
    np.testing.assert_array_equal(lf.histogram(recording).counts, direct.counts)


def test_sizes_are_checked_before_memory_is_taken(tmp_path):
    zarr.create_array(
        str(tmp_path / "h.zarr"), shape=(1 << 14,) * 3, chunks=(1 << 10,) * 3, dtype="u2"
    )
    with pytest.raises(FileFormatError, match=r"needs .* GB of memory"):
        read(tmp_path / "h.zarr", axes="yxt")


def test_damage_is_one_error(tmp_path, cube):
    lf.write(lf.Histograms(cube), tmp_path / "x.zarr")
    (tmp_path / "x.zarr" / "zarr.json").write_text("{")
    with pytest.raises(FileFormatError, match="damaged") as caught:
        read(tmp_path / "x.zarr")
    assert "\n" not in str(caught.value)


def test_without_zarr_it_says_what_to_install(tmp_path, cube, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "zarr", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'lightflight\[batch\]'"):
        lf.write(lf.Histograms(cube), tmp_path / "x.zarr")
    (tmp_path / "y.zarr").mkdir()
    (tmp_path / "y.zarr" / "zarr.json").write_text("{}")
    with pytest.raises(MissingExtraError, match="needs zarr"):
        read(tmp_path / "y.zarr")
