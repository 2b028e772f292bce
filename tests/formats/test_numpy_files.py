"""formats.numpy_files: arrays come in with their axes stated, and nothing is ever unpickled."""

from __future__ import annotations

import io
import pickle
import zipfile
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import ConfigError, FileFormatError

read: Any = lf.read


class _Bomb:
    def __reduce__(self):
        return print, ("pickle was executed",)


@pytest.fixture
def cube(rng):
    return rng.poisson(3.0, (4, 5, 16)).astype(np.uint16)


@pytest.mark.parametrize("axes", ["yxt", "tyx", "ytx", "txy"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_cubes_in_any_order(tmp_path, cube, axes, order):
    turned = np.transpose(cube, ["yxt".index(letter) for letter in axes])
    np.save(tmp_path / "x.npy", np.asarray(turned, order=order))
    hist = read(tmp_path / "x.npy", axes=axes, bin_width_ps=7.0)
    np.testing.assert_array_equal(hist.counts, cube)
    assert hist.bin_width_ps == 7.0


def test_the_order_is_never_guessed(tmp_path, cube):
    np.save(tmp_path / "x.npy", cube)
    np.savez(tmp_path / "x.npz", series=cube)
    for name in ("x.npy", "x.npz"):
        with pytest.raises(FileFormatError, match=r"\(4, 5, 16\)\): give axes="):
            read(tmp_path / name)
    with pytest.raises(ConfigError, match="hint axes must be"):
        read(tmp_path / "x.npy", axes="xyz")
    with pytest.raises(FileFormatError, match="axes='pt' does not describe"):
        read(tmp_path / "x.npy", axes="pt")


def test_axes_a_file_states_wrong_are_asked_for(tmp_path, cube):
    """They are the file's mistake, not the user's."""
    np.savez(tmp_path / "x.npz", hist=cube, axes="yxq")
    with pytest.raises(FileFormatError, match="give axes="):
        read(tmp_path / "x.npz")
    np.testing.assert_array_equal(read(tmp_path / "x.npz", axes="yxt").counts, cube)


def test_npy_frames_are_mapped_not_loaded(tmp_path, rng):
    frames = rng.integers(0, 64, (50, 4, 5)).astype(np.uint16)
    np.save(tmp_path / "x.npy", frames)
    recording = read(tmp_path / "x.npy", axes="fyx", n_codes=64, no_photon_code=0)
    assert isinstance(recording.frames, np.memmap)
    np.testing.assert_array_equal(recording.frames, frames)
    with pytest.raises(ConfigError, match="need n_codes"):
        read(tmp_path / "x.npy", axes="fyx")


def test_pixels_row_by_row_need_a_shape(tmp_path, cube):
    np.save(tmp_path / "x.npy", cube.reshape(20, 16))
    hist = read(tmp_path / "x.npy", axes="pt", shape=(4, 5))
    np.testing.assert_array_equal(hist.counts, cube)
    with pytest.raises(ConfigError, match="need shape"):
        read(tmp_path / "x.npy", axes="pt")
    with pytest.raises(FileFormatError, match=r"holds 20 pixels, not shape=\(4, 4\)"):
        read(tmp_path / "x.npy", axes="pt", shape=(4, 4))
    with pytest.raises(ConfigError, match="hint shape must be"):
        read(tmp_path / "x.npy", axes="pt", shape=4)


def test_one_pixel_is_a_histogram(tmp_path):
    np.save(tmp_path / "x.npy", np.arange(8))
    assert read(tmp_path / "x.npy", axes="t").counts.shape == (1, 1, 8)


def test_scaled_intensities_must_be_said_to_be(tmp_path, cube):
    np.save(tmp_path / "x.npy", cube * 0.5 - 1)
    with pytest.raises(FileFormatError, match="negative"):
        read(tmp_path / "x.npy", axes="yxt")
    hist = read(tmp_path / "x.npy", axes="yxt", poisson=False)
    np.testing.assert_allclose(hist.counts, cube * 0.5 - 1)


def test_npz_comes_back_whole(tmp_path, cube):
    hist = lf.Histograms(
        cube,
        bin_width_ps=55.0,
        laser_period_ps=900.0,
        n_frames=77,
        reversed_codes=True,
        no_photon_code=0,
        settings={"room": "B9", "list": [1, 2]},
    )
    for compress in (True, False):
        lf.write(hist, tmp_path / "x.npz", compress=compress)
        back = read(tmp_path / "x.npz")
        np.testing.assert_array_equal(back.counts, cube)
        assert back.counts.dtype == cube.dtype
        for name in ("bin_width_ps", "laser_period_ps", "n_frames", "reversed_codes", "settings"):
            assert getattr(back, name) == getattr(hist, name)
    with np.load(tmp_path / "x.npz") as plain:  # readable by anyone, without us
        assert str(plain["axes"]) == "yxt"


def test_npz_keeps_scaled_intensities(tmp_path, cube):
    lf.write(lf.Histograms(cube - 0.5, poisson=False), tmp_path / "x.npz")
    assert read(tmp_path / "x.npz").poisson is False


def test_npz_with_several_arrays(tmp_path, cube):
    np.savez(tmp_path / "x.npz", a=cube, b=cube[..., :4], c=cube[0], axes="yxt", exposure_s=3.5)
    with pytest.raises(FileFormatError, match=r"a \(4, 5, 16\), b \(4, 5, 4\), c .* key="):
        read(tmp_path / "x.npz")
    hist = read(tmp_path / "x.npz", key="b")
    np.testing.assert_array_equal(hist.counts, cube[..., :4])
    assert hist.settings["exposure_s"] == 3.5
    with pytest.raises(ConfigError, match="key='d' is not in"):
        read(tmp_path / "x.npz", key="d")


def test_photons_do_not_fit_into_npz(tmp_path):
    recording = lf.Recording.from_events([0], [0], [1], shape=(1, 1), n_codes=4)
    with pytest.raises(ValueError, match="npz holds histograms"):
        lf.write(recording, tmp_path / "x.npz")
    assert not (tmp_path / "x.npz").exists()


# --- hostile ----------------------------------------------------------------------------


def test_nothing_is_unpickled(tmp_path, capsys):
    np.save(tmp_path / "x.npy", np.array([_Bomb()], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "x.npz", hist=np.array([_Bomb()], dtype=object))
    (tmp_path / "y.npy").write_bytes(pickle.dumps(_Bomb()))
    for name, text in [
        ("x.npy", "Python objects are never loaded"),
        ("x.npz", "holds no array"),
        ("y.npy", "no readable .npy header"),
    ]:
        with pytest.raises(FileFormatError, match=text):
            read(tmp_path / name, axes="yxt")
    assert "executed" not in capsys.readouterr().out


def _npy_bytes(header: str) -> bytes:
    text = header.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<u2', 'fortran_order': False, 'shape': (32, 32, 1000000000000)}",
        "{'descr': '<u2', 'fortran_order': False, 'shape': (-1, 32, 2)}",
        "{'descr': '<u2', 'fortran_order': False}",
        "{'descr': '<M8[s]', 'fortran_order': False, 'shape': (1, 1, 1)}",
        "__import__('os').system('true')",
        "[" * 60,
    ],
)
def test_hostile_headers(tmp_path, header):
    image = _npy_bytes(header) + bytes(64)
    (tmp_path / "x.npy").write_bytes(image)
    with pytest.raises(FileFormatError):
        read(tmp_path / "x.npy", axes="yxt")
    with zipfile.ZipFile(tmp_path / "x.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("hist.npy", image)
    with pytest.raises(FileFormatError):
        read(tmp_path / "x.npz", axes="yxt")


def test_truncation_says_where(tmp_path, cube):
    np.save(tmp_path / "x.npy", cube)
    image = (tmp_path / "x.npy").read_bytes()
    (tmp_path / "cut.npy").write_bytes(image[:-10])
    with pytest.raises(FileFormatError, match="truncated") as caught:
        read(tmp_path / "cut.npy", axes="yxt")
    assert caught.value.offset == len(image) - 10
    lf.write(lf.Histograms(cube), tmp_path / "x.npz")
    image = (tmp_path / "x.npz").read_bytes()
    for length in (3, 30, len(image) // 2, len(image) - 1):
        (tmp_path / "cut.npz").write_bytes(image[:length])
        with pytest.raises(FileFormatError):
            read(tmp_path / "cut.npz")


def test_a_zip_bomb_is_refused_before_it_is_opened(tmp_path, monkeypatch):
    buffer = io.BytesIO()
    np.save(buffer, np.zeros((64, 64, 1024), np.uint8))
    with zipfile.ZipFile(tmp_path / "x.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("hist.npy", buffer.getvalue())
    monkeypatch.setattr("lightflight.files.filecheck.free_memory_bytes", lambda: 1 << 20)
    with pytest.raises(FileFormatError, match=r"needs 0.0168 GB of memory"):
        read(tmp_path / "x.npz", axes="yxt")


def test_nan_and_damaged_metadata(tmp_path, cube):
    broken = cube.astype(float)
    broken[1, 2, 3] = np.nan
    np.save(tmp_path / "x.npy", broken)
    with pytest.raises(FileFormatError, match="not finite"):
        read(tmp_path / "x.npy", axes="yxt")
    for text in ("{", "[]", '{"settings": 3}', "[" * 100_000):
        np.savez(tmp_path / "x.npz", hist=cube, axes="yxt", lightflight=text)
        with pytest.raises(FileFormatError, match="metadata are not readable"):
            read(tmp_path / "x.npz")
