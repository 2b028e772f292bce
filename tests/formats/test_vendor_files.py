"""formats.ptu, sdt, spc and isolation: real vendor files, and readers that misbehave."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError, MissingExtraError
from lightflight.formats import isolation
from tests.formats.made_by_hand import ptu_bytes, sdt_bytes

read: Any = lf.read


@pytest.fixture(autouse=True)
def readers_of_this_file_are_found(monkeypatch):
    """A child does not look into the current folder: the tests' own readers must be named."""
    told = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, told)))


@pytest.fixture
def vendor_dir(data_dir):
    return data_dir / "tcspc-vendor-files"


# --- real files -------------------------------------------------------------------------


def test_a_real_ptu(vendor_dir):
    pytest.importorskip("ptufile")
    hist = read(vendor_dir / "hazelnut_FLIM_single_image.ptu")
    assert hist.counts.shape == (256, 256, 139)
    assert hist.counts.sum() == 6_065_123
    assert hist.bin_width_ps == pytest.approx(96.97, abs=0.005)
    assert 1e6 / hist.laser_period_ps == pytest.approx(78.02, abs=0.005)
    assert hist.laser_period_ps / hist.bin_width_ps == pytest.approx(132, abs=0.5)
    for name, value in {
        "n_records": 6_070_158,
        "n_photons": 6_065_123,
        "image_frames": 5,
        "record_type": "PicoHarpT3",
    }.items():
        assert hist.settings[name] == value
    with pytest.raises(FileFormatError, match="holds the channels 0: name one"):
        read(vendor_dir / "hazelnut_FLIM_single_image.ptu", channel=2)


def test_a_real_sdt(vendor_dir):
    pytest.importorskip("sdtfile")
    hist = read(vendor_dir / "seminal_receptacle_FLIM_single_image.sdt")
    assert hist.counts.shape == (512, 512, 256)
    assert hist.counts.sum(dtype=int) == 19_409_541
    assert hist.bin_width_ps == pytest.approx(48.86, abs=0.005)
    assert 255 * hist.bin_width_ps == pytest.approx(12_460, abs=5)
    with pytest.raises(FileFormatError, match=r"holds the blocks 0 \(512, 512, 256\)"):
        read(vendor_dir / "seminal_receptacle_FLIM_single_image.sdt", block=1)


def test_a_real_spc_equals_its_text(vendor_dir):
    recording = read(vendor_dir / "test_noise.spc")
    lines = (vendor_dir / "test_noise.asc").read_text().splitlines()
    times = np.array([line.split() for line in lines if line.split()], dtype=int)
    assert recording.n_photons == len(times) == 6114
    np.testing.assert_array_equal(recording.code, times[:, 1])
    assert recording.bin_width_ps == pytest.approx(2.4430455)
    assert lf.histogram(recording).counts.sum() == 6114


def test_truncated_vendor_files(vendor_dir, tmp_path):
    pytest.importorskip("ptufile")
    pytest.importorskip("sdtfile")
    for name, text in [
        ("hazelnut_FLIM_single_image.ptu", "truncated: 6070158 records need"),
        ("seminal_receptacle_FLIM_single_image.sdt", "cannot be read"),
        ("test_noise.spc", "no whole number of 4-byte records"),
    ]:
        image = (vendor_dir / name).read_bytes()
        (tmp_path / name).write_bytes(image[: len(image) // 2 + 1])
        with pytest.raises(FileFormatError, match=text) as caught:
            read(tmp_path / name)
        assert "\n" not in str(caught.value)
        assert str(tmp_path) in str(caught.value)


# --- .ptu and .sdt byte by byte -----------------------------------------------------------


def test_a_ptu_made_by_hand(tmp_path, rng):
    pytest.importorskip("ptufile")
    codes = rng.integers(0, 3000, 500)
    (tmp_path / "x.ptu").write_bytes(ptu_bytes(codes))
    hist = read(tmp_path / "x.ptu")
    assert hist.shape == (1, 1)
    np.testing.assert_array_equal(
        hist.counts[0, 0], np.bincount(codes, minlength=hist.n_codes)[: hist.n_codes]
    )
    assert hist.counts.sum() == 500
    assert hist.bin_width_ps == pytest.approx(16.0)
    assert hist.laser_period_ps == pytest.approx(50_000.0)
    (tmp_path / "x.ptu").write_bytes(ptu_bytes(codes, mode=2))
    with pytest.raises(FileFormatError, match="T2 recording"):
        read(tmp_path / "x.ptu")
    (tmp_path / "x.ptu").write_bytes(ptu_bytes(codes, promised_records=10**12))
    with pytest.raises(FileFormatError, match="truncated: 1000000000000 records need"):
        read(tmp_path / "x.ptu")


def test_an_sdt_made_by_hand(tmp_path, rng):
    pytest.importorskip("sdtfile")
    decays = rng.poisson(20.0, (3, 256))
    (tmp_path / "x.sdt").write_bytes(sdt_bytes(decays))
    hist = read(tmp_path / "x.sdt")
    np.testing.assert_array_equal(hist.counts, decays[None])
    assert hist.bin_width_ps == pytest.approx(5e4 / 256)
    assert hist.settings["module"] == "SPC-130"
    (tmp_path / "x.sdt").write_bytes(sdt_bytes(decays, n_blocks=2))
    with pytest.raises(FileFormatError, match=r"holds the blocks 0 \(3, 256\), 1 \(3, 256\)"):
        read(tmp_path / "x.sdt")
    np.testing.assert_array_equal(read(tmp_path / "x.sdt", block=1).counts, decays[None])


# --- .spc byte by byte ------------------------------------------------------------------


def _spc(path, photons, *, header=0x8000_005F):
    words = [header]
    for adc, channel, macro in photons:
        words.append(adc << 16 | channel << 12 | macro)
        words.append(0xC000_0001)  # an overflow of the macro time, not a photon
    words.append(0x9000_0000)  # a marker, not a photon
    np.array(words, "<u4").tofile(path)
    return path


def test_spc_records(tmp_path):
    path = _spc(tmp_path / "x.spc", [(0, 0, 5), (4095, 2, 6), (1000, 1, 4095)])
    recording = read(path)
    np.testing.assert_array_equal(recording.code, [4095, 0, 3095])
    np.testing.assert_array_equal(recording.pixel, [0, 2, 1])
    assert recording.shape == (1, 3)
    assert recording.bin_width_ps is None
    assert recording.settings["macro_clock_ns"] == 9.5
    path.with_suffix(".set").write_bytes(b"#SP [SP_TAC_TC,F,2.5e-12]")
    assert read(path).bin_width_ps == 2.5
    assert read(path, bin_width_ps=3.0).bin_width_ps == 3.0


def test_spc_files_that_are_none(tmp_path):
    with pytest.raises(FileFormatError, match="does not start with the header"):
        read(_spc(tmp_path / "x.spc", [(1, 1, 1)], header=0x5F))
    with pytest.raises(FileFormatError, match="holds no photon"):
        read(_spc(tmp_path / "x.spc", []))


# --- readers that misbehave -------------------------------------------------------------


def _crash(path):
    os.kill(os.getpid(), signal.SIGSEGV)


def _hang(path):
    time.sleep(60)


def _eat_memory(path):
    return {"x": np.ones(1 << 50, np.uint8)}, {}


def _raise(path):
    raise RuntimeError("line one\nline two")


def _lack(path):
    raise MissingExtraError("reading this needs that: pip install that")


def _take(path, *, n_bytes):
    return {"x": np.zeros(n_bytes, np.uint8)[:1]}, {}


def _work(path, *, factor):
    return {"x": np.arange(3) * factor}, {"size": path.stat().st_size}


@pytest.fixture
def child(tmp_path, monkeypatch):
    """A reader of this file, importable in the child process."""
    source = tmp_path / "misbehaving_readers.py"
    source.write_text(Path(__file__).read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    file = tmp_path / "file"
    file.write_bytes(b"content")
    monkeypatch.setattr(isolation, "TIME_LIMIT_S", 10.0)
    return lambda name, **arguments: isolation.run_isolated(
        f"misbehaving_readers:{name}", file, arguments
    )


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("_crash", "its reader crashed"),
        ("_eat_memory", "cannot be read"),
        ("_raise", r"cannot be read \(line one\)"),
    ],
)
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals and limits")
def test_a_reader_that_fails_is_one_error(child, name, text):
    with pytest.raises(FileFormatError, match=text) as caught:
        child(name)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX limits")
def test_a_reader_of_a_small_file_may_not_take_much(child):
    """Seven bytes may become an empty image, but not 4 GB, however much is free."""
    with pytest.raises(FileFormatError, match="cannot be read"):
        child("_take", n_bytes=4 << 30)
    arrays, _ = child("_take", n_bytes=1 << 30)
    assert arrays["x"].size == 1


def test_a_reader_that_hangs_is_ended(child, monkeypatch):
    monkeypatch.setattr(isolation, "TIME_LIMIT_S", 2.0)
    with pytest.raises(FileFormatError, match="did not finish in 2 s"):
        child("_hang")


def test_what_a_reader_returns_comes_back(child):
    arrays, values = child("_work", factor=2)
    np.testing.assert_array_equal(arrays["x"], [0, 2, 4])
    assert values == {"size": 7}
    with pytest.raises(MissingExtraError, match="pip install that"):
        child("_lack")
