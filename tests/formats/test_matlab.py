"""formats.matlab: against SciPy's writer and reader, and files made byte by byte."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp
from scipy.io import loadmat, savemat

import lightflight as lf
from lightflight.errors import ConfigError, FileFormatError
from lightflight.formats.matlab5 import array_of, text_of, variables_in

read: Any = lf.read


@pytest.fixture
def cube(rng):
    return rng.poisson(3.0, (4, 5, 16)).astype(np.uint16)


def _v73(path: Path, **arrays: np.ndarray) -> Path:
    """What MATLAB's save -v7.3 writes: HDF5 behind 512 bytes, axes reversed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            file[name] = np.asarray(array).T
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\0\2IM")
    return path


# --- ordinary files ---------------------------------------------------------------------


@pytest.mark.parametrize("compress", [True, False])
@pytest.mark.parametrize("name", ["counts", "series", "hist", "XYZimage", "data_cube", "mine"])
def test_v5_cubes_whatever_they_are_called(tmp_path, cube, name, compress):
    savemat(tmp_path / "x.mat", {name: cube, "exposure": 3.0}, do_compression=compress)
    hist = read(tmp_path / "x.mat", axes="yxt", bin_width_ps=41.1)
    np.testing.assert_array_equal(hist.counts, cube)
    assert hist.settings["variable"] == name
    turned = np.transpose(cube, (2, 0, 1))
    savemat(tmp_path / "x.mat", {name: turned}, do_compression=compress)
    np.testing.assert_array_equal(read(tmp_path / "x.mat", axes="tyx").counts, cube)


def test_v73_shows_the_axes_matlab_shows(tmp_path, cube):
    path = _v73(tmp_path / "x.mat", series=cube, exposure=np.array([[3.0]]))
    hist = read(path, axes="yxt")
    np.testing.assert_array_equal(hist.counts, cube)
    with pytest.raises(FileFormatError, match=r"series \(4, 5, 16\)\): give axes="):
        read(path)


def test_the_order_and_the_variable_are_never_guessed(tmp_path, cube):
    savemat(tmp_path / "x.mat", {"a": cube, "b": cube + 1, "label": "text", "s": {"f": 1}})
    with pytest.raises(FileFormatError, match=r"a \(4, 5, 16\), b \(4, 5, 16\)\): name one"):
        read(tmp_path / "x.mat", axes="yxt")
    with pytest.raises(FileFormatError, match=r"b \(4, 5, 16\)\): give axes="):
        read(tmp_path / "x.mat", variable="b")
    hist = read(tmp_path / "x.mat", variable="b", axes="yxt")
    np.testing.assert_array_equal(hist.counts, cube + 1)
    with pytest.raises(ConfigError, match="variable='c' is no array of numbers"):
        read(tmp_path / "x.mat", variable="c")
    savemat(tmp_path / "x.mat", {"a": cube, "hist": cube + 1})
    np.testing.assert_array_equal(read(tmp_path / "x.mat", axes="yxt").counts, cube + 1)


def test_histograms_come_back_and_matlab_users_see_numbers(tmp_path, cube):
    hist = lf.Histograms(
        cube, bin_width_ps=55.0, n_frames=9, no_photon_code=0, settings={"room": "µ"}
    )
    lf.write(hist, tmp_path / "x.mat")
    back = read(tmp_path / "x.mat")
    np.testing.assert_array_equal(back.counts, cube)
    assert (back.bin_width_ps, back.n_frames, back.no_photon_code) == (55.0, 9, 0)
    assert back.settings["room"] == "µ"
    plain = loadmat(tmp_path / "x.mat")
    assert plain["bin_width_ps"] == 55.0
    np.testing.assert_array_equal(plain["counts"], cube)
    scaled = lf.Histograms(cube - 0.5, poisson=False)
    lf.write(scaled, tmp_path / "x.mat")
    assert read(tmp_path / "x.mat").poisson is False


def test_what_matlab_v5_cannot_hold(tmp_path, monkeypatch, cube):
    recording = lf.Recording.from_events([0], [0], [1], shape=(1, 1), n_codes=4)
    with pytest.raises(ValueError, match="mat holds histograms"):
        lf.write(recording, tmp_path / "x.mat")
    monkeypatch.setattr("lightflight.formats.matlab._LARGEST_V5", 100)
    with pytest.raises(ValueError, match=r"too large for MATLAB v5: write \.h5"):
        lf.write(lf.Histograms(cube), tmp_path / "x.mat")
    assert not (tmp_path / "x.mat").exists()


# --- against SciPy ----------------------------------------------------------------------


@given(
    values=hnp.arrays(
        dtype=st.one_of(
            hnp.unsigned_integer_dtypes(endianness="="),
            hnp.integer_dtypes(endianness="="),
            hnp.floating_dtypes(endianness="=", sizes=(32, 64)),
        ),
        shape=hnp.array_shapes(min_dims=2, max_dims=4, max_side=6),
    ),
    compress=st.booleans(),
    text=st.text(st.characters(codec="ascii", exclude_categories=["Cc"]), min_size=1),
)
def test_numbers_and_texts_equal_scipy(values, compress, text, tmp_path_factory):
    path = tmp_path_factory.mktemp("mat") / "x.mat"
    savemat(
        path,
        {"text": text, "s": {"a": values}, "n": values, "cell": np.array([1, "a"], object)},
        do_compression=compress,
    )
    found = {variable.name: variable for variable in variables_in(path)}
    assert set(found) == {"text", "n"}
    np.testing.assert_array_equal(np.asarray(array_of(found["n"], path)).T, loadmat(path)["n"])
    assert text_of(found["text"], path) == text


def _element(kind: int, content: bytes, order: str = "<") -> bytes:
    return struct.pack(f"{order}II", kind, len(content)) + content + bytes(-len(content) % 8)


def _matrix(
    shape: tuple[int, ...], content: bytes, *, kind: int = 2, array_class: int = 9, order: str = "<"
) -> bytes:
    body = (
        _element(6, struct.pack(f"{order}II", array_class, 0), order)
        + _element(5, struct.pack(f"{order}{len(shape)}i", *shape), order)
        + _element(1, b"hist", order)
        + _element(kind, content, order)
    )
    return _element(14, body, order)


def _file(path: Path, *elements: bytes, mark: bytes = b"IM") -> Path:
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1" + mark + b"".join(elements))
    return path


def test_big_endian_files(tmp_path):
    values = np.arange(24, dtype=">u2").reshape(2, 3, 4)
    element = _matrix((2, 3, 4), values.tobytes("F"), kind=4, array_class=11, order=">")
    path = _file(tmp_path / "x.mat", element, mark=b"MI")
    np.testing.assert_array_equal(read(path, axes="yxt").counts, values)


# --- hostile files ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "shape",
    [(1 << 30, 1 << 30, 1 << 30), (-1, 2, 2), (2, 2, 2), (0, 1, 1), (7,)],
)
def test_sizes_that_contradict_the_content(tmp_path, shape):
    with pytest.raises(FileFormatError):
        read(_file(tmp_path / "x.mat", _matrix(shape, bytes(7))), axes="yxt")
    packed = zlib.compress(_matrix(shape, bytes(7)))
    element = struct.pack("<II", 15, len(packed)) + packed
    with pytest.raises(FileFormatError):
        read(_file(tmp_path / "x.mat", element), axes="yxt")


def test_a_compressed_bomb_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    packed = zlib.compress(_matrix((64, 64, 4096), bytes(1 << 24)))
    path = _file(tmp_path / "x.mat", struct.pack("<II", 15, len(packed)) + packed)
    monkeypatch.setattr("lightflight.files.filecheck.free_memory_bytes", lambda: 1 << 20)
    with pytest.raises(FileFormatError, match=r"needs 0.0[0-9]+ GB of memory"):
        read(path, axes="yxt")


def test_every_truncation_is_one_error(tmp_path, cube):
    savemat(tmp_path / "good.mat", {"hist": cube}, do_compression=True)
    image = (tmp_path / "good.mat").read_bytes()
    for length in range(1, len(image), 7):
        (tmp_path / "cut.mat").write_bytes(image[:length])
        with pytest.raises(FileFormatError) as caught:
            read(tmp_path / "cut.mat", axes="yxt")
        assert "\n" not in str(caught.value)


def test_files_that_are_something_else(tmp_path):
    (tmp_path / "x.mat").write_bytes(b"not a MATLAB file at all, but long enough" * 9)
    with pytest.raises(FileFormatError, match="is no MATLAB v5 file"):
        read(tmp_path / "x.mat", axes="yxt")
    savemat(tmp_path / "x.mat", {"s": {"f": 1}, "text": "only"})
    with pytest.raises(FileFormatError, match="holds no array of real numbers"):
        read(tmp_path / "x.mat", axes="yxt")
    with pytest.raises(FileFormatError, match="unknown type 99"):
        read(_file(tmp_path / "x.mat", _element(99, b"")), axes="yxt")


# --- files of others --------------------------------------------------------------------


def test_a_real_spad_array(data_dir):
    path = data_dir / "flimera-pixel-skew" / "Coumarin.mat"
    hist = read(path, axes="yxt", bin_width_ps=41.1)
    assert hist.counts.shape == (128, 192, 4096)
    assert hist.counts.sum(dtype=np.int64) == 29_918_745
    filled = np.flatnonzero(hist.counts.sum(axis=(0, 1), dtype=np.int64))
    assert 3540 < filled[0] < 3560
    assert filled[-1] == 4094
    with pytest.raises(FileFormatError, match=r"data_cube \(128, 192, 4096\)\): give axes="):
        read(path)


def test_real_files_with_objects_that_scipy_cannot_list(data_dir):
    folder = data_dir / "lift-fiber"
    for name in ("DOF_LinearFiber", "DOF_LinearFiber_vertical", "DeSense_CurveFiber"):
        path = folder / f"{name}.mat"
        found = {variable.name: variable for variable in variables_in(path)}
        np.testing.assert_array_equal(
            np.asarray(array_of(found["image_t"], path)).T, loadmat(path)["image_t"]
        )
